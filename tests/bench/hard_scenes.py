#!/usr/bin/env python3
"""What is hard stays honest: caustics, glossy interreflection, media, thousands of lamps, foliage, each after 1, 4 and
16 s beside the truth, and what the dial chose there.

    tests/bench/hard_scenes.py [--trex build/trex] [--only caustics,glossy,media,lamps,foliage] [--exact auto] [--seconds 1,4,16]
                               [--truth 2048] [--size 256x256] [--out build/hard] [--pictures docs/hard] [-- options of trex render]

The truth is the exact mode with --truth samples of another seed. FLIP is taken against it after Open Image Denoise, if
that is there; its own relMSE, from two halves, is the last column. It is kept in --out and rendered once. Media need build/make_vdb. Prints a table, one JSON line a picture
on stderr. --pictures writes a strip of each scene (needs OpenEXR and Pillow, see peers/setup.sh): the times,
the truth, and last the exact share of the last picture, black 0 and white 1.
"""
import argparse, contextlib, json, math, os, random, subprocess, sys

HERE = os.path.dirname(os.path.abspath(__file__))
ROOT = os.path.dirname(os.path.dirname(HERE))
sys.dont_write_bytecode = True
sys.path[:0] = [HERE, os.path.join(ROOT, "assets"), os.path.join(ROOT, "tests/image")]
from make_assets import Glb, Shape, png, sphere  # noqa: E402
from many_lights import street  # noqa: E402
from scenes import colored_walls, lamp, room, sun  # noqa: E402

SCENES = ("caustics", "glossy", "media", "lamps", "foliage")


def sun_of(glb, direction, intensity):
    """A directional light that shines towards `direction`."""
    x, y, z = direction
    length = math.sqrt(x * x + y * y + z * z)
    turn, tilt = math.atan2(-x, -z) / 2, math.asin(y / length) / 2
    a, b = (math.sin(turn), math.cos(turn)), (math.sin(tilt), math.cos(tilt))
    glb.doc["extensions"] = {"KHR_lights_punctual": {"lights": [
        {"type": "directional", "color": [1.0, 0.92, 0.8], "intensity": intensity}]}}
    glb.extensions.add("KHR_lights_punctual")
    glb.node("sun", rotation=[a[1] * b[0], a[0] * b[1], -a[0] * b[0], a[1] * b[1]],
             extensions={"KHR_lights_punctual": {"light": 0}})


def caustics(glb):
    """A glass ball, a glass block and a polished ring under a lamp of 10 cm and a point light."""
    room(glb, (3, 2.4, 3), colored_walls(glb))
    lamp(glb, 2.39, 0.05, (400.0, 380.0, 340.0))
    glb.doc["extensions"] = {"KHR_lights_punctual": {"lights": [
        {"type": "point", "color": [1.0, 0.8, 0.6], "intensity": 2.0}]}}
    glb.extensions.add("KHR_lights_punctual")
    glb.node("point", translation=[-1.1, 1.5, 0.6], extensions={"KHR_lights_punctual": {"light": 0}})
    clear = glb.material("glass", (1, 1, 1), roughness=0.0, specular=1.0, double_sided=False,
                         glass={"ior": 1.5, "thickness": 1.0, "color": [0.9, 1, 0.95], "distance": 0.5})
    glb.object("ball", sphere(0.3, 32, 64), clear, translation=[0.45, 0.31, -0.2])
    glb.object("block", Shape().box((-0.9, 0.01, -0.9), (-0.4, 0.8, -0.5)), clear)
    gold = glb.material("gold", (0.95, 0.75, 0.4), metallic=1.0, roughness=0.0)
    ring = Shape()
    for i in range(96):
        a, b = (2 * math.pi * k / 96 for k in (i, i + 1))
        p, q = ((-0.35 + 0.28 * math.cos(t), 0.35 + 0.28 * math.sin(t)) for t in (a, b))
        ring.quad((p[0], 0.0, p[1]), (q[0], 0.0, q[1]), (q[0], 0.2, q[1]), (p[0], 0.2, p[1]))
    glb.object("ring", ring, gold)
    glb.camera("camera", (0.2, 1.3, 1.45), (-0.1, 0.35, -0.3), math.radians(60), 1.0)


def glossy(glb):
    """A lamp that shines into a corner of brushed metal alone: all light comes from metal to metal to the room."""
    walls = colored_walls(glb)
    room(glb, (4, 2.6, 4), walls)
    metal = [glb.material(f"metal {r}", (0.95, 0.8, 0.6), metallic=1.0, roughness=r) for r in (0.1, 0.2, 0.3)]
    glow = glb.material("lamp", (0.0, 0.0, 0.0), emission=(60.0, 56.0, 50.0), double_sided=False)
    glb.object("lamp", Shape().quad((-1.4, 1.5, -1.9), (-1.4, 1.0, -1.9), (-1.9, 1.0, -1.0), (-1.9, 1.5, -1.0)), glow)
    glb.object("shade", Shape().quad((-1.88, 1.6, -0.95), (-1.36, 1.6, -1.88), (-1.36, 0.9, -1.88), (-1.88, 0.9, -0.95)),
               walls[3])
    glb.object("floor", Shape().quad((-2, 0.01, 2), (2, 0.01, 2), (2, 0.01, -2), (-2, 0.01, -2)), metal[1])
    glb.object("back", Shape().quad((-2, 0, -1.98), (2, 0, -1.98), (2, 2.6, -1.98), (-2, 2.6, -1.98)), metal[0])
    glb.object("left", Shape().quad((-1.98, 0, 2), (-1.98, 0, -2), (-1.98, 2.6, -2), (-1.98, 2.6, 2)), metal[2])
    for i in range(3):
        glb.object(f"box {i}", Shape().box((-0.7 + 0.8 * i, 0.01, -1.0 + 0.3 * i), (-0.3 + 0.8 * i, 0.5 + 0.2 * i, -0.6 + 0.3 * i)),
                   walls[i])
    glb.camera("camera", (1.5, 1.5, 1.9), (-0.2, 0.6, -0.8), math.radians(65), 1.0)


def foliage(glb):
    """Six trees of 4000 leaves with cut-out edges, under a sun and a sky."""
    def leaf(x, y):
        u, v = (x - 15.5) / 14, (y - 15.5) / 15.5
        inside = abs(u) < (1 - v * v) * (0.55 + 0.3 * math.cos(9 * v))
        return (60 + 4 * (x % 7), 110 + 3 * (y % 9), 30, 255 if inside else 0)

    ground = glb.material("ground", (0.35, 0.3, 0.2))
    bark = glb.material("bark", (0.25, 0.18, 0.12))
    leaves = glb.material("leaf", (1.0, 1.0, 1.0), texture=glb.texture(png(32, 32, leaf, 4), "leaf"))
    glb.doc["materials"][leaves]["alphaMode"] = "MASK"
    glb.object("ground", Shape().quad((-20, 0, 20), (20, 0, 20), (20, 0, -20), (-20, 0, -20)), ground)
    draw = random.Random(1)
    crown = Shape()
    for _ in range(4000):
        while True:
            p = [draw.uniform(-1, 1) for _ in range(3)]
            if 0.3 < sum(c * c for c in p) < 1:
                break
        at = (1.3 * p[0], 2.6 + 1.1 * p[1], 1.3 * p[2])
        a = [draw.gauss(0, 1) for _ in range(3)]
        b = [draw.gauss(0, 1) for _ in range(3)]
        la = 0.07 / math.sqrt(sum(c * c for c in a))
        dot = sum(x * y for x, y in zip(a, b)) / sum(c * c for c in a)
        b = [y - dot * x for x, y in zip(a, b)]
        lb = 0.1 / math.sqrt(sum(c * c for c in b))
        corner = lambda s, t: tuple(c + s * la * x + t * lb * y for c, x, y in zip(at, a, b))  # noqa: E731
        crown.quad(corner(-1, -1), corner(1, -1), corner(1, 1), corner(-1, 1), (1, 1))
    crown_mesh = glb.mesh("crown", crown, leaves)
    trunk_mesh = glb.mesh("trunk", Shape().box((-0.12, 0, -0.12), (0.12, 2.4, 0.12)), bark)
    for i in range(6):
        turn = 1.1 * i
        place = dict(translation=[-3.2 + 1.9 * (i % 3) + 0.4 * (i // 3), 0, -1.2 - 2.3 * (i // 3)],
                     rotation=[0, math.sin(turn / 2), 0, math.cos(turn / 2)], scale=[1, 0.85 + 0.06 * i, 1])
        glb.node(f"crown {i}", mesh=crown_mesh, **place)
        glb.node(f"trunk {i}", mesh=trunk_mesh, **place)
    sun_of(glb, (0.5, -1.0, -0.4), 12.0)
    glb.camera("camera", (0.6, 1.3, 4.2), (-1.0, 1.8, -1.5), math.radians(60), 1.0)


def scene(name, options):
    """Writes the scene's file; returns it and what trex render needs besides."""
    path = os.path.join(options.out, name + ".glb")
    if name == "lamps":
        street(path, 4096, 4096)
        return path, []
    glb = Glb()
    if name == "media":
        sun(glb)
        glb.write(path)
        volume = os.path.join(options.out, "cube.vdb")
        make = os.path.join(os.path.dirname(os.path.abspath(options.trex)), "make_vdb")
        subprocess.run([make, "cube", volume], check=True)
        return path, ["--env", "0.5,0.7,1.0", "--volume", f"{volume}?scale=3.9&move=0,1.95,0&density=0.25&g=0.5"]
    {"caustics": caustics, "glossy": glossy, "foliage": foliage}[name](glb)
    glb.write(path)
    return path, ["--env", "0.6,0.8,1.2"] if name == "foliage" else []


def render(options, path, more, out, arguments):
    command = [options.trex, "render", path, "-o", out, "--size", options.size, "--json", "-q", *more, *arguments, *options.rest]
    return json.loads(subprocess.run(command, check=True, stdout=subprocess.PIPE).stdout)


def difference(options, a, b):
    found = subprocess.run([options.trex, "diff", a, b, "--json"], stdout=subprocess.PIPE, text=True)
    return json.loads(found.stdout)


def truth(options, name, path, more):
    """The true picture, the mean of two halves; the same without noise, for FLIP alone; and its own relMSE."""
    out = os.path.join(options.out, f"{name}-truth-{options.truth}-{options.size}.exr")
    halves = [out.replace("truth", f"half{seed}") for seed in (101, 102)]
    if not all(map(os.path.exists, (out, *halves))):
        for seed, half in zip((101, 102), halves):
            render(options, path, more, half, ["--exact", "1", "--spp", str(options.truth // 2), "--seed", str(seed),
                                               "--denoise", "off", "--device", "none", "--aov", "variance,sampleCount,albedo,normal"])
        subprocess.run([options.trex, "merge", *halves, "-o", out], check=True, stdout=subprocess.DEVNULL)
    clean = out.replace("truth", "clean")
    if not os.path.exists(clean) and subprocess.run([options.trex, "denoise", out, "-o", clean]).returncode != 0:
        clean = out
    return out, clean, difference(options, *halves)["relmse_trimmed"] / 4


def strip(options, name, pictures, true, stops):
    """The pictures side by side, and the share of exact samples of the last."""
    import numpy, OpenEXR
    from PIL import Image

    def channels(path, names):
        found = OpenEXR.File(path, separate_channels=True).channels()
        return numpy.stack([found[n].pixels.astype(float) for n in names], -1)

    shown = [numpy.clip(2 ** stops * channels(p, "RGB"), 0, 1) ** (1 / 2.2) for p in (*pictures, true)]
    share = channels(pictures[-1], ["exactShare"])
    shown.append(numpy.repeat(numpy.clip(share, 0, 1), 3, -1))
    os.makedirs(options.pictures, exist_ok=True)
    Image.fromarray((255 * numpy.concatenate(shown, 1)).astype("uint8")).save(
        os.path.join(options.pictures, name + ".jpg"), quality=88)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--trex", default=os.path.join(ROOT, "build/trex"))
    parser.add_argument("--only", default=",".join(SCENES))
    parser.add_argument("--exact", default="auto")
    parser.add_argument("--seconds", default="1,4,16")
    parser.add_argument("--truth", type=int, default=1024)
    parser.add_argument("--size", default="256x256")
    parser.add_argument("--out", default=os.path.join(ROOT, "build/hard"))
    parser.add_argument("--pictures")
    parser.add_argument("rest", nargs="*")
    options = parser.parse_args()
    for name in options.only.split(","):
        if name not in SCENES:
            parser.error(f"--only {name}: want some of {','.join(SCENES)}")
    os.makedirs(options.out, exist_ok=True)
    print("| scene | FLIP | relMSE | mean / truth | samples | exact share | the truth's own relMSE |\n" + "|---" * 7 + "|")
    for name in options.only.split(","):
        with contextlib.redirect_stdout(sys.stderr):
            path, more = scene(name, options)
        true, clean, noise = truth(options, name, path, more)
        rows, pictures = [], []
        for seconds in options.seconds.split(","):
            out = os.path.join(options.out, f"{name}-{options.exact}-{seconds}s.exr")
            layers = ["--aov", "exactShare"] if options.exact == "auto" else []
            report = render(options, path, more, out, ["--exact", options.exact, "--time", seconds, *layers])
            found = {**difference(options, out, true), "flip": difference(options, out, clean)["flip"]}
            rows.append((found["flip"], found["relmse_trimmed"], found["mean_ratio"], report["samples"], report["exact_share"]))
            pictures.append(out)
            print(json.dumps({"scene": name, "seconds": float(seconds), "flip": found["flip"], "relmse": found["relmse_trimmed"],
                              "mean_ratio": found["mean_ratio"], "samples": report["samples"],
                              "exact_share": report["exact_share"], "denoiser": report.get("denoiser")}), file=sys.stderr)
        columns = [" ".join(form.format(r[i]) for r in rows) for i, form in
                   enumerate(("{:.3f}", "{:.4f}", "{:.3f}", "{}", "{:.2f}"))]
        print(f"| {name} | " + " | ".join(columns) + f" | {noise:.5f} |", flush=True)
        if options.pictures:
            strip(options, name, pictures, true, found["exposure_stops"])


if __name__ == "__main__":
    main()
