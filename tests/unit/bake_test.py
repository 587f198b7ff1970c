#!/usr/bin/env python3
"""Tests of `trex bake`, of rendering a bundle, and of `trex info`."""
import json, math, os, random, resource, signal, struct, subprocess, sys, time, zlib

import program
from program import ProgramTest, run, start


def wavy_ply(path, side):
    """A wavy sheet of 2 * side * side triangles."""
    n = side + 1
    with open(path, "wb") as f:
        f.write((f"ply\nformat binary_little_endian 1.0\nelement vertex {n * n}\nproperty float x\nproperty float y\n"
                 f"property float z\nelement face {2 * side * side}\nproperty list uchar int vertex_indices\n"
                 "end_header\n").encode())
        for i in range(n):
            row = [(i / side, 0.02 * math.sin(40 * i / side) * math.cos(37 * j / side), j / side) for j in range(n)]
            f.write(b"".join(struct.pack("<3f", *p) for p in row))
        for i in range(side):
            f.write(b"".join(struct.pack("<B3iB3i", 3, a, a + 1, a + n, 3, a + 1, a + n + 1, a + n)
                             for a in range(i * n, i * n + side)))


def png(path, width, height, seed):
    """A PNG of noise."""
    noise = random.Random(seed)
    rows = b"".join(b"\0" + noise.randbytes(3 * width) for _ in range(height))

    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
    with open(path, "wb") as f:
        f.write(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">2I5B", width, height, 8, 2, 0, 0, 0)) +
                chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b""))


def sphere(n):
    """Positions, texture coordinates and indices of a sphere of 2 * n * n triangles."""
    positions, uvs, indices = [], [], []
    for i in range(n + 1):
        for j in range(n + 1):
            a, b = math.pi * i / n, 2 * math.pi * j / n
            positions += [math.sin(a) * math.cos(b), math.cos(a), -math.sin(a) * math.sin(b)]
            uvs += [3 * j / n, i / n]
    for i in range(n):
        for j in range(n):
            a = i * (n + 1) + j
            indices += [a, a + n + 1, a + 1, a + 1, a + n + 1, a + n + 2]
    return positions, uvs, indices


def spheres_gltf(folder):
    """Three placements of a textured sphere of 1152 triangles; buffer and texture are files of their own."""
    positions, uvs, indices = sphere(24)
    data = struct.pack(f"<{len(positions)}f", *positions) + struct.pack(f"<{len(uvs)}f", *uvs)
    start = len(data)
    data += struct.pack(f"<{len(indices)}H", *indices)
    with open(os.path.join(folder, "spheres.bin"), "wb") as f:
        f.write(data)
    png(os.path.join(folder, "noise.png"), 33, 17, 1)
    count = len(positions) // 3
    tree = {
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0, 1, 2, 3]}],
        "nodes": [{"name": f"ball {i}", "mesh": 0, "translation": [2.1 * i - 2.1, 0.1 * i, -0.3 * i],
                   "scale": [1, 1 - 0.2 * i, -1 if i == 2 else 1]} for i in range(3)] +
                 [{"name": "eye", "camera": 0, "translation": [0, 0.5, 7]}],
        "cameras": [{"name": "front", "type": "perspective", "perspective": {"yfov": 0.7, "znear": 0.1}}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "NORMAL": 0, "TEXCOORD_0": 1}, "indices": 2,
                                    "material": 0}]}],
        "materials": [{"name": "noise", "pbrMetallicRoughness": {
            "metallicFactor": 0.1, "roughnessFactor": 0.7, "baseColorTexture": {"index": 0}}}],
        "textures": [{"source": 0}], "images": [{"uri": "noise.png"}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": count, "type": "VEC3",
             "min": [-1, -1, -1], "max": [1, 1, 1]},
            {"bufferView": 1, "componentType": 5126, "count": count, "type": "VEC2"},
            {"bufferView": 2, "componentType": 5123, "count": len(indices), "type": "SCALAR"}],
        "bufferViews": [{"buffer": 0, "byteOffset": 0, "byteLength": 12 * count},
                        {"buffer": 0, "byteOffset": 12 * count, "byteLength": 8 * count},
                        {"buffer": 0, "byteOffset": start, "byteLength": 2 * len(indices)}],
        "buffers": [{"byteLength": len(data), "uri": "spheres.bin"}]}
    path = os.path.join(folder, "spheres.gltf")
    with open(path, "w") as f:
        json.dump(tree, f)
    return path


def hdr(path, width, height):
    """A Radiance picture, brighter to one side."""
    with open(path, "wb") as f:
        f.write(f"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y {height} +X {width}\n".encode())
        f.write(b"".join(struct.pack("4B", 128, 100 + x % 50, 90 + y, 127 + x * 4 // width)
                         for y in range(height) for x in range(width)))


class BakeTest(ProgramTest):
    def done(self, *arguments, **kw):
        result = run(*arguments, **kw)
        self.assertEqual(result.returncode, 0, (arguments, result.stderr))
        return result

    def refused(self, code, *arguments, says=""):
        """The command fails with the code and one clear line; no rest is left."""
        before = sorted(os.listdir(self.folder))
        result = run(*arguments)
        lines = [x for x in result.stderr.splitlines() if "error:" in x]
        self.assertEqual(result.returncode, code, (arguments, result.stderr))
        self.assertEqual(len(lines), 1, result.stderr)
        self.assertIn(says, lines[0])
        self.assertEqual(result.stdout, "")
        self.assertEqual(sorted(os.listdir(self.folder)), before)

    def bake(self, source, *arguments):
        out = self.path("x.trex")
        self.done("bake", source, "-o", out, *arguments)
        return out

    def same_picture(self, source, bundle, *arguments):
        """Both give the same bits."""
        a, b = self.path("a.exr"), self.path("b.exr")
        for model, out in ((source, a), (bundle, b)):
            self.done("render", model, "-o", out, "--device", "none", "--size", "256x160", "--spp", 2, *arguments)
        figures = json.loads(self.done("diff", a, b, "--json").stdout)
        self.assertTrue(figures["equal_bits"], (source, arguments, figures))

    def test_two_bakes_are_equal(self):
        for name in ("cornell", "gallery"):
            source = os.path.join(program.ASSETS, name + ".glb")
            first = self.read(self.bake(source, "--threads", 1))
            self.assertEqual(first, self.read(self.bake(source)), name)

    def test_bundles_render_the_same_bits(self):
        for name in ("cornell", "gallery"):
            source = os.path.join(program.ASSETS, name + ".glb")
            bundle = self.bake(source)
            for exact in (0, 0.5, 1):
                self.same_picture(source, bundle, "--exact", exact)

    def test_instances_textures_and_environment_maps(self):
        source = spheres_gltf(self.folder)
        sky = self.path("sky.hdr")
        hdr(sky, 32, 16)
        for exact in (0, 0.5, 1):
            bundle = self.bake(source)  # lit by the soft sky
            self.same_picture(source, bundle, "--exact", exact)
            self.same_picture(source, bundle, "--exact", exact, "--env", sky)
        sky += "?rotate=75&strength=2.5"
        bundle = self.bake(source, "--env", sky)
        self.done("render", source, "--env", sky, "-o", self.path("a.exr"), "--device", "none", "--size", "256x160",
                  "--spp", 2)
        self.done("render", bundle, "-o", self.path("b.exr"), "--device", "none", "--size", "256x160", "--spp", 2)
        figures = json.loads(self.done("diff", self.path("a.exr"), self.path("b.exr"), "--json").stdout)
        self.assertTrue(figures["equal_bits"])

    def test_summary(self):
        out = self.path("x.trex")
        result = self.done("bake", self.cornell, "-o", out, "--json")
        summary = json.loads(result.stdout)
        self.assertEqual(summary["bytes"], os.path.getsize(out))
        self.assertEqual(summary["triangles"], 32)
        self.assertEqual(summary["voxel_depth"], 8)
        parts = sum(summary[k] for k in ("scene_bytes", "hccmesh_bytes", "emitter_bytes", "voxel_bytes",
                                         "texture_bytes"))
        self.assertLess(parts, summary["bytes"])
        self.assertGreater(parts, 0.95 * summary["bytes"])
        for key in ("import", "mesh_build", "voxel_build", "hash", "write", "total"):
            self.assertGreaterEqual(summary[key + "_seconds"], 0)
        plain = self.done("bake", self.cornell, "-o", out)
        self.assertEqual(plain.stdout, f"{out} {os.path.getsize(out)} bytes\n")
        self.assertIn("replacing a bundle of", plain.stderr)

    def test_options(self):
        coarse = self.bake(self.cornell, "--precision", 10, "--depth", 5)
        about = json.loads(self.done("info", coarse, "--json").stdout)
        self.assertEqual((about["precision_bits"], about["voxels"]["depth"]), (10, 5))
        bare = self.bake(self.cornell, "--no-voxels")
        self.assertNotIn("voxels", json.loads(self.done("info", bare, "--json").stdout))
        self.same_picture(self.cornell, bare, "--exact", 1)
        picture = self.done("render", bare, "-o", self.path("a.exr"), "--size", "16x16", "--spp", 1, "--device", "none")
        self.assertIn("has no voxels", picture.stderr)

    def test_wrong_uses(self):
        self.refused(2, "bake", self.cornell, "-o", self.path("x.bin"), says=".trex")
        bundle = self.bake(self.cornell, "--depth", 3)
        self.refused(2, "bake", bundle, "-o", self.path("y.trex"), says="is a bundle")
        self.refused(3, "bake", self.path("none.glb"), "-o", self.path("y.trex"), says="no such file")
        self.refused(4, "bake", self.cornell, "-o", self.path("y.trex"), "--max-memory", "1M", says="--max-memory")
        self.refused(5, "bake", self.cornell, "-o", self.path("none/y.trex"), says="no folder")
        picture = self.write("p.trex", b"my only copy")
        self.refused(5, "bake", self.cornell, "-o", picture, says="is not a trex bundle")
        self.assertEqual(self.read(picture), b"my only copy")

    def test_full_disk(self):
        out = self.bake(self.cornell, "--depth", 3)
        old = self.read(out)
        before = sorted(os.listdir(self.folder))

        def limit():
            resource.setrlimit(resource.RLIMIT_FSIZE, (1 << 20, 1 << 20))
        result = run("bake", self.cornell, "-o", out, preexec_fn=limit)
        self.assertEqual(result.returncode, 5, result.stderr)
        self.assertIn("x.trex: can't be written", result.stderr)
        self.assertEqual(self.read(out), old)
        self.assertEqual(sorted(os.listdir(self.folder)), before)

    def test_damaged_files(self):
        good = self.read(self.bake(self.cornell, "--depth", 4))
        bad = self.path("bad.trex")
        flipped = bytearray(good)
        flipped[len(good) // 2] ^= 1
        other = bytearray(good)
        other[8] = 9
        for data, says in ((good[:-1], "truncated"), (good[:5000], "truncated"), (good + b"x", "follows its end"),
                           (b"X" + good[1:], "not a trex bundle"), (b"", "empty"), (bytes(other), "bake again"),
                           (bytes(flipped), "damaged: page")):
            self.write("bad.trex", data)
            self.refused(3, "info", bad, "--verify", says=says)
            self.refused(3, "render", bad, "-o", self.path("a.png"), "--size", "16x16", says=says)

    def test_stale_sources(self):
        source = spheres_gltf(self.folder)
        bundle = self.bake(source, "--depth", 4)
        state = lambda: [s["state"] for s in json.loads(self.done("info", bundle, "--json").stdout)["sources"]]
        picture = ("render", bundle, "-o", self.path("a.png"), "--size", "16x16", "--spp", 1, "--device", "none")
        self.assertEqual(state(), ["unchanged"] * 3)  # model, buffer, texture
        os.utime(source)
        self.assertEqual(state(), ["unchanged"] * 3)
        self.done(*picture)
        os.remove(self.path("a.png"))
        png(self.path("noise.png"), 33, 17, 2)
        self.assertEqual(sorted(state()), ["changed", "unchanged", "unchanged"])
        self.refused(3, *picture, says="noise.png, which has changed since")
        self.assertIn("has changed since", self.done(*picture, "--stale", "use").stderr)
        for name in ("spheres.gltf", "spheres.bin", "noise.png"):
            os.remove(self.path(name))
        self.assertEqual(state(), ["absent"] * 3)
        self.assertIn("is not there", self.done(*picture, "-v").stderr)

    def test_bundles_find_their_sources_from_any_folder(self):
        source = spheres_gltf(self.folder)
        bundle = self.bake(source, "--depth", 3)
        shown = json.loads(self.done("info", "x.trex", "--json", cwd=self.folder).stdout)
        self.assertEqual({s["state"] for s in shown["sources"]}, {"unchanged"})
        self.assertEqual({s["path"] for s in shown["sources"]}, {"spheres.gltf", "spheres.bin", "noise.png"})
        self.assertEqual(shown["input"], "spheres.gltf")
        self.assertNotIn(self.folder.encode(), self.read(bundle))

    def test_info(self):
        bundle = self.bake(spheres_gltf(self.folder))
        about = json.loads(self.done("info", bundle, "--verify", "--json").stdout)
        self.assertEqual(about["kind"], "bundle")
        self.assertEqual((about["unique_triangles"], about["triangles"]), (1104, 3312))
        self.assertEqual((about["meshes"], about["instances"], about["shared_meshes"]), (1, 3, 1))
        self.assertEqual(about["cameras"], ["front"])
        self.assertEqual(about["materials"], ["noise"])
        self.assertEqual(about["checksums"], "all good")
        self.assertEqual(sum(about["voxels"]["voxels_by_level"]), about["voxels"]["voxels"])
        self.assertEqual(about["voxels"]["voxels_by_level"][-1], about["voxels"]["leaves"])
        self.assertLess(about["error_bound_metres"], 1e-6)
        required = {r["name"]: r["required"] for r in about["requirements"]}
        self.assertTrue(required["textures"] and required["environment"] and required["normals"])
        self.assertFalse(required["vertex colours"] or required["transparency"])
        text = self.done("info", bundle).stdout
        for word in ("'front'", "requires", "left out", "vertices", "1104 unique, 3312 placed"):
            self.assertIn(word, text)
        model = json.loads(self.done("info", self.path("spheres.gltf"), "--json").stdout)
        self.assertEqual((model["kind"], model["triangles"], model["cameras"]), ("model", 3 * 1152, ["front"]))
        self.refused(3, "info", self.path("none.trex"), says="No such file")
        self.refused(3, "info", self.write("odd.xyz", b"what"), says="unknown extension")

    def test_sections_are_files_of_their_own_formats(self):
        data = self.read(self.bake(self.cornell, "--depth", 4))
        directory, count = struct.unpack_from("<Q", data, 24)[0], struct.unpack_from("<I", data, 40)[0]
        parts = {}
        for i in range(count):
            name, offset, size = struct.unpack_from("<48sQQ", data, directory + 64 * i)
            parts[name.rstrip(b"\0").decode()] = data[offset:offset + size]
        self.assertEqual(list(parts), ["scene.json", "world.hccm", "emitters.bin", "voxels.asvo"])
        self.assertEqual(json.loads(parts["scene.json"])["cameras"][0]["name"], "camera")
        mesh = json.loads(self.done("info", self.write("a.hccm", parts["world.hccm"]), "--json").stdout)
        self.assertEqual((mesh["kind"], mesh["triangles"]), ("hccmesh", 32))
        tree = json.loads(self.done("info", self.write("a.asvo", parts["voxels.asvo"]), "--json").stdout)
        self.assertEqual((tree["kind"], tree["voxels"]["depth"]), ("asvo", 4))
        broken = bytearray(parts["world.hccm"])
        broken[200] ^= 8
        self.refused(3, "info", self.write("a.hccm", bytes(broken)), says="a.hccm")

    def start(self, source, out):
        return start("-q", "bake", source, "-o", out, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)

    def temporary(self, process):
        return os.path.join(self.folder, f".x.{process.pid}.tmp.trex")

    def test_kills_leave_nothing_or_a_whole_bundle(self):
        source = self.path("wavy.ply")
        wavy_ply(source, 316)  # 199712 triangles
        out = self.path("x.trex")
        start = time.monotonic()
        self.assertEqual(self.start(source, out).wait(), 0)
        whole, good = time.monotonic() - start, self.read(out)
        os.remove(out)
        chance, absent, halves = random.Random(7), 0, 0
        for i in range(20):
            process = self.start(source, out)
            if i % 2 == 0:
                time.sleep(whole * (i + chance.random()) / 19)  # from the start to a little beyond the end
            else:  # while the file is written, which is short
                while process.poll() is None and not os.path.exists(self.temporary(process)):
                    time.sleep(0.001)
                time.sleep(0.003 * chance.randrange(i))
            process.kill()
            process.wait()
            if os.path.exists(out):
                self.done("info", out, "--verify")
                self.assertEqual(self.read(out), good)
                os.remove(out)
            else:
                absent += 1
                halves += os.path.exists(self.temporary(process))
        print(f"kills: {absent} left no bundle, {halves} of them a temporary", file=sys.stderr)
        self.assertGreater(absent, 5)
        rests = [x for x in os.listdir(self.folder) if ".tmp." in x]
        last = self.done("bake", source, "-o", out)
        for rest in rests:
            self.assertFalse(os.path.exists(self.path(rest)))
        self.assertEqual(self.read(out), good)
        self.assertEqual([x for x in os.listdir(self.folder) if ".tmp" in x], [], last.stderr)

    def test_rest_of_a_dead_bake_is_removed_and_said(self):
        dead = subprocess.Popen(["true"])
        dead.wait()
        rest = self.write(f".x.{dead.pid}.tmp.trex", b"half")
        result = self.done("bake", self.cornell, "-o", self.path("x.trex"), "--depth", 3)
        self.assertIn("removed what an interrupted bake left", result.stderr)
        self.assertFalse(os.path.exists(rest))

    def test_interrupt_leaves_nothing(self):
        source = self.path("wavy.ply")
        wavy_ply(source, 100)
        before = sorted(os.listdir(self.folder))
        for name in (signal.SIGINT, signal.SIGTERM):
            process = self.start(source, self.path("x.trex"))
            time.sleep(0.05)
            process.send_signal(name)
            if process.wait() != 0:
                self.assertIn(process.returncode, (-name, 128 + name))
                self.assertEqual(sorted(os.listdir(self.folder)), before)
            elif os.path.exists(self.path("x.trex")):
                os.remove(self.path("x.trex"))


if __name__ == "__main__":
    program.main()
