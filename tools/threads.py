#!/usr/bin/env python3
"""What more cores bring: a bake with 1, 2, 4 … threads, phase by phase.

    tools/threads.py LEVEL [--threads 1,2] [--runs 3] -- [bake options]

Prints a Markdown table with the fastest of the runs: wall seconds of every phase for each number of
threads, and the serial part s of each, by Amdahl's law from the first and the last number: with n
threads a phase takes s + (1 − s) / n of what it takes with one. Below it, what the law foretells
for the whole bake with 4, 8 and 16 threads, as far as they were not measured. All files but the report must be equal.
LUMEL names the program (common.py)."""
import argparse
import hashlib
import json
import os
import sys
import tempfile

import common


def bake(level, threads, options):
    """-> (seconds by phase, seconds in all, hash of the results)"""
    with tempfile.TemporaryDirectory() as out:
        ran = common.run([common.LUMEL, "bake", level, "-o", out, "-q", "--no-config", "--threads", str(threads), *options])
        if ran["code"]:
            raise SystemExit(ran["err"])
        digest, measured = hashlib.sha256(), None
        for name in sorted(os.listdir(out)):
            data = open(os.path.join(out, name), "rb").read()
            if name.endswith(".report.json"):
                measured = json.loads(data)["measured"]
            else:
                digest.update(data)
        phases = {}
        for lap in measured["phases"]:
            phases[lap["phase"]] = phases.get(lap["phase"], 0.0) + lap["seconds"]
        return phases, measured["seconds"], digest.hexdigest()


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("level")
    parser.add_argument("--threads", default="1,2")
    parser.add_argument("--runs", type=int, default=3)
    own, options = sys.argv[1:], []
    if "--" in own:
        options = own[own.index("--") + 1:]
        own = own[:own.index("--")]
    args = parser.parse_args(own)
    counts = [int(n) for n in args.threads.split(",")]
    if len(set(counts)) < 2:
        parser.error("--threads needs at least two numbers, found %s" % args.threads)
    best, results = {}, set()
    for _ in range(args.runs):
        for n in counts:
            phases, seconds, result = bake(args.level, n, options)
            results.add(result)
            old = best.setdefault(n, {})
            for name, x in [*phases.items(), ("all", seconds)]:
                old[name] = min(old.get(name, x), x)
    if len(results) != 1:
        raise SystemExit("the results differ between numbers of threads")
    first, last = best[counts[0]], best[counts[-1]]
    ratio = counts[0] / counts[-1]
    serial = {}
    print("| phase | " + " | ".join("%d" % n for n in counts) + " | serial part |")
    print("|---|" + "---|" * (len(counts) + 1))
    for name in first:
        s = (last[name] / max(first[name], 1e-9) - ratio) / (1 - ratio)
        serial[name] = min(max(s, 0.0), 1.0)
        row = ["%.2f" % best[n].get(name, 0.0) for n in counts]
        share = first[name] / first["all"]
        print("| %s | %s | %s |" % (name, " | ".join(row), "%.0f %%" % (100 * serial[name]) if share > 0.02 else ""))
    for n in sorted({4, 8, 16} - set(counts)):
        then = sum(first[p] * (serial[p] + (1 - serial[p]) / n) for p in first if p != "all")
        print("\nWith %d threads: %.2f s by the law, %.1f times as fast as one." % (n, then, first["all"] / then), end="")
    print()


if __name__ == "__main__":
    main()
