"""The networks of `malus bench --only networks` in plain PyTorch, float32, 16x256x256: as installed, and with the settings that
malus makes (inherited from it). Definitions: tests/system/plain_networks.py. Prints one JSON list of lines."""

import argparse
import json
import os
import pathlib
import statistics
import subprocess
import sys
import time

LEVERS = ("OPENBLAS_CORETYPE", "ATEN_CPU_CAPABILITY", "LD_LIBRARY_PATH", "OPENBLAS_NUM_THREADS")


def measure(quick):
    sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2] / "tests/system"))
    import torch
    from plain_networks import NAFNet, UNet

    torch.set_num_threads(len(os.sched_getaffinity(0)))
    side, times = 16 if quick else 256, {}
    x = torch.rand(1, 16, side, side)
    for name, network in (("unet", UNet()), ("nafnet-32", NAFNet())):
        with torch.no_grad():
            network.eval()(x)
            runs = []
            for _ in range(1 if quick else 3):
                start = time.perf_counter()
                network(x)
                runs.append(time.perf_counter() - start)
        times[name] = statistics.median(runs)
    print(json.dumps(times))


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--measure", action="store_true")
    arguments = parser.parse_args()
    if arguments.measure:
        return measure(arguments.quick)
    lines = []
    for label, environment in (("as installed", {k: v for k, v in os.environ.items() if k not in LEVERS}),
                               ("malus's settings", dict(os.environ))):
        command = [sys.executable, __file__, "--measure"] + ["--quick"] * arguments.quick
        done = subprocess.run(command, env=environment, capture_output=True, text=True)
        if done.returncode == 0:
            lines += [{"name": f"{name}, forward, PyTorch", "value": value, "unit": "s", "note": label}
                      for name, value in json.loads(done.stdout).items()]
    print(json.dumps(lines))


if __name__ == "__main__":
    main()
