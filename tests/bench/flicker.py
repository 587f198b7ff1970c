#!/usr/bin/env python3
"""Flicker: FLIP between neighbouring frames of a slow camera path, of guesses against exact pictures.

    tests/bench/flicker.py [MODEL.glb ...] [--trex build/trex] [--frames 20] [--seconds 1] [--spp N] [--exact 0,auto] [--truth 512]
                           [--size 128x128] [--step 0.002] [--out build/flicker] [--rest OPTION OF TREX RENDER ...]

The camera of the file moves sideways, looking on, a frame by --step of the median distance of what it sees. Each frame is a
render of --seconds, or of --spp samples, with the same seed, as those of `trex render --path`. "Truth" is --truth exact samples, denoised by
Open Image Denoise: noise of its own would hide flicker. Without MODEL: cornell, staircase2, living-room of TREX_SHARED. Bar: 1.2 of the truth's.
"""
import argparse, json, math, os, statistics, struct, subprocess

HERE = os.path.dirname(os.path.abspath(__file__))
ROOT = os.path.dirname(os.path.dirname(HERE))
SHARED = os.environ.get("TREX_SHARED", os.path.join(os.path.dirname(ROOT), "shared"))
ENV = {"classroom": "0.6,0.75,1.0", "living-room": "3,3.75,5"}


def first_camera(path):
    """Eye, target, up and vertical field of view (degrees) of a .glb's first camera, which has no parents."""
    with open(path, "rb") as file:
        head = file.read(20)
        doc = json.loads(file.read(struct.unpack("<I", head[12:16])[0]))
    node = next(n for n in doc["nodes"] if "camera" in n)
    if "matrix" in node:
        m = node["matrix"]
    else:
        x, y, z, w = node.get("rotation", [0, 0, 0, 1])
        t = node.get("translation", [0, 0, 0])
        m = [1 - 2 * (y * y + z * z), 2 * (x * y + z * w), 2 * (x * z - y * w), 0,
             2 * (x * y - z * w), 1 - 2 * (x * x + z * z), 2 * (y * z + x * w), 0,
             2 * (x * z + y * w), 2 * (y * z - x * w), 1 - 2 * (x * x + y * y), 0, *t, 1]
    fov = math.degrees(doc["cameras"][node["camera"]]["perspective"]["yfov"])
    return [m[12 + k] for k in range(3)], [m[k] for k in range(3)], [m[4 + k] for k in range(3)], [-m[8 + k] for k in range(3)], fov


def path_of(options, model):
    """Cameras of the path. The distance of what is seen comes from a small picture's depths."""
    eye, right, up, ahead, fov = first_camera(model)
    probe = os.path.join(options.out, "probe.exr")
    subprocess.run([options.trex, "render", model, "-o", probe, "--size", "16x16", "--spp", "1", "--device", "none", "-q",
                    "--aov", "depth"], check=True, stdout=subprocess.DEVNULL)
    import numpy, OpenEXR
    depth = OpenEXR.File(probe, separate_channels=True).channels()["depth"].pixels.astype(float)
    step = options.step * float(numpy.median(depth[(depth > 0) & (depth < 1e8)]))
    cameras = []
    for frame in range(options.frames):
        at = [e + frame * step * r for e, r in zip(eye, right)]
        cameras.append(",".join(map(repr, at)) + "/" + ",".join(repr(a + d) for a, d in zip(at, ahead)) + "/" +
                       ",".join(map(repr, up)) + "/" + repr(fov))
    return cameras


def frames(options, model, name, arguments):
    scene = os.path.splitext(os.path.basename(model))[0]
    made = []
    for i, camera in enumerate(options.cameras):
        out = os.path.join(options.out, f"{scene}-{name}-{i:02}.exr")
        if name != "truth" or not os.path.exists(out):
            subprocess.run([options.trex, "render", model, "-o", out, "--size", options.size, "-q", "--camera=" + camera,
                            *(["--env", ENV[scene]] if scene in ENV else []), *arguments, *options.rest], check=True,
                           stdout=subprocess.DEVNULL)
        made.append(out)
    return made


def between(options, made):
    """FLIP between neighbours, all exposed as the first one."""
    found = []
    exposure = None
    for a, b in zip(made, made[1:]):
        command = [options.trex, "diff", b, a, "--json", *([] if exposure is None else ["--exposure", str(exposure)])]
        report = json.loads(subprocess.run(command, stdout=subprocess.PIPE).stdout)
        exposure = report["exposure_stops"] if exposure is None else exposure
        found.append(report["flip"])
    return statistics.mean(found)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("models", nargs="*")
    parser.add_argument("--trex", default=os.path.join(ROOT, "build/trex"))
    parser.add_argument("--frames", type=int, default=20)
    parser.add_argument("--seconds", default="1")
    parser.add_argument("--spp", help="samples a pixel instead of seconds: the same pictures on a busy machine")
    parser.add_argument("--exact", default="0,auto")
    parser.add_argument("--truth", type=int, default=512)
    parser.add_argument("--size", default="128x128")
    parser.add_argument("--step", type=float, default=0.002)
    parser.add_argument("--out", default=os.path.join(ROOT, "build/flicker"))
    parser.add_argument("--rest", nargs=argparse.REMAINDER, default=[], help="options of trex render")
    options = parser.parse_args()
    models = options.models or [os.path.join(SHARED, "scenes/interiors", s + ".glb") for s in ("cornell", "staircase2", "living-room")]
    os.makedirs(options.out, exist_ok=True)
    shares = options.exact.split(",")
    length = ["--spp", options.spp] if options.spp else ["--time", options.seconds]
    print(f"| scene | truth | {' | '.join('exact ' + s for s in shares)} | over the truth |\n|{'---|' * (3 + len(shares))}")
    for model in models:
        options.cameras = path_of(options, model)
        truth = between(options, frames(options, model, "truth", ["--exact", "1", "--spp", str(options.truth), "--device", "none",
                                                                  "--denoise", "oidn"]))
        found = [between(options, frames(options, model, "exact" + s, ["--exact", s, *length])) for s in shares]
        print(f"| {os.path.splitext(os.path.basename(model))[0]} | {truth:.4f} | " + " | ".join(f"{f:.4f}" for f in found) + " | " +
              " ".join(f"{f / truth:.2f}" for f in found) + " |", flush=True)


if __name__ == "__main__":
    main()
