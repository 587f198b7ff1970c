#!/usr/bin/env python3
"""A wood of leaves that half of the light passes, behind panes of glass, out of core: how many pages are loaded by rays that wait
and how many on demand, and whether the picture has the bytes of all in memory.

  foliage.py [--trex build/trex] [--leaves N] [--folder DIR]
"""
import argparse, array, json, math, os, random, struct, subprocess, tempfile


def leaf(random, place, size):
    """Two triangles."""
    def direction():
        z, phi = random.uniform(-1, 1), random.uniform(0, 2 * math.pi)
        r = math.sqrt(1 - z * z)
        return (r * math.cos(phi), r * math.sin(phi), z)
    a, b = direction(), direction()
    corner = lambda i, k: tuple(place[x] + size * (i * a[x] + k * b[x]) for x in range(3))
    p = [corner(0, 0), corner(1, 0), corner(1, 1), corner(0, 1)]
    return [p[0], p[1], p[2], p[0], p[2], p[3]]


def box(lower, upper):
    p = [[(lower, upper)[i >> k & 1][k] for k in range(3)] for i in range(8)]
    sides = [(0, 4, 6, 2), (1, 3, 7, 5), (0, 1, 5, 4), (2, 6, 7, 3), (0, 2, 3, 1), (4, 5, 7, 6)]
    return [p[s[i]] for s in sides for i in (0, 1, 2, 0, 2, 3)]


def write(path, parts):
    """`parts`: material number -> corners."""
    data = array.array("f")
    views, accessors, primitives = [], [], []
    for material, corners in parts:
        start = len(data) * 4
        for c in corners:
            data.extend(c)
        views.append({"buffer": 0, "byteOffset": start, "byteLength": len(corners) * 12})
        accessors.append({"bufferView": len(views) - 1, "componentType": 5126, "count": len(corners), "type": "VEC3",
                          "min": [min(c[k] for c in corners) for k in range(3)], "max": [max(c[k] for c in corners) for k in range(3)]})
        primitives.append({"attributes": {"POSITION": len(accessors) - 1}, "material": material})
    plain = lambda r, g, b, a=1.0: {"pbrMetallicRoughness": {"baseColorFactor": [r, g, b, a], "metallicFactor": 0.0, "roughnessFactor": 1.0}}
    leaves = dict(plain(0.3, 0.5, 0.1, 0.5), alphaMode="BLEND", doubleSided=True)
    glass = {"pbrMetallicRoughness": {"metallicFactor": 0.0, "roughnessFactor": 0.0},
             "extensions": {"KHR_materials_transmission": {"transmissionFactor": 1.0}, "KHR_materials_volume": {"thicknessFactor": 1.0}}}
    sun = {"type": "directional", "color": [1, 1, 1], "intensity": 3.0}
    half = math.sin(-0.5)
    document = {
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0, 1, 2]}],
        "extensionsUsed": ["KHR_lights_punctual", "KHR_materials_transmission", "KHR_materials_volume"],
        "extensions": {"KHR_lights_punctual": {"lights": [sun]}},
        "cameras": [{"type": "perspective", "perspective": {"yfov": 0.8, "znear": 0.01}}],
        "nodes": [{"mesh": 0}, {"rotation": [half, 0, 0, math.cos(0.5)], "extensions": {"KHR_lights_punctual": {"light": 0}}},
                  {"camera": 0, "translation": [0, 1.5, 9]}],
        "meshes": [{"primitives": primitives}], "materials": [plain(0.5, 0.5, 0.5), leaves, glass],
        "buffers": [{"byteLength": len(data) * 4, "uri": os.path.basename(path) + ".bin"}], "bufferViews": views, "accessors": accessors}
    with open(path + ".bin", "wb") as f:
        data.tofile(f)
    with open(path, "w") as f:
        json.dump(document, f)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--trex", default="build/trex")
    parser.add_argument("--leaves", type=int, default=300000)
    parser.add_argument("--folder")
    a = parser.parse_args()
    folder = a.folder or tempfile.mkdtemp()
    model, bundle = os.path.join(folder, "wood.gltf"), os.path.join(folder, "wood.trex")
    rng = random.Random(1)
    crown = []
    for _ in range(a.leaves):
        crown += leaf(rng, (rng.uniform(-4, 4), rng.uniform(0.2, 4), rng.uniform(-4, 3)), 0.05)
    panes = [c for x in range(-4, 4) for c in box((x + 0.05, 0.0, 4.0), (x + 0.95, 3.5, 4.02))]
    ground = box((-6, -0.1, -6), (6, 0.0, 8))
    write(model, [(0, ground), (1, crown), (2, panes)])
    subprocess.run([a.trex, "bake", model, "--stream", "--no-voxels", "-o", bundle], check=True, stdout=subprocess.DEVNULL)
    pages = json.loads(subprocess.run([a.trex, "info", bundle, "--json"], check=True, stdout=subprocess.PIPE).stdout)["mesh_pages"]
    few = str(max(int(pages["memory_bytes"] * 0.05), pages["largest_page_bytes"] + 8192))
    pictures = []
    print("| cache | loads | on demand | waiting | processor seconds | same bytes |\n|---|---|---|---|---|---|")
    for name, options in (("all", []), ("5 %", ["--cache", few])):
        picture = os.path.join(folder, f"{len(pictures)}.exr")
        before = os.times().children_user
        p = subprocess.run([a.trex, "render", bundle, "-o", picture, "--size", "160x90", "--spp", "4", "--exact", "1", "--device", "none",
                            "--denoise", "off", "--json", *options], check=True, stdout=subprocess.PIPE)
        r = json.loads(p.stdout)
        pictures.append(open(picture, "rb").read())
        waiting = r.get("waiting_thread_seconds", 0) / max(r.get("tracing_thread_seconds", 0), 1e-9)
        print(f"| {name} | {r['page_loads']} | {r.get('page_loads_on_demand', '')} | {100 * waiting:.1f} % | "
              f"{os.times().children_user - before:.1f} | {'yes' if pictures[0] == pictures[-1] else 'NO'} |")


if __name__ == "__main__":
    main()
