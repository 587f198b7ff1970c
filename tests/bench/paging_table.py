#!/usr/bin/env python3
"""What a limit of device memory does to a picture: a table of FLIP against the unlimited render.

Usage: paging_table.py [--trex build/trex] [--size 256x256] [--spp 16] [--guess cone] SCENE

Renders without a limit, then with 100 %, 50 %, 25 %, 10 %, 5 % and 1 % of the device memory that
took, and with the least that is not refused. Pictures and summaries stay in --keep DIR.
"""
import argparse
import json
import os
import re
import subprocess
import tempfile


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scene")
    parser.add_argument("--trex", default="build/trex")
    parser.add_argument("--size", default="256x256")
    parser.add_argument("--spp", default="16")
    parser.add_argument("--guess", default="cone")
    parser.add_argument("--limit", action="append", default=[], help="a limit besides, such as 64M")
    parser.add_argument("--keep")
    a = parser.parse_args()
    folder = a.keep or tempfile.mkdtemp(prefix="trex-paging-")
    os.makedirs(folder, exist_ok=True)

    def render(name, *limit):
        out = os.path.join(folder, name + ".exr")
        return out, subprocess.run([a.trex, "render", a.scene, "-o", out, "--size", a.size, "--spp", a.spp,
                                    "--guess", a.guess, "--exact", "0", "--json", *map(str, limit)],
                                   capture_output=True, text=True)

    def row(name, limit):
        out, result = render(name, "--max-gpu-memory", limit)
        if result.returncode != 0:
            print(f"| {name} | refused: {result.stderr.strip().splitlines()[-1]} |")
            return
        s = json.loads(result.stdout)
        diff = subprocess.run([a.trex, "diff", out, whole, "--json"], capture_output=True, text=True)
        d = json.loads(diff.stdout)
        pages = f"{s['voxel_page_slots']} of {s['voxel_pages']}" if "voxel_pages" in s else "all"
        missed = s.get("voxel_missed_reads", 0) / max(1, s["g_rays"])
        print(f"| {name} | {s['device_bytes'] / 2**20:.1f} | {pages} | {s['render_seconds']:.2f} | {missed:.3f} | "
              f"{s.get('voxel_page_loads', 0)} | {d['flip']:.4f} | {d['mean_ratio']:.4f} |", flush=True)

    whole, result = render("unlimited")
    result.check_returncode()
    s = json.loads(result.stdout)
    full = s["device_bytes"]
    print("| limit | MiB used | pages at a time | seconds | missed reads a cone | pages loaded | FLIP | mean |")
    print("|---|---|---|---|---|---|---|---|")
    print(f"| none | {full / 2**20:.1f} | all | {s['render_seconds']:.2f} | | | | |", flush=True)
    for limit in a.limit:
        row(limit, limit)
    for percent in (100, 50, 25, 10, 5, 1):
        row(f"{percent} %", full * percent // 100)
    refusal = render("refused", "--max-gpu-memory", "4K")[1].stderr
    least = re.search(r"need (\d+) bytes", refusal)
    if least:
        row("the least", int(least.group(1)))


if __name__ == "__main__":
    main()
