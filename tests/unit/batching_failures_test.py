#!/usr/bin/env python3
"""Renders whose pages do not fit in memory, and that are killed, run out of disk, or meet a bad page: nothing is lost."""
import json, os, random, re, resource, signal, subprocess, time
import program
from paged_model import PagedModelTest, contents
from program import run


def limited(size):
    """No file may be larger: what a disk does that is full."""
    return lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))


class BatchingFailures(PagedModelTest):
    def job(self, picture, *options, spp=8, bundle=None):
        return ["render", bundle or self.bundle, "-o", self.path(picture), "--size", "80x50", "--spp", spp, "--device", "none",
                "--denoise", "off", "--cache", self.few, "--ray-memory", "6M", *options]

    def start(self, *arguments, **options):
        return program.start(*arguments, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, **options)

    def render(self, *arguments, code=0, **options):
        p = self.start(*arguments, **options)
        said = p.communicate(timeout=300)[1]
        self.assertEqual(p.returncode, code, said)
        return said

    def test_killed_at_any_time_it_resumes_to_the_same_bytes(self):
        chance = random.Random(7)
        for exact in ("1", "0.3"):  # the latter with photons that wait
            options = ["--exact", exact]
            began = time.monotonic()
            self.render(*self.job("whole.exr", *options, spp=30))
            taken = time.monotonic() - began
            parts = self.job("parts.exr", *options, "--checkpoint", self.path("state"), "--checkpoint-seconds", "0.05", "--resume",
                             spp=30)
            for _ in range(5):
                p = self.start(*parts)
                time.sleep(chance.uniform(0.05, 0.05 + taken))
                p.send_signal(signal.SIGKILL)
                p.communicate()
                self.assertFalse(os.path.exists(self.path("parts.exr")) and self.read("parts.exr") != self.read("whole.exr"))
            self.render(*parts)
            self.assertEqual(self.read("parts.exr"), self.read("whole.exr"))
            self.assertEqual(sorted(os.listdir(self.folder)), ["parts.exr", "state", "whole.exr"])
            os.remove(self.path("parts.exr")), os.remove(self.path("state"))

    def test_what_a_killed_one_was_writing_is_removed(self):
        gone = subprocess.Popen(["true"])
        gone.wait()
        self.write(f".a.{gone.pid}.tmp.exr", "half a picture")
        self.write(f".state.{gone.pid}.tmp", "half a checkpoint")
        self.write(".a.other.tmp.exr", "somebody's")
        said = self.render(*self.job("a.exr", "--exact", "1", "--checkpoint", self.path("state"), spp=1))
        self.assertIn(f".a.{gone.pid}.tmp.exr", said)
        self.assertEqual(sorted(os.listdir(self.folder)), [".a.other.tmp.exr", "a.exr", "state"])

    def test_no_room_for_the_picture(self):
        earlier = self.write("a.exr", "an earlier picture")
        said = self.render(*self.job("a.exr", "--exact", "1"), code=5, preexec_fn=limited(4096))
        self.assertIn("a.exr", said)
        self.assertEqual(contents(earlier), b"an earlier picture")
        self.assertEqual(os.listdir(self.folder), ["a.exr"])

    def test_no_room_for_the_checkpoint(self):
        """The picture is written all the same, and the checkpoint before is kept."""
        options = ["--exact", "1"]
        self.render(*self.job("whole.exr", *options, spp=40))
        state = ["--checkpoint", self.path("state"), "--checkpoint-seconds", "0.01"]
        self.render(*self.job("a.exr", *options, *state, spp=2))
        kept, room = self.read("state"), len(self.read("whole.exr")) + 4096
        self.assertGreater(len(kept), room)
        said = self.render(*self.job("a.exr", *options, *state, "--resume", spp=40), code=5, preexec_fn=limited(room))
        self.assertIn("going on", said)
        self.assertIn("state: can't be written", said)
        self.assertEqual(self.read("a.exr"), self.read("whole.exr"))
        self.assertEqual(self.read("state"), kept)
        self.render(*self.job("a.exr", *options, *state, "--resume", spp=40))
        self.assertEqual(self.read("a.exr"), self.read("whole.exr"))

    def test_a_page_that_goes_bad_leaves_the_earlier_picture(self):
        copy = self.write("copy.trex", contents(self.bundle))
        earlier = self.write("a.exr", "an earlier picture")
        data, stamp = bytearray(contents(copy)), os.stat(copy)
        for exact in ("1", "0.3"):
            # Kept pages are not read again, and nobody would notice.
            p = self.start(*self.job("a.exr", "--exact", exact, "--threads", "1", "--page-disk", "off", spp=100000, bundle=copy))
            time.sleep(1.0)
            self.assertIsNone(p.poll())
            damaged = bytearray(data)
            for at in range(data.find(b"\x28\xb5\x2f\xfd", len(data) // 8), len(data) - 4, 2048):
                damaged[at] ^= 0x55
            with open(copy, "r+b") as f:
                f.write(damaged)
            os.utime(copy, ns=(stamp.st_atime_ns, stamp.st_mtime_ns))
            said = p.communicate(timeout=120)[1]
            self.assertEqual(p.returncode, 3, said)
            self.assertRegex(said, r"copy\.trex.*page \d+")
            self.assertEqual(contents(earlier), b"an earlier picture")
            self.assertEqual(sorted(os.listdir(self.folder)), ["a.exr", "copy.trex"])
            with open(copy, "r+b") as f:
                f.write(data)

    def test_memory_stays_within_its_limit(self):
        """Queues included: the largest resident size is within 5 % of --max-memory."""
        bundle = self.path("b.trex")
        self.render("bake", "synth:assembly?triangles=4e6&seed=3", "-o", bundle, "--stream")
        pages = json.loads(run("info", bundle, "--json").stdout)["mesh_pages"]
        for exact, guess in (("1", "auto"), ("0.3", "ray"), ("0.3", "cone")):
            job = ["render", bundle, "-o", self.path("a.exr"), "--size", "160x100", "--spp", "4", "--device", "none", "--denoise", "off",
                   "--exact", exact, "--guess", guess, "--json"]
            said = run(*job, "--max-memory", "10M")
            self.assertEqual(said.returncode, 4, said.stderr)
            least = float(re.search(r"needs about ([\d.]+) MiB", said.stderr)[1])
            limit = int(least) + 16  # too little for all pages
            made = run(*job, "--max-memory", f"{limit}M")
            self.assertEqual(made.returncode, 0, made.stderr)
            report = json.loads(made.stdout)
            self.assertLess(report["page_cache_bytes"], pages["memory_bytes"])
            self.assertGreater(report["ray_memory_bytes"], 0)
            self.assertLessEqual(report["page_peak_bytes"], report["page_cache_bytes"])
            self.assertLessEqual(report["peak_resident_bytes"], 1.05 * limit * 2**20, (exact, guess))


if __name__ == "__main__":
    program.main()
