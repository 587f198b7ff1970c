#!/usr/bin/env python3
"""Prints the figures that the viewer is held to, on a virtual display of its own.

    TREX_SHARED=.../shared tests/bench/viewer_bars.py [--trex build/trex] [--edits 100] [--only response,budget,...]

    response   edit to first complete coarse frame: scripted edits of each class on three scenes, 640x360
    quality    the same edits, a few of them: ms until FLIP 0.1 and 0.05 against the settled picture
    budget     share of turns within 1.2x of --budget-ms for 16, 33, 100
    open       ms to the first coarse frame of the baked Saturn V, and of an unbaked model
    idle       cores used while converged
    window     FLIP of screenshots of a window against one of --reference samples, so many seconds after the coarse frame
               of a turn of the camera, at 1280x720 and 640x360; --out keeps them (needs flip-evaluator and Pillow; not
               among those that run unless asked for)
"""
import argparse
import json
import os
import random
import statistics
import subprocess
import sys
import tempfile

ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
OTHERS = {"living-room": "interiors/living-room.glb", "sponza": "interiors/sponza.glb"}
SCENES = {"cornell": "interiors/cornell.glb", "saturn-v": "cad/saturn-v.glb", "staircase2": "interiors/staircase2.glb"}
WINDOW_SECONDS = (0.07, 0.5, 1, 2, 4)
CLASSES = ("camera", "material", "light", "visibility")

parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
parser.add_argument("--trex", default=os.path.join(ROOT, "build/trex"))
parser.add_argument("--edits", type=int, default=100, help="of each class")
parser.add_argument("--only", default="response,quality,budget,open,idle")
parser.add_argument("--scenes", default=",".join(SCENES))
parser.add_argument("--device", default="auto")
parser.add_argument("--sizes", default="1280x720,640x360", help="of the windows of 'window'")
parser.add_argument("--reference", type=float, default=16, help="samples of the picture that 'window' compares with")
parser.add_argument("--samples", help="'window' after so many samples a pixel instead, such as 0.25,1: on a busy machine")
parser.add_argument("--out", help="folder that gets the screenshots of 'window'")
options = parser.parse_args()
SHARED = os.environ.get("TREX_SHARED", os.path.join(ROOT, "../shared"))
MARKS = tuple(map(float, options.samples.split(","))) if options.samples else WINDOW_SECONDS
UNIT = " samples" if options.samples else " s"
TRANSIENT = tempfile.TemporaryDirectory(prefix="trex-viewer-bars-")


def scene(name):
    return os.path.join(SHARED, "scenes", {**SCENES, **OTHERS}[name])


def counts(path):
    """Materials and objects of a model."""
    info = json.loads(subprocess.run([options.trex, "info", path, "--json"], capture_output=True, check=True).stdout)
    return len(info["materials"]), info["objects"]


def edit(kind, number, dice, materials, objects):
    """One scripted edit; every other visibility edit takes the one before back."""
    if kind == "camera":
        return {"camera": {"orbit": [dice.uniform(-0.1, 0.1), dice.uniform(-0.02, 0.02)]}}
    if kind == "material":
        return {"material": {"index": dice.randrange(materials), "roughness": dice.random(),
                             "base_color": [dice.random(), dice.random(), dice.random(), 1.0]}}
    if kind == "light":
        if number == 0:
            return {"light": {"add": True, "name": "bar", "position": [0, 1, 0], "intensity": [1, 1, 1]}}
        return {"light": {"name": "bar", "position": [dice.uniform(-1, 1), dice.uniform(0, 2), dice.uniform(-1, 1)],
                          "intensity": [dice.uniform(0.5, 5)] * 3}}
    if number % 2 == 1:
        return {"show_all": True}
    return {"hide": [dice.randrange(objects)]}


def replay(path, steps, budget=33, size="640x360", arguments=()):
    script, report = (os.path.join(TRANSIENT.name, name) for name in ("script.json", "report.json"))
    with open(script, "w") as f:
        json.dump({"trex": 1, "size": size, "steps": steps}, f)
    subprocess.run([options.trex, "view", path, "--replay", script, "--report", report, "--device", options.device,
                    "--budget-ms", str(budget), "-q", *arguments], check=True)
    with open(report) as f:
        return json.load(f)


def percentile(values, share):
    return sorted(values)[min(len(values) - 1, int(share * len(values)))]


def edits(path, number, **more):
    dice = random.Random(1)
    materials, objects = counts(path)
    return [{"wait": "ready", "frames": 5}] + [
        {"label": kind, **edit(kind, i, dice, materials, objects), "frames": 3, **more}
        for kind in CLASSES for i in range(number)]


def response(name):
    report = replay(scene(name), edits(scene(name), options.edits))
    slowest = 0.0
    for kind in CLASSES:
        times = [step["first_coarse_ms"] for step in report["steps"]
                 if step["label"] == kind and "first_coarse_ms" in step]
        if not times:
            continue
        slowest = max(slowest, percentile(times, 0.95))
        print(f"| {name} | {kind} | {len(times)} | {statistics.median(times):.1f} | {percentile(times, 0.95):.1f} | "
              f"{max(times):.1f} |", flush=True)
    return slowest


def quality(name):
    report = replay(scene(name), edits(scene(name), 2, settle=4.0))
    for step in report["steps"][1:]:
        cells = [f"{step[key]:.0f}" if key in step else "-" for key in
                 ("first_coarse_ms", "flip_0_10_ms", "flip_0_05_ms")]
        print(f"| {name} | {step['label']} | {' | '.join(cells)} |", flush=True)


def budget(name):
    for milliseconds in (16, 33, 100):
        turns = replay(scene(name), edits(scene(name), 10), milliseconds)["turns"]
        print(f"| {name} | {milliseconds} | {turns['count']} | {100 * turns['steps_within_budget']:.1f} % | "
              f"{100 * turns['frames_within_budget']:.1f} % | {turns['longest_frame_ms']:.0f} | "
              f"{turns['longest_tile_wait_frames']} |", flush=True)


def opening(name):
    baked = os.path.join(TRANSIENT.name, name + ".trex")
    subprocess.run([options.trex, "bake", scene(name), "-o", baked, "-q"], check=True)
    for kind, path in (("baked", baked), ("source", scene(name))):
        report = replay(path, [{"wait": "ready"}])
        print(f"| {name} | {kind} | {report['open']['first_coarse_ms']:.0f} | {report['open']['ready_ms']:.0f} |",
              flush=True)


def idle(name):
    report = replay(scene(name), [{"wait": "idle"}, {"idle": 5.0}], arguments=["--spp", "4"])
    print(f"| {name} | {100 * report['steps'][1]['idle_core_share']:.1f} % |", flush=True)


def window(name):
    for size in options.sizes.split(","):
        window_of(name, size)


def window_of(name, size):
    import flip_evaluator
    import numpy
    from PIL import Image

    folder = os.path.abspath(options.out or TRANSIENT.name)
    os.makedirs(folder, exist_ok=True)
    shot = lambda i: os.path.join(folder, f"{name}-{size}-{i}.png")
    before = {"samples": 1} if options.samples else {"seconds": 3}
    steps = [{"wait": "ready"}, {"exposure": 0.5, **before}, {"camera": {"look": [0.12, 0.03]}}]
    for last, mark in zip((0, *MARKS), MARKS):
        steps.append({"samples": mark} if options.samples else {"seconds": mark - last})
        steps[-1]["screenshot"] = shot(mark)
    report = replay(scene(name), steps + [{"samples": options.reference, "screenshot": shot("last")}], size=size)
    picture = lambda i: numpy.asarray(Image.open(shot(i)).convert("RGB"), dtype=numpy.float32) / 255
    errors = [flip_evaluator.evaluate(picture("last"), picture(mark), "LDR")[1] for mark in MARKS]
    samples = report["steps"][2 + len(MARKS)]["samples_per_pixel"]
    print(f"| {name} | {size} | {report['steps'][2]['first_coarse_ms']:.0f} | {' | '.join(f'{e:.3f}' for e in errors)} | "
          f"{samples:.2f} |", flush=True)


def table(title, columns, names, row):
    print(f"\n{title}\n\n| {' | '.join(columns)} |\n|{'---|' * len(columns)}", flush=True)
    return [row(name) for name in names]


def main():
    xvfb = None
    if not os.environ.get("DISPLAY"):
        reading, writing = os.pipe()
        xvfb = subprocess.Popen(["Xvfb", "-displayfd", str(writing), "-screen", "0", "1280x720x24"],
                                pass_fds=[writing], stderr=subprocess.DEVNULL)
        os.close(writing)
        os.environ["DISPLAY"] = ":" + os.fdopen(reading).readline().strip()
    names, only = options.scenes.split(","), options.only.split(",")
    try:
        if "response" in only:
            slowest = table("Edit to first complete coarse frame, ms (bars: p95 67, median 33)",
                            ("scene", "class", "edits", "median", "p95", "most"), names, response)
            if names[:2] == ["cornell", "saturn-v"]:
                print(f"\nSaturn V's p95 over Cornell's: {slowest[1] / slowest[0]:.2f} (bar 1.3)")
        if "quality" in only:
            table("Edit to quality, ms", ("scene", "class", "first coarse", "FLIP 0.10", "FLIP 0.05"), names, quality)
        if "budget" in only:
            table("Turns within 1.2x of the budget (bar: 95 %), and the most frames that a tile was not served (bar: 16)",
                  ("scene", "budget ms", "turns", "viewer's part", "with drawing", "longest ms", "longest wait of a tile, frames"), names, budget)
        if "open" in only:
            table("Opening, ms (bars: 1000 baked, 3000 source)", ("scene", "from", "first coarse", "ready"),
                  [name for name in names if name != "cornell"], opening)
        if "window" in only:
            table("FLIP after a turn of the camera (bars: 0.15 after 1 s, 0.08 after 4 s; coarse frame 67 ms, 33 at 640x360)",
                  ("scene", "window", "coarse, ms", *(f"{m}{UNIT}" for m in MARKS), "samples by then"), names, window)
        if "idle" in only:
            table("Idle (bar: 5 % of a core)", ("scene", "cores"), names, idle)
    finally:
        if xvfb:
            xvfb.terminate()


if __name__ == "__main__":
    sys.exit(main())
