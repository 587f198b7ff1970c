"""A model in pages of which few fit in memory, for tests of the program. Standard library only."""
import json
from program import ProgramTest, run

MODEL = "synth:assembly?triangles=2e5&seed=3"


def contents(path):
    with open(path, "rb") as f:
        return f.read()


class PagedModelTest(ProgramTest):
    """`bundle`: the model, baked once; `pages`: what trex info tells of its pages; `few`: --cache for a twentieth of them."""

    @classmethod
    def setUpClass(cls):
        cls.shared = ProgramTest("path")
        cls.shared.setUp()
        cls.bundle = cls.shared.path("a.trex")
        p = run("bake", MODEL, "-o", cls.bundle, "--stream")
        assert p.returncode == 0, p.stderr
        cls.pages = json.loads(run("info", cls.bundle, "--json").stdout)["mesh_pages"]
        cls.few = str(max(int(cls.pages["memory_bytes"] * 0.05), cls.pages["largest_page_bytes"] + 8192))

    @classmethod
    def tearDownClass(cls):
        cls.shared.doCleanups()

    def read(self, name):
        return contents(self.path(name))
