#!/usr/bin/env python3
"""What `--error E` says of a picture against what it is, on scenes of all kinds: some of them are lit by few photons.

    tests/bench/told_error.py [MODEL or synth:... or name ...] [--trex build/trex] [--error 0.01] [--seeds 3] [--truth 1024]
                              [--size 128x128] [--most 256] [--out build/told] [-- options of trex render, but of the truth]

Names are those of hard_scenes.py, and: small-lamp, a room under a lamp of 2 cm; back-room, one that is lit through a gap; two-gaps,
through two of them; window, by a spot outside of a small one; globe, by a lamp in a ball of glass; shiny, a room of glossy walls.
Without any: these, caustics, glossy, lamps and foliage. The truth is the exact mode's, as in hard_scenes.py, in two
halves, so that its noise does not count on average; weights are those of it denoised (Open Image Denoise). Each seed renders until the
estimate is --error, or --most samples. Prints a table: medians, what the truth's noise leaves in doubt of the true error (standard error),
and the median, the least and the largest ratio of true over estimate.
"""
import argparse, contextlib, json, math, os, statistics, sys

HERE = os.path.dirname(os.path.abspath(__file__))
ROOT = os.path.dirname(os.path.dirname(HERE))
sys.dont_write_bytecode = True
sys.path[:0] = [HERE, os.path.join(ROOT, "assets"), os.path.join(ROOT, "tests/image")]
import hard_scenes  # noqa: E402
from make_assets import Glb, Shape, sphere  # noqa: E402
from scenes import colored_walls, lamp, room  # noqa: E402


def small_lamp(glb):
    """Nearly all light is that of a point, and what it does to the walls is known by photons."""
    room(glb, (3, 2.4, 3), colored_walls(glb))
    lamp(glb, 2.2, 0.01, (9000.0, 8600.0, 8000.0))
    glb.object("block", Shape().box((-0.9, 0.01, -0.9), (-0.3, 1.1, -0.4)), glb.material("block", (0.7, 0.7, 0.7)))
    glb.object("ball", sphere(0.35, 24, 48), glb.material("ball", (0.6, 0.65, 0.7)), translation=[0.5, 0.36, -0.2])
    glb.camera("camera", (0.2, 1.3, 1.45), (-0.1, 0.7, -0.3), math.radians(65), 1.0)


def back_room(glb):
    """A lamp behind a wall that leaves a gap of 30 cm."""
    walls = colored_walls(glb)
    room(glb, (4, 2.6, 4), walls)
    lamp_of = glb.material("lamp", (0.0, 0.0, 0.0), emission=(90.0, 86.0, 80.0), double_sided=False)
    glb.object("lamp", Shape().quad((-1.8, 2.4, -1.0), (-1.8, 2.4, -1.4), (-1.4, 2.4, -1.4), (-1.4, 2.4, -1.0)), lamp_of)
    glb.object("wall", Shape().box((-0.9, 0.0, -2.0), (-0.8, 2.6, 1.7)), walls[3])
    glb.object("ball", sphere(0.45, 24, 48), glb.material("ball", (0.8, 0.8, 0.8)), translation=[0.7, 0.46, -0.6])
    glb.camera("camera", (1.2, 1.4, 1.9), (0.3, 0.9, -0.8), math.radians(65), 1.0)


def two_gaps(glb):
    """A lamp two walls away, each of which leaves a gap of 40 cm."""
    walls = colored_walls(glb)
    room(glb, (6, 2.6, 4), walls)
    lamp_of = glb.material("lamp", (0.0, 0.0, 0.0), emission=(240.0, 230.0, 210.0), double_sided=False)
    glb.object("lamp", Shape().quad((-2.7, 2.4, 0.4), (-2.7, 2.4, 0.0), (-2.3, 2.4, 0.0), (-2.3, 2.4, 0.4)), lamp_of)
    glb.object("first", Shape().box((-1.6, 0.0, -2.0), (-1.5, 2.6, 1.6)), walls[3])
    glb.object("second", Shape().box((-0.2, 0.0, -1.6), (-0.1, 2.6, 2.0)), walls[3])
    glb.object("block", Shape().box((1.0, 0.01, -1.4), (1.7, 1.2, -0.7)), walls[1])
    glb.camera("camera", (2.6, 1.4, 1.7), (0.8, 0.9, -0.8), math.radians(65), 1.0)


def window(glb):
    """A spot that shines through a window of 30 cm."""
    walls = colored_walls(glb)
    room(glb, (4, 2.6, 4), walls, openings=("back",))
    h, y0, y1 = 0.15, 1.5, 1.8
    for x0, x1, low, high in ((-2, -h, 0, 2.6), (h, 2, 0, 2.6), (-h, h, 0, y0), (-h, h, y1, 2.6)):
        glb.object("back", Shape().box((x0, low, -2.1), (x1, high, -2.0)), walls[2])
    glb.doc["extensions"] = {"KHR_lights_punctual": {"lights": [
        {"type": "spot", "color": [1.0, 0.95, 0.85], "intensity": 900.0, "spot": {"innerConeAngle": 0.1, "outerConeAngle": 0.25}}]}}
    glb.extensions.add("KHR_lights_punctual")
    tilt = -math.atan2(1.0, 3.0) / 2  # down, into the room: a spot shines along -z, here turned about
    turn = (0.0, 1.0, 0.0, 0.0)
    lean = (math.sin(tilt), 0.0, 0.0, math.cos(tilt))
    a, b = turn, lean
    rotation = [a[3] * b[0] + a[0] * b[3] + a[1] * b[2] - a[2] * b[1], a[3] * b[1] - a[0] * b[2] + a[1] * b[3] + a[2] * b[0],
                a[3] * b[2] + a[0] * b[1] - a[1] * b[0] + a[2] * b[3], a[3] * b[3] - a[0] * b[0] - a[1] * b[1] - a[2] * b[2]]
    glb.node("spot", translation=[0.0, 2.65, -5.0], rotation=rotation, extensions={"KHR_lights_punctual": {"light": 0}})
    glb.object("ball", sphere(0.45, 24, 48), glb.material("ball", (0.8, 0.8, 0.8)), translation=[0.9, 0.46, -0.6])
    glb.camera("camera", (1.4, 1.4, 1.9), (-0.3, 0.8, -0.8), math.radians(65), 1.0)


def globe(glb):
    """A lamp of 8 cm in a ball of clear glass: no light sampling passes what bends."""
    room(glb, (3, 2.4, 3), colored_walls(glb))
    glow = glb.material("lamp", (0.0, 0.0, 0.0), emission=(320.0, 300.0, 270.0), double_sided=False)
    glb.object("lamp", sphere(0.04, 12, 24), glow, translation=[0.0, 1.9, 0.0])
    clear = glb.material("glass", (1, 1, 1), roughness=0.0, specular=1.0, double_sided=False,
                         glass={"ior": 1.5, "thickness": 1.0, "color": [1, 1, 1], "distance": 10.0})
    glb.object("globe", sphere(0.12, 32, 64), clear, translation=[0.0, 1.9, 0.0])
    glb.object("block", Shape().box((-0.9, 0.01, -0.9), (-0.3, 1.1, -0.4)), glb.material("block", (0.7, 0.7, 0.7)))
    glb.camera("camera", (0.2, 1.3, 1.45), (-0.1, 0.8, -0.3), math.radians(65), 1.0)


def shiny(glb):
    """Walls that send most of their light on in broad lobes."""
    colors = ((0.8, 0.3, 0.3), (0.3, 0.7, 0.3), (0.7, 0.7, 0.8), (0.75, 0.75, 0.75))
    room(glb, (3, 2.4, 3), tuple(glb.material(f"gloss {i}", c, metallic=0.3, roughness=0.35) for i, c in enumerate(colors)))
    lamp(glb, 2.39, 0.2, (24.0, 23.0, 21.0))
    glb.object("ball", sphere(0.4, 24, 48), glb.material("metal", (0.9, 0.8, 0.6), metallic=1.0, roughness=0.25),
               translation=[0.3, 0.41, -0.3])
    glb.camera("camera", (0.2, 1.3, 1.45), (-0.1, 0.7, -0.3), math.radians(65), 1.0)


OWN = {"small-lamp": small_lamp, "back-room": back_room, "two-gaps": two_gaps, "window": window, "globe": globe, "shiny": shiny}
SCENES = (*OWN, "caustics", "glossy", "lamps", "foliage")


def file_of(model, options):
    """Name, file and further options of a scene."""
    if model in OWN:
        glb = Glb()
        OWN[model](glb)
        path = os.path.join(options.out, model + ".glb")
        glb.write(path)
        return model, path, []
    if model in hard_scenes.SCENES:
        with contextlib.redirect_stdout(sys.stderr):
            return (model, *hard_scenes.scene(model, options))
    name = "".join(c if c.isalnum() else "-" for c in os.path.splitext(os.path.basename(model))[0])
    return name, model, []


def pixels(path):
    import numpy, OpenEXR
    channels = OpenEXR.File(path, separate_channels=True).channels()
    return numpy.stack([channels[c].pixels.astype(float) for c in "RGB"], -1)


def true_error(picture, halves, clean):
    """relMSE against the truth, of which there are two halves: their noises have nothing in common, so they cancel in the product. Half their
    difference is a draw of the noise of their mean, which tells the standard error."""
    weight = 1 / (clean ** 2 + 0.01 * clean.mean() ** 2)
    off, noise = picture - 0.5 * (halves[0] + halves[1]), 0.5 * (halves[0] - halves[1])
    doubt = float(((2.0 * weight * off * noise) ** 2).sum()) ** 0.5 / off.size
    return float(((off ** 2 - noise ** 2) * weight).mean()), doubt


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("models", nargs="*")
    parser.add_argument("--trex", default=os.path.join(ROOT, "build/trex"))
    parser.add_argument("--error", default="0.01")
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--truth", type=int, default=1024)
    parser.add_argument("--size", default="128x128")
    parser.add_argument("--most", default="256")
    parser.add_argument("--out", default=os.path.join(ROOT, "build/told"))
    arguments = sys.argv[1:]
    cut = arguments.index("--") if "--" in arguments else len(arguments)
    options = parser.parse_args(arguments[:cut])
    further, options.rest = arguments[cut + 1:], []  # the truth is taken without
    os.makedirs(options.out, exist_ok=True)
    print("| scene | samples | exact | estimated relMSE | true | true over estimate: median, least, most |\n" + "|---" * 6 + "|")
    for model in options.models or SCENES:
        name, path, more = file_of(model, options)
        true, clean, _ = hard_scenes.truth(options, name, path, more)
        halves = [pixels(true.replace("truth", f"half{seed}")) for seed in (101, 102)]
        clean = pixels(clean)
        rows = []
        for seed in range(options.seeds):
            out = os.path.join(options.out, f"{name}-error.exr")
            report = hard_scenes.render(options, path, more, out, ["--exact", "auto", "--error", options.error, "--spp", options.most,
                                                                   "--seed", str(seed), *further])
            error, doubt = true_error(pixels(out), halves, clean)
            told = report["estimated_relmse"] or float("nan")
            rows.append((report["samples"], report["exact_share"], told, error, doubt, error / told))
            print(json.dumps({"scene": name, "seed": seed, "samples": report["samples"], "exact_share": report["exact_share"],
                              "estimate": told, "true": error, "doubt": doubt}), file=sys.stderr, flush=True)
        samples, share, told, error, doubt, ratio = (statistics.median(column) for column in zip(*rows))
        ratios = [r[-1] for r in rows]
        print(f"| {name} | {samples:.0f} | {share:.3f} | {told:.4f} | {error:.4f} +- {doubt:.4f} | {ratio:.2f} {min(ratios):.2f} {max(ratios):.2f} |", flush=True)


if __name__ == "__main__":
    main()
