#!/usr/bin/env python3
"""Pictures of pbrt scenes: radiances in closed form, the same picture as of the same OBJ file, and not mirrored."""
import json

import program
from exr_file import exr_bytes, rgb

FLOOR = 'Shape "trianglemesh" "point P" [-9 0 -9  9 0 -9  9 0 9  -9 0 9] "integer indices" [0 2 1 0 3 2]\n'
# One degree around the floor's middle, from above.
DOWN = ('Scale -1 1 1\nLookAt 0 3 0  0 0 0  0 0 1\nFilm "{}"\nCamera "perspective" "float fov" 1\nWorldBegin\n'
        'Material "{}" "rgb {}" [.5 .25 .125]\n')
V3, V4 = DOWN.format("image", "matte", "Kd"), DOWN.format("rgb", "diffuse", "reflectance")


class PbrtTest(program.ProgramTest):
    def render(self, source, name, *arguments):
        out = self.path(name)
        self.trex("render", source, "-o", out, "--exact", "1", "--device", "none", *arguments)
        return out

    def expect_radiance(self, scene, color, error=0.002):
        picture = self.render(self.write("a.pbrt", scene), "a.exr", "--size", "4x4", "--spp", "64")
        right = self.write("right.exr", exr_bytes(4, 4, rgb([color] * 16)))
        self.trex("diff", picture, right, "--metric", "rmse", "--max", error * max(color))

    def test_radiances(self):
        pi = 3.14159265
        # E = I / r^2 = 8 pi / 4, times albedo / pi.
        point = f'LightSource "point" "point from" [0 2 0] "rgb I" [{8 * pi} {8 * pi} {8 * pi}]\n'
        self.expect_radiance(V3 + point + FLOOR, (1, 0.5, 0.25))
        # Luminous power 4 pi I.
        power = f'LightSource "point" "point3 from" [0 2 0] "float power" {32 * pi * pi}\n'
        self.expect_radiance(V4 + power + FLOOR, (1, 0.5, 0.25))
        distant = f'LightSource "distant" "point from" [0 4 3] "point to" [0 0 0] "rgb L" [{pi} {pi} {pi}]\n'
        self.expect_radiance(V3 + distant + FLOOR, (0.4, 0.2, 0.1))
        self.expect_radiance(V3 + 'LightSource "infinite" "rgb L" [2 4 8]\n' + FLOOR, (1, 1, 1), 0.02)
        shining = 'AreaLightSource "diffuse" "rgb L" [1 2 3] "float scale" 2\nMaterial "matte" "rgb Kd" [0 0 0]\n'
        self.expect_radiance(V3 + shining + FLOOR, (2, 4, 6))
        # The floor's back does not shine.
        dark = 'LightSource "infinite" "rgb L" [.0001 .0001 .0001]\n' + shining + "ReverseOrientation\n"
        self.expect_radiance(V3 + dark + FLOOR, (0, 0, 0.0001), 10)

    def test_bounces(self):
        # Within a sphere that shines and scatters half of what arrives: 1 + 1/2 + 1/4 ...
        furnace = ('Integrator "path" "integer maxdepth" {}\nFilm "image"\nCamera "perspective" "float fov" 60\n'
                   'WorldBegin\nAreaLightSource "diffuse" "rgb L" [1 1 1]\nMaterial "matte" "rgb Kd" [.5 .5 .5]\n'
                   'ReverseOrientation\nShape "sphere"\n')
        for most, right in ((0, 1), (1, 1.5), (3, 1.875)):
            self.expect_radiance(furnace.format(most), (right,) * 3, 0.02)
        scene, bundle = self.write("a.pbrt", furnace.format(1)), self.path("a.trex")
        for options in ((), ("--stream",)):
            self.trex("bake", scene, "-o", bundle, *options)
            for model in (scene, bundle):
                self.assertEqual(json.loads(self.trex("info", model, "--json"))["max_bounces"], 1)
                self.assertIn("at most 1", self.trex("info", model))
            made = self.path("synth.trex")
            self.trex("bake", "synth:assembly?triangles=1e3", "-o", made, "--max-bounces", "3", *options)
            self.assertEqual(json.loads(self.trex("info", made, "--json"))["max_bounces"], 3)
        limited = self.render(bundle, "b.exr", "--size", "4x4", "--spp", "64")
        self.trex("diff", self.render(scene, "c.exr", "--size", "4x4", "--spp", "64"), limited, "--metric", "rmse", "--max", "0.002")
        for most, right in (("all", 2), ("2", 1.75)):
            for model in (scene, bundle):
                picture = self.render(model, "d.exr", "--size", "4x4", "--spp", "256", "--max-bounces", most)
                exact = self.write("right.exr", exr_bytes(4, 4, rgb([(right,) * 3] * 16)))
                self.trex("diff", picture, exact, "--metric", "rmse", "--max", "0.03")
        for bad in ("-1", "x", "1.5", "4294967295", ""):
            self.trex("render", scene, "-o", limited, f"--max-bounces={bad}", code=2)

    def test_picture_of_the_same_obj(self):
        corners = [(0, 0, 0), (2, 0, 0.5), (1, 2, 0), (-1, 1, 1)]
        faces = [(0, 1, 2), (0, 2, 3)]
        obj = self.write("a.obj", "".join("v {} {} {}\n".format(*c) for c in corners) +
                         "".join("f {} {} {}\n".format(*(i + 1 for i in f)) for f in faces))
        numbers = " ".join(str(x) for c in corners for x in c)
        scene = ('Material "matte" "rgb Kd" [.6 .6 .6]\nShape "trianglemesh" "point P" [%s] "integer indices" [%s]\n'
                 % (numbers, " ".join(str(i) for f in faces for i in f)))
        head = 'Scale -1 1 1\nLookAt 1 1 8  0.5 0.9 0  0 1 0\nCamera "perspective" "float fov" 30\nWorldBegin\n'
        pbrt = self.write("a.pbrt", head + scene)
        view = ["--size", "24x24", "--spp", "4", "--env", "1,2,3"]
        theirs = self.render(obj, "obj.exr", "--camera", "1,1,8/0.5,0.9,0/0,1,0/30", *view)
        self.assertIn("equal bits      yes", self.trex("diff", self.render(pbrt, "pbrt.exr", *view), theirs))
        # Without the mirroring Scale, pbrt shows x to the right of a viewer who looks along +z.
        mirrored = self.write("m.pbrt", head.replace("Scale -1 1 1\n", "") + scene)
        self.trex("diff", self.render(mirrored, "m.exr", *view), theirs, code=6)
        flipped = [(-x, y, z) for x, y, z in corners]
        other = self.write("f.obj", "".join("v {} {} {}\n".format(*c) for c in flipped) +
                           "".join("f {} {} {}\n".format(*(i + 1 for i in f)) for f in faces))
        seen = self.render(other, "f.exr", "--camera", "-1,1,8/-0.5,0.9,0/0,1,0/30", *view)
        self.trex("diff", self.path("m.exr"), seen, "--metric", "rmse", "--max", "1e-3")


if __name__ == "__main__":
    program.main()
