#!/usr/bin/env python3
"""What textures take of memory and time, as the tables of docs/textures.md.

  texture_table.py --trex build/trex [--images 54] [--side 2048] SCENE...

The first table: texels of each SCENE in memory and in a bundle, and what a render takes with all of them, and through tiles
with half. The second: a room of --images pictures under smaller and smaller limits. Seconds are of the processor, user and
system, of rendering alone: with as little as possible rendered they are taken away."""
import argparse, filecmp, json, os, resource, subprocess, sys, tempfile

sys.path.insert(0, os.path.join(os.path.dirname(__file__), "..", "unit"))
import textured_room

MIB = 1 << 20


def run(*arguments):
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    p = subprocess.run([options.trex, *map(str, arguments), "--json", "-q"], capture_output=True, text=True)
    if p.returncode != 0:
        sys.exit(p.stderr)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    out = json.loads(p.stdout)
    out["processor_seconds"] = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return out


def render(model, picture, exact, *more, size="320x180", spp=16):
    return run("render", model, "-o", picture, "--size", size, "--spp", spp, "--exact", exact, "--device", "none",
               "--denoise", "off", "--threads", 1, *more)


def timed(model, name, exact, limit, *more):
    """Seconds of a render, which keeps to a limit unless that is 0, and what it says of itself."""
    limits = ("--texture-memory", limit) if limit else ()
    picture = os.path.join(folder, name)
    start = render(model, picture, exact, *limits, *more, size="4x4", spp=1)
    said = render(model, picture, exact, *limits, *more)
    return said["processor_seconds"] - start["processor_seconds"], said


def check_same(a, b):
    if not filecmp.cmp(os.path.join(folder, a), os.path.join(folder, b), shallow=False):
        sys.exit(f"{a} and {b} are not the same picture")


def scenes():
    print("| scene | texels, MiB | in its bundle | exact 1, s | in half the memory | exact 0, s | in half the memory |")
    print("|---|---|---|---|---|---|---|")
    for scene in options.scenes:
        said = run("bake", scene, "-o", os.path.join(folder, "x.trex"), "--depth", 4)
        texels = render(scene, os.path.join(folder, "a.exr"), 1, size="4x4", spp=1)["texture_bytes"]
        row = [os.path.basename(scene).split(".")[0], f"{texels / MIB:.1f}", f"{said['texture_bytes'] / MIB:.1f}"]
        for exact in (1, 0):
            limit = max(texels // 2, 2 * MIB)
            row.append(f"{timed(scene, 'all.exr', exact, 0)[0]:.2f}")
            row.append(f"{timed(scene, 'some.exr', exact, limit)[0]:.2f}")
            check_same("all.exr", "some.exr")
        print("| " + " | ".join(row) + " |", flush=True)


def room():
    source = textured_room.write_room(folder, options.images, options.side)
    model = os.path.join(folder, "room.trex")
    baked = run("bake", source, "-o", model, "--depth", 6)
    texels = options.images * options.side ** 2 * 3
    print(f"\n{options.images} pictures of {options.side} x {options.side}, {texels / MIB:.0f} MiB of texels, "
          f"{baked['texture_bytes'] / MIB:.0f} in the bundle\n")
    print("| `--texture-memory` | peak of textures, MiB | of the process | exact 1, s | tiles read | exact 0, s | tiles read |")
    print("|---|---|---|---|---|---|---|")
    for share in (1, 2, 4, 10, 40):
        limit = 0 if share == 1 else texels // share
        row = ["all" if share == 1 else f"1/{share}"]
        for exact in (1, 0):
            name = ("some" if limit else "all") + f"{exact}.exr"
            seconds, said = timed(model, name, exact, limit, "--camera", textured_room.CAMERA)
            if exact == 1:
                row += [f"{said['texture_peak_bytes'] / MIB:.0f}", f"{said['peak_resident_bytes'] / MIB:.0f}"]
            row += [f"{seconds:.1f}", str(said.get("texture_loads", 0))]
            if limit:
                check_same(f"all{exact}.exr", name)
        print("| " + " | ".join(row) + " |", flush=True)
    print("\nWithin 1/10, 1280 x 720, 2 samples a pixel, exact: ", end="")
    for bounces, what in ((0, "what the camera sees"), ("all", "all light")):
        said = render(model, os.path.join(folder, "x.exr"), 1, "--camera", textured_room.CAMERA, "--max-bounces", bounces,
                      "--texture-memory", texels // 10, size="1280x720", spp=2)
        print(f"{said['texture_loads']} tiles for {what}", end="; " if bounces == 0 else "\n")


parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
parser.add_argument("scenes", nargs="*")
parser.add_argument("--trex", required=True)
parser.add_argument("--images", type=int, default=54)
parser.add_argument("--side", type=int, default=2048)
options = parser.parse_args()
options.trex = os.path.abspath(options.trex)
with tempfile.TemporaryDirectory(prefix="trex-textures-") as folder:
    scenes()
    room()
