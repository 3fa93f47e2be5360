"""Holds the judge's own tracer against known answers and against the tests' path tracer.

check(): a closed furnace, whose R is its emission / (1 − albedo) everywhere; then points of scenes
against `path-trace`, which shares no code with this: mean z, χ²/n and the difference of the sums.
"""
import os
import subprocess
import tempfile

import numpy as np

from . import scene as scenes
from .trace import LUMINANCE, Tracer, dr, mi
from .truth import point3


def irradiance(tracer, p, n, batches=16, k=256, seed=0):
    """E [n, 3] and its standard error at points (world), by flat faces"""
    count = len(p) * k
    pick = dr.arange(mi.UInt32, count) // k
    at = [dr.gather(kind, mi.Float(np.ascontiguousarray(a, np.float32).ravel()), pick)
          for kind, a in ((mi.Point3f, p - tracer.centre), (mi.Vector3f, n))]
    means = []
    for i in range(batches):
        key = np.random.SeedSequence((seed, i)).generate_state(2, np.uint64)
        key = [dr.opaque(mi.UInt64, int(x)) for x in key]
        rng = mi.PCG32(size=count, initstate=key[0], initseq=key[1])
        u = [rng.next_float32() for _ in range(4)]
        light = tracer.radiance(mi.Point3f(at[0] + at[1] * tracer.eps), at[1], at[1],
                                mi.Point2f(u[0], u[1]), mi.Point2f(u[2], u[3]), rng, mi.Bool(True))
        means.append(light.numpy().reshape(3, len(p), k).mean(2).T * np.pi)
    means = np.array(means, float)
    return means.mean(0), means.std(0, ddof=1) / np.sqrt(batches)


def points(scene, count, seed=1):
    """by area, on front faces that emit nothing"""
    c = scene.corners
    g = np.cross(c[:, 1] - c[:, 0], c[:, 2] - c[:, 0])
    area = np.linalg.norm(g, axis=1) / 2
    dark = np.array([not m.emissive.any() for m in scene.materials])[scene.material]
    weight = area * (dark if dark.any() else 1)
    rng = np.random.default_rng(seed)
    t = rng.choice(len(area), count, p=weight / weight.sum())
    b = rng.dirichlet([1, 1, 1], count)
    return (c[t] * b[..., None]).sum(1), g[t] / (2 * area[t, None])


def check(assets, path_trace, scenes_dir=None):
    for name, share in (("furnace_cube_50", 0.5), ("furnace_cube_90", 0.9)):
        s = scenes.load(os.path.join(assets, name + ".glb"))
        glow = max((m.emissive for m in s.materials), key=lambda e: e.sum())
        e, se = irradiance(Tracer(s), *points(s, 50))
        want = np.pi * glow / (1 - share)
        print("%s: E / known %.5f ± %.5f" % (name, (e / want).mean(), (se / want).mean() / 7))
    for path, sky in ((os.path.join(assets, "cornell_box.glb"), (0, 0, 0)),
                      *((os.path.join(scenes_dir, n), k) for n, k in (
                          ("skylit_room.glb", (1, 1.4, 2)), ("coloured_room.glb", (0, 0, 0)),
                          ("two_rooms_with_a_door.glb", (0, 0, 0))) if scenes_dir)):
        s = scenes.load(path)
        s.sky = np.array(sky, float)
        p, n = points(s, 100)
        e, se = irradiance(Tracer(s), p, n)
        with tempfile.NamedTemporaryFile("w", suffix=".csv") as f:
            np.savetxt(f, np.concatenate([p, n], 1), delimiter=",", fmt="%.9g")
            f.flush()
            r = subprocess.run([path_trace, path, f.name, "4096", "1",
                                ",".join("%g" % x for x in sky)], capture_output=True, text=True)
        if r.returncode:
            print(path, r.stderr[-300:])
            continue
        rows = [line.replace(",", " ").split() for line in r.stdout.splitlines()]
        other = np.array([x[:7] for x in rows if len(x) >= 7 and x[0][0].isdigit()], float)
        d, y = (e - other[:, :3]) @ LUMINANCE, other[:, :3] @ LUMINANCE
        s2 = other[:, 6] ** 2 + (se @ LUMINANCE) ** 2
        z = d[s2 > 0] / np.sqrt(s2[s2 > 0])
        print("%s: %d points, mean z %+.3f ± %.3f, χ²/n %.3f, worst |z| %.2f, sums differ "
              "%+.3f ± %.3f %%" % (os.path.basename(path), len(z), z.mean(), len(z) ** -0.5,
                                   (z * z).mean(), np.abs(z).max(), 100 * d.sum() / y.sum(),
                                   100 * np.sqrt(s2.sum()) / y.sum()))
