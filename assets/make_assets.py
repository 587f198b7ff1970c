#!/usr/bin/env python3
"""Writes the small scenes of our own: cornell.glb and gallery.glb, beside this script.

  python3 assets/make_assets.py [FOLDER]

Plain Python, no packages; the same bytes on every run. Conventions: metres, y up, Lambertian surfaces
are dielectrics with KHR_materials_specular's specularFactor 0, a surface shines from its front
(counter-clockwise) side only.

cornell.glb: the measured data of the Cornell box, as published by the Cornell Program of Computer
Graphics: millimetres divided by 100 (so the room is 5.5 across), reflectances as linear Rec. 709.
gallery.glb: a closed room with a window, a sun and glowing panels, coloured walls, metal, mirror,
glass, vertex colours, a textured floor and columns that are instances of one mesh.
"""
import json
import math
import os
import struct
import sys
import zlib


class Glb:
    """Collects the parts of a glTF file and writes them as one .glb."""

    def __init__(self):
        self.doc = {
            "asset": {"version": "2.0", "generator": "make_assets.py"},
            "scene": 0, "scenes": [{"nodes": []}], "nodes": [], "meshes": [], "materials": [],
            "accessors": [], "bufferViews": [], "buffers": [{}], "cameras": [],
        }
        self.data = bytearray()
        self.extensions = set()

    def view(self, data, target=None):
        self.data += b"\0" * (-len(self.data) % 4)
        view = {"buffer": 0, "byteOffset": len(self.data), "byteLength": len(data)}
        if target:
            view["target"] = target
        self.data += data
        self.doc["bufferViews"].append(view)
        return len(self.doc["bufferViews"]) - 1

    def accessor(self, rows, kind):
        """kind: position, normal, uv, color or index. Returns the accessor's number."""
        form, component, shape = {
            "position": ("<3f", 5126, "VEC3"), "normal": ("<3f", 5126, "VEC3"),
            "uv": ("<2f", 5126, "VEC2"), "color": ("<4B", 5121, "VEC4"),
            "index": ("<H", 5123, "SCALAR"),
        }[kind]
        flat = [(r,) for r in rows] if kind == "index" else rows
        data = b"".join(struct.pack(form, *row) for row in flat)
        entry = {"bufferView": self.view(data, 34963 if kind == "index" else 34962),
                 "componentType": component, "count": len(rows), "type": shape}
        if kind == "color":
            entry["normalized"] = True
        if kind == "position":
            as_float = [struct.unpack("<3f", struct.pack("<3f", *r)) for r in rows]
            entry["min"] = [min(p[k] for p in as_float) for k in range(3)]
            entry["max"] = [max(p[k] for p in as_float) for k in range(3)]
        self.doc["accessors"].append(entry)
        return len(self.doc["accessors"]) - 1

    def extend(self, target, name, body):
        self.extensions.add(name)
        target.setdefault("extensions", {})[name] = body

    def material(self, name, color, metallic=0.0, roughness=1.0, specular=0.0, emission=None,
                 double_sided=True, texture=None, glass=None):
        pbr = {"baseColorFactor": list(color) + [1.0], "metallicFactor": metallic,
               "roughnessFactor": roughness}
        if texture is not None:
            pbr["baseColorTexture"] = {"index": texture}
        made = {"name": name, "pbrMetallicRoughness": pbr, "doubleSided": double_sided}
        if metallic == 0.0 and specular != 1.0:
            self.extend(made, "KHR_materials_specular", {"specularFactor": specular})
        if emission:
            strength = max(emission)
            made["emissiveFactor"] = [e / strength for e in emission]
            self.extend(made, "KHR_materials_emissive_strength", {"emissiveStrength": strength})
        if glass:
            self.extend(made, "KHR_materials_transmission", {"transmissionFactor": 1.0})
            self.extend(made, "KHR_materials_ior", {"ior": glass["ior"]})
            self.extend(made, "KHR_materials_volume", {
                "thicknessFactor": glass["thickness"], "attenuationColor": glass["color"],
                "attenuationDistance": glass["distance"]})
        self.doc["materials"].append(made)
        return len(self.doc["materials"]) - 1

    def texture(self, png, name):
        self.doc.setdefault("images", []).append(
            {"bufferView": self.view(png), "mimeType": "image/png", "name": name})
        self.doc.setdefault("samplers", [{"wrapS": 10497, "wrapT": 10497}])
        self.doc.setdefault("textures", []).append(
            {"source": len(self.doc["images"]) - 1, "sampler": 0})
        return len(self.doc["textures"]) - 1

    def mesh(self, name, shape, material):
        attributes = {"POSITION": self.accessor(shape.positions, "position")}
        for key, rows, kind in (("NORMAL", shape.normals, "normal"),
                                ("TEXCOORD_0", shape.uvs, "uv"),
                                ("COLOR_0", shape.colors, "color")):
            if rows:
                attributes[key] = self.accessor(rows, kind)
        self.doc["meshes"].append({"name": name, "primitives": [{
            "attributes": attributes, "indices": self.accessor(shape.indices, "index"),
            "material": material}]})
        return len(self.doc["meshes"]) - 1

    def node(self, name, **properties):
        self.doc["nodes"].append({"name": name, **properties})
        self.doc["scenes"][0]["nodes"].append(len(self.doc["nodes"]) - 1)
        return self.doc["nodes"][-1]

    def object(self, name, shape, material, **properties):
        self.node(name, mesh=self.mesh(name, shape, material), **properties)

    def camera(self, name, eye, target, fov, aspect):
        self.doc["cameras"].append({"name": name, "type": "perspective", "perspective": {
            "yfov": fov, "znear": 0.01, "zfar": 100.0, "aspectRatio": aspect}})
        self.node(name, camera=len(self.doc["cameras"]) - 1,
                  matrix=look_at(eye, target))

    def write(self, path):
        self.doc["extensionsUsed"] = sorted(self.extensions)
        self.doc["buffers"][0]["byteLength"] = len(self.data)
        text = json.dumps(self.doc, separators=(",", ":")).encode()
        text += b" " * (-len(text) % 4)
        data = bytes(self.data) + b"\0" * (-len(self.data) % 4)
        blob = struct.pack("<4sII", b"glTF", 2, 12 + 8 + len(text) + 8 + len(data))
        blob += struct.pack("<I4s", len(text), b"JSON") + text
        blob += struct.pack("<I4s", len(data), b"BIN\0") + data
        with open(path, "wb") as out:
            out.write(blob)
        print(f"{path}: {len(blob)} bytes")


class Shape:
    """Triangles with their attributes; parts can be joined."""

    def __init__(self):
        self.positions, self.normals, self.uvs, self.colors, self.indices = [], [], [], [], []

    def quad(self, a, b, c, d, uv_scale=None):
        """Counter-clockwise corners as seen from the front."""
        base = len(self.positions)
        self.positions += [a, b, c, d]
        self.indices += [base, base + 1, base + 2, base, base + 2, base + 3]
        if uv_scale:
            u, v = uv_scale
            self.uvs += [(0, 0), (u, 0), (u, v), (0, v)]
        return self

    def box(self, lower, upper):
        (x0, y0, z0), (x1, y1, z1) = lower, upper
        self.quad((x0, y0, z1), (x1, y0, z1), (x1, y1, z1), (x0, y1, z1))
        self.quad((x1, y0, z0), (x0, y0, z0), (x0, y1, z0), (x1, y1, z0))
        self.quad((x1, y0, z1), (x1, y0, z0), (x1, y1, z0), (x1, y1, z1))
        self.quad((x0, y0, z0), (x0, y0, z1), (x0, y1, z1), (x0, y1, z0))
        self.quad((x0, y1, z1), (x1, y1, z1), (x1, y1, z0), (x0, y1, z0))
        self.quad((x0, y0, z0), (x1, y0, z0), (x1, y0, z1), (x0, y0, z1))
        return self


def sub(a, b):
    return tuple(x - y for x, y in zip(a, b))


def cross(a, b):
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def unit(a):
    length = math.sqrt(sum(x * x for x in a))
    return tuple(x / length for x in a)


def look_at(eye, target):
    """Column-major matrix of something at eye that looks at target along its -z."""
    back = unit(sub(eye, target))
    right = unit(cross((0, 1, 0), back))
    up = cross(back, right)
    return [*right, 0, *up, 0, *back, 0, *eye, 1]


def revolution(profile, segments, color=None):
    """Turns (radius, height) pairs, from the bottom to the top, around the y axis; smooth."""
    shape = Shape()
    count = len(profile)
    for i, (radius, height) in enumerate(profile):
        r0, h0 = profile[max(i - 1, 0)]
        r1, h1 = profile[min(i + 1, count - 1)]
        slope = unit((h1 - h0, r0 - r1, 0))
        for j in range(segments + 1):
            angle = 2 * math.pi * j / segments
            c, s = math.cos(angle), math.sin(angle)
            shape.positions.append((radius * c, height, -radius * s))
            normal = (slope[0] * c, slope[1], -slope[0] * s)
            if radius == 0:
                normal = (0, -1 if i == 0 else 1, 0)
            shape.normals.append(unit(normal))
            if color:
                shape.colors.append(color(i / (count - 1), j / segments))
    row = segments + 1
    for i in range(count - 1):
        for j in range(segments):
            a, b, c, d = i * row + j, i * row + j + 1, (i + 1) * row + j + 1, (i + 1) * row + j
            if profile[i][0] > 0:
                shape.indices += [a, b, c]
            if profile[i + 1][0] > 0:
                shape.indices += [a, c, d]
    return shape


def sphere(radius, rings, segments):
    profile = []
    for i in range(rings + 1):
        angle = math.pi * i / rings
        r = 0.0 if i in (0, rings) else radius * math.sin(angle)
        profile.append((r, -radius * math.cos(angle)))
    shape = revolution(profile, segments)
    shape.normals = [unit(p) for p in shape.positions]
    return shape


def png(width, height, pixel, channels=3):
    """An 8-bit PNG of RGB, or RGBA with channels 4; pixel(x, y) gives that many bytes."""
    rows = b"".join(b"\0" + bytes(v for x in range(width) for v in pixel(x, y))
                    for y in range(height))

    def chunk(kind, body):
        return (struct.pack(">I", len(body)) + kind + body +
                struct.pack(">I", zlib.crc32(kind + body)))

    return (b"\x89PNG\r\n\x1a\n" +
            chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 6 if channels == 4 else 2, 0, 0, 0)) +
            chunk(b"IDAT", zlib.compress(rows, 9)) + chunk(b"IEND", b""))


def cornell(path):
    glb = Glb()
    white = glb.material("white", (0.885809, 0.698859, 0.666422))
    green = glb.material("green", (0.105421, 0.37798, 0.076425))
    red = glb.material("red", (0.570068, 0.0430135, 0.0443706))
    light = glb.material("light", (0.78, 0.78, 0.78), emission=(17.0, 12.512, 5.1),
                         double_sided=False)

    def quads(name, material, corners):
        shape = Shape()
        for quad in corners:
            shape.quad(*[tuple(v / 100 for v in p) for p in quad])
        glb.object(name, shape, material)

    # The published corners run around each face as seen from inside the room (room) or from outside
    # (blocks); x grows to the left of the camera, which looks along +z.
    quads("room", white, [
        [(552.8, 0, 0), (0, 0, 0), (0, 0, 559.2), (549.6, 0, 559.2)],
        [(556, 548.8, 0), (556, 548.8, 559.2), (0, 548.8, 559.2), (0, 548.8, 0)],
        [(549.6, 0, 559.2), (0, 0, 559.2), (0, 548.8, 559.2), (556, 548.8, 559.2)]])
    quads("right wall", green, [[(0, 0, 559.2), (0, 0, 0), (0, 548.8, 0), (0, 548.8, 559.2)]])
    quads("left wall", red, [[(552.8, 0, 0), (549.6, 0, 559.2), (556, 548.8, 559.2), (556, 548.8, 0)]])
    quads("short block", white, [
        [(130, 165, 65), (82, 165, 225), (240, 165, 272), (290, 165, 114)],
        [(290, 0, 114), (290, 165, 114), (240, 165, 272), (240, 0, 272)],
        [(130, 0, 65), (130, 165, 65), (290, 165, 114), (290, 0, 114)],
        [(82, 0, 225), (82, 165, 225), (130, 165, 65), (130, 0, 65)],
        [(240, 0, 272), (240, 165, 272), (82, 165, 225), (82, 0, 225)]])
    quads("tall block", white, [
        [(423, 330, 247), (265, 330, 296), (314, 330, 456), (472, 330, 406)],
        [(423, 0, 247), (423, 330, 247), (472, 330, 406), (472, 0, 406)],
        [(472, 0, 406), (472, 330, 406), (314, 330, 456), (314, 0, 456)],
        [(314, 0, 456), (314, 330, 456), (265, 330, 296), (265, 0, 296)],
        [(265, 0, 296), (265, 330, 296), (423, 330, 247), (423, 0, 247)]])
    # A hair below the ceiling, facing down.
    quads("lamp", light, [[(343, 548.6, 227), (343, 548.6, 332), (213, 548.6, 332),
                           (213, 548.6, 227)]])
    fov = 2 * math.atan(0.025 / 2 / 0.035)
    glb.camera("camera", (2.78, 2.73, -8.0), (2.78, 2.73, 0.0), fov, 1.0)
    glb.write(path)


def floor_texture():
    """Wooden boards: eight in a row, each with a shade and a grain of its own."""
    def noise(n):
        n = (n * 2654435761 + 1013904223) & 0xFFFFFFFF
        n ^= n >> 15
        n = (n * 2246822519) & 0xFFFFFFFF
        return ((n ^ (n >> 13)) & 0xFFFF) / 65535

    def pixel(x, y):
        board = x // 32
        joint = (y + 97 * board) % 256
        shade = 0.72 + 0.28 * noise(board * 7 + (y + 97 * board) // 256)
        shade *= 0.93 + 0.07 * noise(1000 + x) + 0.03 * math.sin(0.05 * y + 9 * noise(x // 3))
        if x % 32 == 0 or joint == 0:
            shade *= 0.45
        return tuple(max(0, min(255, int(v * shade))) for v in (205, 150, 98))

    return png(256, 256, pixel)


def gallery(path):
    """The room spans x -4..4, y 0..3.5, z -5..3; the window is in the wall at x = 4."""
    glb = Glb()
    white = glb.material("plaster", (0.82, 0.80, 0.76))
    blue = glb.material("blue wall", (0.10, 0.22, 0.55))
    orange = glb.material("orange wall", (0.75, 0.25, 0.07))
    boards = glb.material("boards", (0.9, 0.9, 0.9), roughness=0.55, specular=1.0,
                          texture=glb.texture(floor_texture(), "boards"))
    stone = glb.material("stone", (0.62, 0.60, 0.55))
    gold = glb.material("rough gold", (0.95, 0.64, 0.25), metallic=1.0, roughness=0.35)
    mirror = glb.material("mirror", (0.95, 0.95, 0.95), metallic=1.0, roughness=0.0)
    glass = glb.material("glass", (1.0, 1.0, 1.0), roughness=0.0, specular=1.0, double_sided=False,
                         glass={"ior": 1.5, "thickness": 1.0, "color": [0.75, 0.95, 0.85],
                                "distance": 1.0})
    glaze = glb.material("glaze", (1.0, 1.0, 1.0), roughness=0.25, specular=1.0)
    panel = glb.material("panel", (0.8, 0.8, 0.8), emission=(9.0, 7.4, 5.4), double_sided=False)
    sky = glb.material("sky", (0.0, 0.0, 0.0), emission=(5.0, 7.0, 10.0), double_sided=False)

    # The shell. Every face looks into the room.
    glb.object("floor", Shape().quad((-4, 0, 3), (4, 0, 3), (4, 0, -5), (-4, 0, -5), (4, 4)), boards)
    shell = Shape()
    shell.quad((-4, 3.5, -5), (4, 3.5, -5), (4, 3.5, 3), (-4, 3.5, 3))
    shell.quad((4, 0, 3), (-4, 0, 3), (-4, 3.5, 3), (4, 3.5, 3))
    # The wall with the window: z -3.2..-0.4, y 0.9..2.9, in four parts, and its jambs, 0.3 deep.
    shell.quad((4, 0, -5), (4, 0, 3), (4, 0.9, 3), (4, 0.9, -5))
    shell.quad((4, 2.9, -5), (4, 2.9, 3), (4, 3.5, 3), (4, 3.5, -5))
    shell.quad((4, 0.9, -5), (4, 0.9, -3.2), (4, 2.9, -3.2), (4, 2.9, -5))
    shell.quad((4, 0.9, -0.4), (4, 0.9, 3), (4, 2.9, 3), (4, 2.9, -0.4))
    shell.quad((4, 0.9, -0.4), (4.3, 0.9, -0.4), (4.3, 0.9, -3.2), (4, 0.9, -3.2))
    shell.quad((4, 2.9, -3.2), (4.3, 2.9, -3.2), (4.3, 2.9, -0.4), (4, 2.9, -0.4))
    shell.quad((4, 0.9, -3.2), (4.3, 0.9, -3.2), (4.3, 2.9, -3.2), (4, 2.9, -3.2))
    shell.quad((4.3, 0.9, -0.4), (4, 0.9, -0.4), (4, 2.9, -0.4), (4.3, 2.9, -0.4))
    glb.object("walls and ceiling", shell, white)
    glb.object("back wall", Shape().quad((-4, 0, -5), (4, 0, -5), (4, 3.5, -5), (-4, 3.5, -5)), blue)
    glb.object("left wall", Shape().quad((-4, 0, 3), (-4, 0, -5), (-4, 3.5, -5), (-4, 3.5, 3)),
               orange)
    # A piece of sky outside the window, which lets the sun pass: it hangs beside its path.
    glb.object("sky", Shape().quad((6.5, -1.5, -6), (6.5, -1.5, 2.4), (6.5, 2.2, 2.4),
                                   (6.5, 2.2, -6)), sky)

    columns = glb.mesh("column", column(), stone)
    for i, (x, z) in enumerate([(-2.9, -4.3), (-0.97, -4.3), (0.97, -4.3), (2.9, -4.3),
                                (-3.3, -2.0), (-3.3, 0.4)]):
        glb.node(f"column {i + 1}", mesh=columns, translation=[x, 0, z])

    plinth = glb.mesh("plinth", Shape().box((-0.5, 0, -0.5), (0.5, 0.5, 0.5)), white)
    for name, x, z, turn in (("plinth of the mirror", -1.75, -2.3, 0.3),
                             ("plinth of the vase", 0.1, -2.9, -0.2),
                             ("plinth of the gold", 1.95, -2.3, 0.5)):
        glb.node(name, mesh=plinth, translation=[x, 0, z],
                 rotation=[0, math.sin(turn / 2), 0, math.cos(turn / 2)])
    ball = sphere(0.5, 40, 64)
    glb.object("mirror ball", ball, mirror, translation=[-1.75, 1.0, -2.3])
    glb.object("gold ball", ball, gold, translation=[1.95, 1.0, -2.3])
    glb.object("glass ball", ball, glass, translation=[0.75, 0.501, -0.9])
    glb.object("vase", vase(), glaze, translation=[0.1, 0.5, -2.9])
    block = Shape().box((-0.35, 0, -0.35), (0.35, 0.7, 0.35))
    glb.object("block", block, orange, translation=[-0.75, 0, -0.75],
               rotation=[0, math.sin(0.25), 0, math.cos(0.25)])
    # Lamps under the ceiling, facing down; the second is a copy of the first.
    lamp = glb.mesh("lamp", Shape().quad((-0.6, 0, -0.2), (0.6, 0, -0.2), (0.6, 0, 0.2),
                                         (-0.6, 0, 0.2)), panel)
    glb.node("lamp 1", mesh=lamp, translation=[-1.6, 3.49, -1.8])
    glb.node("lamp 2", mesh=lamp, translation=[1.6, 3.49, -1.8])

    glb.extend(glb.doc, "KHR_lights_punctual", {"lights": [
        {"name": "sun", "type": "directional", "color": [1.0, 0.87, 0.68], "intensity": 40.0}]})
    sun = glb.node("sun", matrix=look_at((8.0, 5.6, 1.2), (0.5, 0.2, -2.3)))
    glb.extend(sun, "KHR_lights_punctual", {"light": 0})
    glb.camera("camera", (-0.4, 1.75, 2.75), (0.15, 1.15, -2.5), math.radians(48), 16 / 9)
    glb.write(path)


def column():
    """A base, a shaft that tapers, a capital; 3.5 m high."""
    profile = [(0.30, 0.0), (0.30, 0.12), (0.27, 0.16), (0.22, 0.2), (0.20, 0.26)]
    profile += [(0.20 - 0.03 * t / 8, 0.26 + 2.84 * t / 8) for t in range(1, 9)]
    profile += [(0.20, 3.16), (0.26, 3.24), (0.30, 3.32), (0.30, 3.5)]
    return revolution(profile, 32)


def vase():
    """Vertex colours run from deep red to white, with a darker band."""
    profile = [(0.0, 0.0), (0.16, 0.0)]
    for i in range(1, 33):
        t = i / 32
        profile.append((0.16 + 0.17 * math.sin(math.pi * min(1, t * 1.25)) - 0.08 * t, 0.9 * t))
    profile += [(profile[-1][0] - 0.02, 0.9)]
    profile += [(r - 0.02, h) for r, h in profile[32:13:-1]]
    profile += [(0.0, profile[-1][1])]

    def color(t, turn):
        wave = 0.5 + 0.5 * math.sin(2 * math.pi * (6 * turn + 3 * t))
        mix = min(1.0, max(0.0, 1.7 * t))
        red, green, blue = 0.62 + 0.2 * mix, 0.06 + 0.66 * mix, 0.08 + 0.55 * mix
        dark = 0.45 + 0.55 * wave if 0.25 < t < 0.4 else 1.0
        return tuple(int(255 * v * dark) for v in (red, green, blue)) + (255,)

    return revolution(profile, 48, color)


if __name__ == "__main__":
    folder = sys.argv[1] if len(sys.argv) > 1 else os.path.dirname(os.path.abspath(__file__))
    cornell(os.path.join(folder, "cornell.glb"))
    gallery(os.path.join(folder, "gallery.glb"))
