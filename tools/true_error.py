#!/usr/bin/env python3
"""Does a bake know its own error? Claimed against true error over generated levels.

    tools/true_error.py --out DIR [--seeds A..B] [--families F,G] [--quality Q,R] [--lumels 400]
                        [--paths 2048] [--lumel PATH] [--bin DIR] [--label NAME] [--cameras]
                        [--error X]

For every family and seed: draws a small level, bakes it, and compares randomly drawn lumels with
the tests' path tracer (`path-trace --lumels`), which shares no code with the baker. Adds a row to
DIR/true_error.csv: the claims of the report, and the true errors of the lit lumels, by the light of
the part of them that can be seen. They count as claims count them: by this part's area and the
fraction of directions that go far. `--cameras` counts those that the cameras see in full, all
alike. Truths are kept in DIR by atlas. Levels with skies from files, textures or other things that the
path tracer does not model are left out.

Error: (bake - truth) / (truth + 1 % of the mean truth), by luminance, at most 1 as in the report.
Root mean squares have the truth's own noise subtracted, medians do not: they need many paths.
`spread` is the standard deviation of true_rms over resampled lumels; the summary judges levels where it is at most a quarter
of it, and counts the others. `--error X` asks bakes for this error; the summary counts those that
reach it in truth, and those that say that they did not. The path tracer has no smooth shading, so levels with it (cave,
terrain, stairs) differ for another reason.
Needs OpenEXR and numpy (tools/setup.sh).
"""
import argparse
import csv
import hashlib
import json
import os
import shutil
import subprocess
import tomllib
from pathlib import Path

import numpy as np
import OpenEXR

ROOT = Path(__file__).resolve().parent.parent
FIELDS = ["label", "level", "quality", "lumels", "claimed_rms", "true_rms", "claimed_median",
          "true_median", "spread", "layer_rms", "bias", "noise_rms", "seconds", "asked",
          "reached"]
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
JUDGED = 0.25
FAMILIES = ("archviz", "blocks", "furniture", "greybox", "kit", "lamps", "maze", "sheets", "suite")


def read_pages(folder):
    """Radiance of the pages and their layers, by channel name, in the order of pages"""
    def number(path):
        parts = path.name.split(".")
        return int(parts[-2]) if parts[-2].isdigit() else 0
    pages = []
    for path in sorted(folder.glob("*.lightmap*.exr"), key=number):
        with OpenEXR.File(str(path), separate_channels=True) as file:
            channels = file.parts[0].channels
            pages.append({n: np.asarray(c.pixels, np.float64) for n, c in channels.items()})
    return pages


def truth(glb, pages, sky, a):
    """A row per drawn lumel: page, column, row, coverage, E (3), the error of its luminance, the
    part that is seen, the fraction of directions that go far, whether a camera sees it"""
    sizes = ",".join("%dx%d" % p["R"].shape[::-1] for p in pages)
    key = hashlib.sha256(glb.read_bytes() + repr((sky, sizes, a.lumels, a.paths, 5)).encode())
    kept = a.out / "truth" / (key.hexdigest()[:20] + ".csv")
    if not kept.exists():
        kept.parent.mkdir(exist_ok=True)
        command = [a.bin / "path-trace", "--lumels", glb, sizes, a.lumels, a.paths, 1]
        command += [",".join(map(str, sky))]
        r = subprocess.run(list(map(str, command)), capture_output=True, text=True)
        if r.returncode:
            return None
        kept.write_text(r.stdout)
    return np.loadtxt(kept, delimiter=",", ndmin=2)


def compare(level, quality, a):
    folder = a.out / ("bake_" + a.label)
    shutil.rmtree(folder, ignore_errors=True)
    command = [a.lumel, "bake", level, "-o", folder, "--quality", quality, "--no-vertex-colors",
               "--no-split-sides", "--layers", "error,coverage", "-q", *a.option]
    command += ["--error", a.error] if a.error else []
    before = os.times()
    subprocess.run(list(map(str, command)), check=True, capture_output=True)
    after = os.times()
    seconds = sum(after[2:4]) - sum(before[2:4])
    pages = read_pages(folder)
    settings = tomllib.loads(level.with_suffix(".lumel.toml").read_text())
    rows = truth(folder / level.name, pages, settings.get("sky", [0.0, 0.0, 0.0]), a)
    if rows is None:
        return None
    report = json.loads((folder / (level.stem + ".report.json")).read_text())["gather"]
    coverage, noise, part, far, watched = rows[:, 3], *rows[:, 7:11].T
    if a.cameras:
        kept, weight = (watched > 0) & (coverage > 0.999), np.ones(len(rows))
    else:
        kept, weight = part > 0, coverage * part * far
    at = [tuple(map(int, r[:3])) for r in rows]

    def baked(name):
        return np.array([pages[p][name][y, x] for p, x, y in at]) * np.pi
    light = sum(baked(c) * w for c, w in zip("RGB", LUMINANCE))
    error = baked("error.Y")
    true = rows[:, 4:7] @ LUMINANCE
    mean = np.average(true[kept], weights=coverage[kept])
    lit = kept & (true > 1e-3 * mean) & (light > 1e-3 * mean)
    scale, weight = (true + 0.01 * mean)[lit], weight[lit]
    off = np.clip((light - true)[lit] / scale, -1, 1)
    noise, claimed = np.minimum(noise[lit] / scale, 1), np.minimum(error[lit] / scale, 1)

    def rms(x, w=weight):
        return max(np.average(x, weights=w), 0.0) ** 0.5
    square = off ** 2 - noise ** 2
    random = np.random.default_rng(1)
    draws = [random.integers(len(off), size=len(off)) for _ in range(200)]
    order = np.argsort(np.abs(off))
    half = order[np.searchsorted(np.cumsum(weight[order]), 0.5 * weight.sum())]
    # Dividing by a noisy truth is too large by the square of its noise, on average.
    bias = np.average(off - noise ** 2, weights=weight)
    return {"label": a.label, "level": level.stem, "quality": quality, "lumels": int(lit.sum()),
            "claimed_rms": report["estimated_error"], "claimed_median": report["median_error"],
            "true_rms": rms(square), "true_median": abs(off[half]),
            "spread": np.std([rms(square[d], weight[d]) for d in draws]),
            "layer_rms": rms(claimed ** 2), "bias": bias,
            "noise_rms": rms(noise ** 2), "seconds": seconds, "asked": a.error or "",
            "reached": report.get("error_reached")}


def summary(rows):
    for quality in sorted({r["quality"] for r in rows}):
        all_rows = [r for r in rows if r["quality"] == quality]
        known = [r for r in all_rows
                 if float(r["spread"]) <= JUDGED * float(r["true_rms"])]
        for name, true, judged in (("claimed_rms", "true_rms", known),
                                   ("layer_rms", "true_rms", known),
                                   ("claimed_median", "true_median", all_rows)):
            ratio = np.array([float(r[name]) / max(float(r[true]), 1e-9) for r in judged])
            if not len(ratio):
                continue
            near = [np.sum((ratio > 1 / x) & (ratio < x)) for x in (1.5, 2.5)]
            print("%s, %s / %s: median %.2f, %.2f to %.2f; of %d levels %d within 1.5, %d within "
                  "2.5; %d not known" % (quality, name, true, np.median(ratio), ratio.min(),
                                         ratio.max(), len(ratio), *near,
                                         len(all_rows) - len(ratio)))
        asked = [r for r in all_rows if r["asked"]]
        if asked:
            kept = [r for r in asked if float(r["true_rms"]) <= float(r["asked"])]
            said = [r for r in asked if r not in kept and r["reached"] == "False"]
            wrong = [r for r in asked if r not in kept + said]
            print("%s, --error: %d of %d levels reach it in truth, %d say that they do not; the others: %s" % (
                quality, len(kept), len(asked), len(said),
                ", ".join("%s %.3f for %s" % (r["level"], float(r["true_rms"]), r["asked"]) for r in wrong) or "none"))


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--seeds", default="44..45")
    parser.add_argument("--families", default=",".join(FAMILIES))
    parser.add_argument("--quality", default="draft,quick,preview")
    parser.add_argument("--lumels", type=int, default=400)
    parser.add_argument("--paths", type=int, default=2048)
    parser.add_argument("--bin", type=Path, default=ROOT / "target/release")
    parser.add_argument("--lumel", type=Path)
    parser.add_argument("--label", default="today")
    parser.add_argument("--cameras", action="store_true")
    parser.add_argument("--option", action="append", default=[])
    parser.add_argument("--error", type=float)
    a = parser.parse_args()
    a.lumel = a.lumel or a.bin / "lumel"
    (a.out / "levels").mkdir(parents=True, exist_ok=True)
    name = a.out / "true_error.csv"
    old = list(csv.DictReader(name.open())) if name.exists() else []
    done = {(r["label"], r["level"], r["quality"]) for r in old}
    first, end = map(int, a.seeds.split(".."))
    for family in a.families.split(","):
        subprocess.run([a.bin / "make-level", family, "%d..%d" % (first, end), "--small", "-o",
                        a.out / "levels"], check=True, capture_output=True)
        for seed in range(first, end):
            level = a.out / "levels" / ("%s_%d.glb" % (family, seed))
            for quality in a.quality.split(","):
                if (a.label, level.stem, quality) in done:
                    continue
                row = compare(level, quality, a)
                if row is None:
                    print(level.stem, "is left out")
                    break
                new = not name.exists()
                with name.open("a", newline="") as f:
                    writer = csv.DictWriter(f, FIELDS)
                    if new:
                        writer.writeheader()
                    writer.writerow(row)
                print(level.stem, quality, " ".join(
                    "%s %.4f" % (k, row[k]) for k in FIELDS[4:13]), row["reached"], flush=True)
    rows = [r for r in csv.DictReader(name.open()) if r["label"] == a.label]
    summary(rows)


if __name__ == "__main__":
    main()
