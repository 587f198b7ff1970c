#!/usr/bin/env python3
"""Prints what the two ways of photons cost and bring (--photon-bounces), as a Markdown table.

Usage: photon_table.py [--trex build/trex] [--spp 64] [--size 256x256] [SCENE...]
Scenes are those of quality_bars.py, from the folder in TREX_SHARED or ../shared.
"""
import argparse
import json
import os
import subprocess
import sys
import tempfile

from quality_bars import ENV, ROOT, SCENES, SHARED


def measure(options, scene, bounces, folder):
    """FLIP and mean ratio against the reference, seconds of photons and of rendering."""
    model = os.path.join(SHARED, "scenes", "interiors", scene + ".glb")
    reference = os.path.join(SHARED, "scenes", "refs", scene + ".exr")
    out = os.path.join(folder, "out.exr")
    env = ["--env", ENV[scene]] if scene in ENV else []
    result = subprocess.run([options.trex, "render", model, "-o", out, "--size", options.size, "--spp",
                             str(options.spp), "--photon-bounces", bounces, "--exact", "0", "--json", "-q", *env],
                            check=True, capture_output=True, text=True)
    summary = json.loads(result.stdout)
    diff = json.loads(subprocess.run([options.trex, "diff", out, reference, "--json"], capture_output=True,
                                     text=True).stdout)
    return diff["flip"], diff["mean_ratio"], summary["photon_seconds"], summary["render_seconds"]


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--trex", default=os.path.join(ROOT, "build", "trex"))
    parser.add_argument("--spp", type=int, default=64)
    parser.add_argument("--size", default="256x256")
    parser.add_argument("scenes", nargs="*", default=SCENES)
    options = parser.parse_args()
    if not os.path.isdir(os.path.join(SHARED, "scenes")):
        sys.exit("photon_table.py: no shared scenes; set TREX_SHARED")
    print("| scene | FLIP voxel, ray | mean ratio | seconds of photons | of rendering |\n|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        for scene in options.scenes:
            voxel, ray = (measure(options, scene, b, folder) for b in ("voxel", "ray"))
            print(f"| {scene} | {voxel[0]:.3f}, {ray[0]:.3f} | {voxel[1]:.3f}, {ray[1]:.3f} | "
                  f"{voxel[2]:.2f}, {ray[2]:.2f} | {voxel[3]:.1f}, {ray[3]:.1f} |", flush=True)


if __name__ == "__main__":
    main()
