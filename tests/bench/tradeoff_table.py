#!/usr/bin/env python3
"""Prints the tables of docs/tradeoff.md from the JSON of `trex bench tradeoff`.

    tests/bench/tradeoff_table.py report.json [--at 1,8,60]

A figure is that of the last point that is not later than the second asked for, with a tenth of grace.
"""
import argparse, json


def at(points, seconds):
    early = [p for p in points if p["seconds"] <= 1.1 * seconds]
    return early[-1] if early else None


def cell(point, key, digits):
    return "-" if point is None else f"{point[key]:.{digits}f}"


def table(header, rows):
    print(f"\n| {' | '.join(header)} |\n|{'---|' * len(header)}")
    for row in rows:
        print(f"| {' | '.join(row)} |")


def name(run):
    share = run.get("exact")
    return run["name"] if share is None else f"exact {share}" if isinstance(share, str) else f"exact {share:g}"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("report")
    parser.add_argument("--at", default="1,8,60")
    options = parser.parse_args()
    seconds = [float(x) for x in options.at.split(",")]
    with open(options.report) as f:
        report = json.load(f)
    curves = [(s, r) for s in report["scenes"] for r in s["runs"] + s.get("peers", [])]
    for key, digits in (("flip", 3), ("relmse", 4)):
        table(["scene", "", *(f"{key} after {t:g} s" for t in seconds), *(["slope"] if key == "relmse" else [])],
              [[s["name"], name(r), *(cell(at(r["points"], t), key, digits) for t in seconds),
                *([f"{r['slope']:.2f}" if r.get("slope") is not None else "-"] if key == "relmse" else [])]
               for s, r in curves])
    last = [(s, r) for s in report["scenes"] for r in s["runs"]]
    table(["scene", "", "mean ratio at the end", "c_rays", "shadow_rays", "cache_reads", "photons"],
          [[s["name"], name(r), cell(r["points"][-1], "mean_ratio", 4),
            *(f"{r['rays'][k + '_share']:.2f}" for k in ("c_ray", "shadow_ray", "cache_read")),
            f"{r['photons']:.3g}"] for s, r in last])
    table(["scene", "import", "mesh", "voxels"],
          [[s["name"], *(f"{s['setup'][k + '_seconds']:.2f}" for k in ("import", "mesh_build", "voxel_build"))]
           for s in report["scenes"]])


if __name__ == "__main__":
    main()
