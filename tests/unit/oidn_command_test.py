#!/usr/bin/env python3
"""--denoise of `trex render`, and `trex denoise`, as a user runs them: with a library that pretends to be Open
Image Denoise and hands over its input, without any, and with the real one where scripts/oidn has brought it."""
import json, os

from exr_file import exr_bytes, rgb
import program
from program import ProgramTest


class OidnTest(ProgramTest):
    def run_trex(self, *arguments, library=None, mode="", code=0, says=""):
        environment = {**os.environ, "TREX_OIDN": library or program.options.fake, "FAKE_OIDN": mode}
        if library == "brought":
            del environment["TREX_OIDN"]
        result = program.run(*arguments, env=environment)
        self.assertEqual(result.returncode, code, (arguments, result.stderr))
        self.assertIn(says, result.stderr)
        if code == 0 and not says:
            self.assertNotIn("warning", result.stderr)
        return result

    def render(self, name, *arguments, **how):
        """The report, if there is one."""
        for option, value in (("--size", "40x30"), ("--spp", 2)):
            arguments = arguments if option in arguments else (option, value, *arguments)
        result = self.run_trex("render", self.cornell, "-o", self.path(name), "--device", "none", "--json", *arguments,
                               **how)
        return json.loads(result.stdout) if result.stdout else None

    def diff(self, a, b):
        return json.loads(self.run_trex("diff", self.path(a), self.path(b), "--json", code=6).stdout)

    def exr(self, name, channels, width=2, height=1, **metadata):
        with open(self.path(name), "wb") as f:
            f.write(exr_bytes(width, height, channels, {"trex:" + k: v for k, v in metadata.items()}))
        return self.path(name)

    # ---- render ----

    def test_which_denoiser(self):
        oidn = "oidn 2.9.0 (CPU, pretended)"
        for arguments, want in ((("--exact", 0), oidn), (("--exact", 0.5), oidn), (("--exact", 1), "none"),
                                (("--denoise", "oidn", "--exact", 1), oidn), (("--denoise", "filter"), "filter"),
                                (("--denoise", "filter", "--exact", 1), "filter"), (("--denoise", "off"), "none"),
                                (("--max-memory", "200M"), "filter")):
            report = self.render("a.exr", *arguments)
            self.assertEqual(report["denoiser"], want, arguments)
            self.assertEqual(report["filter_seconds"] > 0, want != "none", arguments)
            with open(self.path("a.exr"), "rb") as f:
                data = f.read()
            self.assertIn(b"trex:denoised\0string\0" + len(want).to_bytes(4, "little") + want.encode(), data)

    def test_parts_of_the_light_add_up(self):
        """What is handed over as it is must give the picture that nobody filtered."""
        for arguments in (("--exact", 0), ("--exact", 1), ("--exact", 0, "--transparent"), ("--exact", 0, "--max-bounces", 1)):
            self.render("oidn.exr", "--denoise", "oidn", *arguments)
            self.render("off.exr", "--denoise", "off", *arguments)
            self.assertLess(self.diff("oidn.exr", "off.exr")["max_error"], 1e-4, arguments)

    def test_layers_are_untouched(self):
        self.render("oidn.exr", "--aov", "all")
        self.render("off.exr", "--aov", "all", "--denoise", "off")
        found = self.diff("oidn.exr", "off.exr")
        self.assertEqual((found["channels_only_in_a"], found["channels_only_in_b"]), ([], []))

    def test_without_a_library(self):
        self.assertEqual(self.render("a.exr", library="none")["denoiser"], "filter")
        self.render("b.exr", "--denoise", "oidn", library="none", code=4, says="scripts/oidn")
        self.assertFalse(os.path.exists(self.path("b.exr")))

    def test_a_library_that_is_no_good(self):
        for how, says in (({"mode": "version3"}, "version 3.9.0"), ({"mode": "sick"}, "not well"),
                          ({"library": "/nowhere/lib.so"}, "/nowhere/lib.so")):
            self.assertEqual(self.render("a.exr", says=says, **how)["denoiser"], "filter")
            self.render("b.exr", "--denoise", "oidn", code=4, says=says, **how)

    def test_a_library_that_fails_later(self):
        self.assertEqual(self.render("a.exr", "--size", "80x80", mode="tired", says="pretended")["denoiser"], "filter")
        self.render("b.exr", "--size", "80x80", "--denoise", "oidn", mode="tired", code=4, says="saved")
        self.render("c.exr", "--size", "80x80", "--denoise", "filter", mode="tired")
        with open(self.path("a.exr"), "rb") as a, open(self.path("b.exr"), "rb") as b:
            self.assertEqual(a.read(), b.read())
        self.assertEqual(self.run_trex("diff", self.path("a.exr"), self.path("c.exr")).returncode, 0)

    def test_what_it_lost_comes_back(self):
        """Pairs correct a denoiser that takes all for noise: the picture converges to the truth all the same."""
        self.render("truth.exr", "--denoise", "off", "--exact", 1, "--spp", 256)
        errors = []
        for samples in (8, 64, 256):
            self.render("flat.exr", "--exact", 0.5, "--spp", samples, "--seed", 1, mode="flat")
            errors.append(self.diff("flat.exr", "truth.exr")["relmse_trimmed"])
        self.assertLess(errors[1], 0.3 * errors[0])
        self.assertLess(errors[2], 0.5 * errors[1])

    def test_a_time_limit(self):
        report = self.render("a.exr", "--spp", 100000, "--time", 0.3)
        self.assertIn("oidn", report["denoiser"])
        self.assertLess(report["samples"], 100000)

    def test_resumed(self):
        job = ["--size", "64x64", "--exact", 0.25, "--checkpoint", self.path("job")]
        self.render("whole.exr", *job, "--spp", 6)
        os.remove(self.path("job"))
        self.render("parts.exr", *job, "--spp", 3)
        self.render("parts.exr", *job, "--spp", 6, "--resume")
        with open(self.path("whole.exr"), "rb") as a, open(self.path("parts.exr"), "rb") as b:
            self.assertEqual(a.read(), b.read())
        self.render("parts.exr", *job, "--spp", 8, "--resume", library="none", code=3, says="other settings")

    def test_doctor(self):
        found = json.loads(self.run_trex("doctor", "--json").stdout)["denoiser"]
        self.assertEqual((found["default"], found["library"], found["version"], found["device"]),
                         ("oidn", program.options.fake, "2.9.0", "CPU, pretended"))
        self.assertIn("2.9.0 on CPU, pretended", self.run_trex("doctor").stdout)
        found = json.loads(self.run_trex("doctor", "--json", library="none").stdout)
        self.assertEqual(found["denoiser"]["default"], "filter")
        self.assertNotIn("Denoise", "".join(found["problems"]))
        found = json.loads(self.run_trex("doctor", "--json", library="/nowhere/lib.so").stdout)
        self.assertIn("/nowhere/lib.so", "".join(found["problems"]))

    # ---- trex denoise ----

    def denoise(self, picture, *arguments, **how):
        result = self.run_trex("denoise", picture, "-o", self.path("out.exr"), "--json", *arguments, **how)
        return json.loads(result.stdout) if result.stdout else None

    def test_denoise_finds_the_layers_of_renderers(self):
        colors, normals = rgb([(0.5, 1, 2), (3, 0.25, 1)]), {"X": [0, 1], "Y": [0, 0], "Z": [1, 0]}
        for before, albedo, normal in (("", "albedo", "normal"), ("", "albedo", "sh_normal"), ("", "Albedo", "Ns"),
                                       ("ViewLayer.Combined.", "ViewLayer.Denoising Albedo",
                                        "ViewLayer.Denoising Normal")):
            channels = {**{before + k: v for k, v in colors.items()},
                        **{f"{albedo}.{c}": [0.5, 0.25] for c in "RGB"},
                        **{f"{normal}.{k}": v for k, v in normals.items()}}
            report = self.denoise(self.exr("in.exr", channels))
            self.assertEqual((report["albedo_layer"], report["normal_layer"]), (albedo, normal))
            self.assertAlmostEqual(report["mean_ratio"], 1.0, places=6)
        # The alpha of a picture stays, what is not finite counts as black.
        channels = {**rgb([(float("nan"), 1, 2), (float("inf"), 1, 1)]), "A": [0.5, 1.0]}
        self.denoise(self.exr("in.exr", channels), says="no albedo layer")
        want = self.exr("want.exr", {**rgb([(0, 1, 2), (0, 1, 1)]), "A": [0.5, 1.0]})
        self.run_trex("diff", self.path("out.exr"), want)
        del channels["A"]
        channels.update({f"albedo.{c}": [0.5, 0.25] for c in "RGB"})
        self.denoise(self.exr("in.exr", channels), says="no normal layer")

    def test_denoise_of_our_own(self):
        """Of a picture that the filter has changed, direct and indirect light tell what was before."""
        self.render("off.exr", "--denoise", "off", "--aov", "albedo,normal")
        self.render("filtered.exr", "--denoise", "filter", "--aov", "albedo,normal,direct,indirect")
        self.render("only.exr", "--denoise", "filter", "--aov", "albedo,normal")
        self.denoise(self.path("filtered.exr"))
        self.assertLess(self.diff("out.exr", "off.exr")["max_error"], 1e-4)
        self.denoise(self.path("only.exr"), code=3, says="denoised already")
        self.denoise(self.path("out.exr"))

    def test_denoise_refuses(self):
        picture = self.exr("in.exr", rgb([(1, 1, 1), (2, 2, 2)]))
        for arguments, code, says in (((picture, "-o", self.path("out.png")), 2, ".exr"),
                                      ((picture, "-o", self.path("no/out.exr")), 5, "no"),
                                      ((picture,), 2, "output"),
                                      ((self.path("none.exr"), "-o", self.path("out.exr")), 3, "none.exr"),
                                      ((self.exr("depth.exr", {"depth": [1, 2]}), "-o", self.path("out.exr")), 3,
                                       "no colours")):
            self.run_trex("denoise", *arguments, code=code, says=says)
        self.run_trex("denoise", picture, "-o", self.path("out.exr"), library="none", code=4, says="scripts/oidn")
        self.run_trex("denoise", picture, "-o", self.path("out.exr"), mode="sick", code=4, says="not well")
        with open(picture, "rb") as f:
            data = f.read()
        with open(self.path("cut.exr"), "wb") as f:
            f.write(data[:-10])
        self.run_trex("denoise", self.path("cut.exr"), "-o", self.path("out.exr"), code=3, says="cut.exr")
        self.assertFalse(os.path.exists(self.path("out.exr")))

    # ---- the real one ----

    def test_the_real_one(self):
        found = json.loads(self.run_trex("doctor", "--json", library="brought").stdout)["denoiser"]
        if found["default"] != "oidn":
            self.skipTest(found["problem"])
        self.render("truth.exr", "--denoise", "off", "--spp", 128)
        for exact in (0, 0.25):
            self.render("off.exr", "--denoise", "off", "--exact", exact, "--spp", 1, library="brought")
            pictures = set()
            for threads in (1, 3):
                report = self.render("real.exr", "--exact", exact, "--spp", 1, "--threads", threads, library="brought")
                with open(self.path("real.exr"), "rb") as f:
                    pictures.add(f.read())
            self.assertEqual(len(pictures), 1)
            self.assertIn("oidn 2.", report["denoiser"])
            noisy, real = self.diff("off.exr", "truth.exr"), self.diff("real.exr", "truth.exr")
            self.assertLess(real["flip"], 0.7 * noisy["flip"])
            self.assertAlmostEqual(real["mean_ratio"], noisy["mean_ratio"], delta=0.02)


if __name__ == "__main__":
    program.main("fake")
