#!/usr/bin/env python3
"""A window and its servers by mpirun, on a virtual display: the same pictures as alone, a server that stops or dies, errors."""
import glob
import json
import os
import shutil
import signal
import subprocess
import sys
import time
import unittest

import program
import view_test
from view_test import ViewTest

MPIRUN = ["mpirun", "--oversubscribe", "--allow-run-as-root", "--bind-to", "none", "--mca", "btl", "self,vader,tcp"]


def setUpModule():
    if shutil.which("mpirun") is None or not os.path.exists(os.path.join(os.path.dirname(program.TREX), "libtrex_mpi.so")):
        raise unittest.SkipTest("no mpirun, or a build without MPI")
    view_test.setUpModule()


def tearDownModule():
    view_test.tearDownModule()


EDITS = [
    {"label": "turn", "camera": {"orbit": [0.05, 0.02]}},
    {"label": "material", "material": {"index": 0, "base_color": [0.2, 0.4, 0.9, 1], "roughness": 0.3}},
    {"label": "lamp", "light": {"add": True, "name": "lamp", "position": [0, 1, 0], "intensity": [2, 2, 2]}},
    {"label": "hide", "hide": [1]},
    {"label": "cut", "section": {"point": [0, 1.5, 0], "normal": [0, 1, 0]}}]


class Servers(ViewTest):
    def setUp(self):
        super().setUp()
        self.model = self.path("cornell.trex")
        subprocess.run([program.TREX, "bake", self.cornell, "-o", self.model, "-q"], check=True, capture_output=True)

    def environment(self, display=True):
        environment = super().environment(display)
        return {k: v for k, v in environment.items() if not k.startswith(("OMPI_", "PMIX_"))}

    def command(self, others, *arguments, worker=(), model=None, mpirun=MPIRUN, holders=()):
        """`holders`: models that machines 1, 2, ... have in place of the window."""
        trex = program.TREX
        command = [*mpirun, "-n", "1", trex, "view", *([] if holders else [model or self.model]), *map(str, arguments)]
        for holder in holders:
            command += [":", "-n", "1", trex, "worker", "--threads", "1", holder]
        if others > 0:
            command += [":", "-n", str(others), trex, "worker", "--threads", "1", *map(str, worker)]
        return command

    def script(self, steps, name="script.json", size=(136, 72)):
        with open(self.path(name), "w") as f:
            json.dump({"trex": 1, "size": "%dx%d" % size, "steps": steps}, f)
        return name

    def together(self, others, steps, *arguments, code=0, says="", **more):
        """Runs steps with servers, and returns the report."""
        p = subprocess.run(self.command(others, "--replay", self.script(steps), "--report", "report.json", "--device", "none",
                                        *arguments, **more), capture_output=True, text=True, timeout=300, cwd=self.folder,
                           env=self.environment())
        self.assertEqual(p.returncode, code, p.stderr)
        self.assertIn(says, p.stderr)
        if code != 0:
            return None
        with open(self.path("report.json")) as f:
            return json.load(f)

    def settled(self, edits, prefix):
        """Each edit, settled and saved with its layers."""
        steps = [{"wait": "idle", "save": prefix + "-opened.exr"}]
        for edit in edits:
            steps += [edit, {"wait": "idle", "save": f"{prefix}-{edit['label']}.exr"}]
        return steps

    def expect_same(self, edits, first="alone", second="together"):
        for label in ["opened", *(edit["label"] for edit in edits)]:
            self.same(f"{first}-{label}.exr", f"{second}-{label}.exr")

    def same_as_alone(self, others, *arguments, edits=EDITS, here=(), **more):
        """`here`: of the window that is not alone."""
        model = more.get("model") or next(iter(more.get("holders", [])), self.model)
        self.replay(self.settled(edits, "alone"), *arguments, size=(136, 72), model=model)
        report = self.together(others, [{"wait": "machines"}, *self.settled(edits, "together")], *arguments, *here, **more)
        self.expect_same(edits)
        self.assertEqual(len(report["machines"]), others + len(more.get("holders", [])) + 1)
        for machine in report["machines"][1:]:
            self.assertGreater(machine["samples"], 0)
        return report

    def test_the_same_pictures_after_every_class_of_edit(self):
        report = self.same_as_alone(2, "--spp", 24)
        for machine in report["machines"][1:]:
            self.assertGreater(machine["model_bytes_sent"], 10000)

    def test_the_same_exact_pictures_with_copies_of_the_source(self):
        report = self.same_as_alone(1, "--spp", 16, "--exact", 1, "--scene-db", "local", "--seed", 3, edits=EDITS[:3],
                                    model=self.cornell)
        self.assertEqual(report["machines"][1]["model_bytes_sent"], 0)

    def test_an_environment_file_is_lent(self):
        sky = self.path("sky.exr")
        subprocess.run([program.TREX, "render", self.cornell, "-o", sky, "--size", "16x8", "--spp", "4", "--device", "none"],
                       check=True, capture_output=True)
        report = self.same_as_alone(1, "--spp", 64, "--exact", 0, "--env", sky, edits=EDITS[4:])
        self.assertGreater(report["machines"][1]["samples"], 0)

    def start(self, others, steps, *arguments, mpirun=MPIRUN, environment=None, holders=()):
        p = subprocess.Popen(self.command(others, "--replay", self.script(steps), "--report", "report.json", "--device", "none",
                                          *arguments, mpirun=mpirun, holders=holders), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
                             cwd=self.folder, env=environment or self.environment())
        self.addCleanup(self.end, p)
        return p

    def end(self, p):
        if p.poll() is None:
            p.kill()
        p.communicate()

    def wait_for(self, name, p):
        for _ in range(1200):
            if os.path.exists(self.path(name)):
                return
            self.assertIsNone(p.poll(), "it has ended")
            time.sleep(0.05)
        self.fail(name + " was not written")

    def workers(self, p):
        """Process ids by rank."""
        found = {}
        for path in glob.glob("/proc/[0-9]*/environ"):
            try:
                with open(path, "rb") as f:
                    environ = dict(e.split(b"=", 1) for e in f.read().split(b"\0") if b"=" in e)
                with open(os.path.join(os.path.dirname(path), "cmdline"), "rb") as f:
                    line = f.read()
            except OSError:
                continue
            if environ.get(b"PWD", b"").decode() != self.folder and environ.get(b"XDG_STATE_HOME", b"").decode() != self.folder:
                continue
            if b"worker" in line.split(b"\0") and b"OMPI_COMM_WORLD_RANK" in environ:
                found[int(environ[b"OMPI_COMM_WORLD_RANK"])] = int(path.split("/")[2])
        return found

    EDIT = {"material": {"index": 0, "roughness": 0.3}}  # with light of its own
    LONG = [{"wait": "machines"}, {"save": "begun.exr", "samples": 1}, EDIT, {"wait": "idle", "save": "end.exr"}]

    def test_a_server_that_stops_is_not_waited_for(self):
        p = self.start(2, self.LONG, "--spp", 300)
        self.wait_for("begun.exr", p)
        time.sleep(1.0)
        stopped = self.workers(p)[1]
        os.kill(stopped, signal.SIGSTOP)
        try:
            self.wait_for("end.exr", p)
        finally:
            os.kill(stopped, signal.SIGCONT)  # it can be told to stop
        said = p.communicate(timeout=60)[1]
        self.assertEqual(p.returncode, 0, said)
        self.replay([{"wait": "idle"}, self.EDIT, {"wait": "idle", "save": "alone.exr"}], "--spp", 300, size=(136, 72),
                    model=self.model)
        self.same("end.exr", "alone.exr")

    def test_a_window_outlives_a_server_that_dies(self):
        mpirun, environment = self.openmpi5()
        p = self.start(2, self.LONG, "--spp", 300, mpirun=mpirun, environment=environment)
        self.wait_for("begun.exr", p)
        time.sleep(1.0)
        os.kill(self.workers(p)[2], signal.SIGKILL)
        said = p.communicate(timeout=200)[1]
        self.assertEqual(p.returncode, 0, said)
        self.assertIn("machine 2", said)
        self.assertIn("has ended", said)
        self.replay([{"wait": "idle"}, self.EDIT, {"wait": "idle", "save": "alone.exr"}], "--spp", 300, size=(136, 72),
                    model=self.model)
        self.same("end.exr", "alone.exr")

    def streamed(self, triangles="2e4"):
        """A model in pages, and the memory of all of them."""
        model = self.path("streamed.trex")
        subprocess.run([program.TREX, "bake", f"synth:assembly?triangles={triangles}&seed=1", "--stream", "-o", model, "-q"],
                       check=True, capture_output=True)
        info = subprocess.run([program.TREX, "info", model, "--json"], check=True, capture_output=True, text=True).stdout
        return model, json.loads(info)["mesh_pages"]

    def test_a_window_that_does_not_have_the_model(self):
        model, pages = self.streamed()
        report = self.same_as_alone(1, "--spp", 12, edits=EDITS[:3], holders=[model])
        self.assertGreater(sum(step["page_bytes"] for step in report["steps"]), 10000)
        self.assertEqual([machine["model_bytes_sent"] for machine in report["machines"]], [0, 0, 0])

    def test_a_window_with_room_for_few_pages(self):
        model, pages = self.streamed("3e5")
        cache = pages["memory_bytes"] * 2 // 5
        self.assertGreater(cache, 10 * pages["largest_page_bytes"])
        self.same_as_alone(0, "--spp", 6, "--exact", 0, edits=EDITS[:3], holders=[model], here=["--cache", cache])

    def test_a_window_with_room_for_three_pages(self):
        model, pages = self.streamed("3e5")
        # Photons of the server tell how often they have turned, too.
        self.same_as_alone(0, "--spp", 6, "--exact", 0, "--max-bounces", 6, edits=EDITS[:3], holders=[model],
                           here=["--cache", 3 * pages["largest_page_bytes"]])

    def test_a_window_without_a_model_whose_meshes_are_in_no_pages(self):
        self.same_as_alone(0, "--spp", 24, edits=EDITS[1:], holders=[self.model])

    def test_another_model_after_one_that_lies_elsewhere(self):
        model, _ = self.streamed()
        self.together(0, [{"wait": "ready"}, {"open": self.cornell}, {"wait": "idle", "save": "other.exr"}], "--spp", 2,
                      holders=[model], says="have another model open")
        self.replay([{"wait": "idle", "save": "own.exr"}], "--spp", 2, size=(136, 72), model=self.cornell)
        self.same("other.exr", "own.exr")

    def test_who_has_the_model_stops_and_goes_on(self):
        model, pages = self.streamed("1e5")
        turn = {"camera": {"orbit": [2.0, 0.3]}}
        p = self.start(0, [{"wait": "shown", "save": "begun.exr"}, turn, {"wait": "idle", "save": "end.exr"}], "--spp", 150,
                       "--cache", pages["memory_bytes"] // 3, holders=[model])
        self.wait_for("begun.exr", p)
        stopped = self.workers(p)[1]
        os.kill(stopped, signal.SIGSTOP)
        try:
            time.sleep(6.0)
            self.assertIsNone(p.poll(), "the window has ended")
        finally:
            os.kill(stopped, signal.SIGCONT)
        said = p.communicate(timeout=200)[1]
        self.assertEqual(p.returncode, 0, said)
        self.replay([{"wait": "shown", "save": "alone-begun.exr"}, turn, {"wait": "idle", "save": "alone.exr"}], "--spp", 150,
                    size=(136, 72), model=model)
        self.same("end.exr", "alone.exr")

    def test_who_has_the_model_dies(self):
        mpirun, environment = self.openmpi5()
        model, pages = self.streamed("1e5")
        p = self.start(1, [{"wait": "machines"}, {"save": "begun.exr"}, {"camera": {"orbit": [2.0, 0.3]}}, {"wait": "idle"}],
                       "--spp", 4000, "--cache", pages["memory_bytes"] // 3, mpirun=mpirun, environment=environment, holders=[model])
        self.wait_for("begun.exr", p)
        os.kill(self.workers(p)[1], signal.SIGKILL)
        said = p.communicate(timeout=200)[1]
        self.assertEqual(p.returncode, 1, said)
        self.assertIn("which has the model, has ended", said)
        self.assertIn("what is shown stays", said)

    def test_wrong_uses_of_a_model_elsewhere(self):
        model, _ = self.streamed()
        other = self.path("other.trex")
        subprocess.run([program.TREX, "bake", "synth:assembly?triangles=1e3&seed=2", "--stream", "-o", other, "-q"], check=True,
                       capture_output=True)
        self.together(0, [], code=2, says="two machines have different models", holders=[model, other])
        self.together(0, [], code=2, says="bake it", holders=[self.cornell])
        self.together(0, [], code=3, says="none.trex", holders=[self.path("none.trex")])
        self.together(0, [], "--scene-db", "local", code=2, says="name the model", holders=[model])
        self.together(0, [], "--cache", "some", code=2, says="some", holders=[model])
        self.together(0, [{"wait": "shown"}], "--cache", "1", code=4, says="largest", holders=[model])
        self.together(1, [], code=2, says="name the model, here or at the machine that has it", model="--seed=0")
        self.together(1, [{"wait": "idle"}], "--spp", 1, says="the window has a model too", model=model, worker=[model])

    def openmpi5(self):
        folder = os.environ.get("TREX_OPENMPI5")
        if not folder:
            self.skipTest("TREX_OPENMPI5 is not the folder that scripts/openmpi5 has made")
        mpirun = [os.path.join(folder, "bin", "mpirun"), "--with-ft", "ulfm", "--allow-run-as-root", "--bind-to", "none",
                  "--map-by", ":OVERSUBSCRIBE"]
        return mpirun, {**self.environment(), "LD_LIBRARY_PATH": os.path.join(folder, "lib")}

    def test_a_server_that_can_not_open_the_model_is_left_out(self):
        report = self.together(1, [{"wait": "idle", "seconds": 2, "save": "a.exr"}], "--spp", 2, "--scene-db", "local",
                               model=self.cornell, worker=["--max-memory", "1M"], says="going on without it")
        self.assertEqual(report["machines"][1]["samples"], 0)

    def test_closing_ends_all(self):
        p = self.start(2, [{"wait": "shown", "close": True}])
        said = p.communicate(timeout=60)[1]
        self.assertEqual(p.returncode, 0, said)
        self.assertEqual(self.workers(p), {})
        p = self.start(1, [{"wait": "machines"}, {"save": "begun.exr"}, {"seconds": 100}])
        self.wait_for("begun.exr", p)
        window = [int(x.split("/")[2]) for x in glob.glob("/proc/[0-9]*/cmdline") if self.is_window(x)]
        self.assertEqual(len(window), 1)
        os.kill(window[0], signal.SIGINT)
        said = p.communicate(timeout=60)[1]
        self.assertEqual(p.returncode, 130, said)

    def is_window(self, path):
        try:
            with open(path, "rb") as f:
                words = f.read().split(b"\0")
        except OSError:
            return False
        return words[0].endswith(b"trex-view") and self.model.encode() in words

    def test_wrong_uses(self):
        p = subprocess.run([program.TREX, "worker"], capture_output=True, text=True, env=self.environment())
        self.assertEqual(p.returncode, 2)
        self.assertIn("mpirun", p.stderr)
        self.together(1, [], code=2, says="bake it", model=self.cornell)
        self.together(1, [], worker=["--cache", "some"], code=2, says="some")
        self.together(1, [], code=3, says="none.trex", model=self.path("none.trex"))
        p = subprocess.run([*MPIRUN, "-n", "2", program.TREX, "view", self.model], capture_output=True, text=True, timeout=60,
                           cwd=self.folder, env=self.environment(display=False))
        self.assertNotEqual(p.returncode, 0)
        self.assertIn("one window is enough", p.stderr)
        render = [program.TREX, "render", self.model, "-o", "a.exr", "--size", "64x64", "--spp", "100000", "--device", "none"]
        p = subprocess.run([*MPIRUN, "-n", "1", *render, ":", "-n", "1", program.TREX, "worker"], capture_output=True, text=True,
                           timeout=60, cwd=self.folder, env=self.environment())
        self.assertEqual(p.returncode, 1, p.stderr)
        self.assertIn("trex worker serves trex view", p.stderr)


if __name__ == "__main__":
    program.main()
