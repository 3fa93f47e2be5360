"""Compares the tests' own path tracer with Mitsuba: two references that share no code must agree.

Usage : python second_method.py SCENE.glb [--count 300] [--seed 1] [--paths 65536] [--time 90]
                                 [--sky R,G,B]
Steps : 1 points by area, without emitters and without those nearer than 1 mm to an edge of their
          triangle, where Mitsuba's float32 ray offset of 5e-6 of the scene may start behind the
          next face; 2 truth.py estimates E there (Mitsuba's ray casting); 3 path-trace (cargo build
          --release -p lumel-tests --bin path-trace) does the same.
Output: a line of Markdown: number of points, mean z with its standard error 1/sqrt(n), chi2/n
          (1 +- sqrt(2/n)), largest |z|, the relative difference of the sums per channel with its
          standard error, and the median relative standard error of both. z is of luminance.
Environment: common.py, and PATH_TRACE (default ../target/release/path-trace).
"""
import argparse
import os
import subprocess
import sys
import tempfile
import time

import numpy as np

import common
import lumels
from judge import scene as scenes
from truth import LUMINANCE as LUM

PATH_TRACE = common._env("PATH_TRACE", "../target/release/path-trace")


def main():
    ap = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ap.add_argument("scene")
    ap.add_argument("--count", type=int, default=300)
    ap.add_argument("--seed", type=int, default=1)
    ap.add_argument("--paths", type=int, default=65536, help="for each point")
    ap.add_argument("--time", type=float, default=90, help="limit of truth.py, seconds")
    ap.add_argument("--sky", default="0,0,0")
    a = ap.parse_args()
    with tempfile.TemporaryDirectory() as d:
        points, found, csv = (os.path.join(d, n) for n in ("points.npz", "truth.npz", "points.csv"))
        p = lumels.points(scenes.load(a.scene, images=False), a.count, a.seed, 0.001)
        np.savez(points, **p)
        common.tool("truth.py", a.scene, points, found, "--paths", a.paths, "--time", a.time, "--sky", a.sky)
        t = dict(np.load(found))
        np.savetxt(csv, np.concatenate([p["position"], p["normal"]], 1), delimiter=",", fmt="%.17g")
        start = time.perf_counter()
        out = subprocess.run([PATH_TRACE, a.scene, csv, str(a.paths), str(a.seed), a.sky], check=True, capture_output=True, text=True)
        seconds = time.perf_counter() - start
        e = np.loadtxt(out.stdout.splitlines(), delimiter=",", ndmin=2)
    mean, error, y_error = e[:, :3], e[:, 3:6], e[:, 6]
    their_error = t["stderr_y"]
    difference, s = (mean - t["irradiance"]) @ LUM, np.hypot(y_error, their_error)
    # If neither has any error (darkness), they must be equal, without statistics.
    exact = np.abs(difference[s == 0]).max(initial=0)
    keep = s > 0
    z, n = difference[keep] / s[keep], int(keep.sum())
    bias = mean.sum(0) / t["irradiance"].sum(0) - 1
    bias_error = np.sqrt((error ** 2).sum(0) + (t["stderr"] ** 2).sum(0)) / mean.sum(0)
    y = mean @ LUM
    lit = y > 0
    print("| %s | %d | %+.3f ± %.3f | %.3f ± %.3f | %.2f | %s | %.2f / %.2f %% |" % (
        os.path.splitext(os.path.basename(a.scene))[0], n, z.mean(), n ** -0.5, (z ** 2).mean(), (2 / n) ** 0.5, np.abs(z).max(),
        ", ".join("%+.3f ± %.3f" % (100 * b, 100 * c) for b, c in zip(bias, bias_error)),
        100 * np.median(y_error[lit] / y[lit]), 100 * np.median(their_error[lit] / y[lit])))
    print("path-trace %.1f s; truth.py %.1f s, %d paths a point; %d points with no error on either side differ by at most %.3g" % (
        seconds, float(t["seconds"]), int(t["paths"]), len(keep) - n, exact), file=sys.stderr)
    for z_i, i in sorted(zip(z, np.nonzero(keep)[0]), key=lambda x: -abs(x[0]))[:5]:
        print("  z %+.2f at %s: %.5g ± %.2g, Mitsuba %.5g ± %.2g" % (z_i, p["position"][i].round(3), y[i], y_error[i], t["irradiance"][i] @ LUM, their_error[i]), file=sys.stderr)


if __name__ == "__main__":
    main()
