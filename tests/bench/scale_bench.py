#!/usr/bin/env python3
"""Bakes and renders generated models out of core; prints the table of docs/figures.md.

Usage: scale_bench.py [--triangles 1e7,1e8] [--model assembly] [--max-memory 8G] [--size 1280x720] [--spp 4]
                      [--few 0.05] [--voxels] [--folder .] [--picture FILE] [--keep]
A row a count: rates of sorting and clustering, bytes a triangle, largest resident size of bake and render (each its own
process), and, with --few, the same picture with a cache of that share of the pages: equal bytes or not, and how long.
"""
import argparse, json, os, subprocess, sys, time

HERE = os.path.dirname(os.path.abspath(__file__))


def run(*command):
    """The JSON that a command prints, its seconds, and its largest resident size in bytes."""
    start = time.monotonic()
    process = subprocess.Popen([str(c) for c in command], stdout=subprocess.PIPE, text=True)
    out = process.stdout.read()
    _, status, usage = os.wait4(process.pid, 0)
    if status != 0:
        sys.exit(f"{' '.join(map(str, command))}: failed")
    return json.loads(out), time.monotonic() - start, usage.ru_maxrss * 1024


def row(a, count):
    bundle = os.path.join(a.folder, f"scale-{count}.trex")
    name = f"synth:{a.model}?triangles={count}"
    voxels = [] if a.voxels else ["--no-voxels"]
    bake, seconds, bake_peak = run(a.trex, "bake", name, "--stream", "-o", bundle, "--json", "--max-memory",
                                   a.max_memory, *voxels)
    n = bake["triangles"]
    picture = a.picture or os.path.join(a.folder, "scale.exr")
    common = ["--size", a.size, "--spp", a.spp, "--max-memory", a.max_memory, "--json", "--device", "none", "--exact", "0"]
    render, _, render_peak = run(a.trex, "render", bundle, "-o", picture, *common)
    out = {"triangles": n, "sort_m_per_second": n / bake["sort_seconds"] / 1e6,
           "cluster_m_per_second": n / bake["mesh_build_seconds"] / 1e6,
           "mesh_m_per_second": n / (bake["sort_seconds"] + bake["mesh_build_seconds"]) / 1e6,
           "voxel_seconds": bake["voxel_build_seconds"], "bake_seconds": seconds,
           "bake_peak_gib": bake_peak / 2**30, "disk_bytes_per_triangle": bake["hccmesh_bytes"] / n,
           "memory_bytes_per_triangle": (render["mesh_bytes"] + render["top_level_bytes"]) / n,
           "render_seconds": render["render_seconds"], "render_peak_gib": render_peak / 2**30,
           "pages": render["pages"], "page_loads": render["page_loads"]}
    if a.few > 0:
        other = os.path.join(a.folder, "scale-few" + os.path.splitext(picture)[1])
        cache = int(render["mesh_bytes"] * a.few)
        few, _, peak = run(a.trex, "render", bundle, "-o", other, *common, "--cache", cache)
        with open(picture, "rb") as x, open(other, "rb") as y:
            same = x.read() == y.read()
        out.update(few_render_seconds=few["render_seconds"], few_page_loads=few["page_loads"],
                   few_peak_gib=peak / 2**30, few_same_bytes=same)
        os.remove(other)
    if not a.keep:
        os.remove(bundle)
    return out


def main():
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("--trex", default=os.path.join(HERE, "../../build/trex"))
    p.add_argument("--triangles", default="1e7,1e8")
    p.add_argument("--model", default="assembly")
    p.add_argument("--max-memory", default="8G")
    p.add_argument("--size", default="1280x720")
    p.add_argument("--spp", default="4")
    p.add_argument("--few", type=float, default=0.0)
    p.add_argument("--voxels", action="store_true")
    p.add_argument("--folder", default=".")
    p.add_argument("--picture")
    p.add_argument("--keep", action="store_true")
    a = p.parse_args()
    for count in a.triangles.split(","):
        print(json.dumps(row(a, count), indent=2), flush=True)


if __name__ == "__main__":
    main()
