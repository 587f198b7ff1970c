#!/usr/bin/env python3
"""Tests of the formats that assimp reads: the same picture as of OBJ, units and axes, lights, cameras, materials, textures, and
files that break the process that reads them."""
import json, math, os, signal, subprocess, time

import assimp_files as files, program, two_sets_test as sets

POINTS = [(0, 0, 0), (1, 0, 0), (1, 0, 1.5), (0, 0, 1.5), (0.25, 2, 0.5)]
FACES = [(0, 1, 2), (0, 2, 3), (0, 4, 1), (1, 4, 2), (2, 4, 3), (3, 4, 0)]
COLOR = (0.75, 0.25, 0.125)


class Assimp(program.ProgramTest):
    def write_obj(self, points, color, faces=FACES):
        self.write("model.mtl", "newmtl paint\n" + (f"Kd {files.triple(color)}\n" if color else ""))
        return self.write("model.obj", files.obj(points, faces, color))

    def info(self, path, *options):
        p = program.run("info", path, "--json", *options)
        self.assertEqual(p.returncode, 0, p.stderr)
        return json.loads(p.stdout)

    def picture(self, path, name, *options):
        out = self.path(name)
        p = program.run("render", path, "-o", out, "--size", "48x48", "--spp", 16, "--exact", 1, "--device", "none", "-q",
                "--camera", "3,2.5,4/0.5,0.7,0.5/0,1,0/40", "--env", "1,1,1", *options)
        self.assertEqual(p.returncode, 0, p.stderr)
        return out

    def assert_same(self, path, reference, *options):
        """Within what two meshes with other numbers of vertices may differ in rounding."""
        self.assert_equal(self.picture(path, "a.exr", *options), self.picture(reference, "b.exr"))

    def assert_equal(self, a, b, limit=1e-6):
        p = program.run("diff", a, b, "--json", "--max", limit, "--metric", "relmse")
        self.assertEqual(p.returncode, 0, f"{a}: {json.loads(p.stdout)['relmse'] if p.stdout else p.stderr}")

    def test_pictures_are_those_of_obj(self):
        references = {}  # by axes and colour
        for extension, (writer, colored, axes) in files.FORMATS.items():
            with self.subTest(extension):
                color = COLOR if colored is True else colored or None
                model = self.write("model." + extension, writer(POINTS, FACES, COLOR))
                if (axes, color) not in references:
                    points = {"y": POINTS, "z": [(x, z, -y) for x, y, z in POINTS], "left": [(x, y, -z) for x, y, z in POINTS]}[axes]
                    faces = [f[::-1] for f in FACES] if axes == "left" else FACES
                    references[axes, color] = self.picture(self.write_obj(points, color, faces), f"{len(references)}.exr")
                self.assert_equal(self.picture(model, "a.exr"), references[axes, color])

    def test_a_file_that_knows_its_unit_and_what_is_up(self):
        reference = self.write_obj([(x, z, -y) for x, y, z in POINTS], COLOR)
        large = [tuple(100 * c for c in p) for p in POINTS]
        for name, data in (("m.fbx", files.fbx(large, FACES, COLOR, unit=1.0, up=2)),
                           ("m.dae", files.dae(large, FACES, COLOR, unit=0.01, up="Z_UP"))):
            model = self.write(name, data)
            self.assert_same(model, reference)
            self.assertEqual(program.run("info", model, "--unit", "mm").returncode, 2)

    def test_unit_and_up_of_others(self):
        small = self.write("m.off", files.off([tuple(1000 * c for c in p) for p in POINTS], FACES, COLOR))
        reference = self.write_obj([(x, z, -y) for x, y, z in POINTS], None)
        self.assert_same(small, reference, "--unit", "mm", "--up", "z")
        self.assertIn("tells no unit", program.run("info", small).stderr)

    def test_lights_and_cameras(self):
        libraries = """<library_cameras><camera id="c" name="eye"><optics><technique_common><perspective><xfov>60</xfov>
<aspect_ratio>1.5</aspect_ratio><znear>0.1</znear><zfar>10</zfar></perspective></technique_common></optics></camera></library_cameras>
<library_lights><light id="l"><technique_common><point><color>0.5 1 1</color><constant_attenuation>0</constant_attenuation>
<linear_attenuation>0</linear_attenuation><quadratic_attenuation>1</quadratic_attenuation></point></technique_common></light>
<light id="s"><technique_common><directional><color>1 1 1</color></directional></technique_common></light>
<light id="a"><technique_common><ambient><color>1 1 1</color></ambient></technique_common></light></library_lights>"""
        nodes = """<node id="camera"><translate>0 0 5</translate><instance_camera url="#c"/></node>
<node id="lamp"><translate>0 3 0</translate><instance_light url="#l"/></node>
<node id="sun"><rotate>1 0 0 -90</rotate><instance_light url="#s"/></node><node id="glow"><instance_light url="#a"/></node>"""
        model = self.write("m.dae", files.dae(POINTS, FACES, COLOR, unit=0.5, libraries=libraries, nodes=nodes))
        scene = self.info(model)
        self.assertEqual(scene["cameras"], ["camera"])
        self.assertTrue(any("ambient" in t or "kind that is not shown" in t for t in scene["replaced"]), scene["replaced"])
        # A lamp 1.5 m above a floor of 1 m: pi/4 W/sr for half of the file's unit gives (pi 0.25 / 1.5^2) / pi of radiance.
        floor = self.write("f.dae", files.dae([(-1, 0, -1), (1, 0, -1), (1, 0, 1), (-1, 0, 1)], [(0, 2, 1), (0, 3, 2)], (1, 1, 1),
                                              unit=0.5, libraries=libraries, nodes=nodes.split("\n")[1]))
        self.write("r.mtl", "newmtl glow\nKd 0 0 0\nKe %.9g %.9g %.9g\n" % tuple(c * 0.25 / 2.25 for c in (0.5, 1, 1)))
        glow = self.write("r.obj", "mtllib r.mtl\nv -9 0 -9\nv 9 0 -9\nv 9 0 9\nv -9 0 9\nusemtl glow\nf 1 3 2\nf 1 4 3\n")
        pictures = [self.path(name) for name in ("f.exr", "r.exr")]
        for scene, picture in zip((floor, glow), pictures):
            p = program.run("render", scene, "-o", picture, "--size", "1x1", "--spp", 64, "--exact", 1, "--device", "none", "-q",
                    "--camera", "0,1,0/0,0,0/0,0,1/0.1")
            self.assertEqual(p.returncode, 0, p.stderr)
        self.assert_equal(*pictures, limit=1e-5)

    def test_textures_and_emission(self):
        texels = [(255, 0, 0), (0, 255, 0), (0, 0, 255), (255, 255, 255)]
        self.write("tex ture.png", program.png(len(texels), texels))
        square = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
        uv = [(0, 0), (1, 0), (1, 1), (0, 1)]
        ac = ('AC3Db\nMATERIAL "paint" rgb 1 1 1  amb 0 0 0  emis 0 0 0  spec 0 0 0  shi 0  trans 0\nOBJECT world\nkids 1\nOBJECT poly\n'
              'texture "C:\\\\art\\\\Tex Ture.PNG"\nnumvert 4\n'.replace("\\\\", "\\") + "".join(f"{files.triple(p)}\n" for p in square) +
              "numsurf 1\nSURF 0x20\nmat 0\nrefs 4\n" + "".join(f"{i} {u} {v}\n" for i, (u, v) in enumerate(uv)) + "kids 0\n")
        self.write("t.mtl", "newmtl paint\nKd 1 1 1\nmap_Kd tex ture.png\n")
        reference = self.write("t.obj", "mtllib t.mtl\n" + "".join(f"v {files.triple(p)}\n" for p in square) + "".join(
            f"vt {u} {v}\n" for u, v in uv) + "usemtl paint\nf 1/1 2/2 3/3 4/4\n")
        model = self.write("t.ac", ac)
        self.assert_same(model, reference)
        self.assertIn("tex ture.png", " ".join(s["path"] for s in self.info(model)["sources"]))
        self.write("t.mtl", "newmtl paint\nKd 1 1 1\nmap_Kd tex ture.png\nKe 0.5 0.25 0\n")
        self.assert_same(self.write("t.ac", ac.replace("emis 0 0 0", "emis 0.5 0.25 0")), reference)

    def test_maps_of_their_own(self):
        """Roughness, metalness and opacity, as FBX has them in images of one thing each and OBJ too."""
        def grey(*values):
            return [(v,) * 3 for v in values]
        maps = {"base": [(255, 128, 64), (64, 128, 255)], "rough": grey(40, 120, 200, 255), "metal": grey(0, 255),
                "mask": grey(255, 96, 255)}
        for name, texels in maps.items():
            self.write(f"{name}.png", program.png(len(texels), texels))
        square, uv, faces = [(-1, 0, -1), (2, 0, -1), (2, 0, 2), (-1, 0, 2)], [(0, 0), (1, 0), (1, 1), (0, 1)], [(0, 2, 1), (0, 3, 2)]
        mesh = "mtllib m.mtl\nusemtl paint\n" + "".join(f"v {files.triple(p)}\n" for p in square) + "".join(
            f"vt {u} {v}\n" for u, v in uv) + "".join("f " + " ".join(f"{i + 1}/{i + 1}" for i in f) + "\n" for f in faces)
        for used in (("base", "rough", "metal", "mask"), ("metal",), ("mask",), ("base", "mask"), ("rough", "metal")):
            names = {"base": ("DiffuseColor", "map_Kd"), "rough": ("Maya|TEX_roughness_map", "map_Pr"),
                     "metal": ("ReflectionFactor", "map_Pm"), "mask": ("TransparencyFactor", "map_d")}
            self.write("m.mtl", "newmtl paint\nKd 1 1 1\n" + "".join(f"{names[k][1]} {k}.png\n" for k in used))
            reference = self.write("m.obj", mesh)
            model = self.write("m.fbx", files.fbx_with_maps(square, faces, uv, {names[k][0]: f"{k}.png" for k in used}))
            self.assertEqual(self.info(model)["replaced"], [], used)
            self.assert_same(model, reference)
        bare = self.picture(self.write("bare.fbx", files.fbx_with_maps(square, faces, uv, {})), "bare.exr")
        p = program.run("diff", bare, self.picture(model, "maps.exr"), "--metric", "relmse", "--max", 1e-3)
        self.assertEqual(p.returncode, 6, "the maps show")

    def test_two_sets_of_texture_coordinates(self):
        def turned_over(rows):
            return [(u, 1 - v) for u, v in rows]
        self.write("base.png", program.png(2, sets.BASE))
        self.write("glow.png", program.png(2, sets.GLOW))
        model = self.write("two.dae", files.dae_of_two_sets(sets.CORNERS, turned_over(sets.UPRIGHT), turned_over(sets.TURNED)))
        material = {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}, "metallicFactor": 0}, "emissiveFactor": [1, 1, 1],
                    "emissiveTexture": {"index": 1, "texCoord": 1}}
        glb = sets.Glb(material, [sets.BASE, sets.GLOW], {0: sets.UPRIGHT, 1: sets.TURNED})
        glb.tree["scenes"] = [{"nodes": [0]}]
        glb.tree["samplers"] = [{}]
        self.assert_same(model, self.write("two.glb", glb.bytes()))

    def big(self, name="big.off", rows=700):
        """A file that takes assimp a second or two."""
        n = rows + 1
        points = "".join(f"{i / rows:.6f} {math.sin(i * 0.1):.6f} {j / rows:.6f}\n" for i in range(n) for j in range(n))
        faces = "".join(f"3 {a} {a + 1} {a + n}\n3 {a + 1} {a + n + 1} {a + n}\n" for i in range(rows) for a in range(i * n, i * n + rows))
        return self.write(name, f"OFF\n{n * n} {2 * rows * rows} 0\n{points}{faces}")

    def test_a_file_that_needs_too_much_memory(self):
        model = self.big()
        p = program.run("render", model, "-o", self.path("x.png"), "--size", "8x8", "--max-memory", "64M", "-q")
        self.assertEqual(p.returncode, 4, p.stderr)
        self.assertIn("big.off: assimp needs more than", p.stderr)

    def child_of(self, parent):
        for _ in range(2000):
            with open(f"/proc/{parent}/task/{parent}/children") as f:
                children = f.read().split()
            if children:
                return int(children[0])
            time.sleep(0.002)
        self.fail("no child")

    def test_a_child_that_is_killed(self):
        model = self.big()
        for number, code in ((signal.SIGKILL, 3), (signal.SIGSEGV, 3), (signal.SIGINT, 130)):
            p = program.start("info", model, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
            os.kill(self.child_of(p.pid), number)
            said = p.communicate(timeout=60)[1]
            self.assertEqual(p.returncode, code, said)
            self.assertIn("big.off", said)

    def test_the_child_ends_with_its_parent(self):
        p = program.start("info", self.big(), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        child = self.child_of(p.pid)
        p.kill()
        p.wait()
        for _ in range(500):
            try:
                with open(f"/proc/{child}/stat") as f:
                    if f.read().split()[2] == "Z":
                        return
            except FileNotFoundError:
                return
            time.sleep(0.01)
        self.fail("the child lives on")

    def test_broken_files(self):
        for extension in ("3ds", "3mf", "amf", "dae", "fbx", "off", "x", "x3d"):  # of others any part is whole
            data = files.FORMATS[extension][0](POINTS, FACES, COLOR)
            data = data if isinstance(data, bytes) else data.encode()
            p = program.run("info", self.write("bad." + extension, data[:len(data) // 3]))
            self.assertEqual(p.returncode, 3, p.stderr)
            self.assertIn("bad." + extension, p.stderr)
        p = program.run("info", self.write("bad.fbx", "no model"))
        self.assertEqual(p.returncode, 3)
        self.assertIn("assimp can't read it", p.stderr)


if __name__ == "__main__":
    program.main()
