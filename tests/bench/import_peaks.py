#!/usr/bin/env python3
"""Peak memory and seconds of one model in four formats: binary PLY, text PLY, OBJ and GLB.

Usage: import_peaks.py [--triangles 5e6] [--trex build/trex] [--folder .] [--keep] [--max-memory B] [--runs render,bake,stream]
Prints a table: of each format the largest resident size and the seconds of `render` in core, `bake` and `bake --stream`,
and the size over that of binary PLY.
"""
import argparse, array, json, math, os, struct, subprocess, sys, time

HERE = os.path.dirname(os.path.abspath(__file__))
FORMATS = ("ply", "text.ply", "obj", "glb")


def sheet(triangles):
    """Positions and indices of a wavy sheet, as flat arrays."""
    side = max(1, round(math.sqrt(triangles / 2)))
    n = side + 1
    positions, indices = array.array("f"), array.array("I")
    for i in range(n):
        height = 0.02 * math.sin(40 * i / side)
        for j in range(n):
            positions.extend((i / side, height + 0.01 * math.sin(70 * j / side), j / side))
    for i in range(side):
        for a in range(i * n, i * n + side):
            indices.extend((a, a + 1, a + n, a + 1, a + n + 1, a + n))
    return positions, indices


def rows(values, width=3):
    return (values[k:k + width] for k in range(0, len(values), width))


def write_ply(path, positions, indices, text):
    kind = "ascii" if text else "binary_little_endian"
    with open(path, "wb") as f:
        f.write((f"ply\nformat {kind} 1.0\nelement vertex {len(positions) // 3}\nproperty float x\nproperty float y\n"
                 f"property float z\nelement face {len(indices) // 3}\nproperty list uchar int vertex_indices\n"
                 "end_header\n").encode())
        if text:
            f.writelines(b"%.7g %.7g %.7g\n" % tuple(p) for p in rows(positions))
            f.writelines(b"3 %d %d %d\n" % tuple(t) for t in rows(indices))
        else:
            positions.tofile(f)
            f.writelines(struct.pack("<B3I", 3, *t) for t in rows(indices))


def write_obj(path, positions, indices):
    with open(path, "wb") as f:
        f.writelines(b"v %.7g %.7g %.7g\n" % tuple(p) for p in rows(positions))
        f.writelines(b"f %d %d %d\n" % (t[0] + 1, t[1] + 1, t[2] + 1) for t in rows(indices))


def write_glb(path, positions, indices):
    sizes = [len(positions) * 4, len(indices) * 4]
    bounds = [[f(positions[k::3]) for k in range(3)] for f in (min, max)]
    text = json.dumps({
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}], "buffers": [{"byteLength": sum(sizes)}],
        "bufferViews": [{"buffer": 0, "byteLength": sizes[0]}, {"buffer": 0, "byteOffset": sizes[0], "byteLength": sizes[1]}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "type": "VEC3", "count": len(positions) // 3,
                       "min": bounds[0], "max": bounds[1]},
                      {"bufferView": 1, "componentType": 5125, "type": "SCALAR", "count": len(indices)}]}).encode()
    text += b" " * (-len(text) % 4)
    with open(path, "wb") as f:
        f.write(struct.pack("<4s4I4s", b"glTF", 2, 28 + len(text) + sum(sizes), len(text), 0x4E4F534A, b"")[:20])
        f.write(text + struct.pack("<I4s", sum(sizes), b"BIN\0"))
        positions.tofile(f)
        indices.tofile(f)


def write_all(folder, triangles):
    """Files of each format; those that are there already are kept."""
    paths = {kind: os.path.join(folder, f"peak-{triangles:.0f}.{kind}") for kind in FORMATS}
    if all(os.path.exists(path) for path in paths.values()):
        return paths
    positions, indices = sheet(triangles)
    write_ply(paths["ply"], positions, indices, text=False)
    write_ply(paths["text.ply"], positions, indices, text=True)
    write_obj(paths["obj"], positions, indices)
    write_glb(paths["glb"], positions, indices)
    return paths


def measure(*command):
    """Largest resident bytes and seconds of a command."""
    start = time.monotonic()
    process = subprocess.Popen([str(c) for c in command], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    said = process.stderr.read()
    _, status, usage = os.wait4(process.pid, 0)
    if status != 0:
        sys.exit(f"{' '.join(map(str, command))}: failed\n{said}")
    return usage.ru_maxrss * 1024, time.monotonic() - start


def command(a, run, path):
    made = os.path.join(a.folder, "peak.trex")
    limit = ["--max-memory", a.max_memory] if a.max_memory else []
    if run == "render":
        picture = os.path.join(a.folder, "peak.png")
        return [a.trex, "render", path, "-o", picture, "--size", "64x64", "--spp", 1, "--exact", 1, "-q", *limit]
    return [a.trex, "bake", path, "-o", made, "-q", *(["--stream"] if run == "stream" else []), *limit]


def main():
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("--trex", default=os.path.join(HERE, "../../build/trex"))
    p.add_argument("--triangles", type=float, default=5e6)
    p.add_argument("--folder", default=".")
    p.add_argument("--max-memory")
    p.add_argument("--runs", default="render,bake,stream")
    p.add_argument("--keep", action="store_true")
    a = p.parse_args()
    paths = write_all(a.folder, a.triangles)
    print(f"{'':10}" + "".join(f"{run + ' MiB':>12}{'x PLY':>7}{'s':>7}" for run in a.runs.split(",")))
    base = {}
    for kind, path in paths.items():
        line = f"{kind:10}"
        for run in a.runs.split(","):
            peak, seconds = measure(*command(a, run, path))
            line += f"{peak / 2**20:12.0f}{peak / base.setdefault(run, peak):7.2f}{seconds:7.1f}"
        print(line, flush=True)
    made = [os.path.join(a.folder, name) for name in ("peak.trex", "peak.png")]
    for path in made + ([] if a.keep else list(paths.values())):
        if os.path.exists(path):
            os.remove(path)


if __name__ == "__main__":
    main()
