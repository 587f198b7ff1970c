#!/usr/bin/env python3
"""Prints the seconds a whole small render takes: assets/cornell.glb, 64x64, one sample, median of 9 runs.

    tests/bench/start_bench.py [--trex build/trex] [--runs 9]

The first run of all may also compile shaders, which the driver then keeps; it is listed apart.
"""
import argparse, json, os, statistics, subprocess, tempfile, time

ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
parser.add_argument("--trex", default=os.path.join(ROOT, "build/trex"))
parser.add_argument("--runs", type=int, default=9)
options = parser.parse_args()


def run(arguments):
    start = time.perf_counter()
    subprocess.run([options.trex, *arguments], check=True, capture_output=True)
    return time.perf_counter() - start


with tempfile.TemporaryDirectory() as folder:
    render = ["render", os.path.join(ROOT, "assets/cornell.glb"), "-o", os.path.join(folder, "a.png"),
              "--size", "64x64", "--spp", "1", "-q"]
    first = run(render)
    report = {"first_seconds": first}
    for name, arguments in (("default", render), ("device_none", [*render, "--device", "none"]),
                            ("exact", [*render, "--exact", "1"]), ("version_only", ["--version"])):
        report[name + "_seconds"] = statistics.median(run(arguments) for _ in range(options.runs))
    print(json.dumps({k: round(v, 3) for k, v in report.items()}))
