"""Bakes levels, draws them, scores them, and keeps the figures in a CSV that can be taken up again.

OUT/scores.csv has a row a view; OUT/pictures/LABEL/QUALITY/LEVEL.VIEW.{bake,flip}.png and
OUT/pictures/truth/LEVEL.VIEW.png the pictures; OUT/truth the references.
"""
import csv
import glob
import json
import os
import re
import shutil
import subprocess

import numpy as np

from . import scene as scenes
from . import score, truth

KEYS = ["label", "binary", "family", "seed", "level", "quality", "view"]
MEASURES = ["flip", "patch", "patch_max", "dark", "bright", "dark_line", "bright_line", "blotches",
            "dark_back", "bright_back",
            "error_median", "error_p95", "error_rms"]
COLUMNS = KEYS + MEASURES + ["noise_flip", "noise_patch", "noise_median"] \
    + ["best_" + k for k in ("flip", "patch", "dark", "bright", "dark_line", "bright_line")] \
    + ["seconds", "claimed", "claimed_median", "status"]


def family_of(path):
    """greybox_12.glb -> ("greybox", 12)"""
    name = os.path.splitext(os.path.basename(path))[0]
    m = re.fullmatch(r"(.+?)[_-]?(\d+)", name)
    return (m[1], int(m[2])) if m else (name, 0)


def levels(folder, seeds="all", families=()):
    want = {"all": (0, 1), "even": (0,), "odd": (1,)}[seeds]
    found = [(*family_of(p), p) for p in glob.glob(os.path.join(folder, "*.glb"))]
    return sorted(x for x in found if x[1] % 2 in want and (not families or x[0] in families))


def rows(out):
    name = os.path.join(out, "scores.csv")
    return list(csv.DictReader(open(name))) if os.path.exists(name) else []


def append(out, row):
    name = os.path.join(out, "scores.csv")
    new = not os.path.exists(name)
    os.makedirs(out, exist_ok=True)
    with open(name, "a", newline="") as f:
        writer = csv.DictWriter(f, COLUMNS, restval="")
        if new:
            writer.writeheader()
        writer.writerow({k: "%.6g" % v if isinstance(v, float) else v for k, v in row.items()})


def save(path, image):
    from PIL import Image
    os.makedirs(os.path.dirname(path), exist_ok=True)
    Image.fromarray((np.clip(image, 0, 1) * 255 + 0.5).astype(np.uint8)).save(path)


def processor_seconds():
    """of all children; other work on the machine hardly changes it"""
    used = os.times()
    return used.children_user + used.children_system


def bake(binary, level, folder, quality, options, timeout):
    """-> seconds of processor time, report or None, what went wrong or "ok" """
    shutil.rmtree(folder, ignore_errors=True)
    os.makedirs(folder)
    start = processor_seconds()
    command = [binary, "bake", level, "-o", folder, "-q", "--quality", quality,
               "--no-vertex-colors", *options]
    try:
        r = subprocess.run(command, timeout=timeout, capture_output=True, text=True)
    except subprocess.TimeoutExpired:
        return processor_seconds() - start, None, "no end after %g s" % timeout
    seconds, found = processor_seconds() - start, glob.glob(os.path.join(folder, "*.report.json"))
    if r.returncode or not found:
        said = (r.stderr.strip().splitlines() or [""])[-1][:200]
        return seconds, None, "exit code %d: %s" % (r.returncode, said)
    return seconds, json.load(open(found[0])), "ok"


def pictures(out, row, shown, i):
    name = "%s.%d" % (row["level"], i)
    base = os.path.join(out, "pictures", row["label"], row["quality"], name)
    save(os.path.join(out, "pictures", "truth", name + ".png"), shown[0])
    save(base + ".bake.png", shown[1])
    save(base + ".flip.png", shown[2])


def density_of(report):
    """lumels a metre"""
    return float(report["layout"]["texels_per_unit"])


def judge(out, path, folder, keys, report, width, references, noise):
    """draws and scores a finished bake; appends its rows"""
    from . import blotches, ideal, view
    baked = view.Baked(os.path.join(folder, os.path.basename(path)))
    gather = report.get("gather") or report.get("bake", {}).get("gather") or {}
    density = density_of(report)
    for i, (camera, v) in enumerate(zip(baked.scene.cameras, references)):
        hit = baked.hits(camera, width)
        light = view.shown(baked.light(hit), hit, v, width)
        backs = view.backs(hit, v, width)
        measures, shown = score.compare(v, light, backs)
        row = dict(keys, view=i, status="ok", **measures, **noise[i])
        row.update(ideal.measures(baked, hit, v, width))
        row["blotches"] = blotches.measure(baked.tracer, baked.scene, hit, v, light, density)
        row.update(claimed=gather.get("estimated_error", ""),
                   claimed_median=gather.get("median_error", ""))
        pictures(out, row, shown, i)
        append(out, row)


def bake_all(a):
    binary = truth.digest(a.binary)
    label = a.label or binary[:8]
    done = {(r["binary"], r["level"], r["quality"]) for r in rows(a.out)}
    for family, seed, path in levels(a.levels, a.seeds, a.family):
        level, references = os.path.splitext(os.path.basename(path))[0], None
        level_key = level + ":" + truth.key(path, a.width, a.paths)[:8]
        for quality in a.quality:
            if (binary, level_key, quality) in done:
                continue
            keys = dict(label=label, binary=binary, family=family, seed=seed, level=level_key,
                        quality=quality)
            folder = os.path.join(a.out, "bake_" + label)
            seconds, report, status = bake(a.binary, path, folder, quality, a.option, a.timeout)
            keys["seconds"] = seconds
            try:
                if report is None:
                    raise scenes.Unsupported(status)
                if references is None:
                    references = truth.references(path, os.path.join(a.out, "truth"), a.width,
                                                  a.paths)
                    noise = [{"noise_" + n: score.own_noise(v)[k] for n, k in
                              (("flip", "flip"), ("patch", "patch"), ("median", "error_median"))}
                             for v in references]
                judge(a.out, path, folder, keys, report, a.width, references, noise)
            except scenes.Unsupported as problem:
                status = str(problem)
                append(a.out, dict(keys, view=-1, status=status))
            print("%s %s %s: %.1f s, %s" % (label, level, quality, seconds, status), flush=True)
            shutil.rmtree(folder, ignore_errors=True)
