"""The truth: light at points of a level by path tracing, with its standard error.

Usage : python truth.py SCENE.glb POINTS.npz OUT.npz [--sky R,G,B] [--two-sided] [--paths 65536]
              [--target 0.002] [--time 300] [--seed 0] [--lift 5e-6] [--threads N]
Input : POINTS.npz  position [n, 3], or [n, S, 3] for means over S points (lumels.py): metres, world
                    normal    of the same shape: axis of the hemisphere, unit length
                    face      (optional) normals of the faces: nothing arrives from below them
Output: OUT.npz     irradiance [n, 3] of each channel, and stderr [n, 3], its standard error;
                    stderr_y [n], that of its luminance; paths, seconds, lost (samples that were not
                    finite and count as 0), and all other arrays of POINTS.npz
        One line of JSON.
Model : that of judge/trace.py and judge/scene.py, which is Lumel's. --two-sided: every surface
        reflects and emits on both sides, as in Cycles.
Stops : at --paths for each point, when the median relative standard error of luminance is below
        --target, or after --time seconds, but after 16 batches at the earliest.
Method: a batch is an additive recurrence in two dimensions for directions, another for light
        sources, each shifted at random for every point and batch, and goes through a point's S
        places in turn. Batches are independent, and the error is that of their mean.
Checks: truth_check.py (known answers), second_method.py (the tests' own path tracer).
"""
import argparse
import json
import os
import time

import numpy as np

from judge import scene as scenes

MODEL = "truth 1"       # for caches: increase when answers change
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
LANES = 1 << 19         # samples in a launch, and at most 1 / 256 of them of one point
# Bounces before roulette.  Variance times processor time, Cornell box and demo level: with 1 bounce
# 2.9 times that of 6 (box), with 4 1.14 and 1.21 times, with 9 1.12 and 1.29.
ROULETTE = 6
FEW = 100               # emissive triangles
BATCHES = 16            # fewer give no standard error worth its name: with 8 squares of z are 1.4 on average
# α_j = g^-j with g³ = g + 1 (Roberts 2018): the golden ratio of two dimensions, in 32-bit fractions
GOLDEN = [int(1.3247179572447460 ** -j * 2 ** 32) for j in (1, 2)]


def tracer_of(scene, two_sided=False, lift=5e-6):
    """a Tracer for long runs: paths that live longer than the judge's cost less than their noise, and
    one stratified point of a few emitters is better than one of several random ones"""
    from judge.trace import EMITTER_CANDIDATES, Tracer
    for m in scene.materials if two_sided else ():
        m.double_sided = True
    glow = np.array([m.emissive.any() for m in scene.materials])[scene.material]
    return Tracer(scene, lift, 1 if glow.sum() <= FEW else EMITTER_CANDIDATES, ROULETTE)


def batch(tracer, points, paths, seed, first):
    """mean irradiance [n, 3] by `paths` samples for each of the points (position, normal, face, each
    [n, S, 3], position relative to the tracer's centre), and how many samples were lost.
    `first`: samples that earlier batches took"""
    from judge.trace import dr, mi
    n, places = points[0].shape[:2]
    lane = dr.arange(mi.UInt32, n * paths)
    point, sample = lane // paths, lane % paths
    key = np.random.SeedSequence(seed).generate_state(4, np.uint64)
    # Opaque: one kernel for all batches
    key = [dr.opaque(mi.UInt64, int(x)) for x in key]
    rng = mi.PCG32(size=n * paths, initstate=key[0], initseq=key[1])
    shift = mi.PCG32(size=n, initstate=key[2], initseq=key[3])
    shift = [dr.gather(mi.UInt32, shift.next_uint32(), point) for _ in range(4)]
    u = [mi.Float((s + sample * g) >> 8) * 2.0 ** -24 for s, g in zip(shift, GOLDEN + GOLDEN)]
    at = point * places + (sample + dr.opaque(mi.UInt32, first % places)) % places
    p, normal, face = [dr.gather(kind, mi.Float(np.ascontiguousarray(a, np.float32).ravel()), at)
                       for kind, a in zip((mi.Point3f, mi.Vector3f, mi.Vector3f), points)]
    light = tracer.radiance(p + face * tracer.eps, normal, face, mi.Point2f(u[0], u[1]),
                            mi.Point2f(u[2], u[3]), rng, mi.Bool(True))
    fine = dr.isfinite(light.x) & dr.isfinite(light.y) & dr.isfinite(light.z)
    light = dr.select(fine, light, mi.Color3f(0))
    sums = [dr.block_sum(c, paths) for c in (light.x, light.y, light.z)]
    lost = dr.count(~fine)
    dr.eval(*sums, lost)
    return np.stack([c.numpy() for c in sums], 1).astype(float) * (np.pi / paths), int(lost[0])


def light(tracer, position, normal, face=None, paths=65536, target=0.0, seconds=np.inf, seed=0):
    """-> the arrays that OUT.npz has"""
    face = normal if face is None else face
    points = [np.asarray(a, float).reshape(len(position), -1, 3) for a in (position, normal, face)]
    points[0] = points[0] - tracer.centre
    n, start = len(position), time.time()
    # As many samples a batch as fit into a launch: the error falls faster than with their number.
    size = 1 << int(np.log2(max(1, min(LANES // 256, LANES // max(1, n), paths // BATCHES))))
    some = max(1, LANES // size)
    sums, squares, done, lost = np.zeros((n, 4)), np.zeros((n, 4)), 0, 0
    while True:
        for k in range(0, n, some):
            e, bad = batch(tracer, [a[k:k + some] for a in points], size, (seed, done, k), done * size)
            e = np.concatenate([e, e @ LUMINANCE[:, None]], 1)
            sums[k:k + some] += e
            squares[k:k + some] += e * e
            lost += bad
        done += 1
        if done < BATCHES:
            continue
        mean = sums / done
        error = np.sqrt(np.maximum(squares / done - mean ** 2, 0) / (done - 1))
        on = mean[:, 3] > 0
        noise = float(np.median(error[on, 3] / mean[on, 3])) if on.any() else 0.0
        if done * size >= paths or noise < target or time.time() - start > seconds:
            return dict(irradiance=mean[:, :3], stderr=error[:, :3], stderr_y=error[:, 3],
                        paths=done * size, seconds=time.time() - start, lost=lost, noise=noise)


def main():
    ap = argparse.ArgumentParser(description=__doc__,
                                 formatter_class=argparse.RawDescriptionHelpFormatter)
    ap.add_argument("scene")
    ap.add_argument("points")
    ap.add_argument("out")
    ap.add_argument("--sky")
    ap.add_argument("--two-sided", action="store_true")
    ap.add_argument("--paths", type=int, default=65536, help="for each point, at most")
    ap.add_argument("--target", type=float, default=0.0)
    ap.add_argument("--time", type=float, default=np.inf)
    ap.add_argument("--seed", type=int, default=0)
    ap.add_argument("--lift", type=float, default=5e-6, help="offset of rays, in halves of the scene's diagonal")
    ap.add_argument("--threads", type=int, default=0)
    a = ap.parse_args()
    from judge.trace import dr
    if a.threads:
        dr.set_thread_count(a.threads)
    scene = scenes.load(a.scene)
    if a.sky is not None:
        scene.sky = scenes.colour(a.sky)
    tracer = tracer_of(scene, a.two_sided, a.lift)
    points = dict(np.load(a.points))
    asked = [points.pop("position"), points.pop("normal"), points.pop("face", None)]
    found = light(tracer, *asked, a.paths, a.target, a.time, a.seed)
    np.savez_compressed(a.out, **points, **found)
    print(json.dumps(dict(scene=os.path.basename(a.scene), points=len(asked[0]), triangles=len(scene.corners),
                          **{k: found[k] for k in ("paths", "seconds", "lost", "noise")},
                          mean=found["irradiance"].mean(0).round(6).tolist())))


if __name__ == "__main__":
    main()
