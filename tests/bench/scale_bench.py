#!/usr/bin/env python3
"""Bakes and renders generated models out of core; prints the tables of docs/figures.md.

Usage: scale_bench.py [--triangles 1e7,1e8] [--model assembly] [--max-memory 8G] [--size 1280x720] [--spp 4] [--ways whole,few,demand]
                      [--few 0.05] [--demand 1] [--base OTHER/trex] [--voxels] [--folder .] [--picture FILE] [--keep]
A document a count: rates of sorting and clustering, bytes a triangle, and of each render, a process of its own, seconds until
each pixel had a sample and until the end, of the clock and of processors, pages that were loaded, major faults and the largest
resident size. Ways: "whole" may have all memory; "few" has a cache of that share of the pages, so that rays wait for pages; "demand"
has that cache and threads that wait for pages, for --demand samples. Whether pictures of as many samples as the first have its bytes is
said. --base: "whole" and "demand" of another build, too. A bundle that --keep left is taken as it is.
"""
import argparse, json, os, subprocess, sys, time

HERE = os.path.dirname(os.path.abspath(__file__))


def run(*command):
    """The JSON that a command prints, its seconds, and what it used."""
    start = time.monotonic()
    process = subprocess.Popen([str(c) for c in command], stdout=subprocess.PIPE, text=True)
    out = process.stdout.read()
    _, status, usage = os.wait4(process.pid, 0)
    if status != 0:
        sys.exit(f"{' '.join(map(str, command))}: failed")
    return json.loads(out), time.monotonic() - start, usage


def bake(a, count, bundle):
    name = f"synth:{a.model}?triangles={count}"
    voxels = [] if a.voxels else ["--no-voxels"]
    made, seconds, used = run(a.trex, "bake", name, "--stream", "-o", bundle, "--json", "--max-memory", a.max_memory, *voxels)
    n = made["triangles"]
    return {"sort_m_per_second": n / made["sort_seconds"] / 1e6,
            "cluster_m_per_second": n / made["mesh_build_seconds"] / 1e6,
            "mesh_m_per_second": n / (made["sort_seconds"] + made["mesh_build_seconds"]) / 1e6,
            "voxel_seconds": made["voxel_build_seconds"], "bake_seconds": seconds,
            "bake_processor_seconds": used.ru_utime + used.ru_stime,
            "bake_peak_gib": used.ru_maxrss / 2**20, "disk_bytes_per_triangle": made["hccmesh_bytes"] / n}


def render(a, trex, bundle, picture, spp, *more):
    """What `trex render` says of it, and its process."""
    said, seconds, used = run(trex, "render", bundle, "-o", picture, "--size", a.size, "--spp", spp, "--max-memory", a.max_memory,
                              "--json", "--device", "none", "--denoise", "off", *more)
    return {"samples": said["samples"], "first_picture_seconds": said.get("first_picture_seconds"),
            "render_seconds": said["render_seconds"], "process_seconds": seconds, "user_seconds": used.ru_utime,
            "system_seconds": used.ru_stime, "major_faults": used.ru_majflt, "peak_gib": used.ru_maxrss / 2**20,
            "page_loads": said["page_loads"], "page_cache_gib": said["page_cache_bytes"] / 2**30,
            "ray_memory_gib": said["ray_memory_bytes"] / 2**30, "waiting_seconds": said.get("waiting_thread_seconds", 0.0)}


def bytes_of(file):
    with open(file, "rb") as f:
        return f.read()


def rows(a, bundle, out):
    """Renders of all ways and builds; a way's samples may be fewer."""
    picture = a.picture or os.path.join(a.folder, "scale.exr")
    other = os.path.join(a.folder, "scale-other" + os.path.splitext(picture)[1])
    said = run(a.trex, "render", bundle, "-o", other, "--size", "8x8", "--spp", 1, "--device", "none", "--json", *a.more)[0]
    pages = said["mesh_bytes"]
    out.update(triangles=said["unique_triangles"], pages=said["pages"],
               memory_bytes_per_triangle=(pages + said["top_level_bytes"]) / said["unique_triangles"])
    first = True
    for way in a.ways.split(","):
        for trex in (a.trex, a.base) if a.base and way != "few" else (a.trex,):
            more = list(a.more)
            if way != "whole":
                more += ["--cache", int(pages * a.few)] + (["--ray-memory", "off"] if way == "demand" else [])
            spp = a.demand if way == "demand" else a.spp
            name = way + (" of base" if trex != a.trex else "")
            out[name] = render(a, trex, bundle, picture if first else other, spp, *more)
            if not first and str(spp) == str(a.spp):
                out[name]["same_bytes"] = bytes_of(picture) == bytes_of(other)
            first = False
            print(f"{name}: {json.dumps(out[name])}", file=sys.stderr, flush=True)
    if os.path.exists(other):
        os.remove(other)


def main():
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("--trex", default=os.path.join(HERE, "../../build/trex"))
    p.add_argument("--triangles", default="1e7,1e8")
    p.add_argument("--model", default="assembly")
    p.add_argument("--max-memory", default="8G")
    p.add_argument("--size", default="1280x720")
    p.add_argument("--spp", default="4")
    p.add_argument("--few", type=float, default=0.05)
    p.add_argument("--demand", type=int, default=1)
    p.add_argument("--ways", default="whole")
    p.add_argument("--base")
    p.add_argument("--voxels", action="store_true")
    p.add_argument("--folder", default=".")
    p.add_argument("--picture")
    p.add_argument("--keep", action="store_true")
    a = p.parse_args()
    a.more = ["--exact", 0 if a.voxels else 1]
    for count in a.triangles.split(","):
        bundle = os.path.join(a.folder, f"scale-{count}.trex")
        out = {} if os.path.exists(bundle) else bake(a, count, bundle)
        rows(a, bundle, out)
        print(json.dumps(out, indent=2), flush=True)
        if not a.keep:
            os.remove(bundle)


if __name__ == "__main__":
    main()
