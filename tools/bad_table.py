"""Bake every hostile, broken or odd file and report the outcome of each.

Usage : python bad_table.py [DIR] [--out TABLE.md] [--tsv FILES.tsv] [--timeout 10]
                           [--memory-gib 2] [--jobs 1] [--limit N]
Input : DIR (default LUMEL_SCENES/bad); every .gltf and .glb below it is baked with draft quality
        and otherwise default options.
Checks: the bake ends within the time limit with exit code 0, 3 or 4 (2 if a referenced file is
        missing). On failure, stderr has exactly one line that starts with "error", and no output
        is left. On success, the outputs exist. There is never "panicked" or a signal, and peak
        resident memory is below the limit. MANIFEST.tsv, if present, adds the validator's verdict:
        valid files should bake or report "unsupported". That is a column, not a failure.
Output: a Markdown table by outcome, and a TSV by file. Exits with 1 if any check fails.
"""
import argparse
import collections
import concurrent.futures
import csv
import os
import re
import shutil
import sys
import tempfile

import common


def check(path, timeout, memory):
    out = tempfile.mkdtemp(prefix="lumel-bad-")
    try:
        r = common.run([common.LUMEL, "bake", path, "-o", os.path.join(out, "o"), "--quality", "draft", "-q"], timeout)
        left = sorted(os.path.join(d, f) for d, _, fs in os.walk(out) for f in fs)
        faults = []
        lines = [x for x in r["err"].splitlines() if x.strip()]
        errors = [x for x in lines if re.match(r"(lumel: )?error\b", x)]
        if r["timed_out"]:
            faults.append("over %g s" % timeout)
        elif r["code"] not in (0, 2, 3, 4):
            faults.append("exit %d" % r["code"])
        if "panicked" in r["err"]:
            faults.append("panicked")
        if r["peak_mb"] * (1 << 20) > memory:
            faults.append("%.0f MB" % r["peak_mb"])
        if r["code"] == 0:
            if not any(f.endswith(".exr") for f in left):
                faults.append("no lightmap")
        else:
            if len(errors) != 1:
                faults.append("%d error lines" % len(errors))
            if left:
                faults.append("%d files left" % len(left))
        if any(f.endswith((".tmp", ".part")) for f in left):
            faults.append("temporary file left")
        message = (errors or lines or [""])[0]
        return dict(code="timeout" if r["timed_out"] else r["code"], seconds=r["seconds"], mb=r["peak_mb"], faults=faults, message=message[:240])
    finally:
        shutil.rmtree(out, ignore_errors=True)


def main():
    ap = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ap.add_argument("dir", nargs="?", default=os.path.join(common.SCENES, "bad"))
    ap.add_argument("--out")
    ap.add_argument("--tsv")
    ap.add_argument("--timeout", type=float, default=10)
    ap.add_argument("--memory-gib", type=float, default=2)
    ap.add_argument("--jobs", type=int, default=1)
    ap.add_argument("--limit", type=int)
    a = ap.parse_args()
    verdicts = {}
    manifest = os.path.join(a.dir, "MANIFEST.tsv")
    if os.path.exists(manifest):
        with open(manifest, newline="") as f:
            verdicts = {row["path"]: row["verdict"] for row in csv.DictReader(f, delimiter="\t")}
    files = sorted(os.path.join(d, f) for d, _, fs in os.walk(a.dir) for f in fs if f.lower().endswith((".gltf", ".glb")))[: a.limit]
    memory = int(a.memory_gib * (1 << 30))
    with concurrent.futures.ThreadPoolExecutor(a.jobs) as pool:
        results = list(pool.map(lambda p: check(p, a.timeout, memory), files))
    meaning = {0: "baked", 2: "input/output failure", 3: "invalid input", 4: "unsupported feature"}
    table = collections.Counter()
    worst = collections.defaultdict(lambda: [0.0, 0.0])
    for path, r in zip(files, results):
        key = (meaning.get(r["code"], "exit %s" % r["code"]), verdicts.get(os.path.relpath(path, a.dir), "-"))
        table[key] += 1
        worst[key] = [max(worst[key][0], r["seconds"]), max(worst[key][1], r["mb"])]
    lines = ["| outcome | validator's verdict | files | slowest s | most MB |", "|---|---|---|---|---|"]
    lines += ["| %s | %s | %d | %.2f | %.0f |" % (k[0], k[1], n, *worst[k]) for k, n in sorted(table.items())]
    failed = [(p, r) for p, r in zip(files, results) if r["faults"]]
    lines += ["", "%d files, %d with a fault" % (len(files), len(failed))]
    lines += ["- `%s`: %s — %s" % (os.path.relpath(p, a.dir), ", ".join(r["faults"]), r["message"].replace("|", "\\|")) for p, r in failed]
    text = "\n".join(lines) + "\n"
    print(text)
    if a.out:
        open(a.out, "w").write(text)
    if a.tsv:
        with open(a.tsv, "w", newline="") as f:
            w = csv.writer(f, delimiter="\t")
            w.writerow(["path", "verdict", "code", "seconds", "peak_mb", "faults", "message"])
            for p, r in zip(files, results):
                rel = os.path.relpath(p, a.dir)
                w.writerow([rel, verdicts.get(rel, "-"), r["code"], "%.3f" % r["seconds"], "%.0f" % r["mb"], "; ".join(r["faults"]), r["message"]])
    sys.exit(1 if failed else 0)


if __name__ == "__main__":
    main()
