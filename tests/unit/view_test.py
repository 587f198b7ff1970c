#!/usr/bin/env python3
"""The viewer as a person uses it, on a virtual display: scripts by --replay, and real input by xdotool."""
import json
import os
import shutil
import signal
import subprocess
import sys
import time
import unittest

import program
from program import ProgramTest

SIZE = (160, 90)


class Display:
    """An X server of its own on a free display number. It would begin anew whenever its last window closes, and refuse the next for that moment."""

    def __init__(self):
        reading, writing = os.pipe()
        self.process = subprocess.Popen(
            ["Xvfb", "-displayfd", str(writing), "-screen", "0", "1280x720x24", "-nolisten", "tcp", "-noreset"],
            pass_fds=[writing], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        os.close(writing)
        with os.fdopen(reading) as pipe:
            self.name = ":" + pipe.readline().strip()
        assert len(self.name) > 1, "Xvfb did not start"

    def close(self):
        self.process.terminate()
        self.process.wait()


def setUpModule():
    global DISPLAY
    DISPLAY = Display()


def tearDownModule():
    DISPLAY.close()


class ViewTest(ProgramTest):
    def environment(self, display=True):
        environment = {**os.environ, "XDG_STATE_HOME": self.folder, "TREX_VALIDATION": "1"}
        for name in ("DISPLAY", "WAYLAND_DISPLAY"):
            environment.pop(name, None)
        if display:
            environment["DISPLAY"] = DISPLAY.name
        return environment

    def view(self, *arguments, display=True):
        return subprocess.run([program.TREX, "view", *map(str, arguments)], capture_output=True, text=True, timeout=300,
                              cwd=self.folder, env=self.environment(display))

    def replay(self, steps, *arguments, code=0, size=SIZE, model=None, device="none", **script):
        """Runs steps and returns the report."""
        text = {"trex": 1, "size": "%dx%d" % size, "steps": steps, **script}
        with open(self.path("script.json"), "w") as f:
            json.dump(text, f)
        result = self.view(model or self.cornell, "--replay", "script.json", "--report", "report.json",
                           "--device", device, *arguments)
        self.assertEqual(result.returncode, code, result.stderr)
        if code != 0:
            return result.stderr
        with open(self.path("report.json")) as f:
            return json.load(f)

    def same(self, a, b):
        result = subprocess.run([program.TREX, "diff", a, b, "--metric", "rmse", "--max", "0"], capture_output=True, text=True,
                                cwd=self.folder)
        self.assertEqual(result.returncode, 0, result.stdout + result.stderr)


class CommandLine(ViewTest):
    def test_only_the_viewer_loads_a_window_library(self):
        needs = {name: subprocess.run(["ldd", name], capture_output=True, text=True, check=True).stdout
                 for name in (program.TREX, program.TREX + "-view")}
        for library in ("libglfw", "libimgui", "libvulkan"):
            self.assertNotIn(library, needs[program.TREX])
        self.assertIn("libglfw", needs[program.TREX + "-view"])

    def test_help_needs_no_display(self):
        result = self.view("--help", display=False)
        self.assertEqual(result.returncode, 0, result.stderr)
        for option in ("--edits", "--replay", "--budget-ms", "--screenshot-dir"):
            self.assertIn(option, result.stdout)

    def test_without_a_display(self):
        result = self.view(self.cornell, display=False)
        self.assertEqual(result.returncode, 4, result.stderr)
        self.assertIn("DISPLAY", result.stderr)
        self.assertEqual(len(result.stderr.splitlines()), 1, result.stderr)

    def test_without_the_viewer_beside_it(self):
        alone = self.path("trex")
        shutil.copy(program.TREX, alone)
        result = subprocess.run([alone, "view"], capture_output=True, text=True)
        self.assertEqual(result.returncode, 1, result.stderr)
        self.assertIn("trex-view", result.stderr)

    def test_wrong_uses(self):
        with open(self.path("bad.json"), "w") as f:
            f.write('{"trex": 1, "steps": [{"dance": true}]}')
        with open(self.path("good.json"), "w") as f:
            f.write('{"trex": 1, "steps": []}')
        for code, says, *arguments in (
                (2, "colour", self.cornell, "--colour"), (2, "extra", self.cornell, "extra"),
                (2, "WxH", self.cornell, "--size", "10"), (2, "scale", self.cornell, "--scale", "3"),
                (2, "budget", self.cornell, "--budget-ms", "1"), (2, "exact", self.cornell, "--exact", "2"),
                (2, "device", self.cornell, "--device", "gpu"), (2, "replay", self.cornell, "--report", "r.json"),
                (2, "spp", self.cornell, "--spp", "0"), (3, "missing.glb", "missing.glb"),
                (3, "missing.json", self.cornell, "--edits", "missing.json"),
                (3, "missing.json", self.cornell, "--replay", "missing.json"),
                (3, "dance", self.cornell, "--replay", "bad.json"),
                (5, "no/such", self.cornell, "--replay", "good.json", "--report", "no/such/r.json")):
            with self.subTest(arguments=arguments):
                result = self.view(*arguments)
                self.assertEqual(result.returncode, code, result.stderr)
                self.assertIn(says, result.stderr)


class Replay(ViewTest):
    def test_every_class_of_edit(self):
        report = self.replay([
            {"wait": "ready"},
            {"pick": [80, 45]},
            {"label": "orbit", "camera": {"orbit": [0.05, 0.02]}},
            {"label": "material", "material": {"index": 0, "base_color": [0.2, 0.4, 0.9, 1], "roughness": 0.3}},
            {"label": "lamp", "light": {"add": True, "name": "lamp", "position": [0, 1, 0], "intensity": [2, 2, 2]}},
            {"label": "hide", "hide": [0], "frames": 2},
            {"label": "unhide", "undo": True},
            {"label": "sky", "environment": {"color": [0.2, 0.2, 0.2]}},
            {"label": "cut", "section": {"point": [0, 1, 0], "normal": [0, 1, 0]}, "save_edits": "look.json"},
            {"undo": 5, "save_edits": "none.json"}])
        steps = {step["label"]: step for step in report["steps"]}
        for label in ("orbit", "material", "lamp", "hide", "unhide", "sky", "cut"):
            self.assertGreater(steps[label]["first_coarse_ms"], 0.0, label)
        self.assertTrue(report["steps"][1]["picked_material"])
        self.assertGreater(report["open"]["ready_ms"], 0.0)
        with open(self.path("look.json")) as f:
            look = json.load(f)
        self.assertEqual((len(look["materials"]), len(look["lights"])), (1, 1))
        self.assertEqual(look["section"]["normal"], [0, 1, 0])
        self.assertNotIn("hidden", look)
        with open(self.path("none.json")) as f:
            left = json.load(f)
        for key in ("materials", "lights", "section", "environment"):
            self.assertNotIn(key, left)

    def test_the_screen_is_what_render_makes(self):
        self.replay([
            {"wait": "ready"},
            {"camera": {"orbit": [0.05, 0.02]}, "material": {"index": 0, "roughness": 0.3}},
            {"hide": [1], "exposure": 0.5},
            {"wait": "idle", "screenshot": "screen.png", "save": "saved.png", "save_edits": "look.json"},
            {"save": "saved.exr"}], "--spp", "4")
        self.same("screen.png", "saved.png")
        render = [program.TREX, "render", self.cornell, "--edits", "look.json", "--size", "%dx%d" % SIZE, "--spp", "4",
                  "--device", "none"]
        layers = "A,albedo,normal,position,depth,objectId,materialId,sampleCount,variance,exactShare"
        subprocess.run([*render, "-o", "capture.exr", "--aov", layers], check=True, cwd=self.folder, capture_output=True)
        self.same("saved.exr", "capture.exr")
        for name in ("saved.exr", "capture.exr"):  # the default of both
            with open(self.path(name), "rb") as f:
                self.assertIn(b"trex:exact\0string\0\4\0\0\0auto", f.read())
        subprocess.run([*render, "-o", "capture.png", "--exposure", "0.5"], check=True, cwd=self.folder,
                       capture_output=True)
        self.same("screen.png", "capture.png")

    def test_sizes_from_one_pixel_to_4k(self):
        report = self.replay([
            {"wait": "shown"},
            {"size": "1x1", "frames": 3},
            {"size": "3840x2160", "frames": 1, "screenshot": "large.png"},
            {"size": "160x90", "frames": 3, "screenshot": "small.png"}])
        self.assertEqual(report["size"], "160x90")
        self.same("small.png", "small.png")

    def test_minimised_and_back(self):
        self.replay([{"wait": "shown"}, {"minimise": True, "seconds": 0.2}, {"restore": True, "frames": 2}], visible=True)

    def test_closed_while_it_bakes(self):
        report = self.replay([{"wait": "shown", "close": True}, {"camera": "nobody"}])
        self.assertEqual(len(report["steps"]), 1)

    def test_idle_when_it_has_nothing_to_do(self):
        report = self.replay([{"wait": "idle"}, {"idle": 0.5}], "--spp", "1")
        self.assertIn("idle_core_share", report["steps"][1])

    def test_every_panel_and_view(self):
        panels = ("camera", "materials", "lights", "objects", "view", "section", "edits", "status")
        views = ("albedo", "normal", "depth", "variance", "voxels", "photons")
        self.replay([
            {"wait": "ready", "panel": "lights"},
            *[{"panel": name, "frames": 1, "screenshot": name + ".png"} for name in panels],
            *[{"view": {"mode": name}, "frames": 2} for name in views],
            {"view": {"mode": "beauty", "split": True}, "frames": 3}], ui=True, size=(640, 360))

    def test_on_a_device(self):
        report = self.replay([{"wait": "ready"}, {"material": {"index": 0, "roughness": 0.3}}, {"camera": {"dolly": 1}}],
                             device="auto")
        self.assertNotEqual(report["device"], "none")

    def test_a_step_that_names_nothing_is_an_input_error(self):
        self.assertIn("gold", self.replay([{"material": {"name": "gold"}}], code=3))

    def test_a_broken_model(self):
        with open(self.path("broken.glb"), "wb") as f:
            f.write(b"hello")
        self.assertIn("broken.glb", self.replay([{"wait": "shown"}], code=3, model="broken.glb"))

    def test_too_little_memory(self):
        self.assertIn("need at least", self.replay([{"wait": "shown"}], "--max-memory", "20M", code=4))

    def test_a_picture_that_can_not_be_written(self):
        self.replay([{"wait": "shown", "save": "no/such/a.png"}], code=5)


@unittest.skipUnless(shutil.which("xdotool"), "xdotool is not installed")
class Hands(ViewTest):
    """A visible window that is used with mouse and keys."""

    def start(self, *arguments):
        self.process = subprocess.Popen(
            [program.TREX, "view", self.cornell, "--size", "640x360", "--device", "none", "--spp", "2", "--screenshot-dir",
             self.folder, *arguments], cwd=self.folder, env=self.environment(), stderr=subprocess.PIPE, text=True)
        self.addCleanup(self.end)
        found = self.tool("search", "--sync", "--onlyvisible", "--name", "cornell.glb")
        self.window = found.split()[0]
        self.tool("windowfocus", "--sync", self.window)

    def end(self):
        if self.process.poll() is None:
            self.process.kill()
        self.process.communicate()

    def tool(self, *arguments):
        return subprocess.run(["xdotool", *map(str, arguments)], capture_output=True, text=True, timeout=30,
                              env=self.environment(), check=True).stdout

    def key(self, *names):
        for name in names:
            self.tool("key", name)
            time.sleep(0.15)

    def drag(self, start, end, button=1):
        self.tool("mousemove", *start, "sleep", "0.1", "mousedown", button)
        steps = 5
        for i in range(1, steps + 1):
            self.tool("mousemove", *(a + (b - a) * i // steps for a, b in zip(start, end)), "sleep", "0.03")
        self.tool("mouseup", button)
        time.sleep(0.1)

    def wait_for(self, name):
        for _ in range(200):
            if os.path.exists(self.path(name)):
                return
            self.assertIsNone(self.process.poll(), "the viewer has ended")
            time.sleep(0.05)
        self.fail(name + " was not written")

    def code(self):
        self.process.wait(timeout=30)
        return self.process.returncode

    def test_look_around_save_and_close(self):
        self.start()
        self.key("F12")
        self.wait_for("cornell-0001.png")
        self.drag((150, 200), (230, 210))
        self.drag((150, 200), (150, 230), button=3)
        self.drag((150, 200), (170, 200), button=2)
        self.tool("click", "4")
        self.key("h", "h", "Tab", "p", "p", "b", "b", "1", "f")
        self.tool("mousemove", 200, 200, "click", "--repeat", "2", "--delay", "60", "1")
        self.drag((150, 200), (230, 210))
        self.key("F12", "shift+F12")
        self.wait_for("cornell-0002.png")
        self.wait_for("cornell-0001.exr")
        different = subprocess.run([program.TREX, "diff", "cornell-0001.png", "cornell-0002.png", "--metric", "rmse", "--max",
                                    "0.001"], capture_output=True, cwd=self.folder)
        self.assertEqual(different.returncode, 6)
        self.key("Escape")
        self.assertEqual(self.code(), 0)

    def test_escape_asks_before_edits_are_lost(self):
        self.start("--edits", self.edits())
        self.key("ctrl+z")  # there is nothing to undo: loaded edits are the start
        self.add_a_light()
        self.key("Escape")
        time.sleep(0.3)
        self.assertIsNone(self.process.poll(), "closed without asking")
        self.key("Escape")  # takes the question back
        self.key("ctrl+s")
        for _ in range(100):
            with open(self.path("look.json")) as f:
                if json.load(f).get("lights"):
                    break
            time.sleep(0.05)
        else:
            self.fail("Ctrl+S has not saved the light")
        self.key("Escape")
        self.assertEqual(self.code(), 0)

    def edits(self):
        with open(self.path("look.json"), "w") as f:
            json.dump({"trex": 1, "edits_of": self.cornell, "exposure": 0.5}, f)
        return "look.json"

    def add_a_light(self):
        """Tab Lights, button point; see the layout in src/app/view/ui_draw.cpp."""
        self.tool("mousemove", 530, 35, "sleep", "0.2", "click", "1", "sleep", "0.3")
        self.tool("mousemove", 409, 81, "sleep", "0.2", "click", "1", "sleep", "0.3")

    def test_interrupt(self):
        self.start()
        self.process.send_signal(signal.SIGINT)
        self.assertEqual(self.code(), 130)


if __name__ == "__main__":
    program.main()
