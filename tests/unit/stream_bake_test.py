#!/usr/bin/env python3
"""Tests of streamed bakes on the command line: --stream, --resume after kill -9, --cache, verify, faults."""
import json, math, os, random, resource, signal, struct, subprocess, time

import program
from program import ProgramTest, run, start

MODEL = "synth:assembly?triangles=6e4"


def wavy_ply(path, side, last=None, quads=False, attributes=False):
    """A wavy sheet of 2 * side * side triangles; `last`: the last face's first corner instead of its own;
    `attributes`: normals, one of them zero, and colours."""
    n = side + 1
    faces = []
    for i in range(side):
        for a in range(i * n, i * n + side):
            faces += [(a, a + 1, a + n + 1, a + n)] if quads else [(a, a + 1, a + n), (a + 1, a + n + 1, a + n)]
    if last is not None:
        faces[-1] = (last, *faces[-1][1:])
    extra = ""
    if attributes:
        extra = "".join(f"property float n{k}\n" for k in "xyz") + "".join(f"property uchar {k}\n" for k in ("red", "green", "blue"))
    with open(path, "wb") as f:
        f.write((f"ply\nformat binary_little_endian 1.0\nelement vertex {n * n}\nproperty float x\nproperty float y\n"
                 f"property float z\n{extra}property uchar quality\nelement face {len(faces)}\n"
                 "property list uchar int vertex_indices\nend_header\n").encode())
        for i in range(n):
            for j in range(n):
                f.write(struct.pack("<3f", i / side, 0.02 * math.sin(40 * i / side), j / side))
                if attributes:
                    slope = 0.8 * math.cos(40 * i / side)
                    f.write(struct.pack("<3f3B", *((0, 0, 0) if i == j == 5 else (-slope, 1, 0)), 255 * i // side, 255 * j // side, 90))
                f.write(struct.pack("<B", 7))
        for face in faces:
            f.write(struct.pack(f"<B{len(face)}i", len(face), *face))


class StreamBake(ProgramTest):
    def bake(self, name, *options, model=MODEL, code=0):
        p = run("bake", model, "-o", self.path(name), "--json", *options)
        self.assertEqual(p.returncode, code, p.stderr)
        return json.loads(p.stdout) if code == 0 else p.stderr

    def render(self, name, picture, *options, spp="4", code=0):
        p = run("render", self.path(name), "-o", self.path(picture), "--size", "96x54", "--spp", spp, "--device", "none",
                "--json", *options)
        self.assertEqual(p.returncode, code, p.stderr)
        return json.loads(p.stdout) if code == 0 else p.stderr

    def left_over(self):
        return [f for f in os.listdir(self.folder) if f.startswith(".")]

    def test_streamed_and_in_memory_agree(self):
        a = self.bake("a.trex", "--stream", "--depth", "6")
        b = self.bake("b.trex", "--depth", "6")
        self.assertTrue(a["streamed"])
        self.assertNotIn("streamed", b)
        self.assertEqual(a["triangles"], b["triangles"])
        self.assertEqual(a["voxel_depth"], b["voxel_depth"])
        self.assertEqual(self.left_over(), [])
        for options in (["--exact", "1"], []):
            self.render("a.trex", "a.exr", *options, spp="32")
            self.render("b.trex", "b.exr", *options, spp="32")
            p = run("diff", self.path("a.exr"), self.path("b.exr"), "--json")
            d = json.loads(p.stdout)
            self.assertLess(d["flip"], 0.08, options)
            self.assertLess(abs(d["mean_ratio"] - 1), 0.02, options)

    def test_models_of_files_stream_too(self):
        model = os.path.join(program.ASSETS, "gallery.glb")
        a = self.bake("a.trex", "--stream", "--no-voxels", model=model)
        b = self.bake("b.trex", "--no-voxels", model=model)
        self.assertLessEqual(abs(a["triangles"] + a["dropped_triangles"] - b["triangles"]), b["triangles"] * 0.01)
        self.render("a.trex", "a.exr", spp="32")
        self.render("b.trex", "b.exr", spp="32")
        d = json.loads(run("diff", self.path("a.exr"), self.path("b.exr"), "--json").stdout)
        self.assertLess(abs(d["mean_ratio"] - 1), 0.03)
        self.assertLess(d["flip"], 0.15)

    def test_mapped_ply_files(self):
        for quads, attributes in ((False, False), (True, False), (False, True)):
            wavy_ply(self.path("m.ply"), 120, quads=quads, attributes=attributes)
            a = self.bake("a.trex", "--stream", "--no-voxels", model=self.path("m.ply"))
            b = self.bake("b.trex", "--no-voxels", model=self.path("m.ply"))
            self.assertEqual((a["triangles"], b["triangles"]), (28800, 28800))
            self.render("a.trex", "a.exr")
            self.render("b.trex", "b.exr")
            d = json.loads(run("diff", self.path("a.exr"), self.path("b.exr"), "--json").stdout)
            self.assertLess(d["flip"], 0.05)
            info = json.loads(run("info", self.path("a.trex"), "--json").stdout)
            needed = {r["name"]: r["required"] for r in info["requirements"]}
            self.assertEqual(needed["normals"], attributes)
        # It knows its source.
        wavy_ply(self.path("m.ply"), 121)
        self.assertIn("changed", self.render("a.trex", "c.exr", code=3))
        wavy_ply(self.path("m.ply"), 20, last=441)
        bad = self.bake("c.trex", "--stream", model=self.path("m.ply"))
        self.assertEqual((bad["replaced_parts"], bad["triangles"]), (1, 799))
        info = json.loads(run("info", self.path("c.trex"), "--json").stdout)
        self.assertIn("face 799 refers to vertices", info["replaced"][0])
        self.assertIn("face 799", self.bake("d.trex", "--stream", "--strict", model=self.path("m.ply"), code=3))
        os.remove(self.path("c.trex"))
        wavy_ply(self.path("m.ply"), 20)
        size = os.path.getsize(self.path("m.ply"))
        for cut in (size - 1, size // 2, size // 8):
            os.truncate(self.path("m.ply"), cut)
            self.assertIn("m.ply", self.bake("c.trex", "--stream", model=self.path("m.ply"), code=3))
        self.assertEqual(self.left_over(), [])

    def test_what_does_not_fit_streams_by_itself(self):
        """A file of 50 MB, of which most is not shown: six times that does not fit in 270 MB."""
        side, unseen = 250, 100
        n = side + 1
        skipped = "".join(f"property double unseen{k}\n" for k in range(unseen))
        with open(self.path("m.ply"), "wb") as f:
            f.write((f"ply\nformat binary_little_endian 1.0\nelement vertex {n * n}\nproperty float x\nproperty float y\n"
                     f"property float z\n{skipped}element face {2 * side * side}\n"
                     "property list uchar int vertex_indices\nend_header\n").encode())
            for i in range(n * n):
                f.write(struct.pack("<3f", i % n, 0, i // n) + bytes(8 * unseen))
            for a in (i * n + j for i in range(side) for j in range(side)):
                f.write(struct.pack("<B3iB3i", 3, a, a + 1, a + n, 3, a + 1, a + n + 1, a + n))
        bake = self.bake("a.trex", "--no-voxels", "--max-memory", "270M", model=self.path("m.ply"))
        self.assertTrue(bake["streamed"])
        self.assertEqual(bake["triangles"], 2 * side * side)
        self.assertLess(bake["peak_resident_bytes"], 270 << 20)
        self.assertNotIn("streamed", self.bake("b.trex", "--no-voxels", "--max-memory", "2G", model=self.path("m.ply")))
        p = run("render", self.path("m.ply"), "-o", self.path("x.png"), "--max-memory", "20M", "--size", "8x8")
        self.assertEqual(p.returncode, 4, p.stderr)
        self.assertIn("--stream", p.stderr)

    def test_equal_bytes_for_any_number_of_threads(self):
        self.bake("a.trex", "--stream", "--depth", "6", "--threads", "1")
        self.bake("b.trex", "--stream", "--depth", "6", "--threads", "3")
        self.assertEqual(self.read("a.trex"), self.read("b.trex"))

    def test_a_cache_of_five_percent_gives_the_same_bytes(self):
        self.bake("a.trex", "--stream", "--depth", "6", model="synth:scan?triangles=2e5")
        info = json.loads(run("info", self.path("a.trex"), "--json").stdout)
        pages = info["mesh_pages"]
        self.render("a.trex", "whole.exr")
        out = self.render("a.trex", "few.exr", "--cache", str(int(pages["memory_bytes"] * 0.05)))
        self.assertGreater(out["page_evictions"], 0)
        self.assertLessEqual(out["page_peak_bytes"], pages["memory_bytes"] * 0.05)
        self.assertEqual(self.read("whole.exr"), self.read("few.exr"))
        error = self.render("a.trex", "none.exr", "--cache", "1K", code=4)
        self.assertIn("cache", error)
        self.assertFalse(os.path.exists(self.path("none.exr")))

    def test_verify_and_info(self):
        self.bake("a.trex", "--stream", "--depth", "6")
        p = run("info", self.path("a.trex"), "--verify", "--json")
        self.assertEqual(p.returncode, 0, p.stderr)
        info = json.loads(p.stdout)
        self.assertEqual(info["checksums"], "all good")
        parts = info["hccmesh"]
        total = sum(v for k, v in parts.items() if k.endswith("_bytes"))
        self.assertAlmostEqual(total / info["mesh_pages"]["memory_bytes"], 1, delta=0.1)
        self.assertIn("mesh pages", run("info", self.path("a.trex")).stdout)

    def test_damage_ends_in_an_error(self):
        self.bake("a.trex", "--stream", "--no-voxels")
        good = self.read("a.trex")
        noise = random.Random(1)
        for i in range(12):
            at = noise.randrange(4096, 4096 + len(good) // 2)
            bad = bytearray(good)
            bad[at] ^= 1 << noise.randrange(8)
            with open(self.path("bad.trex"), "wb") as f:
                f.write(bad)
            p = run("info", self.path("bad.trex"), "--verify")
            self.assertEqual(p.returncode, 3, p.stderr)
            self.assertIn("bad.trex", p.stderr)
        p = run("render", self.path("bad.trex"), "-o", self.path("x.exr"), "--spp", "16", "--size", "160x90")
        self.assertIn(p.returncode, (0, 3), p.stderr)  # a page that no ray met is not read
        # All of the pages damaged: some ray meets one.
        bad = bytearray(good)
        for at in range(4096, 4096 + len(good) // 2, 500):
            bad[at] ^= 1
        with open(self.path("bad.trex"), "wb") as f:
            f.write(bad)
        p = run("render", self.path("bad.trex"), "-o", self.path("x2.exr"), "--spp", "1", "--size", "96x54")
        self.assertEqual(p.returncode, 3, p.stderr)
        self.assertIn("byte", p.stderr)
        self.assertIn("bad.trex", p.stderr)
        for size in (len(good) - 1, len(good) // 2, 5000, 100, 0):
            with open(self.path("cut.trex"), "wb") as f:
                f.write(good[:size])
            self.assertEqual(run("info", self.path("cut.trex")).returncode, 3)
        with open(self.path("long.trex"), "wb") as f:
            f.write(good + b"x")
        self.assertEqual(run("info", self.path("long.trex")).returncode, 3)
        old = bytearray(good)
        old[8] = 1
        with open(self.path("old.trex"), "wb") as f:
            f.write(old)
        self.assertIn("version 1", run("info", self.path("old.trex")).stderr)

    def test_killed_and_resumed(self):
        model = "synth:assembly?triangles=6e5"
        start = time.monotonic()
        options = ["--stream", "--depth", "5", "--max-memory", "320M"]
        whole = self.bake("whole.trex", *options, model=model)
        seconds = time.monotonic() - start
        noise = random.Random(7)
        reused, killed = 0, 0
        for i in range(10):
            command = [program.TREX, "bake", model, "-o", self.path("x.trex"), "--resume", *options]
            p = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
            time.sleep(noise.uniform(0.02, 1.0) * seconds)
            p.kill()
            killed += p.wait() == -signal.SIGKILL
            if os.path.exists(self.path("x.trex")):
                self.assertEqual(self.read("x.trex"), self.read("whole.trex"))
                os.remove(self.path("x.trex"))
        self.assertGreater(killed, 0)
        last = self.bake("x.trex", "--resume", *options, model=model)
        self.assertEqual(self.read("x.trex"), self.read("whole.trex"))
        self.assertEqual(last["buckets"], whole["buckets"])
        self.assertEqual(self.left_over(), [])

    def interrupted(self, *options, model):
        """Leaves a bake half done, with some buckets finished."""
        p = start("bake", model, "-o", self.path("x.trex"), *options, stdout=subprocess.DEVNULL,
                  stderr=subprocess.PIPE, text=True)
        deadline = time.monotonic() + 60
        journal = self.path(".x.bake-journal.tmp")
        pages = self.path(".x.bake.tmp")
        # Pages are written once the journal has its key and the spill; what it has more is buckets. Of the last
        # one, pages or its entry may not be whole yet, so wait for two more.
        listed, buckets = None, 0
        while p.poll() is None and time.monotonic() < deadline:
            if os.path.exists(pages) and os.path.getsize(pages) > 0:
                size = os.path.getsize(journal)
                buckets += listed is not None and size > listed
                listed = size
                if buckets == 2:
                    break
            time.sleep(0.002)
        p.kill()
        p.communicate()

    def test_resume_reuses_whole_buckets_and_no_damaged_ones(self):
        model = "synth:scan?triangles=2e6"
        options = ["--no-voxels", "--max-memory", "300M"]
        whole = self.bake("whole.trex", "--stream", *options, model=model)
        self.assertGreater(whole["buckets"], 3)
        self.interrupted("--stream", *options, model=model)
        self.assertFalse(os.path.exists(self.path("x.trex")))
        self.assertNotEqual(self.left_over(), [])
        # The source's name is part of the key: another seed starts anew.
        out = self.bake("x.trex", "--resume", *options, model=model + "&seed=2")
        self.assertEqual(out["buckets_reused"], 0)
        os.remove(self.path("x.trex"))
        self.interrupted("--stream", *options, model=model)
        out = self.bake("x.trex", "--resume", *options, model=model)
        self.assertGreater(out["buckets_reused"], 0)
        self.assertEqual(self.read("x.trex"), self.read("whole.trex"))
        os.remove(self.path("x.trex"))
        self.interrupted("--stream", *options, model=model)
        with open(self.path(".x.bake.tmp"), "r+b") as f:
            f.seek(5000)
            byte = f.read(1)[0]
            f.seek(5000)
            f.write(bytes([byte ^ 1]))
        out = self.bake("x.trex", "--resume", *options, model=model)
        self.assertEqual(out["buckets_reused"], 0)
        self.assertEqual(self.read("x.trex"), self.read("whole.trex"))

    def test_interrupts_keep_what_is_done(self):
        p = start("bake", "synth:scan?triangles=3e6", "-o", self.path("x.trex"), "--stream",
                  stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
        while not os.path.exists(self.path(".x.bake-spill.tmp")) and p.poll() is None:
            time.sleep(0.005)
        p.send_signal(signal.SIGINT)
        _, errors = p.communicate(timeout=60)
        self.assertEqual(p.returncode, 130, errors)
        self.assertIn("--resume", errors)
        self.assertFalse(os.path.exists(self.path("x.trex")))

    def test_a_full_disk(self):
        def limit():
            resource.setrlimit(resource.RLIMIT_FSIZE, (1_000_000, 1_000_000))
        p = run("bake", MODEL, "-o", self.path("x.trex"), "--stream", preexec_fn=limit)
        self.assertEqual(p.returncode, 5, p.stderr)
        self.assertIn("x.trex", p.stderr)
        self.assertEqual(os.listdir(self.folder), [])

    def test_what_cannot_fit_is_refused_first(self):
        start = time.monotonic()
        error = self.bake("x.trex", "--max-memory", "100M", model="synth:assembly?triangles=1e8", code=4)
        self.assertIn("--max-memory", error)
        error = self.bake("x.trex", model="synth:assembly?triangles=1e10", code=4)
        self.assertIn("disk", error)
        self.assertLess(time.monotonic() - start, 30)
        self.assertEqual(os.listdir(self.folder), [])

    def test_two_bakes_of_one_target(self):
        p = start("bake", "synth:scan?triangles=5e6", "-o", self.path("x.trex"), "--stream",
                  stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        while not os.path.exists(self.path(".x.bake-spill.tmp")) and p.poll() is None:
            time.sleep(0.005)
        error = self.bake("x.trex", "--stream", code=5)
        self.assertIn("another bake", error)
        p.kill()
        p.wait()

    def test_bad_names(self):
        for name, code in (("synth:cube", 2), ("synth:scan?triangles=0", 2), ("synth:scan?triangles=1e13", 2),
                           ("synth:scan?colour=red", 2)):
            for command in (["bake", name, "-o", self.path("x.trex")], ["info", name],
                            ["render", name, "-o", self.path("x.png")]):
                p = run(*command)
                self.assertEqual(p.returncode, code, (command, p.stderr))
                self.assertIn("synth:", p.stderr)

    def test_small_models_render_without_a_bake(self):
        p = run("render", "synth:assembly?triangles=2e4", "-o", self.path("x.png"), "--spp", "1", "--size", "64x36",
                "--device", "none")
        self.assertEqual(p.returncode, 0, p.stderr)
        p = run("render", "synth:assembly?triangles=1e9", "-o", self.path("y.png"))
        self.assertEqual(p.returncode, 4, p.stderr)
        self.assertIn("bake", p.stderr)


if __name__ == "__main__":
    program.main()
