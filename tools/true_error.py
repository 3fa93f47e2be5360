#!/usr/bin/env python3
"""Does a bake know its own error? Claimed against true error over generated levels.

    tools/true_error.py --out DIR [--seeds A..B] [--families F,G] [--quality Q,R] [--lumels 400]
                        [--paths 2048] [--lumel PATH] [--bin DIR] [--label NAME]

For every family and seed: draws a small level, bakes it, and compares randomly drawn lumels with
the tests' path tracer (`path-trace --lumels`), which shares no code with the baker. Adds a row to
DIR/true_error.csv: the claims of the report, and the true errors of the lit lumels that lie wholly
on the surface and that the cameras see in full. Truths are kept in DIR by atlas. Levels with skies
from files, textures or other things that the path tracer does not model are left out.

Error: (bake - truth) / (truth + 1 % of the mean truth), by luminance. Root mean squares have the
truth's own noise subtracted, medians do not: they need many paths. The path tracer has no smooth
shading, so levels with it (cave, terrain, stairs) differ for another reason.
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
          "true_median", "layer_rms", "bias", "noise_rms", "seconds"]
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
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
    """A row per drawn lumel: page, column, row, coverage, E (3), its errors (3), of luminance"""
    sizes = ",".join("%dx%d" % p["R"].shape[::-1] for p in pages)
    key = hashlib.sha256(glb.read_bytes() + repr((sky, sizes, a.lumels, a.paths)).encode())
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
    rows = rows[rows[:, 3] > 0.999]
    at = [tuple(map(int, r[:3])) for r in rows]

    def baked(name):
        return np.array([pages[p][name][y, x] for p, x, y in at]) * np.pi
    light = sum(baked(c) * w for c, w in zip("RGB", LUMINANCE))
    error = baked("error.Y")
    true, noise = rows[:, 4:7] @ LUMINANCE, rows[:, 10]
    mean = true.mean()
    lit = (true > 1e-3 * mean) & (light > 1e-3 * mean)
    scale = (true + 0.01 * mean)[lit]
    off, noise = (light - true)[lit] / scale, noise[lit] / scale
    square = max(np.mean(off ** 2) - np.mean(noise ** 2), 0.0)
    # Dividing by a noisy truth is too large by the square of its noise, on average.
    bias = off.mean() - np.mean(noise ** 2)
    return {"label": a.label, "level": level.stem, "quality": quality, "lumels": int(lit.sum()),
            "claimed_rms": report["estimated_error"], "claimed_median": report["median_error"],
            "true_rms": square ** 0.5, "true_median": np.median(np.abs(off)),
            "layer_rms": np.mean((error[lit] / scale) ** 2) ** 0.5, "bias": bias,
            "noise_rms": np.mean(noise ** 2) ** 0.5, "seconds": seconds}


def summary(rows):
    for quality in sorted({r["quality"] for r in rows}):
        for name in ("rms", "median"):
            ratio = np.array([float(r["claimed_" + name]) / max(float(r["true_" + name]), 1e-9)
                              for r in rows if r["quality"] == quality])
            near = [np.mean((ratio > 1 / x) & (ratio < x)) for x in (1.5, 2.5)]
            print("%s, claimed / true %s: %d levels, median %.2f, %.2f to %.2f; %.0f %% within "
                  "1.5, %.0f %% within 2.5" % (quality, name, len(ratio), np.median(ratio),
                                               ratio.min(), ratio.max(), *(100 * x for x in near)))


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
    parser.add_argument("--option", action="append", default=[])
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
                    "%s %.4f" % (k, row[k]) for k in FIELDS[4:]), flush=True)
    rows = [r for r in csv.DictReader(name.open()) if r["label"] == a.label]
    summary(rows)


if __name__ == "__main__":
    main()
