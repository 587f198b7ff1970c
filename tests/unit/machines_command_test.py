#!/usr/bin/env python3
"""`mpirun trex render`: the same bytes by 1, 2 and 4 processes, signals, lost and stopped processes, errors. Without mpirun
or a build with MPI only what needs neither is tested."""
import json, os, shutil, signal, subprocess, time
import program
from program import ProgramTest

MPIRUN = ["mpirun", "--oversubscribe", "--allow-run-as-root", "--bind-to", "none", "--mca", "btl", "self,vader,tcp"]


def has_mpi():
    beside = os.path.join(os.path.dirname(program.TREX), "libtrex_mpi.so")
    return shutil.which("mpirun") is not None and os.path.exists(beside)


def contents(path):
    with open(path, "rb") as f:
        return f.read()


class Machines(ProgramTest):
    def setUp(self):
        super().setUp()
        assets = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "..", "assets")
        self.cornell = os.path.join(assets, "cornell.glb")
        self.environment = {k: v for k, v in os.environ.items() if not k.startswith(("OMPI_", "PMIX_"))}

    def alone(self, *arguments, code=0, model=None):
        p = program.run("render", model or self.cornell, "--device", "none", "--threads", 1, *arguments)
        self.assertEqual(p.returncode, code, p.stderr)
        return p

    def command(self, processes, *arguments, model=None, folders=None, differs={}):
        """`folders`: where each process is; `differs`: further arguments of some."""
        if not has_mpi():
            self.skipTest("no mpirun, or a build without MPI")
        one = ["render", model or self.cornell, "--device", "none", "--threads", 1, *arguments]
        if not folders and not differs:
            return [*MPIRUN, "-n", str(processes), program.TREX, *map(str, one)]
        command = list(MPIRUN)
        for i in range(processes):
            place = ["-wdir", folders[i]] if folders else []
            command += [":"] * (i > 0) + ["-n", "1", *place, program.TREX, *map(str, one), *map(str, differs.get(i, []))]
        return command

    def test_a_device_that_is_lost_does_not_change_the_picture(self):
        if not has_mpi():
            self.skipTest("no mpirun, or a build without MPI")
        for loser, spp in ((0, 16), (1, 48)):
            with self.subTest(loser=loser):
                job = ["render", self.cornell, "--size", "64x64", "--spp", spp, "--denoise", "off", "--guess", "cone", "--threads", 1]
                one, out = self.path("one.exr"), self.path("out.exr")
                self.assertEqual(program.run(*job, "-o", one).returncode, 0)
                trex = [program.TREX, *map(str, job), "-o", out, "--json", "--scene-db", "local"]
                command = list(MPIRUN)
                for i in (0, 1):
                    fails = ["env", "TREX_FAIL_SUBMIT=3"] if i == loser else []
                    command += [":"] * i + ["-n", "1", *fails, *trex]
                p = subprocess.run(command, capture_output=True, text=True, timeout=120, env=self.environment)
                self.assertEqual(p.returncode, 0, p.stderr)
                report = json.loads(p.stdout)
                self.assertIn(", then cpu", report["device"])
                for i, machine in enumerate(report["machines"]):
                    self.assertEqual(", then cpu" in machine["device"], i == loser, machine)
                self.assertIn(b", then cpu", self.read("out.exr")[:8192])  # the picture's metadata
                diff = program.run("diff", out, one, "--metric", "flip", "--max", 0.001)
                self.assertEqual(diff.returncode, 0, diff.stdout)

    def test_a_share_of_cones_by_two_devices(self):
        if not has_mpi():
            self.skipTest("no mpirun, or a build without MPI")
        job = ["render", self.cornell, "--size", "64x64", "--spp", 9, "--guess", 0.5, "--exact", 0.25, "--threads", 1, "--json"]
        pictures, reports = [], []
        for name, before in (("one.exr", []), ("two.exr", [*MPIRUN, "-n", "2"])):
            p = subprocess.run([*before, program.TREX, *map(str, job), "-o", self.path(name)], capture_output=True, text=True,
                               timeout=120, env=self.environment)
            self.assertEqual(p.returncode, 0, p.stderr)
            pictures.append(self.read(name))
            reports.append(json.loads(p.stdout))
        self.assertEqual(pictures[0], pictures[1])
        for key in ("guess", "g_rays", "gathered_by_device", "gathered_by_cpu"):
            self.assertEqual(reports[0][key], reports[1][key], key)
        self.assertEqual(reports[1]["guess"], "0.5")
        self.assertGreater(reports[1]["gathered_by_device"], 0)

    def together(self, processes, *arguments, code=0, says="", **how):
        p = subprocess.run(self.command(processes, *arguments, **how), capture_output=True, text=True, timeout=120,
                           env=self.environment)
        self.assertEqual(p.returncode, code, p.stdout + p.stderr)
        self.assertIn(says, p.stderr)
        return p

    def start(self, processes, *arguments, **how):
        p = subprocess.Popen(self.command(processes, *arguments, **how), stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                             text=True, env=self.environment)
        self.addCleanup(self.end, p)
        return p

    def end(self, process):
        if process.poll() is None:
            process.kill()
        process.communicate()

    def ranks(self, mpirun):
        """Numbers of the processes by rank."""
        found = {}
        for name in filter(str.isdigit, os.listdir("/proc")):
            try:
                with open(f"/proc/{name}/stat") as f:
                    parent = int(f.read().rsplit(")", 1)[1].split()[1])
                variables = dict(x.split(b"=", 1) for x in contents(f"/proc/{name}/environ").split(b"\0") if b"=" in x)
            except (OSError, ValueError):
                continue
            if parent == mpirun.pid and b"OMPI_COMM_WORLD_RANK" in variables:
                found[int(variables[b"OMPI_COMM_WORLD_RANK"])] = int(name)
        return found

    def wait_for(self, path, process):
        for _ in range(1200):
            if os.path.exists(path) or process.poll() is not None:
                return
            time.sleep(0.05)
        self.fail("waited for a minute")

    # ---- the same bits ----

    def test_the_same_bytes_by_any_number_of_processes(self):
        for options in (["--exact", 0], ["--exact", 0.25, "--aov", "all", "--denoise", "off"], [],
                        ["--exact", 1, "--aov", "variance"]):
            job = ["--size", "80x72", "--spp", 9, *options]
            self.alone("-o", self.path("alone.exr"), *job)
            for processes, db in ((1, "central"), (2, "local"), (4, "central")):
                with self.subTest(options=options, processes=processes):
                    self.together(processes, "-o", self.path("a.exr"), *job, "--scene-db", db)
                    self.assertEqual(self.read("a.exr"), self.read("alone.exr"))

    def test_an_error_as_the_goal_stops_at_the_same_sample(self):
        job = ["--size", "32x32", "--exact", 1, "--error", 0.05, "--json"]
        alone = json.loads(self.alone("-o", self.path("alone.exr"), *job).stdout)
        both = json.loads(self.together(2, "-o", self.path("a.exr"), *job).stdout)
        self.assertEqual(both["samples"], alone["samples"])
        self.assertEqual(self.read("a.exr"), self.read("alone.exr"))

    def test_rows_by_machine(self):
        p = self.together(3, "-o", self.path("a.exr"), "--size", "64x64", "--spp", 2000, "--exact", 1, "--json")
        report = json.loads(p.stdout)  # one document: machine 0's
        self.assertEqual([m["machine"] for m in report["machines"]], [0, 1, 2])
        self.assertEqual(sum(m["tile_samples"] for m in report["machines"]), 2000)
        for machine in report["machines"]:
            self.assertGreater(machine["tile_samples"], 0)
            self.assertGreater(machine["peak_resident_bytes"], 1 << 20)
        self.assertEqual(report["machines"][0]["model_bytes_sent"], 0)
        self.assertGreater(report["machines"][1]["model_bytes_sent"], 1000)

    def test_several_pictures(self):
        views = ["--camera", "0,1,3.2/0,1,0/0,1,0/40", "--camera", "0.5,1,3.2/0,1,0/0,1,0/40"]
        self.alone("-o", self.path("alone#.exr"), "--size", "32x32", "--spp", 5, "--exact", 0.5, *views)
        self.together(3, "-o", self.path("a#.exr"), "--size", "32x32", "--spp", 5, "--exact", 0.5, *views)
        for i in (1, 2):
            self.assertEqual(self.read(f"a{i}.exr"), self.read(f"alone{i}.exr"))

    # ---- the central scene database ----

    def test_photons_that_wait_for_pages_are_shared(self):
        if not has_mpi():
            self.skipTest("no mpirun, or a build without MPI")
        bundle = self.path("b.trex")
        self.trex("bake", "synth:assembly?triangles=2e5&seed=3", "-o", bundle, "--stream")
        job = ["--size", "64x48", "--spp", 4, "--exact", 0.25, "--denoise", "off"]
        self.alone("-o", self.path("alone.exr"), *job, model=bundle)
        few = json.loads(self.trex("info", bundle, "--json"))["mesh_pages"]["largest_page_bytes"] + 8192
        for db in ("local", "central"):
            p = self.together(3, "-o", self.path("a.exr"), *job, "--cache", few, "--json", "--scene-db", db, model=bundle)
            self.assertEqual(self.read("a.exr"), self.read("alone.exr"))
            report = json.loads(p.stdout)
            self.assertEqual(sum(m["photons"] for m in report["machines"]), report["photons"])
            self.assertGreater(sum(m["photons"] for m in report["machines"][1:]), 0)

    def two_folders(self, names):
        """One with copies of these files, and an empty one."""
        full, empty = self.path("full"), self.path("empty")
        os.makedirs(full, exist_ok=True), os.makedirs(empty, exist_ok=True)
        for name, data in names.items():
            with open(os.path.join(full, name), "wb") as f:
                f.write(data)
        return full, empty

    def test_only_machine_0_needs_the_files(self):
        look = {"trex": 1, "edits_of": "m.glb", "environment": {"color": [0.2, 0.3, 0.4], "rotation_radians": 0}, "exposure": 1}
        cameras = {"trex": 1, "cameras": [{"eye": [0, 1, 3], "target": [0, 1, 0]}, {"eye": [0, 1.2, 3], "target": [0, 1, 0]}]}
        full, empty = self.two_folders({"m.glb": contents(self.cornell), "look.json": json.dumps(look).encode(),
                                        "path.json": json.dumps(cameras).encode()})
        job = ["--size", "32x32", "--spp", 6, "--exact", 0.5]
        options = ["--edits", "look.json", "--path", "path.json"]
        here = os.getcwd()
        os.chdir(full)
        self.addCleanup(os.chdir, here)
        self.alone("-o", self.path("alone#.exr"), *job, *options, model="m.glb")
        self.together(3, "-o", self.path("a#.exr"), *job, *options, model="m.glb", folders=[full, empty, empty])
        for i in (1, 2):
            self.assertEqual(self.read(f"a{i}.exr"), self.read(f"alone{i}.exr"))
        self.assertEqual(os.listdir(empty), [])

    def test_pages_travel_when_rays_ask_for_them(self):
        bundle = self.path("a.trex")
        self.trex("bake", "synth:assembly?triangles=1e5&seed=3", "-o", bundle, "--stream")
        pages = json.loads(self.trex("info", bundle, "--json"))["mesh_pages"]
        few = str(max(int(pages["memory_bytes"] * 0.1), pages["largest_page_bytes"] + 8192))
        full, empty = self.two_folders({"b.trex": contents(bundle), "sky.exr": b""})
        self.alone("-o", os.path.join(full, "sky.exr"), "--size", "16x8", "--spp", 1, "--exact", 1)
        here = os.getcwd()
        os.chdir(full)
        self.addCleanup(os.chdir, here)
        for options in (["--exact", 1], ["--exact", 0.5, "--env", "sky.exr?strength=2"]):
            job = ["--size", "64x48", "--spp", 4, "--denoise", "off", *options]
            self.alone("-o", self.path("alone.exr"), *job, model="b.trex")
            p = self.together(2, "-o", self.path("a.exr"), *job, "--cache", few, "--json", model="b.trex",
                              folders=[full, empty])
            self.assertEqual(self.read("a.exr"), self.read("alone.exr"))
        # Voxels are read where guesses need them alone.
        self.together(2, "-o", self.path("a.exr"), "--size", "64x48", "--spp", 400, "--exact", 1, "--camera",
                      "0,0,-1e6/0,0,-2e6/0,1,0/40", "--json", model="b.trex", folders=[full, empty])

    def paged(self, triangles="2e5"):
        """A bundle, and a cache that few of its pages fit in."""
        bundle = self.path("p.trex")
        self.trex("bake", f"synth:assembly?triangles={triangles}&seed=3", "-o", bundle, "--stream")
        pages = json.loads(self.trex("info", bundle, "--json"))["mesh_pages"]
        return bundle, max(int(pages["memory_bytes"] * 0.1), pages["largest_page_bytes"] + 8192)

    def test_pages_are_passed_on_by_whoever_has_them(self):
        if not has_mpi():
            self.skipTest("no mpirun, or a build without MPI")
        bundle, few = self.paged()
        job = ["--size", "64x48", "--spp", 16, "--exact", 1, "--cache", few, "--ray-memory", "1M"]
        self.alone("-o", self.path("alone.exr"), *job, model=bundle)
        for order in ("plan", "round-robin"):
            p = self.together(4, "-o", self.path("a.exr"), *job, "--page-order", order, "--json", model=bundle)
            self.assertEqual(self.read("a.exr"), self.read("alone.exr"), order)
            rows = json.loads(p.stdout)["machines"]
            got, passed, planned = (sum(r[f"page_bytes_{key}"] for r in rows) for key in ("received", "passed_on", "planned"))
            self.assertGreater(planned, 0)
            self.assertGreater(passed, 0.3 * got, rows)  # two thirds, if all want all
            self.assertGreaterEqual(got, planned)
        p = self.together(4, "-o", self.path("a.exr"), *job, "--page-disk", "off", "--json", model=bundle)
        self.assertEqual(self.read("a.exr"), self.read("alone.exr"))
        self.assertEqual(sum(r["page_bytes_passed_on"] for r in json.loads(p.stdout)["machines"]), 0)

    # ---- what goes wrong ----

    def test_an_interrupt_saves_picture_and_checkpoint(self):
        for who, code in ((signal.SIGINT, 130), (signal.SIGTERM, 143)):
            out, state = self.path("a.exr"), self.path("state")
            job = ["--size", "64x64", "--exact", 1, "--aov", "sampleCount"]
            p = self.start(3, "-o", out, *job, "--spp", 200000, "--checkpoint", state, "--checkpoint-seconds", 0.2)
            self.wait_for(state, p)
            os.kill(self.ranks(p)[0], who)
            said = p.communicate(timeout=60)[1]
            self.assertEqual(p.returncode, code, said)
            self.assertTrue(os.path.exists(out))
            samples = int(contents(state)[28:32][::-1].hex(), 16)
            self.assertGreater(samples, 0)
            more = ["--spp", samples + 7]
            self.alone("-o", out, *job, *more, "--checkpoint", state, "--resume")
            self.alone("-o", self.path("whole.exr"), *job, *more)
            self.assertEqual(self.read("a.exr"), self.read("whole.exr"))
            os.remove(state), os.remove(out)

    def test_after_a_killed_process_the_checkpoint_goes_on_with_fewer(self):
        out, state = self.path("a.exr"), self.path("state")
        job = ["--size", "64x64", "--exact", 0.25]
        p = self.start(4, "-o", out, *job, "--spp", 200000, "--checkpoint", state, "--checkpoint-seconds", 0.2)
        self.wait_for(state, p)
        os.kill(self.ranks(p)[2], signal.SIGKILL)
        said = p.communicate(timeout=60)[1]
        self.assertNotEqual(p.returncode, 0)
        self.assertIn("rank 2", said)
        self.assertIn("Killed", said)
        samples = int(contents(state)[28:32][::-1].hex(), 16)
        more = ["--spp", samples + 9]
        self.together(2, "-o", out, *job, *more, "--checkpoint", state, "--resume", says="going on after")
        self.alone("-o", self.path("whole.exr"), *job, *more)
        self.assertEqual(self.read("a.exr"), self.read("whole.exr"))

    # ---- with Open MPI 5 ----

    def start5(self, processes, *arguments, model=None):
        """By the Open MPI 5 of scripts/openmpi5, which lets others outlive a process."""
        folder = os.environ.get("TREX_OPENMPI5")
        if not has_mpi() or not folder:
            self.skipTest("TREX_OPENMPI5 is not the folder that scripts/openmpi5 has made")
        mpirun = os.path.join(folder, "bin", "mpirun")
        libraries = os.path.join(folder, "lib")
        command = [mpirun, "--with-ft", "ulfm", "--allow-run-as-root", "--bind-to", "none", "--map-by", ":OVERSUBSCRIBE", "-n",
                   str(processes), program.TREX, "render", model or self.cornell, "--device", "none", "--threads", "1"]
        p = subprocess.Popen([*command, *map(str, arguments)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
                             env={**self.environment, "LD_LIBRARY_PATH": libraries})
        self.addCleanup(self.end, p)
        return p

    def test_others_outlive_a_killed_process(self):
        for killed, options in ((2, ["--exact", 0.25, "--spp", 400]), (1, ["--exact", 1, "--spp", 1000])):
            with self.subTest(killed=killed):
                out, state = self.path("a.exr"), self.path("state")
                job = ["--size", "64x64", *options]
                p = self.start5(4, "-o", out, *job, "--json", "--checkpoint", state, "--checkpoint-seconds", 0.2)
                self.wait_for(state, p)
                time.sleep(0.3)
                os.kill(self.ranks(p)[killed], signal.SIGKILL)
                stdout, said = p.communicate(timeout=100)
                self.assertEqual(p.returncode, 0, said)
                self.assertIn(f"machine {killed}", said)
                self.assertIn("has ended", said)
                self.assertEqual(len(json.loads(stdout)["machines"]), 4)
                self.alone("-o", self.path("whole.exr"), *job)
                self.assertEqual(self.read("a.exr"), self.read("whole.exr"))
                os.remove(state)

    def test_pages_of_a_killed_process_come_from_others(self):
        bundle, few = self.paged()
        out, state = self.path("a.exr"), self.path("state")
        # Nothing is kept unpacked: pages travel all the time.
        job = ["--size", "64x48", "--exact", 1, "--cache", few, "--ray-memory", "1M", "--page-disk", "2M"]
        p = self.start5(4, "-o", out, *job, "--time", 5, "--json", "--checkpoint", state, "--checkpoint-seconds", 0.2, model=bundle)
        self.wait_for(state, p)
        time.sleep(0.5)
        os.kill(self.ranks(p)[1], signal.SIGKILL)
        stdout, said = p.communicate(timeout=100)
        self.assertEqual(p.returncode, 0, said)
        self.assertIn("has ended", said)
        report = json.loads(stdout)
        self.assertGreater(sum(r["page_bytes_passed_on"] for r in report["machines"][2:]), 0)
        self.alone("-o", self.path("whole.exr"), *job, "--spp", report["samples"], model=bundle)
        same = program.run("diff", out, self.path("whole.exr"), "--max", 0)
        self.assertEqual(same.returncode, 0, same.stdout)

    def test_open_mpi_5_ends_as_4_does_where_nobody_dies(self):
        p = self.start5(3, "-o", self.path("a.exr"), "--size", "32x32", "--spp", 20, "--exact", 0.5)
        said = p.communicate(timeout=100)[1]
        self.assertEqual(p.returncode, 0, said)
        self.assertNotIn("has ended", said)
        self.alone("-o", self.path("whole.exr"), "--size", "32x32", "--spp", 20, "--exact", 0.5)
        self.assertEqual(self.read("a.exr"), self.read("whole.exr"))

    # ---- a process that hangs ----

    def test_a_stopped_process_loses_its_jobs_to_others(self):
        out, state = self.path("a.exr"), self.path("state")
        job = ["--size", "64x64", "--exact", 1]
        p = self.start(3, "-o", out, *job, "--time", 9, "--json", "--checkpoint", state, "--checkpoint-seconds", 0.2)
        self.wait_for(state, p)
        time.sleep(1.0)  # until it has jobs
        os.kill(self.ranks(p)[1], signal.SIGSTOP)
        stdout, said = p.communicate(timeout=120)
        self.assertIn("machine 1", said)
        self.assertIn("has not answered", said)
        report = json.loads(stdout)
        self.assertGreater(report["jobs_given_out_again"], 0)
        self.alone("-o", self.path("whole.exr"), *job, "--spp", report["samples"])
        same = program.run("diff", out, self.path("whole.exr"), "--max", 0)
        self.assertEqual(same.returncode, 0, same.stdout)

    def test_pages_of_a_stopped_process_come_from_machine_0(self):
        if not has_mpi():
            self.skipTest("no mpirun, or a build without MPI")
        bundle, few = self.paged()
        out, state = self.path("a.exr"), self.path("state")
        job = ["--size", "64x48", "--exact", 1, "--cache", few, "--ray-memory", "1M", "--page-disk", "4M"]
        p = self.start(4, "-o", out, *job, "--time", 10, "--json", "--checkpoint", state, "--checkpoint-seconds", 0.2, model=bundle)
        self.wait_for(state, p)
        os.kill(self.ranks(p)[1], signal.SIGSTOP)
        stdout, said = p.communicate(timeout=120)
        self.assertIn("machine 1", said)
        report = json.loads(stdout)
        self.assertGreater(sum(r["page_bytes_passed_on"] for r in report["machines"]), 0)
        self.alone("-o", self.path("whole.exr"), *job, "--spp", report["samples"], model=bundle)
        same = program.run("diff", out, self.path("whole.exr"), "--max", 0)
        self.assertEqual(same.returncode, 0, same.stdout)

    def test_machines_that_differ_are_refused(self):
        full, other = self.path("full"), self.path("other")
        os.makedirs(full), os.makedirs(other)
        shutil.copy(self.cornell, os.path.join(full, "m.glb"))
        shutil.copy(os.path.join(os.path.dirname(self.cornell), "gallery.glb"), os.path.join(other, "m.glb"))
        job = ["-o", self.path("a.exr"), "--size", "32x32", "--spp", 4]
        self.together(2, *job, "--scene-db", "local", model="m.glb", folders=[full, other], code=3,
                      says="its model, or what it makes of it, is not that of machine 0")
        self.together(2, *job, "--scene-db", "local", differs={1: ["--seed", 5]}, code=3, says="machine 1")
        self.assertFalse(os.path.exists(self.path("a.exr")))

    def test_errors_of_any_machine_end_the_job(self):
        job = ["-o", self.path("a.exr"), "--size", "32x32", "--spp", 100000]
        self.together(2, *job, model=self.path("none.glb"), code=3, says="none.glb")
        self.together(2, *job, "--scene-db", "local", differs={1: ["--max-memory", "20M"]}, code=4, says="machine 1")
        self.together(2, *job, differs={1: ["--max-memory", "20M"]}, code=4, says="machine 1")
        self.together(2, "-o", self.path("no/such/a.exr"), code=5, says="no/such")
        self.together(2, *job, "--size", "0x0", code=2)

    def test_what_several_machines_can_not_do_is_refused(self):
        self.together(2, "-o", self.path("a.exr"), "--trace", self.path("t.json"), code=2, says="--trace")
        if has_mpi():
            p = subprocess.run([*MPIRUN, "-n", "2", program.TREX, "info", self.cornell], capture_output=True, text=True,
                               timeout=60, env=self.environment)
            self.assertEqual(p.returncode, 2)
            self.assertEqual(p.stderr.count("trex info: runs on one machine"), 1, p.stderr)

    # ---- without MPI ----

    def test_one_process_loads_no_mpi(self):
        p = subprocess.run([program.TREX, "render", self.cornell, "-o", self.path("a.exr"), "--size", "8x8", "--spp", "1",
                            "--device", "none"], capture_output=True, text=True, timeout=60,
                           env={**self.environment, "LD_DEBUG": "libs"})
        self.assertEqual(p.returncode, 0)
        self.assertIn("libembree", p.stderr)
        for name in ("libmpi", "libtrex_mpi", "libopen-pal"):
            self.assertNotIn(name, p.stderr)

    def test_a_program_without_its_mpi_library_says_so(self):
        alone = os.path.join(self.folder, "trex")
        shutil.copy(program.TREX, alone)
        p = subprocess.run([alone, "render", self.cornell, "-o", self.path("a.exr")], capture_output=True, text=True, timeout=60,
                           env={**self.environment, "OMPI_COMM_WORLD_SIZE": "2", "OMPI_COMM_WORLD_RANK": "0"})
        self.assertEqual(p.returncode, 4)
        self.assertIn("libopenmpi-dev", p.stderr)


if __name__ == "__main__":
    program.main()
