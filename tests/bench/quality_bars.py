#!/usr/bin/env python3
"""Prints the picture-quality figures of the README: exact mode against references of another renderer,
early quality, bias of the guess, consistency of the hybrid, what the filter does to the mean.

    tests/bench/quality_bars.py [--trex build/trex] [--only early,first,few,filter,denoisers,bias,exact,consistent,auto,equal,error] [--scenes a,b]
                                [--against OTHER_TREX] [--runs 5] [--seconds 40] [--error 0.01] [--out FOLDER]
                                [-- further options of trex render]

Needs the folder of shared scenes and references (TREX_SHARED, else ../shared) and its Python
environment: peers/setup.sh makes it and prints the interpreter to run this with. One JSON line a
measurement, then a table. Pictures stay in FOLDER (default: build/quality).
"""
import argparse, importlib.util, json, os, resource, statistics, subprocess, sys

HERE = os.path.dirname(os.path.abspath(__file__))
ROOT = os.path.dirname(os.path.dirname(HERE))
SHARED = os.environ.get("TREX_SHARED", os.path.join(os.path.dirname(ROOT), "shared"))
ENV = {"classroom": "0.6,0.75,1.0", "living-room": "3,3.75,5"}
BOUNCES = "16"  # as many as the references have
SCENES = ["cornell", "veach-bidir", "veach-ajar", "staircase2", "classroom", "living-room", "sponza"]


def quality_module():
    path = os.path.join(SHARED, "peers", "quality.py")
    if not os.path.exists(path):
        sys.exit(f"skipped: no {path}; set TREX_SHARED")
    spec = importlib.util.spec_from_file_location("quality", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


class Runner:
    def __init__(self, options):
        self.options = options
        self.quality = quality_module()
        os.makedirs(options.out, exist_ok=True)

    def render(self, scene, name, arguments, trex=None):
        out = os.path.join(self.options.out, f"{scene}-{name}.exr")
        command = [trex or self.options.trex, "render", os.path.join(SHARED, "scenes/interiors", scene + ".glb"),
                   "-o", out, "--size", "256x256", "--max-bounces", BOUNCES, "--json", "-q", *arguments, *self.options.rest]
        if scene in ENV:
            command += ["--env", ENV[scene]]
        report = json.loads(subprocess.run(command, check=True, capture_output=True).stdout)
        return out, report

    def score(self, scene, picture):
        refs = os.path.join(SHARED, "scenes/refs")
        read = self.quality.read
        clean = os.path.join(refs, scene + ".clean.exr")
        return self.quality.quality(read(os.path.join(refs, scene + ".exr")), read(picture),
                                    read(clean) if os.path.exists(clean) else None)

    def measure(self, scene, name, arguments, runs=1):
        """Median figures of several seeds."""
        rows = []
        for seed in range(runs):
            picture, report = self.render(scene, name, [*arguments, "--seed", str(seed)])
            rows.append({**self.score(scene, picture), "samples": report["samples"],
                         "render_seconds": report["render_seconds"] + report["filter_seconds"],
                         "nonfinite_samples": report["nonfinite_samples"]})
        row = {k: statistics.median(r[k] for r in rows) for k in rows[0]}
        print(json.dumps({"scene": scene, "what": name, **row}), flush=True)
        return row


def early(run):
    rows = []
    for scene in run.options.scenes:
        guess = run.measure(scene, "exact0-1s", ["--exact", "0", "--time", "1"], run.options.runs)
        exact = run.measure(scene, "exact1-5s", ["--exact", "1", "--time", "5"], run.options.runs)
        rows.append((scene, f"{guess['flip']:.3f}", f"{exact['flip']:.3f}",
                     "yes" if guess["flip"] < exact["flip"] else "no"))
    return ("scene", "FLIP, guess 1 s", "FLIP, exact 5 s", "guess ahead"), rows


def first(run):
    """FLIP after half a second, of two builds in turn where there is another to compare with."""
    builds = [b for b in (run.options.against, run.options.trex) if b]
    rows, all_means = [], [[] for _ in builds]
    for scene in run.options.scenes:
        scores = [[] for _ in builds]
        for seed in range(run.options.runs):
            for which, build in enumerate(builds):
                arguments = ["--exact", "0", "--time", "0.5", "--seed", str(seed)]
                picture, _ = run.render(scene, f"first-{which}", arguments, build)
                scores[which].append(run.score(scene, picture)["flip"])
        means = [statistics.mean(s) for s in scores]
        for every, mean in zip(all_means, means):
            every.append(mean)
        rows.append((scene, *(f"{m:.3f}" for m in means), f"{means[-1] / means[0] - 1:+.0%}"))
    means = [statistics.mean(every) for every in all_means]
    rows.append(("mean", *(f"{m:.3f}" for m in means), f"{means[-1] / means[0] - 1:+.0%}"))
    return ("scene", *(f"FLIP after 0.5 s, {b}" for b in builds), "change"), rows


def few(run):
    """FLIP after a few samples, of two builds in turn where there is another to compare with: means of the seeds."""
    builds = [b for b in (run.options.against, run.options.trex) if b]
    counts = ("1", "2", "4", "8")
    rows, ratios = [], [[] for _ in counts]
    for scene in run.options.scenes:
        row = [scene]
        for count, every in zip(counts, ratios):
            scores = [[] for _ in builds]
            for seed in range(run.options.runs):
                for which, build in enumerate(builds):
                    arguments = ["--exact", "0", "--spp", count, "--seed", str(seed)]
                    picture, _ = run.render(scene, f"few-{which}", arguments, build)
                    scores[which].append(run.score(scene, picture)["flip"])
            means = [statistics.mean(s) for s in scores]
            every.append(means[-1] / means[0])
            row.append(" ".join(f"{m:.3f}" for m in means))
        print(json.dumps({"scene": scene, "what": "few", "flip": row[1:]}), flush=True)
        rows.append(row)
    if len(builds) > 1:
        rows.append(["new over other, geometric mean", *(f"{statistics.geometric_mean(every):.3f}" for every in ratios)])
    return ("scene", *(f"FLIP after {c}: {', '.join(builds)}" for c in counts)), rows


def filtered(run):
    """Mean of the filtered picture over that of the unfiltered one, for the same samples."""
    rows, counts = [], ("1", "2", "4", "16")
    for scene in run.options.scenes:
        ratios = []
        for count in counts:
            means = []
            for how in ("filter", "off"):
                arguments = ["--exact", "0", "--spp", count, "--denoise", how, "--device", "none"]
                picture, _ = run.render(scene, f"filter-{how}", arguments)
                means.append(run.quality.read(picture).mean())
            ratios.append(means[0] / means[1])
        rows.append((scene, *(f"{r:.4f}" for r in ratios)))
    return ("scene", *(f"filtered over unfiltered mean, {c} samples" for c in counts)), rows


def denoisers(run):
    """FLIP of the denoisers for the same samples, and what they take. The library's quick way is that of a short time."""
    rows, means = [], {}
    for scene in run.options.scenes:
        row = [scene]
        for count in ("1", "16"):
            for how in ("off", "filter", "oidn"):
                arguments = ["--exact", "0", "--spp", count, "--denoise", how, "--device", "none"]
                picture, report = run.render(scene, f"denoise-{how}", arguments)
                score = run.score(scene, picture)
                means.setdefault((count, how), []).append(score["flip"])
                row.append(f"{score['flip']:.3f} ({report['filter_seconds']:.2f} s)")
        rows.append(row)
    rows.append(["mean", *(f"{statistics.mean(means[c, h]):.3f}" for c in ("1", "16") for h in ("off", "filter", "oidn"))])
    return ("scene", *(f"{h}, {c}" for c in ("1 sample", "16") for h in ("off", "filter", "oidn"))), rows


def bias(run):
    rows = []
    for scene in run.options.scenes:
        r = run.measure(scene, "exact0-converged", ["--exact", "0", "--time", run.options.seconds])
        rows.append((scene, f"{r['flip']:.3f}", f"{r['mean_ratio']:.4f}", f"{r['relmse']:.4f}",
                     "yes" if r["flip"] <= 0.10 else "no"))
    return ("scene", "FLIP, guess converged", "mean ratio", "relMSE", "<= 0.10"), rows


def exact(run):
    rows = []
    for scene in run.options.scenes:
        r = run.measure(scene, "exact1-converged", ["--exact", "1", "--time", run.options.seconds])
        rows.append((scene, f"{r['flip']:.3f}", f"{r['mean_ratio']:.4f}", f"{r['relmse']:.4f}"))
    return ("scene", "FLIP, exact converged", "mean ratio", "relMSE"), rows


def auto(run):
    """`--exact auto` against fixed shares, in turn, after --seconds."""
    rows = []
    for scene in run.options.scenes:
        row = [scene]
        for share in ("0", "0.25", "1", "auto"):
            r = run.measure(scene, f"auto-{share}", ["--exact", share, "--time", run.options.seconds], run.options.runs)
            row.append(f"{r['flip']:.3f} {r['relmse']:.4f} {r['mean_ratio']:.4f}")
        rows.append(row)
    return ("scene", *(f"FLIP, relMSE, mean ratio, exact {s}" for s in ("0", "0.25", "1", "auto"))), rows


def equal(run):
    """`--exact auto` over `--exact 0` for the same samples: error, rays between surfaces, processor time. Medians of the seeds' ratios."""
    rows, counts = [], ("1", "2", "4", "16", "64")
    for scene in run.options.scenes:
        row = [scene]
        for count in counts:
            ratios = []
            for seed in range(run.options.runs):
                pair = []
                for share in ("0", "auto"):
                    before = resource.getrusage(resource.RUSAGE_CHILDREN)
                    picture, report = run.render(scene, f"equal-{share}", ["--exact", share, "--spp", count, "--seed", str(seed)])
                    after = resource.getrusage(resource.RUSAGE_CHILDREN)
                    score = run.score(scene, picture)
                    pair.append((score["flip"], score["relmse"], report["c_rays"] + report["shadow_rays"],
                                 after.ru_utime - before.ru_utime, report["exact_share"]))
                ratios.append([b / a for a, b in zip(pair[0][:4], pair[1][:4])] + [pair[1][4], pair[0][0]])
                print(json.dumps({"scene": scene, "what": "equal", "samples": int(count), "seed": seed, "flip_of_guess": pair[0][0],
                                  **dict(zip(("flip", "relmse", "rays", "user_seconds", "exact_share"), ratios[-1]))}), flush=True)
            middle = [statistics.median(column) for column in zip(*ratios)]
            row.append(" ".join(f"{x:.2f}" for x in middle[:4]))
        rows.append(row)
    return ("scene", *(f"FLIP, relMSE, rays, processor time, {c} samples" for c in counts)), rows


def reference_noise(run, scene):
    """The part of relMSE that is the reference's own noise, the largest 0.1 % left out as in relmse."""
    import numpy
    refs = os.path.join(SHARED, "scenes/refs")
    picture, variance = (run.quality.read(os.path.join(refs, scene + end)) for end in (".exr", ".var.exr"))
    terms = numpy.sort((variance / (picture ** 2 + 0.01 * picture.mean() ** 2)).ravel())
    return terms[:-max(1, int(len(terms) * 0.001))].mean()


def against_denoised(run, scene, picture):
    """relMSE against the denoised reference, the largest 0.1 % left out: where the reference's own noise is as large as the error."""
    import numpy
    clean = run.quality.read(os.path.join(SHARED, "scenes/refs", scene + ".clean.exr"))
    terms = numpy.sort(((run.quality.read(picture) - clean) ** 2 / (clean ** 2 + 0.01 * clean.mean() ** 2)).ravel())
    return terms[:-max(1, int(len(terms) * 0.001))].mean()


def error(run):
    """What `--error` stops at against the true error, less the noise of the reference; and against the denoised reference."""
    rows = []
    for scene in run.options.scenes:
        picture, report = run.render(scene, "error", ["--exact", "auto", "--error", run.options.error, "--time", run.options.seconds])
        true = run.score(scene, picture)["relmse"] - reference_noise(run, scene)
        estimate = report["estimated_relmse"]
        denoised = against_denoised(run, scene, picture)
        print(json.dumps({"scene": scene, "what": "error", "estimate": estimate, "true": true, "denoised": float(denoised), "samples": report["samples"],
                          "exact_share": report["exact_share"]}), flush=True)
        rows.append((scene, f"{report['samples']}", f"{report['exact_share']:.3f}", f"{estimate or 0:.4f}", f"{true:.4f}",
                     *(f"{e / estimate:.2f}" if estimate else "-" for e in (true, denoised))))
    return ("scene", "samples", "exact", "estimated relMSE", "true", "ratio", "by the denoised reference"), rows


def mean_and_variance(path):
    """Mean of the picture by channel, and the variance of that mean, from its variance layer."""
    import mitsuba
    bitmap = mitsuba.Bitmap(path)
    names = [field.name for field in bitmap.struct_()]
    values = bitmap_array(bitmap)
    pixels = values.shape[0] * values.shape[1]
    mean = [values[..., names.index(c)].mean() for c in "RGB"]
    variance = [values[..., names.index("variance." + c)].sum() / pixels ** 2 for c in "RGB"]
    return mean, variance


def bitmap_array(bitmap):
    import numpy
    return numpy.array(bitmap, dtype=numpy.float64)


def consistent(run):
    """mean(exact 0.25) - mean(exact 1) of the whole picture in standard errors."""
    rows = []
    for scene in run.options.scenes:
        sides = []
        for share, seed in (("0.25", "11"), ("1", "12")):
            picture, _ = run.render(scene, f"consistent-{share}", [
                "--exact", share, "--time", run.options.seconds, "--seed", seed, "--aov", "variance", "--denoise", "off"])
            sides.append(mean_and_variance(picture))
        (a, va), (b, vb) = sides
        z = [(a[c] - b[c]) / (va[c] + vb[c]) ** 0.5 for c in range(3)]
        rows.append((scene, f"{sum(a) / 3:.5f}", f"{sum(b) / 3:.5f}", " ".join(f"{x:+.2f}" for x in z)))
    return ("scene", "mean, exact 0.25", "mean, exact 1", "difference in standard errors, R G B"), rows


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--trex", default=os.path.join(ROOT, "build/trex"))
    parser.add_argument("--against", help="another build, for `first` and `few`")
    parser.add_argument("--only", default="early,bias,exact,consistent")
    parser.add_argument("--scenes", default=",".join(SCENES))
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--seconds", default="40", help="of rendering, for what should have converged")
    parser.add_argument("--error", default="0.01", help="relMSE that `error` asks for")
    parser.add_argument("--out", default=os.path.join(ROOT, "build/quality"))
    parser.add_argument("rest", nargs="*")
    options = parser.parse_args()
    options.scenes = options.scenes.split(",")
    run = Runner(options)
    for name in options.only.split(","):
        measures = {"early": early, "first": first, "few": few, "filter": filtered, "denoisers": denoisers, "bias": bias, "exact": exact,
                    "consistent": consistent, "auto": auto, "equal": equal, "error": error}
        header, rows = measures[name](run)
        print(f"\n| {' | '.join(header)} |\n|{'---|' * len(header)}")
        for row in rows:
            print(f"| {' | '.join(row)} |")


if __name__ == "__main__":
    main()
