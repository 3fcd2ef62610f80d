"""The networks of `malus bench --only networks` in plain PyTorch, float32, 16x256x256, all cores: as installed, and at their best with
the settings that malus makes (inherited from it), in the order of memory that is faster. Definitions: tests/system/plain_networks.py,
plain_transformers.py. Prints one JSON list of lines."""

import argparse
import ctypes
import json
import os
import pathlib
import statistics
import subprocess
import sys
import time

LEVERS = ("OPENBLAS_CORETYPE", "ATEN_CPU_CAPABILITY", "LD_LIBRARY_PATH", "OPENBLAS_NUM_THREADS")
NAMES = ("unet", "nafnet-32", "uformer-t", "uformer-s", "restormer")


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


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--measure", choices=NAMES)
    parser.add_argument("--channels-last", action="store_true")
    parser.add_argument("--tuned", action="store_true")
    arguments = parser.parse_args()
    if arguments.measure:
        return measure(arguments.measure, arguments.quick, arguments.channels_last, arguments.tuned)
    plain, lines = {k: v for k, v in os.environ.items() if k not in LEVERS}, []
    for name in NAMES[:2] if arguments.quick else NAMES:
        stock = run(name, arguments.quick, False, plain, False)
        tuned = [run(name, arguments.quick, layout, dict(os.environ), True) for layout in (False, True)]
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
    print(json.dumps(lines))


if __name__ == "__main__":
    main()
