#!/usr/bin/env python3
"""Wrong uses of the program: each ends in its exit code and one clear line, and leaves nothing behind.

A row: exit code | words of the message | arguments. {cornell} is a good model, {dir} an empty folder,
{png} and {exr} pictures that could be written, {FILE} one of the files of FILES. Rows of a command that
the program does not have are left out, but for those of COMMANDS, which it must have.
"""
import json
import os
import shlex
import shutil
import subprocess
import tempfile
import sys
import unittest

import program

COMMANDS = {"render", "doctor", "diff", "merge"}

ROWS = """
2 | subcommand            |
2 | paint                 | paint
2 | subcommand            | --sunny
2 | subcommand            | -q
2 | colour                | doctor --colour
2 | extra                 | doctor extra
2 | INPUT                 | render
2 | output                | render {cornell}
2 | sise                  | render {cornell} -o {png} --sise 1x1
2 | 0x0                   | render {cornell} -o {png} --size 0x0
2 | WxH                   | render {cornell} -o {png} --size 10
2 | -3x5                  | render {cornell} -o {png} --size=-3x5
2 | 65536                 | render {cornell} -o {png} --size 99999x1
2 | 1x1x1                 | render {cornell} -o {png} --size 1x1x1
2 | 4294967297x1          | render {cornell} -o {png} --size 4294967297x1
2 | spp                   | render {cornell} -o {png} --spp -1
2 | spp                   | render {cornell} -o {png} --spp many
2 | spp                   | render {cornell} -o {png} --spp 99999999999999999999
2 | spp                   | render {cornell} -o {png} --spp
2 | exact                 | render {cornell} -o {png} --exact 1.5
2 | exact                 | render {cornell} -o {png} --exact nan
2 | time                  | render {cornell} -o {png} --time -1
2 | time                  | render {cornell} -o {png} --time nan
2 | time                  | render {cornell} -o {png} --time inf
2 | threads               | render {cornell} -o {png} --threads 0
2 | threads               | render {cornell} -o {png} --threads 1e9
2 | device                | render {cornell} -o {png} --device gpu
2 | device                | render {cornell} -o {png} --device -1
2 | device                | render {cornell} -o {png} --device 0x1
2 | guess                 | render {cornell} -o {png} --guess magic
2 | guess                 | render {cornell} -o {png} --guess 1.5
2 | guess                 | render {cornell} -o {png} --guess nan
2 | guess                 | render {cornell} -o {png} --guess 0.5cone
2 | denoise               | render {cornell} -o {png} --denoise maybe
2 | exposure              | render {cornell} -o {png} --exposure bright
2 | exposure              | render {cornell} -o {png} --exposure 1e9
2 | aov                   | render {cornell} -o {exr} --aov smell
2 | seed                  | render {cornell} -o {png} --seed -1
2 | camera                | render {cornell} -o {png} --camera 1,2/3
2 | nobody                | render {cornell} -o {png} --camera nobody
2 | 0,0,0/0,0,1/0,1,0/180 | render {cornell} -o {png} --camera 0,0,0/0,0,1/0,1,0/180
2 | --max-memory much     | render {cornell} -o {png} --max-memory much
2 | --texture-memory much | render {cornell} -o {png} --texture-memory much
2 | --cache much          | render {cornell} -o {png} --cache much
2 | --ray-memory much     | render {cornell} -o {png} --ray-memory much
2 | --page-disk much      | render {cornell} -o {png} --page-disk much
2 | --max-gpu-memory much | render {cornell} -o {png} --max-gpu-memory much
2 | --max-memory much     | bake {cornell} -o {dir}/a.trex --max-memory much
2 | -o ''                 | render {cornell} -o ''
2 | --at nan              | render {cornell} -o {png} --at nan
2 | is what is read       | diff {one.exr} {one.exr} -o {one.exr}
2 | is what is read       | render {cornell} -o {one.exr} --env {one.exr}?rotate=1
2 | -5G                   | render {cornell} -o {png} --max-memory=-5G
2 | env                   | render {cornell} -o {png} --env 1,2
2 | -1,0,0                | render {cornell} -o {png} --env=-1,0,0
2 | rotate                | render {cornell} -o {png} --env 1,1,1?rotate=90
2 | no number             | render {cornell} -o {png} --env {one.exr}?rotate=north
2 | rotate                | render {cornell} -o {png} --env {one.exr}?rotate=nan
2 | strength              | render {cornell} -o {png} --env {one.exr}?strength=-1
2 | 'spin'                | render {cornell} -o {png} --env {one.exr}?spin=1
2 | no value              | render {cornell} -o {png} --env {one.exr}?strength
2 | fstop                 | render {cornell} -o {png} --camera 0,0,5/0,0,0/0,1,0/40?fstop=0&focus=1
2 | needs fstop and focus | render {cornell} -o {png} --camera 0,0,5/0,0,0/0,1,0/40?focus=1
2 | focus                 | render {cornell} -o {png} --camera 0,0,5/0,0,0/0,1,0/40?fstop=2&focus=nan
2 | 'iris'                | render {cornell} -o {png} --camera 0,0,5/0,0,0/0,1,0/40?iris=2
2 | tonemap               | render {cornell} -o {png} --tonemap film
2 | bits                  | render {cornell} -o {png} --bits 12
2 | --bits                | render {cornell} -o {exr} --bits 16
2 | --bits                | render {cornell} -o {dir}/a.jpg --bits 16
2 | quality               | render {cornell} -o {dir}/a.jpg --quality 0
2 | no alpha              | render {cornell} -o {dir}/a.jpg --transparent
2 | .bmp                  | render {cornell} -o {dir}/a.bmp
2 | format                | render {cornell} -o {dir}/a
2 | extra                 | render {cornell} -o {png} extra
3 | missing.glb           | render {dir}/missing.glb -o {png}
3 | folder                | render {dir} -o {png}
3 | model.xyz             | render {model.xyz} -o {png}
3 | empty                 | render {empty.glb} -o {png}
3 | truncated.glb         | render {truncated.glb} -o {png}
3 | words.gltf            | render {words.gltf} -o {png}
3 | words.ply             | render {words.ply} -o {png}
3 | no triangle           | render {words.obj} -o {png}
3 | vertex                | render {index.obj} -o {png}
3 | none.hdr              | render {cornell} -o {png} --env {dir}/none.hdr
3 | words.ply             | render {cornell} -o {png} --env {words.ply}
4 | --max-memory          | render {cornell} -o {png} --max-memory 10K
4 | --device none         | render {cornell} -o {png} --size 8x8 --spp 1 --device 99
5 | no/such               | render {cornell} -o {dir}/no/such/a.png
5 | folder                | render {cornell} -o {folder.png}
5 | /proc/a.png           | render {cornell} -o /proc/a.png --size 8x8 --spp 1
2 | A                     | diff
2 | B                     | diff {one.exr}
2 | metric                | diff {one.exr} {one.exr} --metric taste
2 | max                   | diff {one.exr} {one.exr} --max little
2 | max                   | diff {one.exr} {one.exr} --max nan
2 | ppd                   | diff {one.exr} {one.exr} --ppd 0
2 | exposure              | diff {one.exr} {one.exr} --exposure dark
2 | .gif                  | diff {one.exr} {one.exr} -o {dir}/heat.gif
3 | missing.exr           | diff {one.exr} {dir}/missing.exr
3 | words.ply             | diff {words.ply} {one.exr}
3 | cut.exr               | diff {one.exr} {cut.exr}
5 | no/such               | diff {one.exr} {one.exr} -o {dir}/no/such/heat.png
2 | PICTURES              | merge -o {exr}
2 | output                | merge {one.exr} {one.exr}
2 | two                   | merge {one.exr} -o {exr}
2 | .png                  | merge {one.exr} {one.exr} -o {png}
3 | missing.exr           | merge {one.exr} {dir}/missing.exr -o {exr}
3 | one.exr               | merge {one.exr} {one.exr} -o {exr}
5 | no/such               | merge {one.exr} {one.exr} -o {dir}/no/such/a.exr
2 | FILE                  | info
3 | missing.glb           | info {dir}/missing.glb
3 | words.trex            | info {words.trex}
3 | cut.hccm              | info {cut.hccm}
2 | INPUT                 | bake
2 | output                | bake {cornell}
2 | .trex                 | bake {cornell} -o {dir}/a.zip
2 | threads               | bake {cornell} -o {dir}/a.trex --threads -1
3 | missing.glb           | bake {dir}/missing.glb -o {dir}/a.trex
3 | truncated.glb         | bake {truncated.glb} -o {dir}/a.trex
4 | --max-memory          | bake {cornell} -o {dir}/a.trex --max-memory 10K
5 | no/such               | bake {cornell} -o {dir}/no/such/a.trex
"""

WORDS = b"hello, this is no model\n"
FILES = {
    "empty.glb": b"", "model.xyz": WORDS, "words.gltf": WORDS, "words.ply": WORDS, "words.trex": WORDS,
    "words.obj": b"# hello\n", "index.obj": b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n", "cut.hccm": b"HCCM\x01\0\0\0"}


def run(arguments, folder, **environment):
    return subprocess.run([program.TREX, *arguments], capture_output=True, text=True, timeout=300, cwd=folder,
                          env={**os.environ, **environment})


class ExitCodes(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.files = tempfile.mkdtemp(prefix="trex-exit-codes-")
        cls.cornell = os.path.join(program.ASSETS, "cornell.glb")
        cls.folder = os.path.join(cls.files, "dir")
        for name in ("dir", "folder.png"):
            os.mkdir(os.path.join(cls.files, name))
        with open(cls.cornell, "rb") as f:
            contents = {**FILES, "truncated.glb": f.read()[:2000]}
        one = os.path.join(cls.files, "one.exr")
        made = run(["render", cls.cornell, "-o", one, "--size", "8x8", "--spp", "1", "--device", "none",
                    "--denoise", "off", "--aov", "variance,sampleCount"], cls.files)
        assert made.returncode == 0, made.stderr
        with open(one, "rb") as f:
            contents["cut.exr"] = f.read()[:300]
        for name, data in contents.items():
            with open(os.path.join(cls.files, name), "wb") as f:
                f.write(data)
        cls.before = cls.listing()

    @classmethod
    def tearDownClass(cls):
        shutil.rmtree(cls.files)

    @classmethod
    def listing(cls):
        return sorted(os.path.join(at, name) for at, folders, names in os.walk(cls.files) for name in folders + names)

    def fill(self, word):
        places = {"cornell": self.cornell, "dir": self.folder, "png": os.path.join(self.folder, "a.png"),
                  "exr": os.path.join(self.folder, "a.exr")}
        for name in os.listdir(self.files):
            places.setdefault(name, os.path.join(self.files, name))
        for name, path in places.items():
            word = word.replace("{" + name + "}", path)
        return word

    def test_every_row(self):
        known = run(["--help"], self.files).stdout
        rows = [[part.strip() for part in line.split("|")] for line in ROWS.strip().splitlines()]
        tested = 0
        for code, says, arguments in rows:
            words = [self.fill(word) for word in shlex.split(arguments)]  # no shell: & and ? are letters
            command = words[0] if words else ""
            if command in ("info", "bake") and f"\n  {command} " not in known:
                self.assertNotIn(command, COMMANDS)
                continue
            tested += 1
            with self.subTest(arguments=arguments):
                result = run(words, self.folder)
                errors = [line for line in result.stderr.splitlines() if "error:" in line and line.startswith("trex")]
                self.assertEqual(result.returncode, int(code), result.stderr)
                self.assertEqual(len(errors), 1, result.stderr)
                self.assertIn(says, errors[0])
                self.assertEqual(result.stdout, "")
                self.assertEqual(self.listing(), self.before)
        self.assertGreaterEqual(tested, 70)

    def test_quiet_still_says_the_error(self):
        result = run(["render", "missing.glb", "-o", "a.png", "-q"], self.folder)
        self.assertEqual((result.returncode, len(result.stderr.splitlines())), (3, 1), result.stderr)

    def test_auto_without_a_driver_renders_on_the_cpu(self):
        """One warning a process; a number is an error as ever; the picture is that of --device none."""
        job = ["render", self.cornell, "--size", "16x16", "--spp", "1"]
        nowhere = {"VK_ICD_FILENAMES": "/nonexistent", "VK_DRIVER_FILES": "/nonexistent", "TREX_VALIDATION": ""}
        with tempfile.TemporaryDirectory() as out:
            auto, none = os.path.join(out, "auto.exr"), os.path.join(out, "none.exr")
            result = run([*job, "-o", os.path.join(out, "two.png"), "--camera", "0,1,5/0,1,0/0,1,0/40", "--camera",
                          "0,1,4/0,1,0/0,1,0/40"], self.files, **nowhere)
            self.assertEqual(result.returncode, 0, result.stderr)
            self.assertEqual(result.stderr.count("warning"), 1, result.stderr)
            self.assertIn("mesa-vulkan-drivers", result.stderr)
            self.assertIn("C++ tracer", result.stderr)
            self.assertEqual(run([*job, "-o", auto], self.files, **nowhere).returncode, 0)
            self.assertEqual(run([*job, "-o", none, "--device", "none"], self.files).returncode, 0)
            self.assertEqual(run(["diff", auto, none], self.files).returncode, 0)
        result = run([*job, "-o", "a.png", "--device", "0"], self.folder, **nowhere)
        self.assertEqual(result.returncode, 4, result.stderr)

    def test_streams(self):
        """Results that a full disk does not take are an error; a reader that has gone, or a closed stream, is none."""
        picture = os.path.join(self.files, "streams.exr")
        render = ["render", self.cornell, "-o", picture, "--size", "8x8", "--spp", "1", "--device", "none"]

        def ends(words, stdout):
            with subprocess.Popen([program.TREX, *words], stdout=stdout, stderr=subprocess.PIPE, text=True) as p:
                said = p.stderr.read()
            return p.returncode, said
        for words in (["info", self.cornell], ["info", self.cornell, "--json"], ["diff", "one.exr", "one.exr"], render):
            words = [os.path.join(self.files, word) if word == "one.exr" else word for word in words]
            with self.subTest(words=words), open("/dev/full", "w") as full:
                code, said = ends(words, full)
                self.assertEqual(code, 5, said)
                self.assertIn("stdout: can't be written", said)
                reader, writer = os.pipe()
                os.close(reader)
                self.assertEqual(ends(words, writer)[0], 0)
                os.close(writer)
                closed = subprocess.run(["sh", "-c", '"$0" "$@" <&- >&- 2>&-', program.TREX, *words])
                self.assertEqual(closed.returncode, 0)
        # Nothing that was said without streams went into the picture.
        self.assertEqual(run(["diff", picture, picture], self.files).returncode, 0)
        os.remove(picture)

    def test_difference_is_six(self):
        white = os.path.join(self.files, "white.exr")
        run(["render", self.cornell, "-o", white, "--size", "8x8", "--spp", "1", "--device", "none", "--env", "9,9,9"],
            self.files)
        try:
            same = run(["diff", "one.exr", "one.exr", "--max", "0"], self.files)
            self.assertEqual((same.returncode, same.stderr), (0, ""))
            other = run(["diff", "one.exr", "white.exr", "--max", "0"], self.files)
            self.assertEqual(other.returncode, 6)
            self.assertIn("flip", other.stdout)
        finally:
            os.remove(white)


class Start(unittest.TestCase):
    """OpenImageIO and its 250 libraries are loaded when a picture needs them."""

    def test_nothing_waits_for_the_image_library(self):
        environment = dict(os.environ, LD_TRACE_LOADED_OBJECTS="1")
        loaded = subprocess.run([program.TREX], env=environment, capture_output=True, text=True).stdout
        self.assertIn("libembree", loaded)
        self.assertNotIn("OpenImageIO", loaded)

    def test_a_missing_image_library_is_named_before_anything_is_rendered(self):
        with tempfile.TemporaryDirectory() as folder:
            alone = shutil.copy(program.TREX, folder)
            version = subprocess.run([alone, "--version"], capture_output=True)
            self.assertEqual(version.returncode, 0)
            result = subprocess.run(
                [alone, "render", os.path.join(program.ASSETS, "cornell.glb"), "-o", os.path.join(folder, "a.exr"),
                 "--time", "1000", "--exact", "1"], capture_output=True, text=True, timeout=60)
            self.assertEqual(result.returncode, 4, result.stderr)
            self.assertIn("OpenImageIO can't be used", result.stderr)
            self.assertEqual(os.listdir(folder), [os.path.basename(program.TREX)])
            # A .png is written without it.
            subprocess.run([alone, "render", os.path.join(program.ASSETS, "cornell.glb"), "-o", os.path.join(folder, "a.png"),
                            "--spp", "1", "--size", "8x8", "--exact", "1"], check=True, capture_output=True)


class Doctor(unittest.TestCase):
    def doctor(self, *arguments, **environment):
        return run(["doctor", *arguments], None, **environment)

    def test_says_everything(self):
        result = self.doctor("--json", DISPLAY=":7")
        found = json.loads(result.stdout)
        self.assertTrue(found["can_render"])
        self.assertEqual(found["problem"], "")
        self.assertEqual(found["display"], "DISPLAY=:7")
        self.assertGreater(found["threads"], 0)
        self.assertGreater(found["available_memory_bytes"], 1 << 28)
        self.assertLessEqual(found["available_memory_bytes"], found["physical_memory_bytes"])
        names = [library["name"] for library in found["libraries"]]
        for name in ("Embree", "OpenImageIO", "oneTBB", "GLM", "fmt", "Vulkan loader"):
            self.assertIn(name, names)
        device = found["devices"][found["default_device"]]
        for key in ("heap_bytes", "max_allocation_bytes", "max_storage_buffer_range_bytes", "subgroup_size",
                    "max_texel_buffer_elements", "max_workgroup_invocations", "shared_memory_bytes"):
            self.assertGreater(device[key], 0, key)
        self.assertTrue(found["simd_target"])

    def test_without_a_device_the_rest_works(self):
        for environment in ({"VK_ICD_FILENAMES": "/nonexistent"}, {"VK_LOADER_DRIVERS_SELECT": "none",
                                                                   "VK_DRIVER_FILES": "/nonexistent"}):
            result = self.doctor(**environment)
            self.assertEqual(result.returncode, 0, result.stderr)
            self.assertIn("mesa-vulkan-drivers", result.stdout)
            self.assertIn("--device auto is --device none", result.stdout)
            self.assertIn("--exact 1 work", result.stdout)
            found = json.loads(self.doctor("--json", **environment).stdout)
            self.assertTrue(found["can_render"])
            self.assertEqual((found["devices"], found["default_device"]), ([], None))
            self.assertIn(found["problem"], found["problems"])

    def test_measures_and_keeps_it(self):
        with tempfile.TemporaryDirectory() as folder:
            picture, record = os.path.join(folder, "graph.svg"), os.path.join(folder, "trex", "machine.json")
            result = self.doctor("--measure", "--json", "-o", picture, XDG_STATE_HOME=folder)
            self.assertEqual(result.returncode, 0, result.stderr)
            measured = json.loads(result.stdout)["measured"]
            with open(record) as f:
                self.assertEqual(json.load(f), measured)
            self.assertEqual(os.listdir(os.path.join(folder, "trex")), ["machine.json"])
            self.assertEqual([m["name"] for m in measured["memories"][:2]], ["disk", "main"])
            self.assertEqual(set(measured["devices"][0]["times"]), {"rays", "cones", "photons"})
            for channel in measured["channels"]:
                self.assertGreater(channel["bandwidth_bytes_per_second"], 1e5)
            for device in measured["devices"]:
                for time in device["times"].values():
                    self.assertGreater(time["seconds_per_unit"], 0)
            with open(picture) as f:
                self.assertIn("</svg>", f.read())
            text = self.doctor(XDG_STATE_HOME=folder).stdout
            self.assertIn("measured: ", text)
            self.assertIn("rays: ", text)
            for hostile in ("", "{", "[]", '{"trex": 1}', "x" * (2 << 20)):
                with open(record, "w") as f:
                    f.write(hostile)
                result = self.doctor("--json", XDG_STATE_HOME=folder)
                self.assertEqual(result.returncode, 0, result.stderr)
                found = json.loads(result.stdout)
                self.assertIsNone(found["measured"])
                self.assertTrue(any("machine.json" in p for p in found["problems"]), found["problems"])
            # A render that would ask it goes on without; others do not look.
            job = [program.TREX, "render", os.path.join(program.ASSETS, "cornell.glb"), "-o", os.path.join(folder, "a.exr"), "--size", "8x8", "--spp", "1"]
            for options, says in (([], True), (["--guess", "ray"], False), (["--device", "none"], False), (["--exact", "1"], False)):
                result = subprocess.run([*job, *options], capture_output=True, text=True, timeout=600,
                                        env={**os.environ, "XDG_STATE_HOME": folder})
                self.assertEqual(result.returncode, 0, result.stderr)
                self.assertEqual("machine.json" in result.stderr, says, (options, result.stderr))
        self.assertEqual(self.doctor("-o", "x.svg").returncode, 2)
        self.assertEqual(self.doctor("--measure", XDG_STATE_HOME="/proc/nothing").returncode, 5)

    def test_a_broken_loader_is_named(self):
        with tempfile.TemporaryDirectory() as folder:
            open(os.path.join(folder, "libvulkan.so.1"), "w").close()
            result = self.doctor(LD_LIBRARY_PATH=folder)
        self.assertEqual(result.returncode, 0, result.stderr)
        self.assertIn("install libvulkan1", result.stdout)

    def test_unusable_folder_is_a_problem(self):
        result = self.doctor(TMPDIR="/nonexistent")
        self.assertEqual(result.returncode, 0, result.stderr)
        self.assertRegex(result.stdout, "problem: /nonexistent .*TMPDIR")

    def test_no_memory_is_exit_code_4(self):
        # Enough to start, not enough to render.
        script = 'ulimit -v $(($1 * 1024)); shift; exec "$@"'
        for megabytes in (500, 550, 600, 650, 700):
            result = subprocess.run(["bash", "-c", script, "-", str(megabytes), program.TREX, "doctor"], capture_output=True,
                                    text=True, env={**os.environ, "VK_ICD_FILENAMES": "/nonexistent"})
            if result.returncode == 4 and "problem: only" in result.stdout:
                self.assertIn("ulimit", result.stderr)
                self.assertEqual(len(result.stderr.splitlines()), 1, result.stderr)
                return
        self.skipTest("the program does not start in little memory here")


if __name__ == "__main__":
    program.main()
