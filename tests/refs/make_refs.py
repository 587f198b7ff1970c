#!/usr/bin/env python3
"""Makes the committed references: mean and variance of many independent renders by Mitsuba 3.

    make_refs.py      (run with the Python of the shared folder's peers/setup.sh; TREX_SHARED or ../shared)

assets/cornell.glb at 64x64, 64 passes of 256 samples: cornell.exr, and cornell.var.exr, the variance of
that mean.
"""
import os, subprocess, sys

HERE = os.path.dirname(os.path.abspath(__file__))
ROOT = os.path.dirname(os.path.dirname(HERE))
SHARED = os.environ.get("TREX_SHARED", os.path.join(os.path.dirname(ROOT), "shared"))

subprocess.run([sys.executable, "-W", "ignore", os.path.join(SHARED, "peers/render_mitsuba.py"),
                os.path.join(ROOT, "assets/cornell.glb"), os.path.join(HERE, "cornell.exr"),
                "--variance", os.path.join(HERE, "cornell.var.exr"),
                "--size", "64x64", "--spp", "256", "--passes", "64", "--depth", "65"], check=True)
