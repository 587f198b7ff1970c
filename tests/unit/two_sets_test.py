#!/usr/bin/env python3
"""Tests of materials whose textures read two sets of coordinates: pictures in closed form, of a file, of bundles and of a streamed
bundle read page by page."""
import json, math, struct

import exr_file, program

SIDE = 8  # pixels; textures are of 2 x 2 texels, each a quarter of the picture
IRRADIANCE = math.pi
BASE = [(255, 0, 0), (0, 255, 0), (0, 0, 255), (255, 255, 255)]
GLOW = [(255, 255, 255), (0, 0, 0), (0, 0, 255), (255, 0, 0)]
# A normal leans along +u, +v, or not at all.
LEANING = [(204, 128, 229), (128, 204, 229), (128, 128, 255), (52, 128, 229)]
CORNERS = [(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)]
UPRIGHT = [(0, 1), (1, 1), (1, 0), (0, 0)]
TURNED = [(0, 0), (0, 1), (1, 1), (1, 0)]  # u runs up the square, v to the right


class Glb:
    """A square that fills the picture of an orthographic camera, under a sun along `light`."""
    def __init__(self, material, images, sets, light=(0, 0, 1)):
        self.data = b""
        self.tree = {"asset": {"version": "2.0"}, "scene": 0, "bufferViews": [], "accessors": [], "images": [],
                     "samplers": [{"magFilter": 9728, "wrapS": 33071, "wrapT": 33071}], "textures": []}
        attributes = {"POSITION": self.accessor("<f", CORNERS, 5126, "VEC3")}
        self.tree["accessors"][0].update(min=[-1, -1, 0], max=[1, 1, 0])
        for number, coordinates in sets.items():
            attributes[f"TEXCOORD_{number}"] = self.accessor("<f", coordinates, 5126, "VEC2")
        indices = self.accessor("<H", [(0,), (1,), (2,), (0,), (2,), (3,)], 5123, "SCALAR")
        for texels in images:
            self.tree["images"].append({"bufferView": self.view(program.png(2, texels)), "mimeType": "image/png"})
            self.tree["textures"].append({"source": len(self.tree["textures"]), "sampler": 0})
        material.setdefault("extensions", {})["KHR_materials_specular"] = {"specularFactor": 0}
        half = [c / 2 for c in light]  # of the half way from +z to the light
        half[2] += 0.5
        length = math.sqrt(sum(c * c for c in half))
        turn = [-half[1] / length, half[0] / length, 0, half[2] / length]
        self.tree.update({
            "extensionsUsed": ["KHR_lights_punctual", "KHR_materials_specular"],
            "extensions": {"KHR_lights_punctual": {"lights": [{"type": "directional", "intensity": IRRADIANCE}]}},
            "materials": [material], "cameras": [{"type": "orthographic", "orthographic": {
                "xmag": 1, "ymag": 1, "znear": 0.1, "zfar": 10}}],
            "meshes": [{"primitives": [{"attributes": attributes, "indices": indices, "material": 0}]}],
            "nodes": [{"mesh": 0}, {"camera": 0, "translation": [0, 0, 2]},
                      {"rotation": turn, "extensions": {"KHR_lights_punctual": {"light": 0}}}],
            "scenes": [{"nodes": [0, 1, 2]}], "buffers": [{}]})

    def view(self, data):
        self.data += b"\0" * (-len(self.data) % 4)
        self.tree["bufferViews"].append({"buffer": 0, "byteOffset": len(self.data), "byteLength": len(data)})
        self.data += data
        return len(self.tree["bufferViews"]) - 1

    def accessor(self, form, rows, kind, shape):
        view = self.view(b"".join(struct.pack(form, c) for row in rows for c in row))
        self.tree["accessors"].append({"bufferView": view, "componentType": kind, "count": len(rows), "type": shape})
        return len(self.tree["accessors"]) - 1

    def bytes(self):
        self.data += b"\0" * (-len(self.data) % 4)
        self.tree["buffers"][0]["byteLength"] = len(self.data)
        text = json.dumps(self.tree).encode()
        text += b" " * (-len(text) % 4)
        body = struct.pack("<II", len(text), 0x4E4F534A) + text + struct.pack("<II", len(self.data), 0x004E4942) + self.data
        return struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body


def upright(texels, row, column):
    return texels[2 * row + column]


def turned(texels, row, column):
    """By TURNED: the picture's right is v, its up is u."""
    return texels[2 * column + 1 - row]


def picture(pixel):
    """{channel: values} of a function of the quarter's row and column."""
    return exr_file.rgb([pixel(2 * y // SIDE, 2 * x // SIDE) for y in range(SIDE) for x in range(SIDE)])


class TwoSets(program.ProgramTest):
    def assert_shows(self, model, wanted, lights, *options):
        """Without noise where there is one light; else it is chance which one a sample looks at."""
        samples, limit = (4, 2e-3) if lights == 1 else (128, 0.4)
        self.trex("render", model, "-o", self.path("got.exr"), "--size", f"{SIDE}x{SIDE}", "--spp", samples, "--exact", 1, "--device",
                  "none", "--threads", 1, "--env", "0,0,0", "-q", *options)
        p = program.run("diff", self.path("got.exr"), self.write("wanted.exr", exr_file.exr_bytes(SIDE, SIDE, wanted)), "--json")
        differ = json.loads(p.stdout)
        self.assertLess(differ["max_error"], limit, model)
        self.assertLess(abs(differ["mean_ratio"] - 1), 0.02, model)

    def assert_everywhere(self, glb, pixel, lights=1):
        """As it is, baked, and streamed."""
        wanted = picture(pixel)
        model = self.write("model.glb", glb.bytes())
        self.assert_shows(model, wanted, lights, "--strict")
        for name, options in (("whole.trex", ()), ("stream.trex", ("--stream",))):
            self.trex("bake", model, "-o", self.path(name), "-q", *options)
            self.assert_shows(self.path(name), wanted, lights, *(("--cache", "2000") if options else ()))

    def test_base_color_with_its_alpha_and_emission(self):
        base = [(*color, alpha) for color, alpha in zip(BASE, (255, 0, 255, 255))]
        material = {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0, "texCoord": 1}, "metallicFactor": 0},
                    "alphaMode": "MASK", "emissiveFactor": [1, 1, 1], "emissiveTexture": {"index": 1}}

        def pixel(row, column):
            *color, alpha = turned(base, row, column)
            return [alpha / 255 * (a + b) / 255 for a, b in zip(color, upright(GLOW, row, column))]
        self.assert_everywhere(Glb(material, [base, GLOW], {0: UPRIGHT, 1: TURNED}), pixel, lights=2)

    def test_normal_maps_lean_along_their_own_set(self):
        light = (0.48, 0.36, 0.8)
        for first, at, along in ((0, upright, lambda u, v: (u, v)), (1, turned, lambda u, v: (-v, u))):
            material = {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0, "texCoord": 1 - first}, "metallicFactor": 0},
                        "normalTexture": {"index": 1, "texCoord": first}}
            glb = Glb(material, [BASE, LEANING], {0: UPRIGHT, 1: TURNED}, light)
            other = upright if first == 1 else turned

            def pixel(row, column):
                # Along +u and up the texture, which is -v.
                u, up, z = (2 * c / 255 - 1 for c in at(LEANING, row, column))
                normal = (*along(u, up), z)
                length = math.sqrt(sum(c * c for c in normal))
                cosine = sum(a * b for a, b in zip(normal, light)) / length
                return [cosine * c / 255 for c in other(BASE, row, column)]
            if first == 0:
                self.assert_shows(self.write("model.glb", glb.bytes()), picture(pixel), 1)
            else:
                self.assert_everywhere(glb, pixel)

    def test_a_third_set_is_said(self):
        material = {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}, "emissiveFactor": [1, 1, 1],
                    "emissiveTexture": {"index": 0, "texCoord": 1}, "occlusionTexture": {"index": 0, "texCoord": 3},
                    "normalTexture": {"index": 0, "texCoord": 2}}
        odd = [(0, 0), (1, 0.1), (0.2, 1), (0.7, 0.3)]
        model = self.write("model.glb", Glb(material, [BASE], {0: UPRIGHT, 1: TURNED, 2: odd, 3: odd}).bytes())
        p = program.run("render", model, "-o", self.path("x.png"), "--strict")
        self.assertEqual(p.returncode, 3)
        self.assertIn("coordinate sets 2, 0 and 1; set 2 is used for 1", p.stderr)


if __name__ == "__main__":
    program.main()
