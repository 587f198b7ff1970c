#!/usr/bin/env python3
"""Noise and cost of many lights: a street of lamps against the same with only those nearest to the camera, and a room
with 49 lamps against 48.

    tests/bench/many_lights.py [--trex build/trex] [--lamps 10000] [--near 64] [--spp 32] [--size 96x54] [--runs 3]
                               [--out FOLDER] [-- further options of trex render]

Noise is the root of the relMSE of one exact picture, estimated by two seeds; seconds are those of rendering, a sample of
all pixels, the median of --runs, one of each scene in turn. Every other lamp is a point light, the others are balls of
72 triangles, all placements of one mesh. Prints a table; JSON with --json.
"""
import argparse, json, math, os, statistics, subprocess, sys

HERE = os.path.dirname(os.path.abspath(__file__))
ROOT = os.path.dirname(os.path.dirname(HERE))
sys.dont_write_bytecode = True
sys.path[:0] = [os.path.join(ROOT, "assets"), os.path.join(ROOT, "tests/image")]
from make_assets import Glb, Shape, sphere  # noqa: E402
from scenes import colored_walls, room  # noqa: E402


def lights(glb, places, radius, radiance, intensity):
    """A lamp at each place: in turn a ball and a point light."""
    glow = glb.material("glow", (0.0, 0.0, 0.0), emission=(radiance, 0.9 * radiance, 0.7 * radiance), double_sided=False)
    ball = glb.mesh("ball", sphere(radius, 5, 9), glow)
    glb.doc["extensions"] = {"KHR_lights_punctual": {"lights": [
        {"type": "point", "color": [1.0, 0.9, 0.7], "intensity": intensity}]}}
    glb.extensions.add("KHR_lights_punctual")
    for i, place in enumerate(places):
        if i % 2:
            glb.node(f"lamp {i}", mesh=ball, translation=list(place))
        else:
            glb.node(f"lamp {i}", translation=list(place), extensions={"KHR_lights_punctual": {"light": 0}})


def street(path, count, lamps):
    """`count` of the lamps of a long street, those nearest to its middle; houses stand around the camera."""
    glb = Glb()
    ground = glb.material("ground", (0.4, 0.4, 0.4))
    wall = glb.material("wall", (0.6, 0.5, 0.4))
    half = 3.0 * lamps + 50.0  # the same ground however many lamps
    glb.object("ground", Shape().quad((-half, 0, 30), (half, 0, 30), (half, 0, -30), (-half, 0, -30)), ground)
    for i in range(-8, 8):
        for side in (-1, 1):
            z = sorted((8.0 * side, 16.0 * side))
            glb.object(f"house {i} {side}", Shape().box((12.0 * i, 0, z[0]), (12.0 * i + 10.0, 5 + abs(i) % 3, z[1])),
                       wall)
    order = sorted(range(lamps), key=lambda i: abs(i - lamps / 2))[:count]
    places = [(6.0 * (i - lamps / 2) + 3.0, 4.0, 5.0 if i % 4 < 2 else -5.0) for i in order]
    lights(glb, places, 0.1, 90.0, 9.0)
    glb.camera("camera", (0.0, 2.0, 0.0), (20.0, 1.5, 2.0), math.radians(50), 16 / 9)
    glb.write(path)


def ceiling(path, count):
    glb = Glb()
    room(glb, (8, 2.6, 7), colored_walls(glb))
    lights(glb, [(-3.5 + i % 8, 2.3, -3.0 + i // 8) for i in range(count)], 0.04, 30.0, 0.5)
    glb.object("block", Shape().box((-1, 0, -1), (0.5, 1.1, 0.4)), 3)
    glb.camera("camera", (3.0, 1.6, 3.0), (-0.5, 0.7, -1.0), math.radians(50), 16 / 9)
    glb.write(path)


def render(options, scene, seed):
    out = os.path.join(options.out, f"many-{scene}-{seed}.exr")
    path = os.path.join(options.out, f"many-{scene}.glb")
    command = [options.trex, "render", path, "-o", out, "--size", options.size, "--spp", str(options.spp), "--exact", "1",
               "--seed", str(seed), "--json", "-q", *options.rest]
    report = json.loads(subprocess.run(command, check=True, capture_output=True).stdout)
    return out, report["render_seconds"] / report["samples"]


def noise(options, scene):
    a, b = (render(options, scene, seed)[0] for seed in (1, 2))
    found = subprocess.run([options.trex, "diff", a, b, "--json"], capture_output=True, text=True)
    return math.sqrt(json.loads(found.stdout)["relmse_trimmed"] / 2)


def compare(options, name, few, many):
    seconds = {few: [], many: []}
    for run in range(options.runs):
        for scene in (few, many):
            seconds[scene].append(render(options, scene, 1)[1])
    a, b = noise(options, few), noise(options, many)
    cost = statistics.median(y / x for x, y in zip(seconds[few], seconds[many]))
    return {"what": name, "noise_few": a, "noise_many": b, "noise_ratio": b / a,
            "seconds_few": statistics.median(seconds[few]), "seconds_many": statistics.median(seconds[many]),
            "seconds_ratio": cost}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--trex", default=os.path.join(ROOT, "build/trex"))
    parser.add_argument("--lamps", type=int, default=10000)
    parser.add_argument("--near", type=int, default=64)
    parser.add_argument("--spp", type=int, default=32)
    parser.add_argument("--size", default="96x54")
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--out", default=os.path.join(ROOT, "build"))
    parser.add_argument("rest", nargs="*")
    options = parser.parse_args()
    where = os.path.join(options.out, "many-")
    street(where + "near.glb", options.near, options.lamps)
    street(where + "street.glb", options.lamps, options.lamps)
    ceiling(where + "48.glb", 48)
    ceiling(where + "49.glb", 49)
    rows = [compare(options, f"street of {options.lamps} lamps over its {options.near} nearest", "near", "street"),
            compare(options, "49 lamps over 48", "48", "49")]
    if options.json:
        print(json.dumps(rows, indent=1))
        return
    print("| what | noise | ratio | ms a sample | ratio |\n|---|---|---|---|---|")
    for r in rows:
        print(f"| {r['what']} | {r['noise_few']:.3f} {r['noise_many']:.3f} | {r['noise_ratio']:.2f} | "
              f"{r['seconds_few'] * 1e3:.1f} {r['seconds_many'] * 1e3:.1f} | {r['seconds_ratio']:.2f} |")


if __name__ == "__main__":
    main()
