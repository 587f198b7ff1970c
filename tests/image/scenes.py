#!/usr/bin/env python3
"""Writes the scenes of the image tests as .glb files.

  python3 tests/image/scenes.py FOLDER

Plain Python, no packages; the same bytes on every run. The writer is that of assets/make_assets.py.
Each scene holds one thing that a renderer may get wrong, see docs/tests.md. All but `coats`
use only what the reference renderer's script reads the same way: Lambertian surfaces, metals,
smooth glass, textures without a transform, flat faces.
"""
import math
import os
import sys

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path.insert(0, os.path.join(os.path.dirname(os.path.dirname(HERE)), "assets"))
sys.dont_write_bytecode = True
from make_assets import Glb, Shape, png, sphere  # noqa: E402


def room(glb, size, walls, floor=None, openings=()):
    """A closed room, x and z from -size/2 to size/2, y from 0 up; each side looks inwards.

    walls: material of all sides, or of left, right, back, the rest. openings: sides to leave out.
    """
    x, y, z = size[0] / 2, size[1], size[2] / 2
    left, right, back, rest = walls if isinstance(walls, tuple) else (walls,) * 4
    sides = {
        "floor": (rest if floor is None else floor, (-x, 0, z), (x, 0, z), (x, 0, -z), (-x, 0, -z)),
        "ceiling": (rest, (-x, y, -z), (x, y, -z), (x, y, z), (-x, y, z)),
        "left": (left, (-x, 0, z), (-x, 0, -z), (-x, y, -z), (-x, y, z)),
        "right": (right, (x, 0, -z), (x, 0, z), (x, y, z), (x, y, -z)),
        "back": (back, (-x, 0, -z), (x, 0, -z), (x, y, -z), (-x, y, -z)),
        "front": (rest, (x, 0, z), (-x, 0, z), (-x, y, z), (x, y, z)),
    }
    for name, (material, *corners) in sides.items():
        if name not in openings:
            glb.object(name, Shape().quad(*corners), material)


def lamp(glb, height, half, radiance):
    """A square lamp that shines downwards."""
    glow = glb.material("lamp", (0.5, 0.5, 0.5), emission=radiance, double_sided=False)
    h = half
    glb.object("lamp", Shape().quad((-h, height, -h), (h, height, -h), (h, height, h),
                                    (-h, height, h)), glow)


def flat_sphere(radius, rings, segments):
    shape = sphere(radius, rings, segments)
    shape.normals = []
    return shape


def colored_walls(glb):
    return (glb.material("red", (0.6, 0.1, 0.1)), glb.material("green", (0.1, 0.5, 0.15)),
            glb.material("blue", (0.2, 0.25, 0.6)), glb.material("white", (0.75, 0.75, 0.75)))


def glossy(glb):
    """A floor of metal strips, roughness 0.05 to 0.5, that reflect walls and boxes."""
    walls = colored_walls(glb)
    room(glb, (4, 2.6, 4), walls)
    lamp(glb, 2.59, 0.6, (8.0, 7.5, 7.0))
    for i, roughness in enumerate((0.05, 0.1, 0.2, 0.35, 0.5)):
        metal = glb.material(f"metal {i}", (0.9, 0.85, 0.8), metallic=1.0, roughness=roughness)
        x0, x1 = -1.9 + 0.76 * i, -1.9 + 0.76 * (i + 1) - 0.04
        glb.object(f"strip {i}", Shape().quad((x0, 0.01, 1.5), (x1, 0.01, 1.5), (x1, 0.01, -1.4),
                                              (x0, 0.01, -1.4)), metal)
        glb.object(f"box {i}", Shape().box((x0 + 0.2, 0, -1.8), (x1 - 0.2, 0.9, -1.5)),
                   walls[i % 3])
    glb.camera("camera", (0.0, 1.5, 1.9), (0.0, 0.35, -0.8), math.radians(75), 1.0)


def emitters(glb):
    """A wall with 64 lamps of 3 cm, each an object of its own."""
    room(glb, (3, 2.4, 3), colored_walls(glb))
    colors = [glb.material(f"glow {i}", (0.0, 0.0, 0.0), emission=e, double_sided=False)
              for i, e in enumerate(((90, 40, 20), (30, 80, 30), (30, 40, 100)))]
    for i in range(8):
        for j in range(8):
            x, y = -1.2 + 0.34 * i, 0.15 + 0.3 * j
            glb.object(f"glow {i} {j}", Shape().quad((x, y, -1.48), (x + 0.03, y, -1.48),
                                                     (x + 0.03, y + 0.03, -1.48),
                                                     (x, y + 0.03, -1.48)), colors[(i + j) % 3])
    glb.object("block", Shape().box((-0.4, 0, -0.7), (0.3, 1.1, -0.2)), 3)
    glb.camera("camera", (0.6, 1.2, 1.4), (-0.2, 0.9, -0.6), math.radians(70), 1.0)


def slit(glb):
    """A dark room that gets its light from the next one through a slit of 25 cm."""
    walls = colored_walls(glb)
    white = walls[3]
    room(glb, (6, 2.4, 3), (walls[0], walls[1], white, white))
    for name, z0, z1 in (("near", 0.125, 1.5), ("far", -1.5, -0.125)):
        glb.object(f"wall {name}", Shape().box((-0.1, 0, z0), (0.1, 2.4, z1)), white)
    glow = glb.material("lamp", (0.5, 0.5, 0.5), emission=(30.0, 28.0, 25.0), double_sided=False)
    glb.object("lamp", Shape().quad((-2.4, 2.39, -0.8), (-0.8, 2.39, -0.8), (-0.8, 2.39, 0.8),
                                    (-2.4, 2.39, 0.8)), glow)
    glb.camera("camera", (2.7, 1.5, 1.2), (0.6, 0.8, -0.6), math.radians(75), 1.0)


def sun(glb):
    """A room with a window: a sun shines in; the sky is given with the test."""
    room(glb, (4, 2.6, 4), colored_walls(glb), openings=("left",))
    wall = Shape()
    wall.box((-2.2, 0, -2), (-2, 0.8, 2)).box((-2.2, 2.2, -2), (-2, 2.6, 2))
    wall.box((-2.2, 0.8, -2), (-2, 2.2, -0.8)).box((-2.2, 0.8, 0.8), (-2, 2.2, 2))
    glb.object("window wall", wall, 0)
    glb.doc["extensions"] = {"KHR_lights_punctual": {"lights": [
        {"type": "directional", "color": [1.0, 0.9, 0.75], "intensity": 20.0}]}}
    glb.extensions.add("KHR_lights_punctual")
    # A light shines along its -z: here towards (0.8, -0.6, 0).
    half = math.radians(-90) / 2
    tilt = -math.asin(0.6) / 2
    y, x = (math.sin(half), math.cos(half)), (math.sin(tilt), math.cos(tilt))
    rotation = [y[1] * x[0], y[0] * x[1], -y[0] * x[0], y[1] * x[1]]
    glb.node("sun", rotation=rotation, extensions={"KHR_lights_punctual": {"light": 0}})
    glb.camera("camera", (1.6, 1.5, 1.8), (-0.9, 0.8, -0.9), math.radians(75), 1.0)


def glass(glb):
    """A glass block and a glass ball with flat faces under a large lamp."""
    room(glb, (3, 2.4, 3), colored_walls(glb))
    lamp(glb, 2.39, 0.7, (6.0, 6.0, 6.0))
    clear = glb.material("glass", (1, 1, 1), roughness=0.0, specular=1.0, double_sided=False,
                         glass={"ior": 1.5, "thickness": 1.0, "color": [1, 1, 1],
                                "distance": 1000.0})
    glb.object("block", Shape().box((-0.9, 0.3, -0.7), (-0.2, 1.1, 0.0)), clear)
    glb.object("ball", flat_sphere(0.4, 10, 20), clear, translation=[0.5, 0.6, -0.2])
    glb.camera("camera", (0.2, 1.2, 1.45), (-0.1, 0.8, -0.4), math.radians(65), 1.0)


def instances(glb):
    """One mesh placed nine times: scaled, turned, mirrored, in a mirror."""
    room(glb, (4, 2.6, 4), colored_walls(glb))
    lamp(glb, 2.59, 0.8, (7.0, 7.0, 7.0))
    stone = glb.material("stone", (0.6, 0.55, 0.5))
    mesh = glb.mesh("ball", flat_sphere(0.3, 12, 24), stone)
    for i in range(9):
        scale = [1 + 0.3 * (i % 3), 0.6 + 0.25 * (i // 3), (-1 if i % 2 else 1) * (0.7 + 0.1 * i)]
        angle = 0.35 * i
        glb.node(f"ball {i}", mesh=mesh, scale=scale,
                 rotation=[0.0, math.sin(angle / 2), 0.0, math.cos(angle / 2)],
                 translation=[-1.2 + 1.2 * (i % 3), 0.35 + 0.75 * (i // 3), -1.0 + 0.4 * (i % 2)])
    mirror = glb.material("mirror", (0.9, 0.9, 0.9), metallic=1.0, roughness=0.0)
    glb.object("mirror", Shape().quad((-1.98, 0.2, 1.2), (-1.98, 0.2, -1.8), (-1.98, 2.4, -1.8),
                                      (-1.98, 2.4, 1.2)), mirror)
    glb.camera("camera", (1.3, 1.4, 1.9), (-0.4, 1.0, -0.9), math.radians(70), 1.0)


def texture(glb):
    """A textured floor and wall that color what is around them."""
    def pixel(x, y):
        if (x // 16 + y // 16) % 2:
            return (230, 60 + x, 40)
        return (20, 60, 90 + y)

    board = glb.material("board", (0.9, 0.9, 0.9), texture=glb.texture(png(128, 128, pixel), "t"))
    white = glb.material("white", (0.7, 0.7, 0.7))
    room(glb, (4, 2.6, 4), white, openings=("floor", "back"))
    shape = Shape().quad((-2, 0, 2), (2, 0, 2), (2, 0, -2), (-2, 0, -2), (3, 3))
    glb.object("floor", shape, board)
    glb.object("back", Shape().quad((-2, 0, -2), (2, 0, -2), (2, 2.6, -2), (-2, 2.6, -2), (2, 1)),
               board)
    lamp(glb, 2.59, 0.7, (8.0, 8.0, 8.0))
    glb.object("block", Shape().box((-0.5, 0, -0.9), (0.4, 0.9, -0.1)), white)
    glb.camera("camera", (0.9, 1.6, 1.8), (-0.2, 0.6, -0.9), math.radians(75), 1.0)


def point(glb):
    """Two point lights, one close to a wall."""
    room(glb, (4, 2.6, 4), colored_walls(glb))
    glb.doc["extensions"] = {"KHR_lights_punctual": {"lights": [
        {"type": "point", "color": [1.0, 0.9, 0.8], "intensity": 6.0},
        {"type": "point", "color": [0.3, 0.5, 1.0], "intensity": 3.0}]}}
    glb.extensions.add("KHR_lights_punctual")
    glb.node("a", translation=[0.7, 2.0, -0.3], extensions={"KHR_lights_punctual": {"light": 0}})
    glb.node("b", translation=[-1.6, 0.7, -1.2], extensions={"KHR_lights_punctual": {"light": 1}})
    glb.object("block", Shape().box((-0.7, 0, -0.9), (0.2, 1.2, -0.1)), 3)
    glb.camera("camera", (0.9, 1.5, 1.9), (-0.2, 0.9, -0.9), math.radians(75), 1.0)


def coats(glb):
    """Glossy dielectrics, rough glass, vertex colors: materials of ours alone."""
    room(glb, (4, 2.6, 4), colored_walls(glb))
    lamp(glb, 2.59, 0.8, (7.0, 7.0, 7.0))
    for i, roughness in enumerate((0.1, 0.3, 0.6)):
        coat = glb.material(f"coat {i}", (0.7, 0.5, 0.3), roughness=roughness, specular=1.0)
        glb.object(f"ball {i}", sphere(0.4, 16, 32), coat, translation=[-1.1 + 1.1 * i, 0.4, -0.9])
    frosted = glb.material("frosted", (0.9, 0.95, 1.0), roughness=0.4, specular=1.0,
                           glass={"ior": 1.4, "thickness": 1.0, "color": [0.8, 0.95, 0.9],
                                  "distance": 0.5})
    glb.object("frosted", Shape().box((0.3, 0.01, -0.2), (0.9, 0.7, 0.3)), frosted)
    painted = Shape().box((-0.9, 0.0, -0.2), (-0.3, 0.7, 0.3))
    painted.colors = [(255 - 9 * i, 10 * i, 128, 255) for i in range(24)]
    glb.object("painted", painted, glb.material("paint", (1, 1, 1)))
    glb.camera("camera", (0.0, 1.4, 1.9), (0.0, 0.6, -0.6), math.radians(70), 1.0)


SCENES = (glossy, emitters, slit, sun, glass, instances, texture, point, coats)


def main():
    folder = sys.argv[1]
    os.makedirs(folder, exist_ok=True)
    for make in SCENES:
        glb = Glb()
        make(glb)
        glb.write(os.path.join(folder, make.__name__ + ".glb"))


if __name__ == "__main__":
    main()
