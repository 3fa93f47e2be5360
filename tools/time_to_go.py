#!/usr/bin/env python3
"""How far the time to go jumps back during a bake, and how right it is.

    tools/time_to_go.py LEVEL… [-- bake options]

Bakes each level and prints the bake's seconds, the first time to go that was shown and how long it
really took from there, and the largest factor by which a shown time exceeded one shown before. The
aim is 1.2. Only a machine without other work says anything.

LUMEL names the program (common.py)."""
import argparse
import os
import re
import subprocess
import sys
import tempfile
import time

import common

LINE = re.compile(r"\s*progress .*?, ([\d.]+) (s|min|h) left$")
SECONDS = {"s": 1, "min": 60, "h": 3600}


def watch(level, options):
    """-> seconds of the bake, [(when, seconds to go shown)]"""
    with tempfile.TemporaryDirectory() as out:
        start, shown = time.time(), []
        command = [common.LUMEL, "bake", level, "-o", out, "--no-config", "--progress", "lines", *options]
        with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as p:
            for line in p.stderr:
                if m := LINE.match(line.rstrip()):
                    shown.append((time.time() - start, float(m[1]) * SECONDS[m[2]]))
        if p.returncode:
            raise SystemExit(f"{level}: the bake ended with {p.returncode}")
        return time.time() - start, shown


def main():
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("levels", nargs="+")
    own = sys.argv[1:]
    cut = own.index("--") if "--" in own else len(own)
    a, options = p.parse_args(own[:cut]), own[cut + 1:]
    print("| level | bake, s | first shown, s | true, s | jumps back by | at |")
    print("|---|---|---|---|---|---|")
    for level in a.levels:
        total, shown = watch(level, options)
        least, worst, at = float("inf"), 1.0, 0.0
        for when, left in shown:
            if left / least > worst:
                worst, at = left / least, when
            # Below two seconds the figure's last digit is a fifth.
            least = min(least, max(left, 2.0))
        first = shown[0] if shown else (total, 0.0)
        print(f"| {os.path.basename(level)} | {total:.1f} | {first[1]:.1f} | {total - first[0]:.1f} | {worst:.2f} "
              f"| {at:.1f} s |", flush=True)


if __name__ == "__main__":
    main()
