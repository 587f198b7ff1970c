#!/usr/bin/env python3
"""Tests of --point-size: what clouds of points cover, in closed form, of a file, in memory and from a streamed bundle; its errors."""
import json, struct

import program
from exr_file import exr_bytes, rgb

SIDE = 10  # points along a square of one metre
SIZE = 0.05


def cloud(normals, text=False, points=None):
    """Black points on the square from 0 to 1 of the plane z = 0."""
    points = points or [((i + 0.5) / SIDE, (j + 0.5) / SIDE, 0) for i in range(SIDE) for j in range(SIDE)]
    floats = ["x", "y", "z"] + ["nx", "ny", "nz"] * normals
    head = (f"ply\nformat {'ascii' if text else 'binary_little_endian'} 1.0\nelement vertex {len(points)}\n" +
            "".join(f"property float {f}\n" for f in floats) + "".join(f"property uchar {c}\n" for c in ("red", "green", "blue")) +
            "end_header\n").encode()
    rows = [(*p, *(0, 0, 2) * normals) for p in points]
    if text:
        return head + "".join(" ".join(map(str, r)) + " 0 0 0\n" for r in rows).encode()
    return head + b"".join(struct.pack(f"<{len(floats)}f3B", *r, 0, 0, 0) for r in rows)


class Points(program.ProgramTest):
    def expect_cover(self, model, share, *options):
        """One pixel that sees the square in a sky of 1."""
        picture, right = self.path("a.exr"), self.write("right.exr", exr_bytes(1, 1, rgb([(1 - share,) * 3])))
        self.trex("render", model, "-o", picture, "--size", "1x1", "--spp", 4096, "--exact", 1, "--device", "none", "-q",
                  "--env", "1,1,1", "--camera", "0.5,0.5,100/0.5,0.5,0/0,1,0/0.57295302", *options)  # 2 atan(1 / 200)
        self.trex("diff", picture, right, "--metric", "rmse", "--max", 0.01)

    def test_what_they_cover(self):
        for normals, share in ((True, 100 * SIZE ** 2), (False, 50 * SIZE ** 2)):
            for text in (False, True):
                model, bundle = self.write("a.ply", cloud(normals, text)), self.path("a.trex")
                self.expect_cover(model, share, "--point-size", SIZE)
                if text:
                    continue
                for options in ((), ("--stream",)):
                    self.trex("bake", model, "-o", bundle, "--point-size", SIZE, *options)
                    info = json.loads(self.trex("info", bundle, "--json"))
                    self.assertEqual(info["triangles"], SIDE * SIDE * (2 if normals else 8))
                    self.expect_cover(bundle, share)
        self.expect_cover(self.write("a.ply", cloud(True)), 4 * share * 2, "--point-size", 2 * SIZE)

    def test_errors(self):
        model, out = self.write("a.ply", cloud(False)), self.path("x.png")
        self.assertIn("--point-size METRES shows them", self.trex("render", model, "-o", out, code=3))
        for bad in ("0", "-1", "nan", "inf", "x", "1e10", ""):
            self.trex("render", model, "-o", out, f"--point-size={bad}", code=2)
        self.trex("info", self.write("a.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"), "--point-size", 1, code=2)

    def test_a_cloud_that_does_not_fit(self):
        points = [(i * 0.01, j * 0.01, 0) for i in range(600) for j in range(600)]
        model, bundle = self.write("a.ply", cloud(False, points=points)), self.path("a.trex")
        said = self.trex("render", model, "-o", self.path("x.png"), "--size", "8x8", "--max-memory", "90M",
                         "--point-size", 0.01, code=4)
        self.assertIn("--stream", said)
        baked = json.loads(self.trex("bake", model, "-o", bundle, "--max-memory", "280M", "--point-size", 0.01, "--json", "-q"))
        self.assertTrue(baked["streamed"])
        self.assertLess(baked["peak_resident_bytes"], 280 << 20)


if __name__ == "__main__":
    program.main()
