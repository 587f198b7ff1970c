#!/usr/bin/env python3
"""`trex diff` as a user runs it: exit codes, reasons, JSON, heat maps, bad files and wrong uses."""
import json, math, os, struct, zlib

from exr_file import exr_bytes, rgb
import program
from program import ProgramTest, run

NAN = float("nan")


def pattern(width, height):
    return [(0.1 + x / width, 0.2 + y / height, 0.5) for y in range(height) for x in range(width)]


def png_bytes(width, height, pixels):
    """8-bit RGB."""
    rows = b"".join(b"\0" + bytes(v for p in pixels[y * width:(y + 1) * width] for v in p) for y in range(height))

    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b"")


class DiffTest(ProgramTest):
    def setUp(self):
        super().setUp()
        self.good = self.exr("good.exr", pattern(8, 8))

    def exr(self, name, pixels, width=8, height=8, **layers):
        return self.write(name, exr_bytes(width, height, {**rgb(pixels), **layers}))

    def compare(self, a, b, *options, code=0):
        result = run("diff", a, b, "--json", *options)
        self.assertEqual(result.returncode, code, result.stdout + result.stderr)
        found = json.loads(result.stdout)
        self.assertEqual(found["differ"], code == 6)
        self.assertEqual(bool(found["reasons"]), code == 6)
        return found

    def refused(self, code, *arguments, says=""):
        before = set(os.listdir(self.folder))
        result = run("diff", *arguments)
        lines = [x for x in result.stderr.splitlines() if "error:" in x]
        self.assertEqual(result.returncode, code, (arguments, result.stdout, result.stderr))
        self.assertEqual(len(lines), 1, result.stderr)
        self.assertIn(says, lines[0])
        self.assertEqual(result.stdout, "")
        self.assertEqual(set(os.listdir(self.folder)), before)

    def test_equal(self):
        found = self.compare(self.good, self.good, "--max", 0)
        self.assertTrue(found["equal_bits"])
        self.assertEqual((found["flip"], found["hdr_flip"], found["rmse"], found["max_error"]), (0, 0, 0, 0))
        self.assertIsNone(found["psnr_db"])
        self.assertEqual(found["size"], [8, 8])
        self.assertIn("equal bits      yes", run("diff", self.good, self.good).stdout)

    def test_one_pixel(self):
        pixels = pattern(8, 8)
        pixels[3 * 8 + 5] = (pixels[3 * 8 + 5][0], 2.0, 0.5)
        other = self.exr("other.exr", pixels)
        found = self.compare(other, self.good, code=6)
        self.assertFalse(found["equal_bits"])
        self.assertEqual((found["max_error_pixel"], found["max_error_channel"]), ([5, 3], "G"))
        self.assertAlmostEqual(found["max_error"], 2.0 - (0.2 + 3 / 8), places=5)
        self.assertGreater(found["flip"], 0)
        self.compare(other, self.good, "--max", found["flip"] * 1.01)
        self.compare(other, self.good, "--max", found["flip"] * 0.99, code=6)

    def test_any_difference_counts_without_a_limit(self):
        """One bit of a colour or of a layer is a difference; a limit speaks of colours alone."""
        pixels = pattern(8, 8)
        pixels[9] = (pixels[9][0] * (1 + 2 ** -23), *pixels[9][1:])
        one_bit = self.exr("bit.exr", pixels)
        found = self.compare(one_bit, self.good, code=6)
        self.assertIn("--max", found["reasons"][0])
        self.compare(one_bit, self.good, "--max", 1e-6)
        near = self.exr("near.exr", pattern(8, 8), depth=[1.0] * 64)
        far = self.exr("far.exr", pattern(8, 8), depth=[1.0] * 63 + [2.0])
        self.compare(near, far, code=6)
        self.compare(near, far, "--max", 0)
        self.compare(near, self.good, "--max", 1, code=6)  # a layer that is not there

    def test_limits_of_every_metric(self):
        other = self.exr("other.exr", [(r * 1.1, g, b) for r, g, b in pattern(8, 8)])
        figures = self.compare(other, self.good, code=6)
        for metric, key in (("flip", "flip"), ("hdrflip", "hdr_flip"), ("relmse", "relmse_trimmed"),
                            ("rmse", "rmse"), ("psnr", "psnr_db")):
            larger = 6 if metric == "psnr" else 0
            self.compare(other, self.good, "--metric", metric, "--max", figures[key] + 1e-4, code=larger)
            self.compare(other, self.good, "--metric", metric, "--max", figures[key] - 1e-4, code=6 - larger)
        self.compare(self.good, self.good, "--metric", "psnr", "--max", 200)

    def test_sign_error(self):
        other = self.exr("other.exr", [(-r, g, b) for r, g, b in pattern(8, 8)])
        found = self.compare(other, self.good, "--max", 0.05, code=6)
        self.assertLess(found["mean_ratio"], 0.5)

    def test_sizes(self):
        wide = []
        for y in range(8):
            wide += pattern(8, 8)[y * 8:y * 8 + 8] + [(0, 0, 0)]
        found = self.compare(self.good, self.exr("wide.exr", wide, 9, 8), code=6)
        self.assertIn("8x8 and 9x8", found["reasons"][0])
        self.assertIsNone(found["flip"])

    def test_channels(self):
        layered = self.exr("layered.exr", pattern(8, 8), depth=[1.0] * 64)
        found = self.compare(layered, self.good, code=6)
        self.assertEqual((found["channels_only_in_a"], found["channels_only_in_b"]), (["depth"], []))
        self.assertEqual(found["rmse"], 0)
        lacking = self.write("rb.exr", exr_bytes(8, 8, {"R": [0.5] * 64, "B": [0.5] * 64}))
        found = self.compare(lacking, self.good, code=6)
        self.assertEqual(found["channels_only_in_b"], ["G"])
        self.assertIsNone(found["rmse"])
        self.refused(3, lacking, lacking, says="no channel G")

    def test_not_finite(self):
        for bad in (NAN, math.inf, -math.inf):
            pixels = pattern(8, 8)
            pixels[2 * 8 + 7] = (0, 0, bad)
            other = self.exr("other.exr", pixels)
            for a, b, count in ((other, self.good, 1), (self.good, other, 1), (other, other, 2)):
                found = self.compare(a, b, code=6)
                self.assertEqual(len(found["reasons"]), count)
                self.assertIn("7,2", found["reasons"][0])
            self.assertEqual(found["nonfinite_b"], {"values": 1, "first_pixel": [7, 2], "first_channel": "B"})
        layer = self.exr("layer.exr", pattern(8, 8), depth=[NAN] + [1.0] * 63)
        self.assertEqual(self.compare(layer, layer, code=6)["nonfinite_a"]["first_channel"], "depth")

    def test_variance(self):
        variance = {f"variance.{c}": [0.01] * 64 for c in "RGB"}
        a = self.exr("a.exr", pattern(8, 8), **variance)
        b = self.exr("b.exr", [(r + 0.1, g, b) for r, g, b in pattern(8, 8)], **variance)
        z = self.compare(a, b, code=6)["z"]
        self.assertAlmostEqual(z["largest"], 0.1 / 0.02 ** 0.5, places=4)
        self.assertAlmostEqual(z["mean_z"][0], -8 * 0.1 / 0.02 ** 0.5, places=3)
        self.assertEqual(z["share_within_2"], 1)
        self.compare(a, b, "--metric", "z", "--max", 0.01, code=6)
        self.compare(a, a, "--metric", "z", "--max", 0.01)
        self.refused(3, self.good, self.good, "--metric", "z", "--max", 0.01, says="good.exr")

    def test_png(self):
        pixels = [(x * 16 + 8, y * 16 + 8, 128) for y in range(16) for x in range(16)]
        a = self.write("a.png", png_bytes(16, 16, pixels))
        b = self.write("b.png", png_bytes(16, 16, [(r, g, 131) for r, g, _ in pixels]))
        found = self.compare(b, a, code=6)
        self.assertEqual(found["exposure_stops"], 0)
        self.assertAlmostEqual(found["psnr_db"], -10 * math.log10((3 / 255) ** 2 / 3), places=2)

    def test_exposure(self):
        other = self.exr("other.exr", [(r * 1.1, g, b) for r, g, b in pattern(8, 8)])
        found = self.compare(other, self.good, "--exposure", -1.5, code=6)
        self.assertEqual(found["exposure_stops"], -1.5)
        self.assertNotEqual(found["flip"], self.compare(other, self.good, code=6)["flip"])
        at_20 = self.compare(other, self.good, "--exposure", -1.5, "--ppd", 20, code=6)["flip"]
        self.assertNotEqual(found["flip"], at_20)

    def test_heat_map(self):
        other = self.exr("other.exr", [(r * 1.1, g, b) for r, g, b in pattern(8, 8)])
        for metric, key in (("flip", "flip"), ("hdrflip", "hdr_flip")):
            png, exr = self.path("heat.png"), self.path("heat.exr")
            self.compare(other, self.good, "-o", png, "--metric", metric, code=6)
            with open(png, "rb") as f:
                self.assertEqual(f.read(4), b"\x89PNG")
            self.compare(other, self.good, "-o", exr, "--metric", metric, code=6)
            self.assertGreater(os.path.getsize(exr), 100)
        self.refused(5, other, self.good, "-o", self.path("no/such/heat.png"), says="no/such")
        self.refused(2, other, self.good, "-o", self.path("heat.bmp"), says="heat.bmp")

    def test_bad_files(self):
        with open(self.good, "rb") as f:
            data = f.read()
        huge = data.replace(struct.pack("<4i", 0, 0, 7, 7), struct.pack("<4i", 0, 0, 60000, 60000))
        for name, content in (
                ("empty.exr", b""), ("words.exr", b"hello"), ("cut.exr", data[:len(data) // 2]),
                ("header.exr", data[:60]), ("huge.exr", huge), ("words.png", b"\x89PNG hello"),
                ("negative.exr", data.replace(struct.pack("<4i", 0, 0, 7, 7), struct.pack("<4i", 7, 7, 0, 0))),
                ("cropped.exr", data.replace(struct.pack("<4i", 0, 0, 7, 7), struct.pack("<4i", 0, 0, 3, 3), 1)),
                ("words.hdr", b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 70000 +X 70000\n"),
                ("picture.bmp", data), ("name", data)):
            with self.subTest(name=name):
                bad = self.write(name, content)
                self.refused(3, bad, self.good, says=name)
                self.refused(3, self.good, bad, says=name)
                os.remove(bad)
        self.refused(3, self.path("none.exr"), self.good, says="none.exr: no such file")
        self.refused(3, self.good, self.folder)

    def test_wrong_uses(self):
        for arguments, says in (
                ([], "A"), ([self.good], "B"), ([self.good, self.good, "--metric", "ssim"], "metric"),
                ([self.good, self.good, "--max", "much"], "max"), ([self.good, self.good, "--max", "nan"], "max"),
                ([self.good, self.good, "--exposure", "bright"], "bright"),
                ([self.good, self.good, "--exposure", "nan"], "nan"),
                ([self.good, self.good, "--ppd", "0"], "ppd"), ([self.good, self.good, "--ppd", "1e9"], "ppd"),
                ([self.good, self.good, "--ppd", "nan"], "ppd"),
                ([self.good, self.good, self.good], "")):
            with self.subTest(arguments=arguments):
                self.refused(2, *arguments, says=says)


if __name__ == "__main__":
    program.main()
