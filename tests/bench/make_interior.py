#!/usr/bin/env python3
"""Writes an interior of about two million unique triangles as a binary PLY: a hall with tables, shelves and
bumpy balls of many sizes on them. Usage: make_interior.py OUT.ply [--triangles 2000000]"""
import argparse
import array
import math
import random
import struct


class Mesh:
    def __init__(self):
        self.positions = array.array("f")
        self.triangles = bytearray()
        self.count = 0

    def vertex(self, x, y, z):
        self.positions.extend((x, y, z))
        return len(self.positions) // 3 - 1

    def triangle(self, a, b, c):
        self.triangles += struct.pack("<Biii", 3, a, b, c)
        self.count += 1

    def box(self, lower, upper, inwards=False):
        first = [self.vertex(*(upper[axis] if corner >> axis & 1 else lower[axis] for axis in range(3)))
                 for corner in range(8)]
        for q in ((0, 4, 6, 2), (1, 3, 7, 5), (0, 1, 5, 4), (2, 6, 7, 3), (0, 2, 3, 1), (4, 5, 7, 6)):
            for a, b, c in ((q[0], q[1], q[2]), (q[0], q[2], q[3])):
                self.triangle(first[a], *((first[c], first[b]) if inwards else (first[b], first[c])))

    def ball(self, centre, radius, rings, phase):
        first = len(self.positions) // 3
        for i in range(rings + 1):
            theta = math.pi * i / rings
            for j in range(rings):
                phi = 2 * math.pi * j / rings
                bump = 1 + 0.08 * math.sin(7 * theta + phase) * math.sin(6 * phi + 2 * phase)
                r = radius * bump if 0 < i < rings else radius
                self.vertex(centre[0] + r * math.sin(theta) * math.cos(phi), centre[1] + r * math.cos(theta),
                            centre[2] - r * math.sin(theta) * math.sin(phi))
        for i in range(rings):
            for j in range(rings):
                a, b = first + i * rings + j, first + i * rings + (j + 1) % rings
                if i > 0:
                    self.triangle(a, a + rings, b)
                if i < rings - 1:
                    self.triangle(b, a + rings, b + rings)


def interior(triangles):
    mesh = Mesh()
    mesh.box((0, 0, 0), (9, 3.2, 7), inwards=True)
    surfaces = []  # tops that balls stand on: lower corner, upper corner, height
    for x in (1.0, 3.6, 6.2):
        for z in (1.2, 4.2):
            mesh.box((x, 0.68, z), (x + 1.6, 0.74, z + 0.9))
            for leg in range(4):
                lx, lz = x + 0.05 + 1.45 * (leg & 1), z + 0.05 + 0.75 * (leg >> 1)
                mesh.box((lx, 0, lz), (lx + 0.05, 0.68, lz + 0.05))
            surfaces.append((x, z, 1.6, 0.9, 0.74))
    for level in range(5):
        mesh.box((0.6, 0.3 + 0.5 * level, 6.6), (8.4, 0.33 + 0.5 * level, 6.98))
        surfaces.append((0.6, 6.6, 7.8, 0.38, 0.33 + 0.5 * level))
    surfaces.append((0.3, 0.3, 8.4, 5.9, 0.0))
    source, rings = random.Random(1), 130
    for i in range(max(0, triangles - mesh.count) // (2 * rings * (rings - 1)) + 1):
        x, z, width, depth, height = surfaces[i % len(surfaces)]
        radius = source.uniform(0.06, 0.18 if depth > 0.5 else 0.15)
        mesh.ball((x + radius + source.random() * (width - 2 * radius), height + 1.08 * radius,
                   z + radius + source.random() * (depth - 2 * radius)), radius, rings, i)
    return mesh


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("output")
    parser.add_argument("--triangles", type=int, default=2_000_000)
    arguments = parser.parse_args()
    mesh = interior(arguments.triangles)
    with open(arguments.output, "wb") as file:
        file.write(f"ply\nformat binary_little_endian 1.0\nelement vertex {len(mesh.positions) // 3}\n"
                   "property float x\nproperty float y\nproperty float z\n"
                   f"element face {mesh.count}\nproperty list uchar int vertex_indices\nend_header\n".encode())
        file.write(mesh.positions.tobytes())
        file.write(mesh.triangles)
    print(f"{arguments.output}: {mesh.count} triangles")


if __name__ == "__main__":
    main()
