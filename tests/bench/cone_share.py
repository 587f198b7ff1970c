#!/usr/bin/env python3
"""What gathering by cones is worth: FLIP and processor seconds of guesses by rays into cached light, by cones, and by half of both, for the
same samples; and FLIP by cones in the time of the rays, were there a device of its own whose cones took no time.

    tests/bench/cone_share.py [--trex build/trex] [--scenes a,b] [--spp 16] [--runs 3] [--json] [-- further options of trex render]

Each round renders every variant in turn, with a seed of its own; medians. Needs the shared folder and its Python environment, as
quality_bars.py, and what `trex doctor --measure` kept. Processor seconds are those of all threads, the device's too where it is the
processor's own cores; of samples alone (of four times as many less as many, so that set-up, denoiser and first photons are left out). One
thread, so that seconds of gathering by the C++ tracer are a part of them. The second table has what the rest of the paths costs, in rays of
the record: the constants of src/session/cone_share.cpp.
"""
import argparse, json, os, resource, statistics, subprocess, sys

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path.insert(0, HERE)
from quality_bars import ROOT, SCENES, Runner  # noqa: E402

RAYS, CONES = "rays, no device", "cones, no device"
VARIANTS = [(RAYS, "none", "ray"), ("rays", "auto", "0"), ("half", "auto", "0.5"), ("cones", "auto", "1"), (CONES, "none", "cone")]
MORE = 4


def record(trex):
    """Processor seconds of a ray."""
    doctor = json.loads(subprocess.run([trex, "doctor", "--json"], check=True, capture_output=True).stdout)
    if not doctor["measured"]:
        sys.exit("nothing is known of this machine: trex doctor --measure")
    return doctor["threads"] * doctor["measured"]["devices"][0]["times"]["rays"]["seconds_per_unit"]


class Table:
    def __init__(self, options):
        self.options, self.run = options, Runner(options)

    def render(self, scene, variant, spp, seed):
        _, device, guess = variant
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        picture, report = self.run.render(scene, "cone-share", ["--exact", "0", "--spp", str(spp), "--seed", str(seed),
                                                                "--device", device, "--guess", guess, "--threads", "1"])
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, picture, report

    def flip(self, scene, variant, spp):
        return statistics.median(self.run.score(scene, self.render(scene, variant, spp, seed)[1])["flip"]
                                 for seed in range(self.options.runs))

    def rows(self, scene):
        spp, found = self.options.spp, {v[0]: [] for v in VARIANTS}
        for seed in range(self.options.runs):
            for variant in VARIANTS:
                less, picture, report = self.render(scene, variant, spp, seed)
                flip = self.run.score(scene, picture)["flip"]
                more, _, longer = self.render(scene, variant, MORE * spp, seed)
                gathered = report["gathered_by_device"] + report["gathered_by_cpu"]
                samples = (MORE - 1) * spp
                found[variant[0]].append({"flip": flip, "seconds": (more - less) / samples,
                                          "cones": (longer["g_rays"] - report["g_rays"]) / samples,
                                          "gathering": (longer["gather_seconds"] - report["gather_seconds"])
                                          / (longer["render_seconds"] - report["render_seconds"]),
                                          "device": report["gathered_by_device"] / max(gathered, 1)})
        return [{"scene": scene, "what": name, **{k: statistics.median(r[k] for r in rows) for k in rows[0]}}
                for name, rows in found.items()]

    def costs(self, scene, rows, ray):
        """What the processors do for a cone's path, a sample, without the cone; the rest in its terms."""
        of = {r["what"]: r for r in rows}
        path = of[CONES]["seconds"] * (1 - of[CONES]["gathering"])
        samples = max(1, round(self.options.spp * of[RAYS]["seconds"] / path))
        return {"scene": scene, "path": path / of[CONES]["cones"] / ray,
                "gather": (of[RAYS]["seconds"] - path) / of[CONES]["cones"] / ray, "samples": samples,
                "rays": of[RAYS]["flip"], "cones": self.flip(scene, VARIANTS[-1], samples)}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--trex", default=os.path.join(ROOT, "build/trex"))
    parser.add_argument("--scenes", default=",".join(SCENES))
    parser.add_argument("--spp", type=int, default=16)
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--out", default=os.path.join(ROOT, "build/quality"))
    parser.add_argument("rest", nargs="*")
    options = parser.parse_args()
    table, rows, costs = Table(options), [], []
    ray = record(options.trex)
    for scene in options.scenes.split(","):
        of = table.rows(scene)
        rows += of
        costs.append(table.costs(scene, of, ray))
        print(json.dumps(costs[-1]), file=sys.stderr, flush=True)
    if options.json:
        print(json.dumps({"rows": rows, "costs": costs}, indent=1))
        return
    print("| scene | gathered by | FLIP | processors, ms a sample | of rays without a device | gathered by the device |\n|---|---|---|---|---|---|")
    for r in rows:
        base = next(b["seconds"] for b in rows if b["scene"] == r["scene"])
        print(f"| {r['scene']} | {r['what']} | {r['flip']:.3f} | {1e3 * r['seconds']:.0f} | {r['seconds'] / base:.2f} |"
              f" {r['device']:.0%} |")
    print(f"\n| scene | rays a cone's path costs | more for a ray into cached light | FLIP by rays, {options.spp} samples |"
          " by cones in the same time, a device of its own |\n|---|---|---|---|---|")
    for c in costs:
        print(f"| {c['scene']} | {c['path']:.1f} | {c['gather']:.1f} | {c['rays']:.3f} | {c['cones']:.3f} ({c['samples']} samples) |")


if __name__ == "__main__":
    main()
