#!/usr/bin/env python3
"""Adds other renderers to a report of `trex bench tradeoff`: Mitsuba 3 and Cycles, same scenes, size and cores.

    trex bench tradeoff scenes/interiors/cornell.glb --reference scenes/refs --json report.json
    tests/bench/peers.py report.json [--only mitsuba,cycles,denoised] [--seconds S] [--out FOLDER]
    trex bench tradeoff --from report.json --html report.html --svg FOLDER

Each renderer draws 4, 16, 64, ... samples a pixel until a picture takes longer than the report's seconds. The seconds
of a point are those of its sampling (and of Cycles's filter, for `denoised`); reading the scene, building and compiling
are its start-up. Pictures are scored with quality.py against the report's references, so references must be files.
Needs the folder of shared scenes (TREX_SHARED, else ../shared) and the environment that its peers/setup.sh makes and
names; run this script with that interpreter.
"""
import argparse, base64, importlib.util, json, os, subprocess, sys, tempfile

HERE = os.path.dirname(os.path.abspath(__file__))
ROOT = os.path.dirname(os.path.dirname(HERE))
SHARED = os.environ.get("TREX_SHARED", os.path.join(os.path.dirname(ROOT), "shared"))
PEERS = os.path.join(SHARED, "peers")
MOST_SAMPLES = 1 << 20


def quality_module():
    path = os.path.join(PEERS, "quality.py")
    if not os.path.exists(path):
        sys.exit(f"skipped: no {path}; set TREX_SHARED")
    spec = importlib.util.spec_from_file_location("quality", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


class Mitsuba:
    name, script, options = "Mitsuba 3", "render_mitsuba.py", []

    def times(self, told):
        """Seconds of start-up and of sampling."""
        return told["load_s"], told["render_s"]


class Cycles:
    name, script, options = "Cycles", "render_cycles.py", []

    def times(self, told):
        return told["import_s"] + max(told["total_s"] - told["render_s"], 0), told["render_s"]


class Denoised(Cycles):
    """Its one-sample render is filtered too, so start-up is taken from one that is not."""
    name, options = "Cycles, denoised", ["--denoise"]
    built = 0.0

    def times(self, told):
        return told["import_s"] + self.built, max(told["total_s"] - self.built, 1e-3)


RENDERERS = {"mitsuba": Mitsuba, "cycles": Cycles, "denoised": Denoised}


class Bench:
    def __init__(self, options, report):
        self.options, self.report = options, report
        self.quality = quality_module()
        self.size = f"{report['settings']['width']}x{report['settings']['height']}"
        self.seconds = options.seconds or report["settings"]["seconds"]
        os.makedirs(options.out, exist_ok=True)

    def render(self, scene, renderer, samples):
        """The script's report, or None if the renderer failed."""
        out = os.path.join(self.options.out, f"{scene['name']}-{type(renderer).__name__}-{samples}.exr")
        command = [sys.executable, "-W", "ignore", os.path.join(PEERS, renderer.script), scene["input"], out,
                   "--size", self.size, "--spp", str(samples), *renderer.options]
        environment = scene["environment"]
        if environment:
            is_file = environment.lower().endswith((".hdr", ".exr"))
            command += ["--env-file" if is_file else "--env", environment]
        threads = self.report["machine"]["threads"]
        if renderer.script == "render_cycles.py":
            command += ["--threads", str(threads)]
        else:
            command = ["taskset", "-c", f"0-{threads - 1}", *command]
        done = subprocess.run(command, capture_output=True, text=True)
        if done.returncode != 0:
            last = (done.stderr.strip().splitlines() or ["no message"])[-1]
            print(f"{scene['name']}: {renderer.name} failed: {last}", file=sys.stderr)
            return None
        return json.loads(done.stdout.strip().splitlines()[-1])

    def score(self, scene, picture):
        read = self.quality.read
        reference = scene["reference"]["file"]
        clean = reference[:-4] + ".clean.exr"
        found = self.quality.quality(read(reference), read(picture), read(clean) if os.path.exists(clean) else None)
        return {"relmse": found["relmse"], "relmse_all": found["relmse_all"], "flip": found["flip"],
                "mean_ratio": found["mean_ratio"], "nonfinite_pixels": found["nonfinite"]}

    def shown(self, scene, picture):
        """A PNG at the reference's exposure, as the report's own pictures are."""
        import io
        import numpy
        from PIL import Image
        reference, image = self.quality.read(scene["reference"]["file"]), self.quality.read(picture)
        scale = 0.5 / max(numpy.percentile(reference.mean(-1), 70), 1e-12)
        encoded = self.quality.srgb(numpy.nan_to_num(image) * scale)
        file = io.BytesIO()
        Image.fromarray(numpy.round(encoded * 255).astype(numpy.uint8)).save(file, "PNG")
        return base64.b64encode(file.getvalue()).decode()

    def measure(self, scene, renderer):
        peer = {"renderer": renderer.name, "points": []}
        starts, samples = [], 4
        if isinstance(renderer, Denoised):
            plain = self.render(scene, Cycles(), 1)
            renderer.built = plain["first_sample_s"] if plain else 0.0
        while samples <= MOST_SAMPLES:
            told = self.render(scene, renderer, samples)
            if told is None:
                break
            start, seconds = renderer.times(told)
            starts.append(start)
            point = {"seconds": max(seconds, 1e-3), "samples": samples, **self.score(scene, told["out"])}
            peer["points"].append(point)
            peer["version"] = told["renderer"]
            print(json.dumps({"scene": scene["name"], "renderer": renderer.name, **point}), flush=True)
            picture = {"seconds": point["seconds"], "png_base64": self.shown(scene, told["out"])}
            if "picture_early" not in peer or seconds <= 1.1:
                peer["picture_early"] = picture
            peer["picture_last"] = picture
            if seconds >= self.seconds:
                break
            # Four times the samples, or what the time that is left should be enough for.
            aim = samples * self.seconds / max(seconds, 1e-3) * 1.02
            samples = max(samples + 1, min(samples * 4, int(aim) + 1))
        if starts:
            peer["start_seconds"] = sorted(starts)[len(starts) // 2]
        return peer


def write(path, report):
    folder = os.path.dirname(os.path.abspath(path))
    with tempfile.NamedTemporaryFile("w", dir=folder, delete=False) as f:
        json.dump(report, f, indent=1)
    os.replace(f.name, path)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("report")
    parser.add_argument("--only", default="mitsuba,cycles,denoised")
    parser.add_argument("--seconds", type=float, help="of sampling [the report's]")
    parser.add_argument("--out", default=os.path.join(ROOT, "build/peers"), help="folder of the pictures")
    options = parser.parse_args()
    unknown = set(options.only.split(",")) - set(RENDERERS)
    if unknown:
        parser.error(f"--only: {', '.join(sorted(unknown))}: want some of {', '.join(RENDERERS)}")
    with open(options.report) as f:
        report = json.load(f)
    bench = Bench(options, report)
    for scene in report["scenes"]:
        if scene["reference"]["file"] == "auto":
            print(f"{scene['name']}: skipped, its reference is no file", file=sys.stderr)
            continue
        for name in options.only.split(","):
            renderer = RENDERERS[name]()
            scene["peers"] = [p for p in scene["peers"] if p["renderer"] != renderer.name]
            peer = bench.measure(scene, renderer)
            if peer["points"]:
                scene["peers"].append(peer)
            write(options.report, report)


if __name__ == "__main__":
    main()
