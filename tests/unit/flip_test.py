#!/usr/bin/env python3
"""`trex diff` against the reference evaluator of FLIP (flip-evaluator 1.7) and NumPy.

The interpreter named by TREX_TEST_PYTHON has both; scripts/test-python makes it. Without it the test is skipped.
"""
import argparse, json, os, subprocess, sys, tempfile

TOLERANCE = 1e-4
SKIPPED = 77


def skip(reason):
    print("SKIPPED:", reason)
    sys.exit(SKIPPED)


def enter_test_python():
    """Goes on in the interpreter that has the packages."""
    if os.environ.get("TREX_TEST_PYTHON_ENTERED"):
        return
    python = os.environ.get("TREX_TEST_PYTHON")
    if not python:
        skip("TREX_TEST_PYTHON is not set; scripts/test-python prints what to set it to")
    probe = subprocess.run([python, "-c", "import numpy, flip_evaluator"], capture_output=True, text=True)
    if probe.returncode != 0:
        skip(f"{python} lacks a package: {probe.stderr.strip().splitlines()[-1]}")
    os.environ["TREX_TEST_PYTHON_ENTERED"] = "1"
    os.execv(python, [python, *sys.argv])


def make_pairs(np):
    """(name, reference, picture): linear colours."""
    def rng(seed):
        return np.random.default_rng(seed)

    def noise(h, w, seed, scale=1.0):
        return rng(seed).uniform(0, scale, (h, w, 3))

    def ramp(h, w):
        x = np.linspace(0, 1, w)[None, :, None] * np.ones((h, 1, 1))
        y = np.linspace(0, 1, h)[:, None, None] * np.ones((1, w, 1))
        return np.concatenate([x, y, 0.5 * x + 0.5 * (1 - y)], -1)

    def stripes(h, w, period):
        return np.broadcast_to(((np.arange(w) // period) % 2)[None, :, None], (h, w, 3)).astype(float)

    def hdr(h, w, seed, low=-3, high=4):
        return 10 ** rng(seed).uniform(low, high, (h, w, 3))

    def disc(h, w, inside, outside):
        y, x = np.mgrid[:h, :w]
        d = (x - w / 2) ** 2 + (y - h / 2) ** 2 < (min(h, w) / 3) ** 2
        return np.where(d[..., None], inside, outside) * np.ones((h, w, 3))

    def changed(image, y, x, value):
        out = image.copy()
        out[y, x] = value
        return out

    base, smooth = noise(48, 64, 1), ramp(40, 50)
    flat = np.full((30, 30, 3), 0.4)
    lit = disc(64, 64, (900, 700, 300), (0.02, 0.03, 0.05))
    return [
        ("noise", base, np.clip(base + rng(2).normal(0, 0.1, base.shape), 0, None)),
        ("unrelated noise", base, noise(48, 64, 3)),
        ("equal", base, base),
        ("ramp and noise", smooth, smooth * rng(4).uniform(0.8, 1.2, smooth.shape)),
        ("red shift", smooth, smooth * (1.3, 1, 1)),
        ("blue shift", smooth, smooth * (1, 1, 0.5)),
        ("swapped channels", smooth, smooth[..., ::-1]),
        ("one pixel", flat, changed(flat, 14, 9, (0.9, 0.1, 0.1))),
        ("one corner", flat, changed(flat, 0, 29, (0, 0, 5))),
        ("stripes moved", stripes(33, 70, 5), stripes(33, 71, 5)[:, 1:]),
        ("stripes of other width", stripes(33, 70, 2), stripes(33, 70, 3)),
        ("edge softened", disc(50, 60, 0.9, 0.1), 0.7 * disc(50, 60, 0.9, 0.1) + 0.3 * disc(50, 60, 0.9, 0.5)),
        ("hdr noise", hdr(40, 40, 5), hdr(40, 40, 6)),
        ("hdr scaled", hdr(32, 48, 7), hdr(32, 48, 7) * 1.1),
        ("hdr lamp", lit, lit * rng(8).gamma(20, 1 / 20, lit.shape)),
        ("mostly black", disc(40, 40, 3, 0), disc(40, 40, 2.5, 0)),
        ("black picture", flat, flat * 0),
        ("black reference", flat * 0, flat),
        ("1x1", np.full((1, 1, 3), 0.3), np.array([[[0.6, 0.2, 0.1]]])),
        ("3 wide, 200 high", noise(200, 3, 9), noise(200, 3, 10)),
        ("200 wide, 3 high", noise(3, 200, 11), noise(3, 200, 11) ** 1.2),
        ("negative values", base - 0.2, base),
    ]


def srgb(np, a):
    a = np.clip(a, 0, 1)
    return np.where(a <= 0.0031308, 12.92 * a, 1.055 * a ** (1 / 2.4) - 0.055).astype(np.float32)


def expected(np, evaluate, reference, picture):
    scale = 0.5 / max(np.percentile(reference.mean(-1), 70), 1e-12)
    out = {"flip": evaluate(srgb(np, reference * scale), srgb(np, picture * scale), "LDR", applyMagma=False)[1]}
    if reference.max() > 0:  # the evaluator ends the process for a black reference
        sides = [np.ascontiguousarray(np.clip(x, 0, None), np.float32) for x in (reference, picture)]
        out["hdr_flip"] = evaluate(*sides, "HDR", applyMagma=False)[1]
    terms = (picture - reference) ** 2
    out["rmse"] = terms.mean() ** 0.5
    if reference.max() > 0:
        terms = np.sort((terms / (reference ** 2 + 0.01 * reference.mean() ** 2)).ravel())
        out["relmse"] = terms.mean()
        out["relmse_trimmed"] = terms[:-max(1, len(terms) // 1000)].mean()
        out["mean_ratio"] = picture.mean() / reference.mean()
    return {key: float(value) for key, value in out.items()}


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--trex", required=True)
    options = parser.parse_args()
    enter_test_python()
    import numpy as np
    from flip_evaluator import evaluate
    from exr_file import exr_bytes
    failures, largest = 0, 0.0
    with tempfile.TemporaryDirectory(prefix="trex-flip-") as folder:
        for name, reference, picture in make_pairs(np):
            sides = []
            for side, image in (("b", reference), ("a", picture)):
                image = image.astype(np.float32)
                path = os.path.join(folder, side + ".exr")
                with open(path, "wb") as f:
                    f.write(exr_bytes(image.shape[1], image.shape[0],
                                      {c: image[..., i].ravel().tolist() for i, c in enumerate("RGB")}))
                sides.append(image.astype(np.float64))
            run = subprocess.run([options.trex, "diff", os.path.join(folder, "a.exr"), os.path.join(folder, "b.exr"),
                                  "--json"], capture_output=True, text=True, timeout=300)
            found = json.loads(run.stdout)
            for key, want in expected(np, evaluate, *sides).items():
                error = abs(found[key] - want) / (1 if "flip" in key else max(abs(want), 1e-12))
                largest = max(largest, error)
                if not error <= TOLERANCE:
                    failures += 1
                    print(f"{name}: {key} is {found[key]}, want {want}")
    print(f"largest error {largest:.2e}")
    sys.exit(1 if failures else 0)


if __name__ == "__main__":
    main()
