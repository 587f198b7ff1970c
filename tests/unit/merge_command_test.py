#!/usr/bin/env python3
"""`trex merge` as a user runs it: the merged picture, what is refused, wrong uses."""
import json, os

from exr_file import exr_bytes, rgb
import program
from program import ProgramTest, run


def layers(value, count, variance):
    """One pixel."""
    return {**rgb([(value, value, value)]), **{f"variance.{c}": [variance] for c in "RGB"}, "sampleCount": [count]}


class MergeTest(ProgramTest):
    def setUp(self):
        super().setUp()
        # Samples 1, 3 and 2, 4, 6: means 2 and 4, variances of the mean 1 and 4 / 3.
        self.a = self.exr("a.exr", layers(2, 2, 1), seed=0)
        self.b = self.exr("b.exr", layers(4, 3, 4 / 3), seed=1)
        self.out = self.path("out.exr")

    def exr(self, name, channels, width=1, height=1, **metadata):
        metadata = {"scene": "room.glb", "camera": "first", "exact": "1", "samples": 2, **metadata}
        with open(self.path(name), "wb") as f:
            f.write(exr_bytes(width, height, channels, {"trex:" + k: str(v) for k, v in metadata.items()}))
        return self.path(name)

    def refused(self, code, *arguments, says=""):
        before = set(os.listdir(self.folder))
        result = run("merge", *arguments)
        self.assertEqual(result.returncode, code, (arguments, result.stdout, result.stderr))
        self.assertIn(says, result.stderr)
        self.assertEqual(result.stderr.count("error:"), 1)
        self.assertEqual((result.stdout, set(os.listdir(self.folder))), ("", before))

    def test_equals_the_whole(self):
        result = run("merge", self.a, self.b, "-o", self.out)
        self.assertEqual((result.returncode, result.stdout.strip()), (0, self.out), result.stderr)
        # The mean of 1, 3, 2, 4, 6 is 3.2, their variance 3.7, of the mean 0.74.
        want = self.exr("want.exr", layers(3.2, 5, 0.74))
        found = json.loads(run("diff", self.out, want, "--json").stdout)
        self.assertEqual((found["channels_only_in_a"], found["channels_only_in_b"]), ([], []))
        self.assertLess(found["max_error"], 1e-6)
        with open(self.out, "rb") as f:
            data = f.read()
        for text in (b"trex:seed\0string\0\x03\0\0\0" + b"0,1", b"trex:samples\0string\0\x01\0\0\0" + b"4"):
            self.assertIn(text, data)
        # A difference of 1 with variances 0.74 and 0.26 is one standard error.
        shifted = self.exr("shifted.exr", layers(2.2, 5, 0.26))
        z = json.loads(run("diff", self.out, shifted, "--json").stdout)["z"]["mean_z"]
        for value in z:
            self.assertAlmostEqual(value, 1.0, places=5)

    def test_renders_of_the_program(self):
        assets = os.path.join(os.path.dirname(os.path.abspath(__file__)), "../../assets/cornell.glb")
        for seed in (0, 1):
            result = run("render", assets, "-o", self.path(f"{seed}.exr"), "--size", "16x12", "--spp", 4, "--seed", seed,
                         "--exact", 1, "--aov", "variance,sampleCount")
            self.assertEqual(result.returncode, 0, result.stderr)
        self.assertEqual(run("merge", self.path("0.exr"), self.path("1.exr"), "-o", self.out).returncode, 0)
        for seed in (0, 1):
            found = json.loads(run("diff", self.out, self.path(f"{seed}.exr"), "--json").stdout)
            self.assertTrue(found["differ"])
            self.assertGreater(found["max_error"], 0)
        self.refused(3, self.path("0.exr"), self.path("0.exr"), "-o", self.path("x.exr"), says="seed 0")

    def test_refusals(self):
        lacking = layers(4, 3, 1)
        del lacking["sampleCount"]
        extra = {**layers(4, 3, 1), "depth": [1.0]}
        infinite = layers(float("inf"), 3, 1)
        wide = {name: values * 2 for name, values in layers(4, 3, 1).items()}
        for says, other in (
                ("2x1", self.exr("x.exr", wide, 2, 1, seed=1)),
                ("sampleCount", self.exr("lacking.exr", lacking, seed=1)),
                ("depth", self.exr("extra.exr", extra, seed=1)),
                ("not finite", self.exr("infinite.exr", infinite, seed=1)),
                ("seed 0", self.exr("seed.exr", layers(4, 3, 1), seed=0)),
                ("trex:seed", self.exr("none.exr", layers(4, 3, 1))),
                ("trex:scene", self.exr("scene.exr", layers(4, 3, 1), seed=1, scene="hall.glb")),
                ("trex:camera", self.exr("camera.exr", layers(4, 3, 1), seed=1, camera="second")),
                ("trex:exact", self.exr("exact.exr", layers(4, 3, 1), seed=1, exact="0.5")),
                ("--denoise off", self.exr("filtered.exr", layers(4, 3, 1), seed=1, denoised="yes"))):
            with self.subTest(says=says):
                self.refused(3, self.a, other, "-o", self.out, says=says)
        self.refused(3, self.a, self.path("missing.exr"), "-o", self.out, says="missing.exr")

    def test_wrong_uses(self):
        self.refused(2, self.a, "-o", self.out, says="two")
        self.refused(2, self.a, self.b, says="output")
        self.refused(2, self.a, self.b, "-o", self.path("out.png"), says=".exr")
        self.refused(2, "-o", self.out, says="PICTURES")
        self.refused(5, self.a, self.b, "-o", self.path("no/out.exr"), says="no folder")


if __name__ == "__main__":
    program.main()
