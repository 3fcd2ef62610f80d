"""The networks of `malus bench --only networks` in plain PyTorch, float32, 16x256x256, all cores: as installed, and at their best with
the settings that malus makes (inherited from it), in the order of memory that is faster. Definitions: tests/system/plain_networks.py,
plain_transformers.py. With --device cuda: images per second of inference and training of PyTorch eager at its best there (cuDNN's
benchmark, fused Adam, the faster order of memory; TF32 as PyTorch sets it). Prints one JSON list of lines."""

import argparse
import ctypes
import json
import math
import os
import pathlib
import statistics
import subprocess
import sys
import time

LEVERS = ("OPENBLAS_CORETYPE", "ATEN_CPU_CAPABILITY", "LD_LIBRARY_PATH", "OPENBLAS_NUM_THREADS")
NAMES = ("unet", "nafnet-32", "uformer-t", "uformer-s", "restormer")
HALF = ("unet", "nafnet-32")  # those that malus offers bfloat16 for on a GPU
# As src/malus/neural/device_speed: batch and side of the planes; the device is waited for once per block of steps.
WORK = {"inference": (8, 256), "training": (16, 128)}
WARM_UP_STEPS, BLOCKS, BLOCK_SECONDS = 5, 5, 0.15


def networks():
    sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2] / "tests/system"))
    from plain_networks import NAFNet, UNet
    from plain_transformers import Restormer, Uformer
    return dict(zip(NAMES, (UNet, NAFNet, lambda: Uformer(dim=16), Uformer, Restormer)))


def memory(line):
    status = pathlib.Path("/proc/self/status").read_text().split()
    return 1024 * int(status[status.index(line) + 1])


def measure(name, quick, channels_last, tuned):
    import torch

    libc = ctypes.CDLL("libc.so.6")
    if tuned:  # as malus: freed memory is kept (M_MMAP_MAX, M_TRIM_THRESHOLD, M_TOP_PAD)
        for option, value in ((-4, 0), (-1, -1), (-2, 256 << 20)):
            libc.mallopt(option, value)
    torch.set_num_threads(len(os.sched_getaffinity(0)))
    layout = torch.channels_last if channels_last else torch.contiguous_format
    side = 16 if quick else 256
    x = torch.rand(1, 16, side, side).to(memory_format=layout)
    network = networks()[name]().eval().to(memory_format=layout)
    with torch.no_grad():
        network(x)
        libc.malloc_trim(0)
        pathlib.Path("/proc/self/clear_refs").write_text("5")
        before = memory("VmRSS:")
        network(x)
        peak, runs, processor = memory("VmHWM:") - before, [], []
        for _ in range(1 if quick else 3):
            start, processor_start = time.perf_counter(), time.process_time()
            network(x)
            processor.append(time.process_time() - processor_start)
            runs.append(time.perf_counter() - start)
    print(json.dumps({"seconds": statistics.median(runs), "processor": min(processor), "peak": peak}))


def run(name, quick, channels_last, environment, tuned):
    command = [sys.executable, __file__, "--measure", name] + ["--quick"] * quick
    command += ["--channels-last"] * channels_last + ["--tuned"] * tuned
    done = subprocess.run(command, env=environment, capture_output=True, text=True)
    return json.loads(done.stdout) if done.returncode == 0 else None


def steps_per_second(step, device, quick):
    import torch

    def time_of(steps):
        start = time.perf_counter()
        for _ in range(steps):
            step()
        if device == "cuda":
            torch.cuda.synchronize()
        return time.perf_counter() - start

    if quick:
        return 1 / time_of(1)
    time_of(WARM_UP_STEPS)
    steps = max(1, math.ceil(BLOCK_SECONDS / time_of(1)))
    return steps / statistics.median(time_of(steps) for _ in range(BLOCKS))


def inference(network, x, half, device, quick):
    import torch

    network.eval()

    def step():
        with torch.autocast(device, dtype=torch.bfloat16, enabled=half):
            network(x)

    with torch.inference_mode():
        return steps_per_second(step, device, quick)


def training(network, x, half, device, quick):
    import torch
    from torch.nn import functional as F

    network.train()
    target = torch.rand_like(x)
    # One kernel for all weights: the fastest of PyTorch's Adams, on a GPU only.
    adam = torch.optim.Adam(network.parameters(), lr=1e-5, fused=device == "cuda")

    def step():
        adam.zero_grad(set_to_none=True)
        with torch.autocast(device, dtype=torch.bfloat16, enabled=half):
            loss = F.l1_loss(network(x), target)
        loss.backward()
        adam.step()

    return steps_per_second(step, device, quick)


def measure_device(name, device, quick):
    """Images per second by work, precision and order of memory; without those that fail, such as for want of memory."""
    import torch

    torch.backends.cudnn.benchmark = True
    found = []
    for work, function in (("inference", inference), ("training", training)):
        batch, side = (1, 16 if name in HALF else 128) if quick else WORK[work]
        for half in (False, True) if name in HALF else (False,):
            for order, layout in (("channels first", torch.contiguous_format), ("channels last", torch.channels_last)):
                torch.manual_seed(1)
                network = networks()[name]().to(device).to(memory_format=layout)
                x = torch.rand(batch, 16, side, side, device=device).contiguous(memory_format=layout)
                try:
                    rate = batch * function(network, x, half, device, quick)
                except RuntimeError as error:
                    print(f"{name}, {work}, {order}: {error}", file=sys.stderr)
                    continue
                note = f"{batch} x 16 x {side} x {side}, {order}"
                if not half:
                    note += ", TF32" * torch.backends.cudnn.allow_tf32 + " in convolutions" * (
                        torch.backends.cudnn.allow_tf32 and not torch.backends.cuda.matmul.allow_tf32)
                found.append({"work": work, "precision": "bfloat16" if half else "float32", "rate": rate, "note": note})
    print(json.dumps(found))


def device_lines(names, device, quick):
    import torch

    lines = []
    if device == "cuda" and not torch.cuda.is_available():
        return lines
    for name in names:
        command = [sys.executable, __file__, "--measure", name, "--device", device] + ["--quick"] * quick
        done = subprocess.run(command, stdout=subprocess.PIPE, text=True)
        best = {}
        for found in json.loads(done.stdout) if done.returncode == 0 else []:
            key = f"{name}, {found['work']}, {found['precision']}"
            if key not in best or found["rate"] > best[key]["rate"]:
                best[key] = found
        for key, found in best.items():
            lines.append({"name": f"{key}, PyTorch", "value": found["rate"], "unit": "images/s",
                          "note": f"PyTorch {torch.__version__}, {found['note']}", "compared": key})
    return lines


def cpu_lines(names, quick):
    plain, lines = {k: v for k, v in os.environ.items() if k not in LEVERS}, []
    for name in names:
        stock = run(name, quick, False, plain, False)
        tuned = [run(name, quick, layout, dict(os.environ), True) for layout in (False, True)]
        if stock is None or None in tuned:
            continue
        best = min(tuned, key=lambda result: result["processor"])
        note = "malus's settings" + (", channels last" if best is tuned[1] else "")
        for result, label in ((stock, "as installed"), (best, note)):
            label += f"; {result['processor']:.3f} s of processor time"
            lines.append({"name": f"{name}, forward, PyTorch", "value": result["seconds"], "unit": "s", "note": label})
        lines[-1]["compared"] = f"{name}, forward"
        lines.append({"name": f"{name}, memory of a pass, PyTorch", "value": min(r["peak"] for r in tuned) / 1e6, "unit": "MB",
                      "note": "beside the weights, malus's settings"})
    return lines


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--device", choices=("cpu", "cuda"), help="images per second there; cpu: to try that out")
    parser.add_argument("--measure", choices=NAMES)
    parser.add_argument("--network", action="append", help="these only; names that are not known here are left out")
    parser.add_argument("--channels-last", action="store_true")
    parser.add_argument("--tuned", action="store_true")
    arguments = parser.parse_args()
    if arguments.measure and arguments.device:
        return measure_device(arguments.measure, arguments.device, arguments.quick)
    if arguments.measure:
        return measure(arguments.measure, arguments.quick, arguments.channels_last, arguments.tuned)
    names = [name for name in NAMES if name in (arguments.network or NAMES)]
    if arguments.quick:
        names = names[:2]
    try:
        lines = device_lines(names, arguments.device, arguments.quick) if arguments.device else cpu_lines(names, arguments.quick)
    except ImportError:  # no PyTorch: nothing to compare with
        lines = []
    print(json.dumps(lines))


if __name__ == "__main__":
    main()
