#!/usr/bin/env python3
"""Makes the committed references of the image tests: refs/NAME.exr, mean and variance of the mean.

    make_refs.py [NAME ...] [--trex build/trex]

Run with the Python of the shared folder's peers/setup.sh (TREX_SHARED or ../shared). Mitsuba 3
renders 64 passes of 128 samples, 64x64, of `glass`, whose light it finds by chance alone, 96 of
1024. It can't express `coats`: that one is our own exact mode
with another seed than the tests use, 16384 samples. The file's metadata `trex:reference` says
which. Channels: R, G, B and variance.R, .G, .B, whose mantissas are cut to 8 bits to keep the files
small.
"""
import argparse, os, subprocess, sys, tempfile

import mitsuba as mi
import numpy as np

mi.set_variant("scalar_rgb")
HERE = os.path.dirname(os.path.abspath(__file__))
ROOT = os.path.dirname(os.path.dirname(HERE))
SHARED = os.environ.get("TREX_SHARED", os.path.join(os.path.dirname(ROOT), "shared"))
ENVIRONMENT = {"sun": "1,1.5,2"}
OWN = {"coats"}
PASSES = {"glass": (96, 1024)}
OWN_SEED, OWN_SAMPLES = 977, 16384


def pixels(path):
    return np.array(mi.Bitmap(path), dtype=np.float32)


def by_mitsuba(name, scene, folder):
    passes, samples = PASSES.get(name, (64, 128))
    mean, variance = os.path.join(folder, "mean.exr"), os.path.join(folder, "variance.exr")
    subprocess.run([sys.executable, "-W", "ignore", os.path.join(SHARED, "peers/render_mitsuba.py"),
                    scene, mean, "--variance", variance, "--size", "64x64", "--spp",
                    str(samples), "--passes", str(passes), "--depth", "65", "--env", ENVIRONMENT.get(name, "0,0,0")],
                   check=True)
    return pixels(mean), pixels(variance), f"Mitsuba {mi.__version__}, {passes * samples} samples"


def by_ourselves(name, scene, folder, trex):
    out = os.path.join(folder, "own.exr")
    subprocess.run([trex, "render", scene, "-o", out, "--size", "64x64", "--exact", "1",
                    "--spp", str(OWN_SAMPLES), "--seed", str(OWN_SEED), "--aov", "variance", "-q"],
                   check=True)
    bitmap = mi.Bitmap(out)
    names = [bitmap.struct_()[i].name for i in range(bitmap.channel_count())]
    values = np.array(bitmap, dtype=np.float32)
    pick = lambda wanted: values[..., [names.index(w) for w in wanted]]
    return (pick(["R", "G", "B"]), pick(["variance.R", "variance.G", "variance.B"]),
            f"own exact mode, seed {OWN_SEED}, {OWN_SAMPLES} samples")


def cut_mantissa(values):
    bits = np.ascontiguousarray(values, dtype=np.float32).view(np.uint32)
    return ((bits + 0x4000) & np.uint32(0xFFFF8000)).view(np.float32)


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*")
    parser.add_argument("--trex", default=os.path.join(ROOT, "build/trex"))
    a = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run([sys.executable, os.path.join(HERE, "scenes.py"), folder], check=True)
        scenes = sorted(f[:-4] for f in os.listdir(folder) if f.endswith(".glb"))
        for name in a.names or scenes:
            scene = os.path.join(folder, name + ".glb")
            mean, variance, source = (by_ourselves(name, scene, folder, a.trex) if name in OWN
                                      else by_mitsuba(name, scene, folder))
            both = np.concatenate([mean, cut_mantissa(variance)], axis=2)
            bitmap = mi.Bitmap(both, channel_names=["R", "G", "B", "variance.R", "variance.G",
                                                    "variance.B"])
            bitmap.metadata()["trex:reference"] = source
            target = os.path.join(HERE, "refs", name + ".exr")
            bitmap.write(target)
            print(target, os.path.getsize(target), mean.mean((0, 1)))


if __name__ == "__main__":
    main()
