#!/usr/bin/env python3
"""Seconds a sample of two builds in turn, so that a change's cost is known on a noisy machine; or of one build with two sets of
options.

    tests/bench/two_builds.py --base OTHER/trex [--trex build/trex] [--scenes a,b] [--exact 1,0] [--spp 8] [--size 256x256]
                              [--runs 5] [--of all|photons|processors] [--base-options "--a b"] [-- further options of trex render]

The interiors of the shared folder (TREX_SHARED, else ../shared) unless paths are given. Seconds are those of
rendering, photons and filter included, set-up left out; of photons alone (--of photons); or of all processors, set-up included. Each run of one
build is followed by one of the other. `--base-options` are those of the base alone. Prints the median of each and the median of the ratios, new
over base; JSON with --json.
"""
import argparse, json, os, resource, shlex, statistics, subprocess, sys

HERE = os.path.dirname(os.path.abspath(__file__))
ROOT = os.path.dirname(os.path.dirname(HERE))
sys.path.insert(0, HERE)
from quality_bars import ENV, SCENES, SHARED  # noqa: E402


def processors():
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def seconds(trex, scene, exact, options, more):
    path = scene if os.path.sep in scene else os.path.join(SHARED, "scenes/interiors", scene + ".glb")
    command = [trex, "render", path, "-o", os.path.join(options.out, "two_builds.exr"), "--size", options.size, "--spp",
               str(options.spp), "--exact", exact, "--json", "-q", *options.rest, *more]
    if scene in ENV:
        command += ["--env", ENV[scene]]
    before = processors()
    report = json.loads(subprocess.run(command, check=True, capture_output=True).stdout)
    if options.of == "processors":
        return (processors() - before) / report["samples"]
    if options.of == "photons":
        return report["photon_seconds"] / report["samples"]
    return (report["render_seconds"] + report["filter_seconds"]) / report["samples"]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--base", required=True)
    parser.add_argument("--trex", default=os.path.join(ROOT, "build/trex"))
    parser.add_argument("--scenes", default=",".join(SCENES))
    parser.add_argument("--exact", default="1,0")
    parser.add_argument("--spp", type=int, default=8)
    parser.add_argument("--size", default="256x256")
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--of", choices=("all", "photons", "processors"), default="all")
    parser.add_argument("--base-options", default="", type=shlex.split)
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--out", default=os.path.join(ROOT, "build"))
    parser.add_argument("rest", nargs="*")
    options = parser.parse_args()
    rows = []
    for scene in options.scenes.split(","):
        for exact in options.exact.split(","):
            both = [[], []]
            for _ in range(options.runs):
                for times, trex, more in zip(both, (options.base, options.trex), (options.base_options, [])):
                    times.append(seconds(trex, scene, exact, options, more))
            base, new = (statistics.median(times) for times in both)
            ratio = statistics.median(b / a for a, b in zip(*both))
            rows.append({"scene": scene, "exact": exact, "base_seconds": base, "seconds": new, "ratio": ratio})
    if options.json:
        print(json.dumps(rows, indent=1))
        return
    print("| scene | exact | base, ms a sample | new | new over base |\n|---|---|---|---|---|")
    for r in rows:
        print(f"| {r['scene']} | {r['exact']} | {r['base_seconds'] * 1e3:.1f} | {r['seconds'] * 1e3:.1f} | {r['ratio']:.3f} |")


if __name__ == "__main__":
    main()
