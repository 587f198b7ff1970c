#!/usr/bin/env python3
"""`trex bench asvo` and `trex export-vdb` on a tiny scene: keys, grids, wrong uses."""
import json, os

import program
from program import ProgramTest, run


class AsvoCommandTest(ProgramTest):
    def test_bench_has_its_keys(self):
        path = self.path("bench.json")
        result = run("bench", "asvo", self.cornell, "--depth", 5, "--cones", 2000, "--repeats", 1, "--device", "none",
                     "--json", path)
        self.assertEqual(result.returncode, 0, result.stderr)
        self.assertIn("cones depth_5", result.stdout)
        with open(path) as file:
            document = json.load(file)
        self.assertGreater(document["voxels"], 1000)
        self.assertGreater(document["bytes_per_voxel"], 40)
        self.assertLessEqual(document["sizes"]["leaf_geometry_bytes"], 20)
        self.assertLessEqual(document["sizes"]["leaf_material_and_light_bytes"], 28)
        self.assertGreater(document["build_triangles_per_second"], 0)
        self.assertGreater(document["cones_per_second"]["depth_5"]["0.3"], 0)
        self.assertGreater(document["embree_rays_per_second"], 0)
        self.assertEqual(set(document["leak_percent"]), {"0.5", "1", "2", "4"})
        self.assertEqual(set(document["furnace_error_percent"]), {"0.5", "0.9"})
        self.assertLess(document["leak_percent"]["1"], 0.5)

    def test_wrong_uses_of_bench(self):
        self.assertEqual(run("bench", "asvo").returncode, 2)
        self.assertEqual(run("bench", "asvo", self.path("none.glb")).returncode, 3)

    def test_export_writes_four_grids(self):
        path = self.path("cornell.vdb")
        result = run("export-vdb", self.cornell, "-o", path, "--photons", 2000, "--voxel-depth", 5)
        self.assertEqual(result.returncode, 0, result.stderr)
        self.assertEqual(result.stdout.strip(), path)
        with open(path, "rb") as file:
            data = file.read()
        self.assertEqual(data[:4], b" BDV")  # OpenVDB's magic number
        for name in (b"coverage", b"albedo", b"normal", b"radiance"):
            self.assertIn(name, data)

    def test_wrong_uses_of_export(self):
        self.assertEqual(run("export-vdb", self.cornell, "-o", self.path("x.exr")).returncode, 2)
        self.assertEqual(run("export-vdb", "none.glb", "-o", self.path("x.vdb")).returncode, 3)
        self.assertFalse(os.path.exists(self.path("x.vdb")))


if __name__ == "__main__":
    program.main()
