#!/usr/bin/env python3
"""Bakes many generated levels: does every bake end well, in the time and memory foretold?

    tools/many_levels.py --out DIR [--seeds A..B] [--quality Q] [--lumel PATH] [--make-level PATH]

For every family and seed: draws a small level, runs `--dry-run`, bakes, and adds a row to
DIR/many_QUALITY.csv: processor seconds, true and foretold (the foretold time times the number of
processors that it may use), peak memory likewise, and anything wrong: an exit code other than 0, a
text that speaks of a panic, or a value in the pages that is not finite or below 0.
Rows that exist are skipped, so an interrupted run can go on. At the end a summary is printed.
Needs OpenEXR and numpy (tools/setup.sh).
"""
import argparse
import csv
import json
import os
import resource
import shutil
import subprocess
import time
from pathlib import Path

import numpy as np
import OpenEXR

ROOT = Path(__file__).resolve().parent.parent
FIELDS = ["level", "code", "foretold_s", "true_s", "foretold_mib", "true_mib", "wrong"]


def run(command):
    """(exit code, standard output and errors, processor seconds, peak MiB)"""
    child = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    text = child.stdout.read()
    _, status, used = os.wait4(child.pid, 0)
    return os.waitstatus_to_exitcode(status), text, used.ru_utime + used.ru_stime, used.ru_maxrss / 1024


def faults(folder):
    """What is wrong with the values of the pages in `folder`."""
    wrong = []
    for page in sorted(folder.glob("*.exr")):
        with OpenEXR.File(str(page), separate_channels=True) as file:
            for name, channel in file.parts[0].channels.items():
                values = np.asarray(channel.pixels, np.float32)
                if not np.isfinite(values).all():
                    wrong.append(f"{page.name} {name}: not finite")
                elif name in "RGB" and values.min() < 0:
                    wrong.append(f"{page.name} {name}: {values.min()}")
    return wrong


def bake(level, quality, lumel, folder):
    shutil.rmtree(folder, ignore_errors=True)
    arguments = [lumel, "bake", str(level), "-o", str(folder), "--quality", quality]
    code, text, _, _ = run(arguments + ["--dry-run", "--json"])
    row = {"level": level.stem, "code": code, "wrong": ""}
    if code:
        return row | {"wrong": text.strip().splitlines()[-1][:200]}
    cost = json.loads(text)["estimate"]
    row |= {"foretold_s": cost["seconds"] * len(os.sched_getaffinity(0)),
            "foretold_mib": cost["bytes"] / 2**20}
    code, text, seconds, mib = run(arguments)
    wrong = faults(folder) if code == 0 else [text.strip().splitlines()[-1][:200]]
    wrong += ["panic"] if "panicked" in text else []
    return row | {"code": code, "true_s": seconds, "true_mib": mib, "wrong": "; ".join(wrong)}


def summary(rows):
    good = [r for r in rows if str(r["code"]) == "0"]
    print(f"{len(rows)} levels, {len(rows) - len(good)} without a bake, {sum(bool(r['wrong']) for r in rows)} with something wrong")
    for r in rows:
        if r["wrong"]:
            print("  ", r["level"], r["code"], r["wrong"])
    for what in ("s", "mib"):
        ratio = np.array([float(r["foretold_" + what]) / float(r["true_" + what]) for r in good])
        order = np.argsort(ratio)
        ends = [f"{good[i]['level']} {ratio[i]:.2f}" for i in (*order[:3], *order[-3:])]
        within = np.mean((ratio >= 0.5) & (ratio <= 2))
        print(f"foretold over true, {what}: median {np.median(ratio):.2f}, 5 to 95 % {np.quantile(ratio, 0.05):.2f} to "
              f"{np.quantile(ratio, 0.95):.2f}, within 2: {100 * within:.1f} %; ends: {', '.join(ends)}")
    true = [float(r["true_s"]) for r in good]
    print(f"processor seconds of a bake: mean {np.mean(true):.2f}, largest {max(true):.2f}")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--seeds", default="101..136")
    parser.add_argument("--quality", default="draft")
    parser.add_argument("--lumel", default=str(ROOT / "target/release/lumel"))
    parser.add_argument("--make-level", default=str(ROOT / "target/release/make-level"))
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    table = args.out / f"many_{args.quality}.csv"
    rows = list(csv.DictReader(table.open())) if table.exists() else []
    done = {row["level"] for row in rows}
    first, _, last = args.seeds.partition("..")
    listed = subprocess.run([args.make_level, "--list"], capture_output=True, text=True, check=True).stdout
    families = [line.split()[0] for line in listed.splitlines()]
    with table.open("a", newline="") as file:
        out = csv.DictWriter(file, FIELDS)
        if not done:
            out.writeheader()
        for seed in range(int(first), int(last or first) + 1):
            for family in families:
                level = args.out / f"{family}_{seed}.glb"
                if level.stem in done:
                    continue
                subprocess.run([args.make_level, family, str(seed), "-o", str(args.out), "--small"],
                               check=True, capture_output=True)
                row = bake(level, args.quality, args.lumel, args.out / "bake")
                for path in args.out.glob(level.stem + ".*"):
                    path.unlink()
                out.writerow(row)
                file.flush()
                rows.append({k: row.get(k, "") for k in FIELDS})
    summary(rows)


if __name__ == "__main__":
    main()
