#!/usr/bin/env python3
"""Peak memory of renders whose pages do not fit, against --max-memory: planned and actual by part.

    memory_table.py BUNDLE [--trex build/trex] [--limits 350M,500M,1G] [--threads 1,2] [--size 640x360] [--spp 2] [--exact 1]

A row a limit and number of threads: what the estimate gives each part (-v), what pages took of theirs, and the largest resident size of
the process over the limit (bar 1.05)."""
import argparse, json, os, re, subprocess, sys, tempfile

UNITS = {"B": 1, "KiB": 2**10, "MiB": 2**20, "GiB": 2**30}


def planned(text, what):
    """MiB of the line `memory: SIZE WHAT` of -v."""
    found = re.findall(rf"memory: +([\d.]+) (\w+) {what}", text)
    return float(found[-1][0]) * UNITS[found[-1][1]] / 2**20 if found else 0.0


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("bundle")
    parser.add_argument("--trex", default="build/trex")
    parser.add_argument("--limits", default="350M,500M,1G")
    parser.add_argument("--threads", default="1,2")
    parser.add_argument("--size", default="640x360")
    parser.add_argument("--spp", default="2")
    parser.add_argument("--exact", default="1")
    a = parser.parse_args()
    print("| limit | threads | program and rest | paths | pages | of these taken | peak | of the limit |")
    print("|---|---|---|---|---|---|---|---|")
    worst = 0.0
    with tempfile.TemporaryDirectory(prefix="trex-memory-") as folder:
        for limit in a.limits.split(","):
            for threads in a.threads.split(","):
                p = subprocess.run([a.trex, "render", a.bundle, "-o", os.path.join(folder, "a.exr"), "--size", a.size, "--spp", a.spp,
                                    "--exact", a.exact, "--device", "none", "--denoise", "off", "--max-memory", limit, "--threads",
                                    threads, "--json", "-v"], capture_output=True, text=True)
                if p.returncode != 0:
                    print(f"| {limit} | {threads} | refused: {p.stderr.strip().splitlines()[-1]} |")
                    continue
                r = json.loads(p.stdout)
                allowed, peak = planned(p.stderr, "allowed"), r["peak_resident_bytes"] / 2**20
                worst = max(worst, peak / allowed)
                print(f"| {limit} | {threads} | {planned(p.stderr, 'rendering'):.0f} MiB | {r['ray_memory_bytes'] / 2**20:.0f} MiB | "
                      f"{r['page_cache_bytes'] / 2**20:.0f} MiB | {r['page_peak_bytes'] / 2**20:.0f} MiB | {peak:.0f} MiB | "
                      f"{peak / allowed:.2f} |", flush=True)
    print(f"at most {worst:.2f} of the limit")
    return 0 if worst <= 1.05 else 1


if __name__ == "__main__":
    sys.exit(main())
