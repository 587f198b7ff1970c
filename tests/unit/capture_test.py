#!/usr/bin/env python3
"""Tests of capture: several cameras, paths, layers, checkpoints through kills, signals, limits."""
import json, os, random, signal, subprocess, time

import program
from program import ProgramTest, run, start

KILLS = 20


class CaptureTest(ProgramTest):
    def render(self, *arguments, code=0, says="", device="none"):
        result = run("render", self.cornell, "--device", device, *arguments)
        self.assertEqual(result.returncode, code, result.stderr)
        self.assertIn(says, result.stderr)
        return result

    def start(self, *arguments):
        return start("render", self.cornell, *arguments, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)

    def wait_for(self, condition, process):
        for _ in range(1200):
            if condition() or process.poll() is not None:
                return
            time.sleep(0.05)
        self.fail("waited for a minute")

    def test_killed_at_random_it_resumes_to_the_same_bits(self):
        chance = random.Random(5)
        for exact, device in (("auto", "none"), (0, "auto")):
            # The kills of both jobs together make KILLS.
            job = ["--size", "96x72", "--spp", 200, "--exact", exact, "--device", device, "--aov", "all", "--seed", 3]
            whole = self.path("whole.exr")
            began = time.monotonic()
            self.assertEqual(run("render", self.cornell, "-o", whole, *job).returncode, 0)
            taken = time.monotonic() - began
            out, state = self.path("parts.exr"), self.path("job.checkpoint")
            parts = ["-o", out, *job, "--checkpoint", state, "--checkpoint-seconds", 0.05, "--resume"]
            for _ in range(KILLS // 2):
                process = self.start(*parts)
                time.sleep(chance.uniform(0.1, 0.1 + taken))
                process.send_signal(signal.SIGKILL)
                process.communicate()
                self.assertFalse(os.path.exists(out) and self.read(out) != self.read(whole), "a wrong picture was left")
            result = run("render", self.cornell, *parts)
            self.assertEqual(result.returncode, 0, result.stderr)
            self.assertEqual(self.read(out), self.read(whole))
            os.remove(out), os.remove(state)

    def test_interrupt_saves_picture_and_checkpoint(self):
        whole, out, state = self.path("whole.exr"), self.path("a.exr"), self.path("a.checkpoint")
        job = ["--size", "64x64", "--spp", 400, "--exact", 1, "--aov", "sampleCount"]
        self.render("-o", whole, *job)
        process = self.start("-o", out, *job, "--checkpoint", state, "--checkpoint-seconds", 0.1)
        self.wait_for(lambda: os.path.exists(state), process)
        process.send_signal(signal.SIGINT)
        _, stderr = process.communicate(timeout=60)
        if process.returncode == 0:
            self.skipTest("it was finished before the signal")
        self.assertEqual(process.returncode, 130, stderr)
        self.assertTrue(os.path.exists(out))
        self.assertNotEqual(self.read(out), self.read(whole))
        result = run("render", self.cornell, "-o", out, *job, "--checkpoint", state, "--resume")
        self.assertEqual(result.returncode, 0, result.stderr)
        self.assertIn("going on after", result.stderr)
        self.assertEqual(self.read(out), self.read(whole))

    def test_more_samples_than_the_finished_job(self):
        state = self.path("a.checkpoint")
        common = ["--size", "32x32", "--exact", 0.5, "--checkpoint", state]
        self.render("-o", self.path("a.exr"), *common, "--spp", 4)
        self.render("-o", self.path("a.exr"), *common, "--spp", 9, "--resume", says="going on after 4 samples")
        self.render("-o", self.path("b.exr"), "--size", "32x32", "--exact", 0.5, "--spp", 9)
        self.assertEqual(self.read("a.exr"), self.read("b.exr"))

    def test_checkpoints_of_other_jobs_are_refused(self):
        state, out = self.path("a.checkpoint"), self.path("a.exr")
        job = ["-o", out, "--size", "32x32", "--checkpoint", state, "--spp", 2]
        self.render(*job)
        before = self.read(state)
        self.render(*job, code=2, says="--resume")
        self.render(*job, "--resume", "--seed", 7, code=3, says="other settings")
        self.render(*job, "--resume", "--exact", 0, code=3, says="other settings")
        self.render("-o", out, "--size", "32x16", "--checkpoint", state, "--resume", code=3, says="other settings")
        self.render(*job, "--resume", "--camera", "1,1,1/0,0,0/0,1,0/40", code=3, says="other settings")
        self.assertEqual(self.read(state), before)
        with open(state, "r+b") as f:
            f.seek(300)
            f.write(b"?")
        self.render(*job, "--resume", code=3, says="checksum")
        self.render("-o", out, "--resume", code=2, says="--checkpoint")
        self.render("-o", out, "--checkpoint", out, code=2, says="name another")
        self.render("-o", out, "--checkpoint", self.path("no/such/file"), code=5, says="no/such")

    def test_the_default_share_goes_on_as_auto(self):
        state = self.path("a.checkpoint")
        job = ["--size", "64x48", "--checkpoint", state, "-o", self.path("a.exr")]
        self.render(*job, "--spp", 5)
        self.render(*job, "--spp", 14, "--resume", "--exact", "auto", says="going on after 5 samples")
        self.render("--size", "64x48", "-o", self.path("b.exr"), "--spp", 14)
        self.assertEqual(self.read("a.exr"), self.read("b.exr"))

    def test_hangup_writes_the_picture_and_goes_on(self):
        out = self.path("a.exr")
        process = self.start("-o", out, "--size", "64x64", "--spp", 3000, "--exact", 1)
        time.sleep(1.5)
        process.send_signal(signal.SIGHUP)
        self.wait_for(lambda: os.path.exists(out), process)
        early = self.read(out)
        self.assertIsNone(process.poll())
        process.send_signal(signal.SIGTERM)
        _, stderr = process.communicate(timeout=60)
        self.assertEqual(process.returncode, 143, stderr)
        self.assertIn("going on", stderr)
        self.assertNotEqual(self.read(out), early)

    def test_a_lost_device_leaves_the_picture_so_far(self):
        out = self.path("a.exr")
        result = self.lose_device(60, "-o", out, "--spp", 5000, "--device", 0, "--aov", "sampleCount")
        self.assertEqual(result.returncode, 4, result.stderr)
        self.assertIn("--device none", result.stderr)
        self.assertIn("saved after", result.stderr)
        self.assertEqual(run("diff", out, out).returncode, 0)

    def lose_device(self, submit, *parts, guess="cone"):
        command = ["render", self.cornell, "--size", "64x64", "--guess", guess, *parts]
        return run(*command, env={**os.environ, "TREX_FAIL_SUBMIT": str(submit)})

    def test_after_a_lost_device_the_cpu_goes_on(self):
        whole, out = self.path("whole.exr"), self.path("a.exr")
        job = ["--spp", 32, "--denoise", "off"]
        self.render("-o", whole, "--size", "64x64", "--guess", "cone", *job)
        # While photons are shot, while cones are traced, in the rounds of photons that follow: the
        # photons that were lost are shot again, and the picture is the same.
        for submit in (1, 5, 11, 25):
            result = self.lose_device(submit, "-o", out, *job, "--json")
            self.assertEqual(result.returncode, 0, result.stderr)
            self.assertEqual(result.stderr.count("going on with the C++ tracer"), 1, result.stderr)
            self.assertIn(", then cpu", json.loads(result.stdout)["device"])
            self.assertIn(b", then cpu", self.read(out))
            self.assertEqual(json.loads(result.stdout)["samples"], 32)
            diff = run("diff", out, whole, "--metric", "flip", "--max", 0.001)
            self.assertEqual(diff.returncode, 0, (submit, diff.stdout, diff.stderr))

    def test_a_share_of_cones_outlasts_a_lost_device(self):
        whole, out = self.path("whole.exr"), self.path("a.exr")
        job = ["--spp", 32, "--denoise", "off", "--json"]
        full = json.loads(self.render("-o", whole, "--size", "64x64", "--guess", 0.5, *job, device="auto").stdout)
        self.assertEqual(full["gathered_by_device"], full["g_rays"])
        self.assertEqual(full["gathered_by_cpu"], full["cache_reads"])
        self.assertGreater(full["gathered_by_cpu"], 0)
        result = self.lose_device(25, "-o", out, *job, guess="0.5")
        self.assertEqual(result.returncode, 0, result.stderr)
        self.assertEqual(result.stderr.count("going on with the C++ tracer"), 1, result.stderr)
        lost = json.loads(result.stdout)
        self.assertIn(", then cpu", lost["device"])
        self.assertEqual((lost["guess"], lost["samples"]), ("0.5", 32))
        self.assertEqual(lost["g_rays"], full["g_rays"])
        self.assertGreater(lost["gathered_by_device"], 0)
        self.assertLess(lost["gathered_by_device"], lost["g_rays"])
        self.assertEqual(lost["gathered_by_device"] + lost["gathered_by_cpu"], lost["g_rays"] + lost["cache_reads"])
        self.assertIn(b", then cpu", self.read(out))
        self.assertIn(b"trex:guess", self.read(out))
        diff = run("diff", out, whole, "--metric", "flip", "--max", 0.001)
        self.assertEqual(diff.returncode, 0, (diff.stdout, diff.stderr))

    def test_a_share_of_cones_resumes_to_the_same_bits(self):
        job = ["--size", "64x64", "--guess", 0.5, "--exact", 0.25, "--denoise", "off"]
        whole, out, state = self.path("whole.exr"), self.path("a.exr"), self.path("a.checkpoint")
        for device in ("none", "auto"):
            self.render("-o", whole, *job, "--spp", 6, device=device)
            self.render("-o", out, *job, "--spp", 3, "--checkpoint", state, device=device)
            other = ["0.25" if x == 0.5 else x for x in job[:4]] + job[4:]
            self.render("-o", out, *other, "--spp", 6, "--checkpoint", state, "--resume", code=3, says="other settings",
                        device=device)
            self.render("-o", out, *job, "--spp", 6, "--checkpoint", state, "--resume", device=device)
            self.assertEqual(self.read(out), self.read(whole))
            os.remove(state)

    def test_several_cameras_make_numbered_pictures(self):
        views = ["0,1,3.2/0,1,0/0,1,0/40", "0.5,1,3.2/0,1,0/0,1,0/40"]
        result = self.render("-o", self.path("a.exr"), "--size", "24x16", "--spp", 2, "--camera", views[0],
                             "--camera", views[1], "--json")
        names = [self.path("a.0001.exr"), self.path("a.0002.exr")]
        self.assertEqual([x["output"] for x in json.loads(result.stdout)], names)
        for view, name in zip(views, names):
            self.render("-o", self.path("single.exr"), "--size", "24x16", "--spp", 2, "--camera", view)
            self.assertEqual(self.read("single.exr"), self.read(name))

    def test_camera_path(self):
        cams = self.write("cams.json", json.dumps({"trex": 1, "cameras": [
            {"eye": [0, 1, 3.2], "target": [0, 1, 0], "vfov": 40, "fstop": 1.4, "focus": 3},
            {"eye": [0, 1, 3.2], "target": [0, 1, 0]}]}))
        result = self.render("-o", self.path("shot_##.png"), "--size", "24x16", "--spp", 2, "--path", cams)
        self.assertEqual(result.stdout.split(), [self.path("shot_01.png"), self.path("shot_02.png")])
        self.assertNotEqual(self.read("shot_01.png"), self.read("shot_02.png"))
        result = self.render("-o", self.path("b.png"), "--size", "8x8", "--spp", 1, "--camera", "all")
        self.assertEqual(result.stdout.split(), [self.path("b.png")])

    def test_bad_camera_paths(self):
        out = self.path("a.png")
        good = {"eye": [0, 1, 3], "target": [0, 1, 0]}
        for data, says in (("{", "JSON"), ("[]", "/trex"), ('{"trex": 2, "cameras": []}', "/trex"),
                           ('{"trex": 1}', "/cameras"), ('{"trex": 1, "cameras": []}', "/cameras"),
                           ('{"trex": 1, "cameras": [5]}', "/cameras/0"),
                           (json.dumps({"trex": 1, "cameras": [good, {**good, "eye": [0, 1]}]}), "/cameras/1"),
                           (json.dumps({"trex": 1, "cameras": [{**good, "fov": 3}]}), "fov"),
                           (json.dumps({"trex": 1, "cameras": [{**good, "eye": ["a", 0, 0]}]}), "/cameras/0"),
                           (json.dumps({"trex": 1, "cameras": [{**good, "fstop": 2}]}), "needs fstop and focus"),
                           (json.dumps({"trex": 1, "cameras": [{**good, "vfov": 200}]}), "field of view"),
                           (json.dumps({"trex": 1, "cameras": [{**good, "target": [0, 1, 3]}]}), "differ"),
                           (json.dumps({"trex": 1, "cameras": ["nobody"]}), "nobody"),
                           (json.dumps({"trex": 1, "cameras": [good], "fps": 3}), "/fps")):
            with self.subTest(data=data):
                self.render("-o", out, "--path", self.write("cams.json", data), code=3, says=says)
        self.render("-o", out, "--path", self.path("none.json"), code=3, says="none.json")
        self.render("-o", out, "--path", self.path("cams.json"), "--camera", "all", code=2, says="--path")

    def test_layers_and_metadata(self):
        out = self.path("a.exr")
        self.render("-o", out, "--size", "16x16", "--spp", 2, "--aov", "depth,objectId,direct", "--seed", 9)
        data = self.read(out)
        for name in (b"depth", b"objectId", b"direct.R", b"trex:seed", b"trex:camera", b"trex:nonFiniteSamples"):
            self.assertIn(name, data)
        self.assertNotIn(b"variance", data)
        self.render("-o", out, "--aov", "depht", code=2, says="depht")

    def test_without_background_it_resumes_to_the_same_bits(self):
        job = ["--size", "24x24", "--camera", "0,1,9/0,1,0/0,1,0/40?fstop=2&focus=8", "--transparent", "--exact", 0.5]
        whole, out, state = self.path("whole.exr"), self.path("a.exr"), self.path("a.checkpoint")
        self.render("-o", whole, *job, "--spp", 6)
        self.render("-o", out, *job, "--spp", 3, "--checkpoint", state)
        self.render("-o", out, *job, "--spp", 6, "--checkpoint", state, "--resume")
        self.assertEqual(self.read(out), self.read(whole))
        self.assertIn(b"trex:transparent", self.read(whole))
        for other in (job[:-3] + job[-2:], [x.replace("fstop=2", "fstop=4") for x in map(str, job)]):
            self.render("-o", out, *other, "--spp", 7, "--checkpoint", state, "--resume", code=3, says="other settings")

    def test_pictures_for_the_eye(self):
        """Operators, depths and formats of one render; a .jpg is close to the .png."""
        job = ["--size", "32x32", "--spp", 4, "--exposure", 1]
        pictures = {}
        for name, options in (("none.png", ["--tonemap", "none"]), ("agx.png", ["--tonemap", "agx"]),
                              ("neutral.png", ["--tonemap", "neutral"]), ("default.png", []), ("deep.png", ["--bits", 16]),
                              ("a.jpg", ["--quality", 98])):
            self.render("-o", self.path(name), *job, *options)
            pictures[name] = self.read(self.path(name))
        self.assertEqual(pictures["default.png"], pictures["neutral.png"])
        self.assertNotEqual(pictures["neutral.png"], pictures["none.png"])
        self.assertNotEqual(pictures["neutral.png"], pictures["agx.png"])
        self.assertEqual(pictures["a.jpg"][:3], b"\xff\xd8\xff")
        self.assertEqual((pictures["default.png"][24], pictures["deep.png"][24]), (8, 16))  # bits of the header
        for other, limit in (("deep.png", 0.002), ("a.jpg", 0.02)):
            diff = run("diff", self.path(other), self.path("default.png"), "--metric", "rmse", "--max", limit)
            self.assertEqual(diff.returncode, 0, diff.stdout)

    def test_error_goal(self):
        result = self.render("-o", self.path("a.exr"), "--size", "32x32", "--exact", 1, "--error", 0.05, "--json")
        summary = json.loads(result.stdout)
        self.assertLessEqual(summary["estimated_relmse"], 0.05)
        self.assertGreaterEqual(summary["samples"], 16)

    def test_memory_limit_is_kept_or_refused(self):
        for limit, size in (("1G", "640x360"), ("300M", "320x180"), ("200M", "64x64"), ("100M", "64x64"),
                            ("300M", "4000x4000")):
            for device in ("none", "auto"):
                out = self.path("a.exr")
                result = run("render", self.cornell, "-o", out, "--size", size, "--spp", 1, "--device", device,
                             "--max-memory", limit, "--json")
                if result.returncode == 4:
                    self.assertIn("allowed", result.stderr)
                    continue
                self.assertEqual(result.returncode, 0, result.stderr)
                allowed = int(limit[:-1]) << (30 if limit[-1] == "G" else 20)
                self.assertLessEqual(json.loads(result.stdout)["peak_resident_bytes"], 1.02 * allowed, (limit, device))
        result = run("render", self.cornell, "-o", self.path("a.exr"), "--max-memory", "20M")
        self.assertEqual(result.returncode, 4)

    def test_device_memory_limit(self):
        """What does not fit on the device is paged: the picture is complete and nearly the same."""
        whole, out = self.path("whole.exr"), self.path("a.exr")
        job = ["--size", "200x200", "--spp", 4, "--denoise", "off", "--guess", "cone", "--json"]
        full = json.loads(self.render("-o", whole, *job, device="auto").stdout)
        self.assertNotIn("voxel_pages", full)
        for limit, flip in ((64 << 20, 0.05), (4 << 20, 0.05), (1 << 20, 0.12)):
            summary = json.loads(self.render("-o", out, *job, "--max-gpu-memory", limit, device="auto").stdout)
            self.assertLessEqual(summary["device_bytes"], limit)
            self.assertEqual(summary["voxel_depth"], full["voxel_depth"])
            self.assertEqual(summary["nonfinite_samples"], 0)
            if limit < 2 << 20:
                self.assertLess(summary["voxel_page_slots"], summary["voxel_pages"])
                self.assertGreater(summary["voxel_page_loads"], 0)
                first = self.read(out)
                self.render("-o", out, *job, "--max-gpu-memory", limit, device="auto")
                self.assertEqual(self.read(out), first, "not the same bits again")
            diff = run("diff", out, whole, "--metric", "flip", "--max", flip)
            self.assertEqual(diff.returncode, 0, (limit, diff.stdout, diff.stderr))
        result = self.render("-o", out, *job, "--max-gpu-memory", "64K", device="auto", code=4,
                             says="--max-gpu-memory")
        self.assertIn("bytes", result.stderr)


if __name__ == "__main__":
    program.main()
