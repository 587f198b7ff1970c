#!/usr/bin/env python3
"""Paths that wait for pages: the same bytes as in memory, and errors that are clear."""
import json, os, signal, subprocess, time
import program
from paged_model import MODEL, PagedModelTest, contents
from program import run


class RayBatching(PagedModelTest):
    def render(self, picture, *options, code=0, spp=3, bundle=None):
        p = run("render", bundle or self.bundle, "-o", self.path(picture), "--size", "80x50", "--spp", spp, "--device", "none",
                "--denoise", "off", "--json", *options)
        self.assertEqual(p.returncode, code, p.stderr)
        return json.loads(p.stdout) if code == 0 else p.stderr

    def same(self, *options, **kw):
        """All in memory, on demand, and waiting, the latter with room for all paths and for few."""
        whole = self.render("all.exr", *options, **kw)
        self.assertEqual(whole["ray_memory_bytes"], 0)
        demand = self.render("demand.exr", "--cache", self.few, "--ray-memory", "off", *options, **kw)
        waiting = self.render("waiting.exr", "--cache", self.few, *options, **kw)
        self.render("little.exr", "--cache", self.few, "--ray-memory", "6M", "--threads", "1", *options, **kw)
        again = self.render("again.exr", "--cache", self.few, "--page-disk", "off", *options, **kw)
        self.assertEqual((whole["page_loads_restored"], again["page_loads_restored"]), (0, 0))
        self.assertEqual((whole["page_disk_bytes"], again["page_disk_bytes"]), (0, 0))
        for other in ("demand", "waiting", "little", "again"):
            self.assertEqual(self.read(other + ".exr"), self.read("all.exr"), other)
        self.assertLessEqual(waiting["page_peak_bytes"], int(self.few))
        for key in ("c_rays", "shadow_rays", "g_rays", "cache_reads", "exact_paths"):
            self.assertEqual(waiting[key], whole[key], key)
        return whole, demand, waiting

    def test_exact_paths(self):
        whole, demand, waiting = self.same("--exact", "1", "--aov", "all")
        self.assertLess(waiting["page_loads"], demand["page_loads"] / 4)

    def test_guesses_that_read_cached_light(self):
        whole, demand, waiting = self.same("--exact", "0.3", "--guess", "ray")
        self.assertGreater(whole["cache_reads"], 0)
        self.assertLess(waiting["page_loads"], demand["page_loads"] / 4)  # photons and importons wait, too

    def test_a_dial_asks_for_no_more_pages(self):
        """It looks where samples wait for each other anyway."""
        dialled = self.same("--aov", "all", spp=20)[2]
        self.assertGreater(dialled["exact_paths"], 0)
        guess = self.render("guess.exr", "--exact", "0", "--cache", self.few, spp=20)
        self.assertLess(dialled["page_loads"], 1.5 * guess["page_loads"])

    def test_guesses_that_ask_cones(self):
        self.assertGreater(self.same("--exact", "0.3", "--guess", "cone")[0]["g_rays"], 0)

    def test_an_error_as_the_goal_stops_at_the_same_sample(self):
        options = ["--exact", "1", "--error", "0.05", "--seed", "2"]
        a = self.render("a.exr", *options, spp=64)
        b = self.render("b.exr", "--cache", self.few, *options, spp=64)
        self.assertEqual(a["samples"], b["samples"])
        self.assertEqual(self.read("a.exr"), self.read("b.exr"))

    def test_disk_for_unpacked_pages(self):
        """As much as is asked for at most, and nothing stays there."""
        options = ["--exact", "1", "--cache", self.few]
        kept = self.render("a.exr", *options)
        self.assertGreater(kept["page_loads_restored"], 0)
        self.assertLess(kept["page_loads_restored"], kept["page_loads"])
        self.assertLess(kept["page_disk_bytes"], 2 * self.pages["memory_bytes"])
        little = self.render("b.exr", *options, "--page-disk", "100K")
        self.assertLessEqual(little["page_disk_bytes"], 100 << 10)
        self.assertEqual(self.read("a.exr"), self.read("b.exr"))
        self.assertEqual(sorted(os.listdir(self.folder)), ["a.exr", "b.exr"])
        self.assertIn("much", self.render("a.exr", *options, "--page-disk", "much", code=2))

    def test_memory_that_is_not_there_is_refused(self):
        said = self.render("a.exr", "--exact", "1", "--cache", self.few, "--ray-memory", "6G", "--max-memory", "1G", code=4)
        self.assertIn("--ray-memory 6G", said)
        self.assertFalse(os.path.exists(self.path("a.exr")))
        self.render("a.exr", "--ray-memory", "much", "--cache", self.few, code=2)
        for option, size in (("--ray-memory", "-5"), ("--ray-memory", "much"), ("--cache", "much")):
            said = self.render("a.exr", option, size, code=2, bundle=MODEL)  # all of which fits in memory
            self.assertIn(size, said)

    def test_a_damaged_page_is_named(self):
        damaged = bytearray(contents(self.bundle))
        start = damaged.find(b"\x28\xb5\x2f\xfd", len(damaged) // 8)  # frames of zstd: pages
        for at in range(start, len(damaged) - 4, 4096):
            if damaged[at:at + 16] != bytes(16):
                damaged[at] ^= 0x55
        bad = self.write("bad.trex", bytes(damaged))
        said = self.render("a.exr", "--exact", "1", "--cache", self.few, code=3, bundle=bad)
        self.assertIn("bad.trex", said)
        self.assertFalse(os.path.exists(self.path("a.exr")))

    def test_a_page_that_goes_bad_leaves_the_checkpoint(self):
        options = ["--exact", "1", "--cache", self.few]
        copy = self.write("copy.trex", contents(self.bundle))
        kept = self.path("kept")
        self.render("half.exr", *options, "--checkpoint", kept, spp=2, bundle=copy)
        before = self.read("kept")
        data = bytearray(contents(copy))
        stamp = os.stat(copy)
        start = data.find(b"\x28\xb5\x2f\xfd", len(data) // 8)
        damaged = bytearray(data)
        for at in range(start, len(data) - 4, 2048):
            damaged[at] ^= 0x55
        # What a bundle holds is part of a job's name, so the file changes under a program that runs.
        p = program.start("render", copy, "-o", self.path("b.exr"), "--size", "400x300", "--spp", "4000", "--device", "none",
                          *options, "--threads", "1", "--page-disk", "off", stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
        time.sleep(1.0)
        with open(copy, "r+b") as f:
            f.write(damaged)
        os.utime(copy, ns=(stamp.st_atime_ns, stamp.st_mtime_ns))
        self.assertEqual(p.wait(timeout=120), 3)
        self.assertIn("copy.trex", p.stderr.read())
        p.stderr.close()
        with open(copy, "r+b") as f:
            f.write(data)
        self.assertEqual(self.read("kept"), before)
        self.render("whole.exr", *options, "--checkpoint", kept, "--resume", spp=4, bundle=copy)
        self.render("all.exr", *options, spp=4, bundle=copy)
        self.assertEqual(self.read("whole.exr"), self.read("all.exr"))

    def test_interrupted_and_resumed(self):
        options = ["--exact", "1", "--cache", self.few, "--ray-memory", "6M", "--checkpoint", self.path("kept")]
        p = program.start("render", self.bundle, "-o", self.path("a.exr"), "--size", "80x50", "--spp", "300", "--device", "none",
                          "--denoise", "off", *options, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        time.sleep(1.0)
        p.send_signal(signal.SIGTERM)
        self.assertIn(p.wait(timeout=120), (0, 143))
        self.render("a.exr", *options, "--resume", spp=300)
        self.render("b.exr", "--exact", "1", spp=300)
        self.assertEqual(self.read("a.exr"), self.read("b.exr"))

    def test_traces(self):
        options = ["--exact", "1", "--cache", self.few]
        self.render("a.exr", *options, "--trace", self.path("t.json"))
        events = json.loads(self.read("t.json"))["traceEvents"]
        rows = {e["tid"]: e["args"]["name"] for e in events if e["ph"] == "M"}
        spans = {}
        for e in events:
            if e["ph"] == "X":
                spans.setdefault(rows[e["tid"]], []).append((e["ts"], e["ts"] + e["dur"]))
        self.assertIn("planned", spans)
        self.assertIn("planned reads", spans)
        self.assertIn("thread 0", spans)
        for row, times in spans.items():
            if row.startswith("planned"):
                continue
            times.sort()
            for before, after in zip(times, times[1:]):
                self.assertLessEqual(before[1], after[0] + 1e-3, row)
        for name, first in (("t.svg", b"<svg"), ("t.html", b"<!doctype html>")):
            self.render("a.exr", *options, "--trace", self.path(name))
            self.assertTrue(self.read(name).startswith(first))
        self.render("a.exr", "--exact", "0.3", "--guess", "cone", "--cache", self.few, "--trace", self.path("t.json"))
        events = json.loads(self.read("t.json"))["traceEvents"]
        rows = {e["tid"]: e["args"]["name"] for e in events if e["ph"] == "M"}
        cones = [rows[e["tid"]] for e in events if e["ph"] == "X" and rows[e["tid"]].endswith("cones")]
        self.assertGreater(cones.count("cones"), 0)
        self.assertEqual(cones.count("cones"), cones.count("planned cones"))
        said = run("render", self.bundle, "-o", self.path("a.exr"), "--size", "8x8", "--spp", "1", "--device", "none", "--trace",
                   self.path("none.json"))
        self.assertEqual(said.returncode, 0)
        self.assertIn("no path waited", said.stderr)
        self.render("a.exr", *options, "--trace", self.path("no/such/folder.json"), code=5)


if __name__ == "__main__":
    program.main()
