#!/usr/bin/env python3
"""Prints the tables of docs/tradeoff.md from the JSON of `trex bench tradeoff`.

    tests/bench/tradeoff_table.py report.json [seed1.json ...] [--at 1,8,60] [--flip 0.1]

A figure lies between the points before and after the second asked for, by their logarithms. Where peers.py has added
other renderers, two last tables say how long each of them takes to the relMSE of our last point, and both to FLIP 0.1.
Further reports are of other seeds: ours are then the medians of all, and what lies between the least and the largest
FLIP and relMSE is told. Peers are those of the first report.
"""
import argparse, json, math, statistics


def at(points, seconds, key):
    """A curve after so many seconds, along straight lines of the logarithms; a last point a tenth early counts."""
    for a, b in zip(points, points[1:]):
        if a["seconds"] <= seconds <= b["seconds"]:
            way = math.log(seconds / a["seconds"]) / math.log(b["seconds"] / a["seconds"])
            return a[key] * (b[key] / a[key]) ** way
    near = [p for p in points if 0.9 * seconds <= p["seconds"] <= 1.1 * seconds]
    return near[-1][key] if near else None


def median(values):
    """None is later than, or above, everything."""
    found = statistics.median_low([math.inf if v is None else v for v in values])
    return None if math.isinf(found) else found


def seeds_of(reports):
    """(scene, run, the same run of all seeds) of the first report."""
    for s, scene in enumerate(reports[0]["scenes"]):
        for r, run in enumerate(scene["runs"]):
            yield scene, run, [report["scenes"][s]["runs"][r] for report in reports]


def check_alike(reports):
    for report in reports[1:]:
        for told in (lambda d: [s["name"] for s in d["scenes"]], lambda d: d["settings"]["exact"]):
            if told(report) != told(reports[0]):
                raise SystemExit("reports of different scenes or shares")


def cell(value, digits):
    return "-" if value is None else f"{value:.{digits}f}"


def table(header, rows):
    print(f"\n| {' | '.join(header)} |\n|{'---|' * len(header)}")
    for row in rows:
        print(f"| {' | '.join(row)} |")


def seconds_to(points, key, value):
    """When a curve reaches a value, along straight lines of the logarithms; none before its first or after its last point."""
    for a, b in zip(points, points[1:]):
        if a[key] > value >= b[key]:
            way = math.log(a[key] / value) / math.log(a[key] / b[key])
            return a["seconds"] * (b["seconds"] / a["seconds"]) ** way
    return None


def seconds_to_error(points, relmse):
    """As above; before the first and after the last point noise is what errs, and falls as 1 over seconds."""
    nearest = points[0] if relmse >= points[0]["relmse"] else points[-1]
    return seconds_to(points, "relmse", relmse) or nearest["seconds"] * nearest["relmse"] / relmse


def geometric_means(ratios):
    return [[f"geometric mean of {len(r)}", run, peer, "", "", f"{math.exp(sum(map(math.log, r)) / len(r)):.2f}"]
            for (run, peer), r in ratios.items()]


def against_peers(reports, flip):
    """How long other renderers take to what we reach: to the relMSE of our last point, and both to a FLIP."""
    errors, looks, ratios = [], [], {}
    for scene, run, seeds in seeds_of(reports):
        for peer in scene.get("peers", []):
            key = (name(run), peer["renderer"])
            ours = {k: statistics.median(s["points"][-1][k] for s in seeds) for k in ("seconds", "relmse")}
            theirs = seconds_to_error(peer["points"], ours["relmse"])
            ratios.setdefault(key, []).append(theirs / ours["seconds"])
            errors.append([scene["name"], *key, f"{ours['relmse']:.4g} in {ours['seconds']:.1f} s", f"{theirs:.1f} s",
                           f"{theirs / ours['seconds']:.2f}"])
            row = [scene["name"], *key]
            for curves in ([s["points"] for s in seeds], [peer["points"]]):
                found = median([0.0 if points[0]["flip"] <= flip else seconds_to(points, "flip", flip) for points in curves])
                first, last = curves[0][0], curves[0][-1]
                row.append(f"{found:.2f} s" if found else f"< {first['seconds']:.2f} s" if found == 0.0
                           else f"> {last['seconds']:.2f} s")
            looks.append(row)
    if errors:
        table(["scene", "", "renderer", "our relMSE", "its seconds to that", "over ours"], errors + geometric_means(ratios))
        table(["scene", "", "renderer", f"our seconds to FLIP {flip:g}", "its"], looks)


def name(run):
    share = run.get("exact")
    return run["renderer"] if share is None else f"exact {share}" if isinstance(share, str) else f"exact {share:g}"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("reports", nargs="+", metavar="report")
    parser.add_argument("--at", default="1,8,60")
    parser.add_argument("--flip", type=float, default=0.1)
    options = parser.parse_args()
    seconds = [float(x) for x in options.at.split(",")]
    reports = []
    for path in options.reports:
        with open(path) as f:
            reports.append(json.load(f))
        if reports[-1].get("bench") != "tradeoff":
            parser.error(f"{path}: not a report of trex bench tradeoff")
    check_alike(reports)
    report = reports[0]
    curves = []
    for scene in report["scenes"]:
        curves += [(scene, run, seeds) for s, run, seeds in seeds_of(reports) if s is scene]
        curves += [(scene, peer, [peer]) for peer in scene.get("peers", [])]
    for key, digits in (("flip", 3), ("relmse", 4)):
        rows = []
        for s, r, seeds in curves:
            row = [s["name"], name(r)]
            for t in seconds:
                values = [at(one["points"], t, key) for one in seeds]
                row.append(cell(median(values), digits))
                if len(values) > 1 and None not in values:
                    row[-1] += f" ({min(values):.{digits}f} to {max(values):.{digits}f})"
            if key == "relmse":
                row.append(f"{r['slope']:.2f}" if r.get("slope") is not None else "-")
            rows.append(row)
        table(["scene", "", *(f"{key} after {t:g} s" for t in seconds), *(["slope"] if key == "relmse" else [])], rows)
    last = [(s, r) for s in report["scenes"] for r in s["runs"]]
    table(["scene", "", "mean ratio at the end", "c_rays", "shadow_rays", "cache_reads", "photons"],
          [[s["name"], name(r), cell(r["points"][-1]["mean_ratio"], 4),
            *(f"{r['rays'][k + '_share']:.2f}" for k in ("c_ray", "shadow_ray", "cache_read")),
            f"{r['photons']:.3g}"] for s, r in last])
    table(["scene", "import", "mesh", "voxels"],
          [[s["name"], *(f"{s['setup'][k + '_seconds']:.2f}" for k in ("import", "mesh_build", "voxel_build"))]
           for s in report["scenes"]])
    against_peers(reports, options.flip)


if __name__ == "__main__":
    main()
