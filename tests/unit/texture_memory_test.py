#!/usr/bin/env python3
"""Tests of --texture-memory: the same picture within the limit, from models and from bundles, and what goes wrong with files."""
import json, os, struct, time

import program, textured_room

MIB = 1 << 20
LIMIT = 2 * MIB


class TextureMemory(program.ProgramTest):
    def setUp(self):
        super().setUp()
        self.model = textured_room.write_room(self.folder)  # 4.5 MiB of texels

    def render(self, picture, *options, model=None, spp="2", code=0):
        p = program.run("render", model or self.model, "-o", self.path(picture), "--size", "64x48", "--spp", spp,
                        "--device", "none", "--denoise", "off", "--camera", textured_room.CAMERA, "--json",
                        *(options if "--exact" in options else ("--exact", "1", *options)))
        self.assertEqual(p.returncode, code, p.stdout + p.stderr)
        return json.loads(p.stdout) if code == 0 else p.stderr

    def bytes_of(self, name):
        with open(self.path(name), "rb") as f:
            return f.read()

    def test_the_picture_is_the_same_within_any_limit(self):
        for number, options in enumerate([("--exact", "1"), ("--exact", "0"), ("--exact", "0.5", "--threads", "1")]):
            whole = self.render("whole.exr", *options)
            self.assertEqual(whole["texture_bytes"], 6 * 512 * 512 * 3)
            self.assertEqual(whole["texture_peak_bytes"], whole["texture_bytes"])
            self.assertNotIn("texture_loads", whole)
            for limit in (LIMIT, 4 * MIB):
                tiles = self.render("tiles.exr", *options, "--texture-memory", str(limit))
                self.assertEqual(self.bytes_of("tiles.exr"), self.bytes_of("whole.exr"), (number, limit))
                self.assertEqual(tiles["paged_images"], 6)
                self.assertLessEqual(tiles["texture_peak_bytes"], limit)
                self.assertGreater(tiles["texture_loads"], 0)
                self.assertGreater(tiles["texture_bytes_read"], 0)
            self.assertGreater(self.render("tiles.exr", *options, "--texture-memory", str(LIMIT))["texture_evictions"], 0)
        fits = self.render("tiles.exr", "--texture-memory", "5M")
        self.assertEqual(fits["texture_peak_bytes"], fits["texture_bytes"])
        self.assertNotIn("texture_loads", fits)

    def test_half_of_the_memory_is_theirs(self):
        textured_room.write_room(self.folder, 12, 2048)  # 144 MiB
        self.render("whole.exr", spp="1")
        tiles = self.render("tiles.exr", "--max-memory", "220M", spp="1")
        self.assertEqual(self.bytes_of("tiles.exr"), self.bytes_of("whole.exr"))
        self.assertEqual(tiles["paged_images"], 12)
        self.assertLessEqual(tiles["texture_peak_bytes"], 46 * MIB)
        self.assertLess(tiles["peak_resident_bytes"], 220 * MIB)
        said = self.trex("render", self.model, "-o", self.path("x.png"), "--size", "8x8", "--spp", "1", "--exact", "1", "-v",
                         "--max-memory", "220M")
        self.assertIn("144.0 MiB of textures, at most 46.0 MiB at a time", said)

    def test_bundles_are_read_in_tiles(self):
        said = json.loads(program.run("bake", self.model, "-o", self.path("room.trex"), "--depth", "4", "--json").stdout)
        self.assertLess(said["texture_bytes"], 6 * 512 * 512 * 3)
        bundle = self.path("room.trex")
        self.render("whole.exr", model=bundle)
        tiles = self.render("tiles.exr", "--texture-memory", str(LIMIT), model=bundle)
        self.assertEqual(self.bytes_of("tiles.exr"), self.bytes_of("whole.exr"))
        self.assertLessEqual(tiles["texture_peak_bytes"], LIMIT)
        # One that was baked with little memory is the same file.
        textured_room.write_room(self.folder, 12, 2048)
        for name, limit in (("all.trex", "2G"), ("few.trex", "260M")):
            self.trex("bake", self.model, "-o", self.path(name), "--depth", "4", "--max-memory", limit)
        self.assertEqual(self.bytes_of("few.trex"), self.bytes_of("all.trex"))

    def image_section(self, bundle, name=b"image-5.tiles"):
        """Where a section of a bundle begins and ends, by its directory."""
        data = self.bytes_of(bundle)
        directory, = struct.unpack_from("<Q", data, 24)
        at = data.index(name + b"\0", directory)
        return struct.unpack_from("<QQ", data, at + 48)

    def test_damaged_bundles_are_refused(self):
        self.trex("bake", self.model, "-o", self.path("room.trex"), "--depth", "4")
        offset, length = self.image_section("room.trex")
        for where, what in ((10, "table"), (length // 2, "tile")):
            data = bytearray(self.bytes_of("room.trex"))
            data[offset + where] ^= 4
            self.write("bad.trex", bytes(data))
            for limit in ((), ("--texture-memory", str(LIMIT))):
                said = self.render("x.exr", *limit, model=self.path("bad.trex"), spp="64", code=3)
                self.assertIn("bad.trex", said)
                self.assertIn("damaged; bake again", said)
            self.assertIn("damaged", self.trex("info", "--verify", self.path("bad.trex"), code=3))

    def test_files_that_change_while_they_are_rendered(self):
        self.trex("bake", self.model, "-o", self.path("room.trex"), "--depth", "4", "--no-voxels")
        self.render("whole.exr", spp="40")
        offset, length = self.image_section("room.trex", b"image-0.tiles")

        def start(model, *options):
            p = program.start("render", model, "-o", self.path("x.exr"), "--size", "64x48", "--exact", "1", "--device", "none",
                              "--denoise", "off", "--camera", textured_room.CAMERA, "--texture-memory", str(LIMIT), *options,
                              stdout=-1, stderr=-1, text=True)
            time.sleep(1.5)
            return p

        # What has been read of a model's images lies in a file of the program's own.
        p = start(self.model, "--time", "4")
        for i in range(6):
            os.remove(self.path(f"wall{i}.png"))
        said = p.communicate(timeout=100)[1]
        self.assertEqual(p.returncode, 0, said)
        # A bundle that is removed stays as long as it is open; one that is cut off says so.
        p = start(self.path("room.trex"), "--time", "4")
        os.rename(self.path("room.trex"), self.path("moved.trex"))
        said = p.communicate(timeout=100)[1]
        self.assertEqual(p.returncode, 0, said)
        p = start(self.path("moved.trex"), "--time", "100")
        os.truncate(self.path("moved.trex"), offset + length // 2)
        said = p.communicate(timeout=100)[1]
        self.assertEqual(p.returncode, 3, said)
        self.assertIn("moved.trex, byte", said)
        self.assertIn("cut off since it was opened", said)

    def test_images_that_are_missing_or_broken_are_left_out_within_a_limit_too(self):
        os.remove(self.path("wall0.png"))
        self.write("wall1.png", self.bytes_of("wall1.png")[:500])
        said = self.trex("render", self.model, "-o", self.path("x.png"), "--size", "8x8", "--spp", "1", "--texture-memory", str(LIMIT))
        self.assertIn("wall0.png", said)
        self.assertIn("wall1.png", said)
        self.trex("render", self.model, "-o", self.path("x.png"), "--size", "8x8", "--spp", "1", "--texture-memory", str(LIMIT),
                  "--strict", code=3)

    def test_limits_that_are_none_or_too_small(self):
        for wrong in ("0", "-1", "3X", "much", "nan", "1e99"):
            said = self.trex("render", self.model, "-o", self.path("x.png"), f"--texture-memory={wrong}", code=2)
            self.assertIn("512M", said)
        said = self.trex("render", self.model, "-o", self.path("x.png"), "--texture-memory", "100K", code=4)
        self.assertIn("--texture-memory", said)
        self.assertFalse(os.path.exists(self.path("x.png")))
        # A picture that says of itself that it is huge.
        data = bytearray(self.bytes_of("wall0.png"))
        data[16:24] = struct.pack(">2I", 16384, 16384)
        data[29:33] = struct.pack(">I", __import__("zlib").crc32(bytes(data[12:29])))
        self.write("wall0.png", bytes(data))
        said = self.trex("render", self.model, "-o", self.path("x.png"), "--max-memory", "500M", code=4)
        self.assertIn("wall0.png", said)
        self.assertIn("768.0 MiB", said)


if __name__ == "__main__":
    program.main()
