"""A room whose walls have large textures, as OBJ, MTL and PNG files. Standard library only."""
import os, random, struct, zlib


def png(path, side, seed, bits=8):
    """Colours that wander from texel to texel and from row to row, a little harder to pack than photographs."""
    def chunk(name, data):
        return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))
    generator = random.Random(seed)
    row, at = bytearray(), [generator.randrange(240) for _ in range(3)]
    for _ in range(side):
        at = [min(max(c + generator.randrange(-4, 5), 0), 240) for c in at]
        row += bytes(at if bits == 8 else [c for v in at for c in (v, generator.randrange(240))])
    step, row = 3 * bits // 8, bytes(row)
    packer, grain = zlib.compressobj(1), int.from_bytes(b"\7" * len(row), "little")
    data = b""
    for y in range(side):
        turn = y * step
        shifted = int.from_bytes(row[turn:] + row[:turn], "little")
        noise = int.from_bytes(generator.randbytes(len(row)), "little") & grain
        data += packer.compress(b"\0" + (shifted + noise).to_bytes(len(row), "little"))
    with open(path, "wb") as f:
        f.write(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">2I5B", side, side, bits, 2, 0, 0, 0)) +
                chunk(b"IDAT", data + packer.flush()) + chunk(b"IEND", b""))


def write_room(folder, images=6, side=512, bits=8):
    """Returns the model's path. `images` pictures of `side` x `side` on tiles of the walls; a lamp below the ceiling."""
    materials = ["newmtl lamp\nKd 0 0 0\nKe 12 12 12\n"]
    for i in range(images):
        png(os.path.join(folder, f"wall{i}.png"), side, i, bits)
        materials.append(f"newmtl m{i}\nKd 0.9 0.9 0.9\nKs 0 0 0\nmap_Kd wall{i}.png\n")
    with open(os.path.join(folder, "room.mtl"), "w") as f:
        f.write("\n".join(materials))
    vertices, faces = [], []

    def quad(corner, u, v, material):
        first = len(vertices) + 1
        for a, b in ((0, 0), (1, 0), (1, 1), (0, 1)):
            vertices.append([corner[k] + a * u[k] + b * v[k] for k in range(3)])
        faces.append(f"usemtl {material}\nf " + " ".join(f"{first + k}/{k + 1}" for k in range(4)))

    walls = [((-1, 0, -1), (2, 0, 0), (0, 2, 0)), ((-1, 0, 1), (0, 0, -2), (0, 2, 0)), ((1, 0, -1), (0, 0, 2), (0, 2, 0)),
             ((-1, 0, 1), (2, 0, 0), (0, 0, -2)), ((-1, 2, -1), (2, 0, 0), (0, 0, 2)), ((1, 0, 1), (-2, 0, 0), (0, 2, 0))]
    tiles = 1
    while len(walls) * tiles * tiles < images:
        tiles += 1
    number = 0
    for corner, u, v in walls:
        for a in range(tiles):
            for b in range(tiles):
                at = [corner[k] + (a * u[k] + b * v[k]) / tiles for k in range(3)]
                quad(at, [x / tiles for x in u], [x / tiles for x in v], f"m{number % images}")
                number += 1
    quad((-0.4, 1.98, -0.4), (0.8, 0, 0), (0, 0, 0.8), "lamp")
    model = os.path.join(folder, "room.obj")
    with open(model, "w") as f:
        f.write("mtllib room.mtl\n" + "".join(f"v {x} {y} {z}\n" for x, y, z in vertices) +
                "vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n" + "\n".join(faces) + "\n")
    return model


CAMERA = "0,1,0.9/0,1,-1/0,1,0/75"
