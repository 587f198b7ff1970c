"""What tests of the program share: a folder of their own, files in it, and the program's ends. Standard library only."""
import argparse, os, shutil, struct, subprocess, tempfile, unittest, zlib

ASSETS = os.path.abspath(os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "..", "assets"))
# Absolute, and what main() was given beside it, from main() on.
TREX, options = None, None


def run(*arguments, timeout=600, **how):
    return subprocess.run([TREX, *map(str, arguments)], capture_output=True, text=True, timeout=timeout, **how)


def start(*arguments, **how):
    return subprocess.Popen([TREX, *map(str, arguments)], **how)


class ProgramTest(unittest.TestCase):
    cornell = os.path.join(ASSETS, "cornell.glb")

    def setUp(self):
        self.folder = tempfile.mkdtemp(prefix=f"trex-{type(self).__name__.lower()}-")
        self.addCleanup(shutil.rmtree, self.folder)

    def path(self, name):
        return os.path.join(self.folder, name)

    def write(self, name, data):
        with open(self.path(name), "wb") as f:
            f.write(data if isinstance(data, bytes) else data.encode())
        return self.path(name)

    def read(self, name):
        """The bytes of a file of the folder, or of a path."""
        with open(self.path(name), "rb") as f:
            return f.read()

    def trex(self, *arguments, code=0):
        """What the program says, on both of its outputs."""
        p = run(*arguments)
        self.assertEqual(p.returncode, code, p.stdout + p.stderr)
        return p.stdout + p.stderr


def png(width, texels):
    """A picture of 3 or 4 channels, rows of `width` texels from the top."""
    def chunk(name, data):
        return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))
    rows = [texels[i:i + width] for i in range(0, len(texels), width)]
    head = struct.pack(">2I5B", width, len(rows), 8, 2 if len(texels[0]) == 3 else 6, 0, 0, 0)
    data = b"".join(b"\0" + bytes(sum(row, ())) for row in rows)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(data)) + chunk(b"IEND", b"")


def main(*more):
    """Runs the tests of the calling script with the program that its option --trex names; options named in `more` are put
    into `options`."""
    global TREX, options
    parser = argparse.ArgumentParser()
    for name in ("trex", *more):
        parser.add_argument("--" + name, required=True)
    options, rest = parser.parse_known_args()
    TREX = os.path.abspath(options.trex)
    unittest.main(module="__main__", argv=["test", *rest], verbosity=1)
