#!/usr/bin/env python3
"""Makes the references of the tests of Mitsuba scenes: refs/NAME.exr of mitsuba/NAME.xml by Mitsuba 3
itself, as make_refs.py does for the others.

    make_mitsuba_refs.py [NAME ...]      (run with a Python that has mitsuba and numpy)

NAME is one of mitsuba/, or of the folders in TREX_SHARED/scenes/mitsuba: refs/mitsuba-NAME.exr.
"""
import os, re, sys

import mitsuba as mi
import numpy as np

mi.set_variant(os.environ.get("MI_VARIANT", "scalar_rgb"))
HERE = os.path.dirname(os.path.abspath(__file__))
SHARED = os.environ.get("TREX_SHARED", os.path.join(HERE, "../../../shared"))
PASSES, SAMPLES, SIDE = 32, int(os.environ.get("SAMPLES", 64)), 64


def cut_mantissa(values):
    bits = np.ascontiguousarray(values, dtype=np.float32).view(np.uint32)
    return ((bits + 0x4000) & np.uint32(0xFFFF8000)).view(np.float32)


def render(path):
    """Mean and variance of the mean of independent pictures, box filter, paths of any length."""
    with open(path) as f:
        named = re.search(r'<integrator type="\$(\w+)"', f.read())
    scene = mi.load_file(path, **({named[1]: "path"} if named else {}))
    film = {"type": "hdrfilm", "width": SIDE, "height": SIDE, "pixel_format": "rgb",
            "component_format": "float32", "rfilter": {"type": "box"}}
    seen = scene.sensors()[0]
    width, height = seen.film().size()
    x_fov = np.radians(np.array(mi.traverse(seen)["x_fov"]).ravel()[0])
    y_fov = float(np.degrees(2 * np.arctan(np.tan(x_fov / 2) * height / width)))
    sensor = mi.load_dict({
        "type": "perspective", "fov": y_fov, "fov_axis": "y",
        "near_clip": 1e-3, "far_clip": 1e7, "film": film, "sampler": {"type": "independent"},
        "to_world": mi.ScalarTransform4f(np.array(seen.world_transform().matrix).reshape(4, 4))})
    integrator = mi.load_dict({"type": "path", "max_depth": -1})
    passes = np.array([np.array(mi.render(scene, sensor=sensor, integrator=integrator, spp=SAMPLES, seed=i))
                       for i in range(PASSES)], dtype=np.float64)
    return passes.mean(0).astype(np.float32), (passes.var(0, ddof=1) / PASSES).astype(np.float32)


for name in sys.argv[1:] or sorted(f[:-4] for f in os.listdir(os.path.join(HERE, "mitsuba"))):
    own = os.path.join(HERE, "mitsuba", name + ".xml")
    shared = os.path.join(SHARED, "scenes/mitsuba", name, "scene.xml")
    mean, variance = render(own if os.path.exists(own) else os.path.abspath(shared))
    name = name if name.startswith("mitsuba-") else "mitsuba-" + name
    bitmap = mi.Bitmap(np.concatenate([mean, cut_mantissa(variance)], axis=2),
                       channel_names=["R", "G", "B", "variance.R", "variance.G", "variance.B"])
    bitmap.metadata()["trex:reference"] = f"Mitsuba {mi.__version__}, {PASSES * SAMPLES} samples"
    target = os.path.join(HERE, "refs", name + ".exr")
    bitmap.write(target)
    print(target, os.path.getsize(target), mean.mean((0, 1)))
