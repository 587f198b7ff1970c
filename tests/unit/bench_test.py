#!/usr/bin/env python3
"""`trex bench`: documents' keys, the page and the charts of tradeoff, wrong uses."""
import html.parser, json, os, shutil, subprocess, sys, tempfile, unittest
import xml.etree.ElementTree

from exr_file import exr_bytes
import program
from program import run

SVG = "{http://www.w3.org/2000/svg}"
VOID = {"meta", "img", "br"}


class Page(html.parser.HTMLParser):
    """Checks that tags nest, and counts them."""

    def __init__(self, text):
        super().__init__()
        self.open, self.counts, self.sources = [], {}, []
        self.feed(text)
        self.close()
        if self.open:
            raise ValueError(f"not closed: {self.open}")

    def handle_starttag(self, tag, attributes):
        self.counts[tag] = self.counts.get(tag, 0) + 1
        self.sources += [value for name, value in attributes if name in ("src", "href")]
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attributes):
        self.counts[tag] = self.counts.get(tag, 0) + 1

    def handle_endtag(self, tag):
        if not self.open or self.open.pop() != tag:
            raise ValueError(f"</{tag}> does not close what is open")


class BenchTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.mkdtemp(prefix="trex-bench-")
        cls.cornell = os.path.join(program.ASSETS, "cornell.glb")
        cls.report = os.path.join(cls.folder, "report.json")
        cls.result = run("bench", "tradeoff", cls.cornell, "--size", "32x32", "--seconds", 1, "--exact", "0,0.25,1",
                         "--reference-seconds", 1, "--device", "none", "--json", cls.report,
                         "--html", os.path.join(cls.folder, "report.html"), "--svg", os.path.join(cls.folder, "svg"))

    @classmethod
    def tearDownClass(cls):
        shutil.rmtree(cls.folder)

    def document(self):
        self.assertEqual(self.result.returncode, 0, self.result.stderr)
        with open(self.report) as f:
            return json.load(f)

    def check_page(self, path, pictures):
        with open(path) as f:
            page = Page(f.read())
        self.assertEqual(page.counts["img"], pictures)
        self.assertEqual(page.counts["svg"], 2)
        self.assertNotIn("script", page.counts)
        for source in page.sources:
            self.assertTrue(source.startswith("data:image/png;base64,iVBORw0KGgo"), source[:60])

    def check_chart(self, path, curves):
        root = xml.etree.ElementTree.parse(path).getroot()
        self.assertEqual(root.tag, SVG + "svg")
        lines = root.findall(SVG + "polyline")
        self.assertEqual(len(lines), curves)
        for line in lines:
            for point in line.get("points").split():
                x, y = map(float, point.split(","))
                self.assertTrue(70 <= x <= 500 and 70 <= y <= 350, point)

    def test_document(self):
        d = self.document()
        self.assertEqual(d["bench"], "tradeoff")
        self.assertTrue(d["machine"]["cpu"])
        self.assertEqual((d["settings"]["width"], d["settings"]["exact"]), (32, [0, 0.25, 1]))
        scene, = d["scenes"]
        self.assertEqual(scene["name"], "cornell")
        for key in ("import_seconds", "mesh_build_seconds", "voxel_build_seconds"):
            self.assertGreaterEqual(scene["setup"][key], 0)
        self.assertGreater(scene["reference"]["samples"], 0)
        self.assertEqual([r["exact"] for r in scene["runs"]], [0, 0.25, 1])
        for r in scene["runs"]:
            times = [p["seconds"] for p in r["points"]]
            self.assertEqual(times, sorted(set(times)))
            self.assertGreaterEqual(times[-1], 0.9)
            self.assertLessEqual(len(times), 5)  # from 0.0625 s on, twice as long each time
            for p in r["points"]:
                self.assertGreater(p["samples"], 0)
                self.assertGreater(p["relmse"], 0)
                self.assertTrue(0 < p["flip"] < 1)
                self.assertAlmostEqual(p["mean_ratio"], 1, delta=0.3)
            for key in ("c_rays", "shadow_rays", "g_rays", "cache_reads", "exact_paths"):
                self.assertIn(key, r["rays"])
            shares = [v for k, v in r["rays"].items() if k.endswith("_share")]
            self.assertAlmostEqual(sum(shares), 1, places=9)
        guess, mixed, exact = scene["runs"]
        self.assertIsNone(guess["slope"])
        self.assertGreater(guess["points"][-1]["filter_seconds"], 0)
        self.assertEqual(exact["points"][-1]["filter_seconds"], 0)
        self.assertEqual((exact["photons"], exact["rays"]["cache_reads"]), (0, 0))
        self.assertGreater(mixed["photons"], 0)

    def test_bounces(self):
        result = run("bench", "tradeoff", self.cornell, "--size", "16x16", "--seconds", 0.1, "--exact", "1", "--max-bounces", 0,
                     "--device", "none", "--json", "-")
        self.assertEqual(result.returncode, 0, result.stderr)
        scene, = json.loads(result.stdout)["scenes"]
        self.assertEqual(scene["max_bounces"], 0)
        self.assertEqual(scene["runs"][0]["rays"]["shadow_rays"], 0)
        whole = self.document()["scenes"][0]
        self.assertIsNone(whole["max_bounces"])
        self.assertGreater(whole["runs"][2]["rays"]["shadow_rays"], 0)

    def test_table_of_seeds(self):
        """Medians of three reports, of which one is twice as wrong everywhere."""
        d = self.document()
        point = dict(d["scenes"][0]["runs"][2]["points"][-1])
        d["scenes"][0]["peers"] = [{"renderer": "peer", "start_seconds": 1.5, "points": [point, {**point, "seconds": 9.0, "flip": 1e-6}]}]
        paths = []
        for factor in (1.0, 2.0, 1.0):
            for r in d["scenes"][0]["runs"]:
                for p in r["points"]:
                    p["flip"] *= factor
            paths.append(os.path.join(self.folder, f"seed{len(paths)}.json"))
            with open(paths[-1], "w") as f:
                json.dump(d, f)
            for r in d["scenes"][0]["runs"]:
                for p in r["points"]:
                    p["flip"] /= factor
        tool = os.path.join(os.path.dirname(program.ASSETS), "tests/bench/tradeoff_table.py")
        at = "0.5"
        one, three = (subprocess.run([sys.executable, tool, *p, "--at", at], capture_output=True, text=True, check=True).stdout
                      for p in (paths[:1], paths))
        first, all_seeds = (next(line for line in text.splitlines() if line.startswith("| cornell | exact 0 |"))
                            for text in (one, three))
        value = first.split("|")[3].strip()
        self.assertTrue(all_seeds.split("|")[3].strip().startswith(value + " (" + value + " to "), all_seeds)
        self.assertIn("seconds to FLIP 0.1", three)

    def test_page_and_charts(self):
        self.document()
        self.check_page(os.path.join(self.folder, "report.html"), 8)
        for metric in ("relmse", "flip"):
            self.check_chart(os.path.join(self.folder, "svg", f"cornell-{metric}.svg"), 3)

    def test_draws_a_report_again_with_peers(self):
        d = self.document()
        point = dict(d["scenes"][0]["runs"][2]["points"][-1])
        d["scenes"][0]["peers"] = [{"renderer": "another <renderer>", "start_seconds": 1.5,
                                    "points": [point, {**point, "seconds": point["seconds"] * 2}]}]
        path = os.path.join(self.folder, "peers.json")
        with open(path, "w") as f:
            json.dump(d, f)
        page, charts = os.path.join(self.folder, "peers.html"), os.path.join(self.folder, "peers")
        result = run("bench", "tradeoff", "--from", path, "--html", page, "--svg", charts)
        self.assertEqual(result.returncode, 0, result.stderr)
        self.check_page(page, 8)
        self.check_chart(os.path.join(charts, "cornell-relmse.svg"), 4)

    def test_hccmesh(self):
        path = os.path.join(self.folder, "hccmesh.json")
        result = run("bench", "hccmesh", self.cornell, "--rays", 4096, "--runs", 1, "--json", path)
        self.assertEqual(result.returncode, 0, result.stderr)
        self.assertIn("Embree compact", result.stdout)
        with open(path) as f:
            d = json.load(f)
        self.assertEqual((d["bench"], d["input"]), ("hccmesh", self.cornell))
        self.assertGreater(d["triangles"], 0)
        parts = d["bytes_per_triangle_by_part"]
        self.assertAlmostEqual(sum(parts.values()), d["bytes_per_triangle"], places=6)
        self.assertGreater(d["disk_bytes_per_triangle"], 0)
        self.assertGreater(d["embree_bytes_per_triangle"], 0)
        self.assertGreater(d["embree_compact_bytes_per_triangle"], 0)
        for kind in ("coherent", "diffuse", "shadow"):
            self.assertEqual(set(d["rays_per_second"][kind]), {"hccmesh", "embree", "embree_compact"})
            self.assertTrue(all(v > 0 for v in d["rays_per_second"][kind].values()))
            self.assertGreater(d["rays"][kind], 0)
        for name in ("embree", "embree_compact"):  # the same rays hit, but for rounding at edges
            self.assertLess(d["different_hits"]["coherent"][name], 8)
        alone = run("bench", "hccmesh", self.cornell, "--rays", 1024, "--runs", 1, "--no-embree", "--json", "-")
        self.assertEqual(alone.returncode, 0, alone.stderr)
        self.assertNotIn("embree_bytes_per_triangle", json.loads(alone.stdout))
        coarse = run("bench", "hccmesh", self.cornell, "--precision", 25)
        self.assertEqual(coarse.returncode, 2)
        self.assertEqual(run("bench", "hccmesh", os.path.join(self.folder, "none.glb")).returncode, 3)

    def test_schedule(self):
        path, picture, trace = (os.path.join(self.folder, name) for name in ("s.json", "s.svg", "s.trace.json"))
        result = run("bench", "schedule", "--machines", "R,AR", "--model", "particles", "--seeds", 2, "--json", path,
                     "-o", picture, "--trace", trace)
        self.assertEqual(result.returncode, 0, result.stderr)
        self.assertIn("of LoadAnyOnce", result.stdout)
        with open(path) as f:
            d = json.load(f)
        self.assertEqual((d["bench"], [row["machines"] for row in d["rows"]]), ("schedule", ["R", "AR"]))
        rivals = {"earliest start", "earliest finish", "round robin", "LoadAnyOnce", "dmda"}
        self.assertEqual(set(d["geometric_mean"]), rivals | {"bound"})
        for row in d["rows"]:
            self.assertGreaterEqual(row["of_bound"], 1)
            self.assertEqual(set(row["of"]), rivals)
            self.assertTrue(all(row["worst_of"][name] >= row["of"][name] > 0 for name in rivals))
        again = run("bench", "schedule", "--machines", "R", "--model", "particles", "--seeds", 2, "--json", "-")
        row = json.loads(again.stdout)["rows"][0]
        self.assertEqual({k: v for k, v in row.items() if k != "plan_core_share"},
                         {k: v for k, v in d["rows"][0].items() if k != "plan_core_share"})
        texts = [t.text for t in xml.etree.ElementTree.parse(picture).iter(SVG + "text")]
        for name in ("R CPU", "R GTX 980", "R SATA", "R PCIe"):
            self.assertIn(name, texts)
        with open(trace) as f:
            events = json.load(f)["traceEvents"]
        self.assertEqual({e["ph"] for e in events}, {"M", "X"})
        self.assertTrue(all(e["dur"] >= 0 for e in events if e["ph"] == "X"))
        for arguments in (["--machines", "Z"], ["--machines", ""], ["--model", "teapot"], ["--seeds", 0]):
            self.assertEqual(run("bench", "schedule", *arguments).returncode, 2, arguments)
        self.assertEqual(run("bench", "schedule", "--seeds", 1, "-o", "/no/such/folder/x.svg").returncode, 5)

    def test_baselines(self):
        path = os.path.join(self.folder, "baselines.json")
        result = run("bench", "baselines", self.cornell, "--size", "32x32", "--seconds", 1, "--photons", 100000,
                     "--device", "none", "--json", path)
        self.assertEqual(result.returncode, 0, result.stderr)
        with open(path) as f:
            document = json.load(f)
        photons, cpu = document["runs"]
        self.assertEqual([photons["name"], cpu["name"]], ["photons", "cpu"])
        self.assertGreater(photons["photons_stored"], 50000)
        # Density estimation darkens edges by some percent; a wrong area or power would be far off.
        self.assertAlmostEqual(photons["points"][-1]["mean_ratio"], 1.0, delta=0.05)
        self.assertAlmostEqual(cpu["points"][-1]["mean_ratio"], 1.0, delta=0.02)
        last = [run["points"][-1]["relmse"] for run in document["runs"]]
        self.assertEqual(document["common_relmse"], max(last))
        # Each got there by its last point and no earlier than at its first.
        ratio = document["ratios"]["photons_over_cpu"]
        first, last = ([run["points"][i]["seconds"] for run in document["runs"]] for i in (0, -1))
        self.assertGreaterEqual(ratio, 0.999 * first[0] / last[1])
        self.assertLessEqual(ratio, 1.001 * last[0] / first[1])
        self.assertNotIn("cpu_over_device", document["ratios"])
        self.assertIn("photon mapping over ours", result.stdout)

    def test_baselines_of_a_dark_scene(self):
        dark, path = os.path.join(self.folder, "dark.obj"), os.path.join(self.folder, "dark.json")
        with open(dark, "w") as f:
            f.write("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
        result = run("bench", "baselines", dark, "--env", "0,0,0", "--size", "16x16", "--seconds", 0.1, "--photons", 1,
                     "--device", "none", "--json", path)
        self.assertEqual(result.returncode, 0, result.stderr)
        self.assertNotIn("nan", result.stdout)
        with open(path) as f:
            for run_ in json.load(f)["runs"]:
                self.assertEqual((run_["points"][-1]["relmse"], run_["points"][-1]["mean_ratio"]), (0.0, 1.0))

    def test_wrong_baselines(self):
        for code, arguments, says in (
                (2, [], "MODEL"), (2, [self.cornell, "--nearest", "0"], "nearest"),
                (2, [self.cornell, "--photons", "0"], "photons"), (2, [self.cornell, "--size", "1"], "WxH"),
                (2, [self.cornell, "--env", "1,2"], "env"), (2, [self.cornell, "--exact", "nan"], "nan"),
                (2, [self.cornell, "--seconds", "nan"], "seconds"),
                (3, [os.path.join(self.folder, "none.glb")], "none.glb"),
                (3, [self.cornell, "--reference", "none.exr"], "none.exr"),
                (5, [self.cornell, "--json", os.path.join(self.folder, "no/a.json")], "no folder")):
            with self.subTest(arguments=arguments):
                result = run("bench", "baselines", *arguments)
                self.assertEqual(result.returncode, code, result.stderr)
                self.assertIn(says, result.stderr)
                self.assertEqual(result.stderr.count("error:"), 1, result.stderr)

    def test_wrong_uses(self):
        reference = os.path.join(self.folder, "reference.exr")
        with open(reference, "wb") as f:
            f.write(exr_bytes(4, 4, {c: [0.5] * 16 for c in "RGB"}))
        broken, empty = os.path.join(self.folder, "broken.json"), os.path.join(self.folder, "empty.json")
        for path, text in ((broken, "{"), (empty, '{"bench": "tradeoff"}')):
            with open(path, "w") as f:
                f.write(text)
        page = os.path.join(self.folder, "no.html")
        for code, arguments, says in (
                (2, [], "SCENE"), (2, [self.cornell, "--exact", "0,2"], "2"),
                (2, [self.cornell, "--exact", "nan"], "nan"), (2, [self.cornell, "--seconds", "0"], "seconds"),
                (2, [self.cornell, "--seconds", "nan"], "seconds"), (2, [self.cornell, "--size", "1"], "WxH"),
                (2, [self.cornell, "--device", "gpu"], "gpu"), (2, [self.cornell, "--env", "attic=1,1,1"], "attic"),
                (2, [self.cornell, "--reference", reference, "--reference", reference], "2 given"),
                (2, [self.cornell, "--from", self.report], "--from"),
                (3, [self.cornell, "--reference", reference, "--size", "8x8"], "4x4"),
                (3, [self.cornell, "--reference", os.path.join(self.folder, "none.exr")], "none.exr"),
                (3, [os.path.join(self.folder, "none.glb"), "--seconds", 1], "none.glb"),
                (3, ["--from", broken, "--html", page], "broken.json"), (3, ["--from", empty, "--html", page], "lacks"),
                (3, ["--from", os.path.join(self.folder, "none.json")], "none.json"),
                (5, [self.cornell, "--html", os.path.join(self.folder, "no/a.html")], "no folder"),
                (5, [self.cornell, "--json", os.path.join(self.folder, "no/a.json")], "no folder")):
            with self.subTest(arguments=arguments):
                result = run("bench", "tradeoff", *arguments)
                self.assertEqual(result.returncode, code, result.stderr)
                self.assertIn(says, result.stderr)
                self.assertEqual(result.stderr.count("error:"), 1, result.stderr)
        self.assertEqual(run("bench").returncode, 2)
        self.assertFalse(os.path.exists(page))


if __name__ == "__main__":
    program.main()
