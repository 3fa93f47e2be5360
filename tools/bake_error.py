"""Compare time and error of a build of lumel with its own bake at many rays, one line per scene.
This is for trying out ideas.

Usage : python bake_error.py [--scenes cornell,demo,sponza] [--quality draft,preview]
                             [--lumel BINARY] [--reference DIR] [--repeat 1]
                             [-- further options of `lumel bake`]
Steps : 1 find the reference of each scene under DIR (default $LUMEL_REF/bakes), or bake it there
          with BINARY at `production`, which takes minutes each; 2 bake; 3 compare the pages, lumel
          by lumel.
Output: one line per scene and quality: seconds, processor seconds, million rays, million
        instructions if `perf` is installed; over lit lumels (reference above a thousandth of its
        mean) relRMSE, median, 99th percentile and bias of all light; relRMSE and median of its
        indirect part (relative to the mean of all light, and to all light); and the bake's own
        error estimate.
Note  : Reference and bake share the first random points and the faults of the method, so errors
        that both have do not show. For true errors, use speed_error.py. Lumels that a wall cuts
        are not judged (`--hidden mean` averages over a lumel on both sides).
"""
import argparse
import json
import os
import re
import resource
import shutil
import subprocess
import sys
import time

import numpy as np

import common

ASSETS = os.path.join(common.HERE, "..", "assets")
SCENES = {
    "cornell": [os.path.join(ASSETS, "cornell_box.glb"), "--texels-per-unit", "13.53"],
    "demo": [os.path.join(ASSETS, "demo_level.glb"), "--sky", "0.25,0.35,0.5"],
    "sponza": [os.path.join(common.SCENES, "sponza", "sponza.glb"), "--sky", "1,1,1", "--sun", "0.3,-1,0.2,20"],
}
# Plain area means without post-processing, and light in its parts.
PLAIN = ["--hidden", "mean", "--no-stitch", "--layers", "direct,indirect,error,coverage"]
# The box is small enough for more rays.
FINE = {"cornell": ["--quality", "production", "--error", "0.004"]}
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])


def planes(directory):
    """{channel group: array} of all pages, and coverage; lumels only"""
    out = {}
    for path in common.outputs(directory)["pages"]:
        at = common.exr_channels(path)
        keep = at["coverage.Y"] > 0
        for group, prefix in (("all", ""), ("direct", "direct."), ("indirect", "indirect.")):
            out.setdefault(group, []).append(sum(w * at[prefix + c][keep] for w, c in zip(LUMINANCE, "RGB")))
        out.setdefault("error", []).append(at["error.Y"][keep])
    return {k: np.concatenate(v) for k, v in out.items()}


def compare(bake, truth):
    t = truth["all"]
    mean = t.mean()
    lit = t > 1e-3 * mean
    scale = t[lit] + 0.01 * mean
    rel = (bake["all"] - t)[lit] / scale
    ind = (bake["indirect"] - truth["indirect"])[lit] / scale
    rms = lambda x: 100 * float(np.sqrt((x * x).mean()))
    return dict(relRMSE=rms(rel), p50=100 * float(np.median(abs(rel))), p99=100 * float(np.quantile(abs(rel), 0.99)),
                bias=100 * float((bake["all"][lit].mean() / t[lit].mean()) - 1), indirect=rms(ind),
                indirect_p50=100 * float(np.median(abs(ind))), claimed=rms(bake["error"][lit] / scale))


def bake(binary, scene, out, options):
    command = [binary, "bake", *SCENES[scene], "-o", out, "-q", *PLAIN, *options]
    perf = shutil.which("perf")
    if perf:
        command = [perf, "stat", "-x,", "-e", "instructions:u", "--", *command]
    before = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
    start = time.time()
    run = subprocess.run(command, capture_output=True, text=True)
    if run.returncode != 0:
        raise SystemExit("lumel failed: " + run.stderr)
    count = re.search(r"^(\d+),", run.stderr, re.M)
    return time.time() - start, resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime - before, int(count.group(1)) / 1e6 if count else None


def main():
    argv, further = sys.argv[1:], []
    if "--" in argv:
        i = argv.index("--")
        argv, further = argv[:i], argv[i + 1:]
    ap = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ap.add_argument("--scenes", default=",".join(SCENES))
    ap.add_argument("--quality", default="draft,preview")
    ap.add_argument("--lumel", default=common.LUMEL)
    ap.add_argument("--reference", default=os.path.join(common.REF, "bakes"))
    ap.add_argument("--repeat", type=int, default=1)
    ap.add_argument("--work", default="/tmp/lumel-bake-error")
    a = ap.parse_args(argv)
    print("%-8s %-10s %7s %7s %7s %9s %8s %7s %8s %7s %9s %8s %8s   load %.1f" % (
        "scene", "quality", "s", "cpu s", "Mrays", "M instr", "relRMSE", "p50", "p99", "bias", "indirect", "p50", "claimed", os.getloadavg()[0]))
    for scene in a.scenes.split(","):
        reference = os.path.join(a.reference, scene)
        if not os.path.exists(os.path.join(reference, "done")):
            bake(a.lumel, scene, reference, FINE.get(scene, ["--quality", "production"]))
            open(os.path.join(reference, "done"), "w").close()
        truth = planes(reference)
        for quality in a.quality.split(","):
            out = os.path.join(a.work, scene + "-" + quality)
            times = sorted(bake(a.lumel, scene, out, ["--quality", quality, *further]) for _ in range(a.repeat))
            seconds, cpu, instructions = times[len(times) // 2]
            report = json.load(open(common.outputs(out)["report"]))
            c = compare(planes(out), truth)
            print("%-8s %-10s %7.2f %7.2f %7.1f %9.0f %7.2f%% %6.2f%% %7.1f%% %+6.2f%% %8.2f%% %7.2f%% %7.2f%%" % (
                scene, quality, seconds, cpu, (report["gather"]["lumel_rays"] + (report["gather"]["vertices"] or {}).get("rays", 0)) / 1e6, instructions or 0,
                c["relRMSE"], c["p50"], c["p99"], c["bias"], c["indirect"], c["indirect_p50"], c["claimed"]), flush=True)


if __name__ == "__main__":
    main()
