#!/usr/bin/env python3
"""Tests of the program as a user runs it: results, wrong uses, bad files, interrupts, equal bits."""
import json, math, os, signal, struct, subprocess, time

import program
from program import ProgramTest, run, start


def glb(tree, payload=b""):
    """A .glb of a JSON tree and a binary chunk."""
    text = json.dumps(tree).encode()
    text += b" " * (-len(text) % 4)
    payload += b"\0" * (-len(payload) % 4)
    body = struct.pack("<II", len(text), 0x4E4F534A) + text
    if payload:
        body += struct.pack("<II", len(payload), 0x004E4942) + payload
    return struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body


def triangle(positions=(0, 0, 0, 1, 0, 0, 0, 1, 0), indices=(0, 1, 2), **changes):
    """One triangle as a .glb; `changes` replace parts of the JSON."""
    data = struct.pack(f"<{len(positions)}f", *positions) + struct.pack(f"<{len(indices)}H", *indices)
    size = 4 * len(positions)
    tree = {
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": len(positions) // 3, "type": "VEC3",
             "min": [0, 0, 0], "max": [1, 1, 1]},
            {"bufferView": 1, "componentType": 5123, "count": len(indices), "type": "SCALAR"}],
        "bufferViews": [{"buffer": 0, "byteOffset": 0, "byteLength": size},
                        {"buffer": 0, "byteOffset": size, "byteLength": 2 * len(indices)}],
        "buffers": [{"byteLength": len(data)}]}
    tree.update(changes)
    return glb(tree, data)


class AppTest(ProgramTest):
    def refused(self, code, *arguments, says=""):
        """The command fails with the code and one clear line; no picture and no rest is left."""
        before = set(os.listdir(self.folder))
        result = run(*arguments)
        lines = [x for x in result.stderr.splitlines() if "error:" in x]
        self.assertEqual(result.returncode, code, (arguments, result.stderr))
        self.assertEqual(len(lines), 1, result.stderr)
        self.assertIn(says, lines[0])
        self.assertEqual(result.stdout, "")
        self.assertEqual(set(os.listdir(self.folder)), before)

    def test_renders_png_and_exr_and_says_where(self):
        for name, magic in (("a.png", b"\x89PNG"), ("a.exr", b"\x76\x2f\x31\x01")):
            out = self.path(name)
            result = run("render", self.cornell, "-o", out, "--size", "32x24", "--spp", 2)
            self.assertEqual(result.returncode, 0, result.stderr)
            self.assertEqual(result.stdout.strip(), out)
            with open(out, "rb") as f:
                self.assertEqual(f.read(4), magic)

    def test_json_summary(self):
        result = run("render", self.cornell, "-o", self.path("a.exr"), "--size", "32x24", "--spp", 3,
                     "--exact", 0.5, "--json")
        self.assertEqual(result.returncode, 0, result.stderr)
        summary = json.loads(result.stdout)
        self.assertEqual(summary["samples"], 3)
        self.assertEqual((summary["width"], summary["height"]), (32, 24))
        self.assertEqual(summary["nonfinite_samples"], 0)
        self.assertGreater(summary["c_rays"], 32 * 24 * 3)
        self.assertAlmostEqual(summary["exact_paths"], 0.5 * 3 * 32 * 24, delta=32 * 24)
        self.assertGreater(summary["peak_resident_bytes"], 1 << 20)
        for key in ("import_seconds", "render_seconds", "photons", "device", "voxel_bytes"):
            self.assertIn(key, summary)

    def test_exact_auto_is_the_default(self):
        """Said so, the same picture; with one sample it is that of the guess."""
        reports = {}
        for samples in (1, 6):
            for name, options in (("default", ()), ("auto", ("--exact", "auto")), ("guess", ("--exact", 0))):
                result = run("render", self.cornell, "-o", self.path(f"{name}{samples}.exr"), "--size", "48x40", "--spp", samples,
                             "--device", "none", "--json", *options)
                self.assertEqual(result.returncode, 0, result.stderr)
                reports[name, samples] = json.loads(result.stdout)
        self.assertEqual([reports[name, 6]["exact"] for name in ("default", "auto", "guess")], ["auto", "auto", 0])
        self.assertGreater(reports["default", 6]["exact_paths"], 0)
        self.assertEqual([reports[name, 1]["exact_paths"] for name in ("default", "guess")], [0, 0])
        for a, b in (("default6", "auto6"), ("default1", "auto1"), ("default1", "guess1")):
            self.assertEqual(run("diff", self.path(a + ".exr"), self.path(b + ".exr"), "--metric", "rmse", "--max", 0).returncode, 0)
        with open(self.path("default6.exr"), "rb") as f:
            self.assertIn(b"trex:exact\0string\0\4\0\0\0auto", f.read())
        self.assertRegex(run("render", "--help").stdout, r"--exact TEXT(=| \[)auto")

    def test_exact_mode_builds_no_voxels(self):
        result = run("render", self.cornell, "-o", self.path("a.exr"), "--size", "16x16", "--spp", 1,
                     "--exact", 1, "--json")
        summary = json.loads(result.stdout)
        self.assertEqual((summary["voxels"], summary["photons"], summary["device"]), (0, 0, "none"))

    def same_bits(self, variants, *common):
        pictures = set()
        for i, variant in enumerate(variants):
            out = self.path("a.exr")
            result = run("render", self.cornell, "-o", out, "--size", "96x80", "--spp", 3, *common, *variant)
            self.assertEqual(result.returncode, 0, result.stderr)
            with open(out, "rb") as f:
                pictures.add(f.read())
        return len(pictures) == 1

    def test_threads_do_not_change_a_bit(self):
        threads = [("--threads", n) for n in (1, 2, 5)]
        for exact in (0, 0.25, "auto", 1):
            for guess in ("ray", "cone", 0.5):
                self.assertTrue(self.same_bits(threads, "--device", "none", "--exact", exact, "--guess", guess))

    def test_two_runs_on_the_device_are_equal(self):
        for guess in ("ray", "cone", 0.5):
            self.assertTrue(self.same_bits([(), ("--threads", 1)], "--guess", guess, "--exact", 0.25))

    def test_seeds_differ(self):
        self.assertFalse(self.same_bits([("--seed", 1), ("--seed", 2)], "--device", "none"))

    def test_time_limit_ends_the_run(self):
        for extra in (("--denoise", "off"), ()):
            result = run("render", self.cornell, "-o", self.path("a.exr"), "--size", "64x64", "--time", 0.3, "--json",
                         *extra)
            summary = json.loads(result.stdout)
            self.assertGreater(summary["samples"], 0)
            if extra:
                self.assertGreaterEqual(summary["render_seconds"], 0.3)
                self.assertEqual(summary["filter_seconds"], 0)
            else:  # what the filter may take is kept free for it
                self.assertGreaterEqual(summary["render_seconds"], 0.2)
                self.assertGreater(summary["filter_seconds"], 0)

    def test_interrupt_saves_the_picture(self):
        for number, code in ((signal.SIGINT, 130), (signal.SIGTERM, 143)):
            out = self.path(f"{number}.png")
            process = start("render", self.cornell, "-o", out, "--size", "64x64", "--time", 600,
                            stdout=subprocess.PIPE, stderr=subprocess.PIPE)
            time.sleep(3)
            process.send_signal(number)
            _, stderr = process.communicate(timeout=60)
            self.assertEqual(process.returncode, code, stderr)
            self.assertGreater(os.path.getsize(out), 100)

    def test_wrong_uses(self):
        out = self.path("a.png")
        for arguments, says in (
                ([], ""), (["paint"], ""), (["render"], "INPUT"), (["render", self.cornell], "output"),
                (["render", self.cornell, "-o", out, "--sise", "1x1"], "sise"),
                (["render", self.cornell, "-o", out, "--size", "0x0"], "0x0"),
                (["render", self.cornell, "-o", out, "--size", "0x10"], "0x10"),
                (["render", self.cornell, "-o", out, "--size", "10"], "WxH"),
                (["render", self.cornell, "-o", out, "--size", "-3x5"], "-3x5"),
                (["render", self.cornell, "-o", out, "--size", "99999x1"], "99999x1"),
                (["render", self.cornell, "-o", out, "--spp", "-1"], "spp"),
                (["render", self.cornell, "-o", out, "--spp", "many"], "spp"),
                (["render", self.cornell, "-o", out, "--exact", "1.5"], "exact"),
                (["render", self.cornell, "-o", out, "--exact", "nan"], "exact"),
                (["render", self.cornell, "-o", out, "--time", "-1"], "time"),
                (["render", self.cornell, "-o", out, "--threads", "0"], "threads"),
                (["render", self.cornell, "-o", out, "--device", "gpu"], "device"),
                (["render", self.cornell, "-o", out, "--guess", "magic"], "guess"),
                (["render", self.cornell, "-o", out, "--photon-bounces", "0"], "photon-bounces"),
                (["render", self.cornell, "-o", out, "--exposure", "bright"], "exposure"),
                (["render", self.cornell, "-o", out, "--camera", "1,2/3"], "camera"),
                (["render", self.cornell, "-o", out, "--max-memory", "much"], "much"),
                (["render", self.cornell, "-o", self.path("a.bmp")], ".bmp"),
                (["render", self.cornell, "-o", self.path("a")], "format")):
            with self.subTest(arguments=arguments):
                self.refused(2, *arguments, says=says)

    def test_bad_input(self):
        nan = float("nan")
        good = triangle()
        for name, data, says in (
                ("truncated.glb", good[:len(good) // 2], "truncated.glb"),
                ("empty.glb", b"", "empty.glb"),
                ("words.glb", b"hello, this is no model", "words.glb"),
                ("long.glb", triangle(accessors=[
                    {"bufferView": 0, "componentType": 5126, "count": 3000000, "type": "VEC3"},
                    {"bufferView": 1, "componentType": 5123, "count": 3, "type": "SCALAR"}]), "long.glb"),
                ("index.glb", triangle(indices=(0, 1, 7)), "index.glb"),
                ("nan.glb", triangle(positions=(nan,) * 9), "nan.glb"),
                ("nothing.glb", triangle(nodes=[{}]), "nothing.glb"),
                ("required.glb", triangle(extensionsUsed=["KHR_unheard_of"], extensionsRequired=["KHR_unheard_of"]),
                 "KHR_unheard_of"),
                ("cut.ply", b"ply\nformat binary_little_endian 1.0\nelement vertex 999\nproperty float x\n"
                            b"property float y\nproperty float z\nend_header\n", "cut.ply"),
                ("bad.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n", "bad.obj"),
                ("model.xyz", b"?", "model.xyz")):
            with self.subTest(name=name):
                self.refused(3, "render", self.write(name, data), "-o", self.path("a.png"), "--spp", 1, says=says)
        self.refused(3, "render", self.path("missing.glb"), "-o", self.path("a.png"), says="missing.glb")
        self.refused(3, "render", self.folder, "-o", self.path("a.png"))
        self.refused(3, "render", self.cornell, "-o", self.path("a.png"), "--env", self.path("none.hdr"), says="none.hdr")

    def test_replaced_parts(self):
        """One bad part does not refuse the rest; it is counted, kept in bundles, and an error with --strict."""
        bad = self.write("image.glb", triangle(
            images=[{"uri": "data:image/png;base64,AAAA"}], textures=[{"source": 0}],
            materials=[{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}],
            meshes=[{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1, "material": 0}]}]))
        small = ("--size", "8x8", "--spp", 1, "--exact", 1)
        summary = json.loads(run("render", bad, "-o", self.path("a.png"), *small, "--json").stdout)
        self.assertEqual(summary["replaced_parts"], 2)  # its coordinates are missing too
        bundle = self.path("b.trex")
        baked = json.loads(run("bake", bad, "-o", bundle, "--no-voxels", "--json").stdout)
        self.assertEqual(baked["replaced_parts"], 2)
        for model in (bad, bundle):
            info = json.loads(run("info", model, "--json").stdout)
            self.assertEqual(info["replaced_parts"], 2)
            self.assertIn("image 0", info["replaced"][1])
            self.assertIn("replaced", run("info", model).stdout)
            self.refused(3, "render", model, "-o", self.path("c.png"), *small, "--strict", says="without --strict")
            self.refused(3, "info", model, "--strict", says="without --strict")
        self.refused(3, "bake", bad, "-o", self.path("d.trex"), "--strict", says="without --strict")

    def test_options_before_the_model(self):
        small = ("--size", "8x8", "--spp", 1, "--exact", 1)
        for options in (("--aov", "albedo,depth"), ("--aov", "albedo", "--aov", "depth"),
                        ("--camera", "-3,2,8/0,0,0/0,1,0/40"), ("--env", "1,1,1")):
            result = run("render", *options, self.cornell, "-o", self.path("a.exr"), *small)
            self.assertEqual(result.returncode, 0, (options, result.stderr))
        self.assertIn("bake", run("help").stdout)
        self.assertIn("--strict", run("help", "render").stdout)

    def test_a_model_on_standard_input(self):
        for name in ("/dev/stdin", "-"):
            result = run("render", name, "-o", self.path("a.png"), input="glTF")
            self.assertEqual(result.returncode, 3, result.stderr)
            self.assertIn("save it", result.stderr)

    def test_framing_of_tall_pictures(self):
        """A bar without a camera is whole in a portrait too: both edges of the picture are background."""
        bar = self.write("bar.glb", triangle(positions=(-10, 0, 0, 10, 0, 0, 10, 1, 0)))
        for size in ("32x32", "16x48"):
            out = self.path("a.exr")
            summary = json.loads(run("render", bar, "-o", out, "--size", size, "--spp", 4, "--exact", 1,
                                     "--aov", "objectId", "--json").stdout)
            eye, target, _, fov = summary["camera"].split("/")
            width, height = (int(n) for n in size.split("x"))
            eye, target = ([float(n) for n in t.split(",")] for t in (eye, target))
            forward = [b - a for a, b in zip(eye, target)]
            half = math.tan(math.radians(float(fov)) / 2) * width / height
            for x in (-10, 10):
                depth = sum(f * (p - e) for f, p, e in zip(forward, (x, 0, 0), eye))
                self.assertLess(abs(x), depth * half)

    def test_unwritable_output(self):
        self.refused(5, "render", self.cornell, "-o", self.path("no/such/a.png"), says="no/such")
        os.mkdir(self.path("folder.png"))
        self.refused(5, "render", self.cornell, "-o", self.path("folder.png"), says="folder.png")
        if os.path.exists("/dev/full"):
            self.refused(5, "render", self.cornell, "-o", "/proc/a.png", "--spp", 1, "--size", "8x8", says="/proc/a.png")

    def test_limits(self):
        self.refused(4, "render", self.cornell, "-o", self.path("a.png"), "--max-memory", "10K", says="allowed")
        self.refused(4, "render", self.cornell, "-o", self.path("a.png"), "--device", 99, "--spp", 1, says="--device none")

    def test_one_pixel_and_one_triangle(self):
        model = self.write("one.glb", triangle())
        for device in ("none", "auto"):
            result = run("render", model, "-o", self.path("a.exr"), "--size", "1x1", "--spp", 1, "--device", device)
            self.assertEqual(result.returncode, 0, result.stderr)
            self.assertIn("sky", result.stderr)

    def test_doctor_lists_devices(self):
        result = run("doctor", "--json")
        self.assertEqual(result.returncode, 0, result.stderr)
        found = json.loads(result.stdout)
        self.assertEqual(found["problem"], "")
        self.assertGreaterEqual(len(found["devices"]), 1)
        self.assertGreater(found["memory_bytes"], 1 << 28)
        self.assertIn("G-rays work", run("doctor").stdout)

    def test_help_and_version(self):
        self.assertIn("Exit codes", run("--help").stdout)
        self.assertRegex(run("--version").stdout, r"^trex \d+\.\d+\.\d+")


if __name__ == "__main__":
    program.main()
