#!/usr/bin/env python3
"""Extremes as a user meets them: numbers in files that are none, pictures of few and many pixels.

A model with such numbers is either refused (exit 3, one line) or rendered without a single sample
that is not finite, with a quarter of the samples traced exactly.
"""
import json, os, struct

import program
from program import ProgramTest, run

NAN, INFINITY, DENORMAL, HUGE = float("nan"), float("inf"), 1e-42, 3e38


def glb(tree, payload=b""):
    """A .glb of a JSON tree, or of JSON text, and a binary chunk."""
    text = (tree if isinstance(tree, str) else json.dumps(tree)).encode()
    text += b" " * (-len(text) % 4)
    payload += b"\0" * (-len(payload) % 4)
    body = struct.pack("<II", len(text), 0x4E4F534A) + text
    if payload:
        body += struct.pack("<II", len(payload), 0x004E4942) + payload
    return struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body


class Model:
    """Two quads, a floor and a lamp, with normals, texture coordinates and colors."""

    def __init__(self):
        self.arrays = {
            "POSITION": [[-1, 0, 1], [1, 0, 1], [1, 0, -1], [-1, 0, -1],
                         [-1, 1, -1], [1, 1, -1], [1, 1, 1], [-1, 1, 1]],
            "NORMAL": [[0, 1, 0]] * 4 + [[0, -1, 0]] * 4,
            "TEXCOORD_0": [[0, 0], [1, 0], [1, 1], [0, 1]] * 2,
            "COLOR_0": [[1.0, 0.9, 0.8, 1.0]] * 8,
        }
        self.floor = {"baseColorFactor": [0.7, 0.7, 0.7, 1], "metallicFactor": 0.2,
                      "roughnessFactor": 0.5}
        self.lamp = {"emissiveFactor": [1, 1, 1], "pbrMetallicRoughness": {"metallicFactor": 0}}
        self.floor_extensions = {}
        self.node = {"mesh": 0}
        self.camera = {"yfov": 0.9, "znear": 0.01}
        self.camera_node = {"camera": 0, "translation": [0, 0.5, 3]}
        self.lights = []

    def set(self, name, vertex, value, count=1):
        """Puts `value` into all parts of `count` vertices from `vertex` on."""
        for i in range(vertex, vertex + count):
            self.arrays[name][i] = [value] * len(self.arrays[name][i])
        return self

    def bytes(self):
        payload, views, accessors, attributes = b"", [], [], {}

        def add(data, **accessor):
            nonlocal payload
            views.append({"buffer": 0, "byteOffset": len(payload), "byteLength": len(data)})
            payload += data
            accessors.append({"bufferView": len(views) - 1, **accessor})
            return len(accessors) - 1

        for name, rows in self.arrays.items():
            data = b"".join(struct.pack(f"<{len(r)}f", *r) for r in rows)
            attributes[name] = add(data, componentType=5126, count=len(rows),
                                   type=f"VEC{len(rows[0])}")
        primitives = []
        for material, first in ((0, 0), (1, 4)):
            corners = [first + k for k in (0, 1, 2, 0, 2, 3)]
            indices = add(struct.pack("<6H", *corners), componentType=5123, count=6, type="SCALAR")
            primitives.append({"attributes": attributes, "indices": indices, "material": material})
        nodes = [self.node, self.camera_node]
        tree = {
            "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0, 1]}], "nodes": nodes,
            "meshes": [{"primitives": primitives}],
            "materials": [{"pbrMetallicRoughness": self.floor, "extensions": self.floor_extensions},
                          self.lamp],
            "cameras": [{"type": "perspective", "perspective": self.camera}],
            "accessors": accessors, "bufferViews": views,
            "buffers": [{"byteLength": len(payload)}]}
        if self.lights:
            tree["extensionsUsed"] = ["KHR_lights_punctual"]
            tree["extensions"] = {"KHR_lights_punctual": {"lights": self.lights}}
            nodes.append({"extensions": {"KHR_lights_punctual": {"light": 0}},
                          "translation": [0.2, 0.6, 0.1]})
            tree["scenes"][0]["nodes"].append(2)
        # JSON has no NaN; a number too large for a double is what a file can hold.
        text = json.dumps(tree).replace("NaN", "null").replace("Infinity", "1e999")
        return glb(text, payload)


def float_exr(width, height, value):
    """An uncompressed .exr of three float channels; value(x, y) gives R, G, B."""
    def attribute(name, kind, body):
        return name.encode() + b"\0" + kind.encode() + b"\0" + struct.pack("<i", len(body)) + body

    channels = b"".join(c + b"\0" + struct.pack("<iBxxxii", 2, 0, 1, 1) for c in (b"B", b"G", b"R"))
    window = struct.pack("<4i", 0, 0, width - 1, height - 1)
    header = b"\x76\x2f\x31\x01" + struct.pack("<i", 2) + b"".join((
        attribute("channels", "chlist", channels + b"\0"),
        attribute("compression", "compression", b"\0"), attribute("dataWindow", "box2i", window),
        attribute("displayWindow", "box2i", window), attribute("lineOrder", "lineOrder", b"\0"),
        attribute("pixelAspectRatio", "float", struct.pack("<f", 1)),
        attribute("screenWindowCenter", "v2f", struct.pack("<2f", 0, 0)),
        attribute("screenWindowWidth", "float", struct.pack("<f", 1)))) + b"\0"
    row = 8 + 12 * width
    table = b"".join(struct.pack("<Q", len(header) + 8 * height + y * row) for y in range(height))
    rows = b"".join(
        struct.pack("<ii", y, 12 * width) +
        b"".join(struct.pack(f"<{width}f", *(value(x, y)[c] for x in range(width)))
                 for c in (2, 1, 0)) for y in range(height))
    return header + table + rows


class Extremes(ProgramTest):
    def setUp(self):
        super().setUp()
        self.out = self.path("out.exr")

    def survives(self, model, *more, refused=None):
        """Renders finite samples alone, or ends with exit 3. Gives the summary, None if refused."""
        data = model.bytes() if isinstance(model, Model) else model
        result = run("render", self.write("m.glb", data), "-o", self.out, "--size", "12x12", "--spp",
                     8, "--exact", 0.25, "--device", "none", "--json", *more)
        self.assertIn(result.returncode, (0, 3), result.stderr)
        if refused is not None:
            self.assertEqual(result.returncode, 3 if refused else 0, result.stderr)
        if result.returncode == 3:
            lines = [x for x in result.stderr.splitlines() if "error:" in x]
            self.assertEqual(len(lines), 1, result.stderr)
            return None
        summary = json.loads(result.stdout)
        self.assertEqual(summary["nonfinite_samples"], 0, result.stderr)
        return summary

    def test_sound_model(self):
        self.assertEqual(self.survives(Model(), refused=False)["triangles"], 4)

    def test_positions(self):
        for value, left in ((NAN, 2), (INFINITY, 2), (-INFINITY, 2)):
            summary = self.survives(Model().set("POSITION", 0, value), refused=False)
            self.assertEqual(summary["triangles"], left)  # both of the floor share the vertex
        for value in (DENORMAL, HUGE, -HUGE, 1e20):
            with self.subTest(value=value):
                self.survives(Model().set("POSITION", 0, value))
        self.survives(Model().set("POSITION", 0, DENORMAL, 4), refused=False)

    def test_no_triangle_left(self):
        self.survives(Model().set("POSITION", 0, NAN, 8), refused=True)

    def test_normals_coordinates_colors(self):
        values = (NAN, INFINITY, DENORMAL, HUGE, -INFINITY, 0.0, -1.0, -HUGE)
        for name in ("NORMAL", "TEXCOORD_0", "COLOR_0"):
            with self.subTest(name=name):
                model = Model()
                for vertex, value in enumerate(values):
                    model.set(name, vertex, value)
                self.survives(model, refused=False)
                self.survives(Model().set(name, 0, NAN, 8), refused=False)

    def test_material_factors(self):
        for key in ("baseColorFactor", "metallicFactor", "roughnessFactor"):
            for value in (INFINITY, HUGE, -1.0):
                with self.subTest(key=key, value=value):
                    model = Model()
                    model.floor[key] = [value] * 4 if key == "baseColorFactor" else value
                    self.survives(model)

    def test_material_extensions(self):
        for name, key in (("ior", "ior"), ("specular", "specularFactor"),
                          ("transmission", "transmissionFactor"),
                          ("emissive_strength", "emissiveStrength")):
            for value in (INFINITY, HUGE, 0.0, -1.0):
                with self.subTest(key=key, value=value):
                    model = Model()
                    model.floor_extensions = {"KHR_materials_" + name: {key: value}}
                    self.survives(model)

    def test_emission(self):
        for value in (INFINITY, 1e30, DENORMAL, -1.0):
            with self.subTest(value=value):
                model = Model()
                model.lamp["emissiveFactor"] = [value] * 3
                self.survives(model)

    def test_lights(self):
        for kind in ("point", "directional"):
            for value in (INFINITY, 1e30, DENORMAL, -1.0):
                with self.subTest(kind=kind, value=value):
                    model = Model()
                    model.lights = [{"type": kind, "intensity": value}]
                    self.survives(model)

    def test_transforms(self):
        for value in (INFINITY, 1e308, HUGE, 1e9, 1e-30, 0.0):
            with self.subTest(value=value):
                model = Model()
                model.node = {"mesh": 0, "translation": [value, 0, 0]}
                self.survives(model)
                model.node = {"mesh": 0, "scale": [value] * 3}
                self.survives(model)
                model.node = {"mesh": 0, "rotation": [value] * 4}
                self.survives(model)

    def test_far_from_the_origin(self):
        """All nodes 5e6 m away: the same bytes."""
        pictures = []
        for far in (0.0, 5e6):
            model = Model()
            model.node = {"mesh": 0, "translation": [far, -far, far]}
            model.camera_node = {"camera": 0, "translation": [far, 0.5 - far, 3 + far]}
            out = self.path("far.png")
            result = run("render", self.write("m.glb", model.bytes()), "-o", out, "--size", "48x48",
                         "--spp", 16, "--exact", 0.25, "--device", "none", "--exposure", 0)
            self.assertEqual(result.returncode, 0, result.stderr)
            with open(out, "rb") as f:
                pictures.append(f.read())
        self.assertEqual(pictures[0], pictures[1])

    def test_cameras_of_the_file(self):
        for value in (INFINITY, 1e308, HUGE, 1e-30, 0.0, -1.0):
            with self.subTest(value=value):
                model = Model()
                model.camera_node = {"camera": 0, "translation": [value, 0.5, 3]}
                self.survives(model)
                model = Model()
                model.camera["yfov"] = value
                self.survives(model)

    def test_cameras_of_the_command_line(self):
        model = self.write("m.glb", Model().bytes())
        for camera in ("nan,0,0/0,0,1/0,1,0/40", "inf,0,0/0,0,1/0,1,0/40", "0,0,0/0,0,0/0,1,0/40",
                       "0,0,0/0,0,1/0,0,1/40", "0,0,0/0,0,1/0,1,0/nan"):
            with self.subTest(camera=camera):
                result = run("render", model, "-o", self.out, "--size", "8x8", "--spp", 1,
                             "--device", "none", "--camera", camera, "--json")
                self.assertIn(result.returncode, (0, 2), result.stderr)
                if result.returncode == 0:
                    self.assertEqual(json.loads(result.stdout)["nonfinite_samples"], 0)
        self.survives(Model(), "--camera", "1e30,0,0/0,0,0/0,1,0/40", refused=False)
        self.survives(Model(), "--camera", "0,1e-40,1/0,0,0/0,1,0/1e-6", refused=False)

    def test_environments(self):
        for color in ("nan,0,0", "inf,1,1", "-1,0,0", "1e999,0,0"):
            result = run("render", self.write("m.glb", Model().bytes()), "-o", self.out, "--env",
                         color, "--size", "8x8", "--spp", 1)
            self.assertEqual(result.returncode, 2, (color, result.stderr))
        for color in ("1e-42,0,0", "3e38,3e38,3e38"):
            self.survives(Model(), "--env", color, refused=False)

    def test_environment_map(self):
        bad = {(1, 1): NAN, (2, 1): INFINITY, (3, 1): -INFINITY, (4, 1): -5.0, (5, 1): DENORMAL,
               (6, 1): HUGE}
        sky = float_exr(16, 8, lambda x, y: (bad.get((x, y), 0.5),) * 3)
        self.survives(Model(), "--env", self.write("sky.exr", sky), refused=False)

    def test_empty_scenes(self):
        self.survives(glb({"asset": {"version": "2.0"}, "scenes": [{"nodes": []}], "scene": 0}),
                      refused=True)
        ply = ("ply\nformat ascii 1.0\nelement vertex 0\nproperty float x\nproperty float y\n"
               "property float z\nend_header\n")
        for name, text in (("e.obj", "v 0 0 0\n"), ("e.ply", ply)):
            result = run("render", self.write(name, text.encode()), "-o", self.out)
            self.assertEqual(result.returncode, 3, result.stderr)

    def test_sizes(self):
        model = self.write("m.glb", Model().bytes())
        for size in ("1x1", "16384x4", "4x16384"):
            for exact in (0, 1):
                result = run("render", model, "-o", self.out, "--size", size, "--spp", 1, "--exact",
                             exact, "--json")
                self.assertEqual(result.returncode, 0, result.stderr)
                summary = json.loads(result.stdout)
                self.assertEqual(f"{summary['width']}x{summary['height']}", size)
                self.assertEqual(summary["nonfinite_samples"], 0)
        os.remove(self.out)
        result = run("render", model, "-o", self.out, "--size", "16384x16384", "--max-memory", "1G")
        self.assertEqual(result.returncode, 4, result.stderr)
        self.assertFalse(os.path.exists(self.out))
        result = run("render", model, "-o", self.out, "--size", "0x16")
        self.assertEqual(result.returncode, 2, result.stderr)


if __name__ == "__main__":
    program.main()
