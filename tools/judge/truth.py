"""Path-traced views of a level: what its bake should look like.

view(tracer, camera, ...) -> dict of float32 images [h, w, 3]: `light` = Σ albedo R / Σ albedo over
the pixel's subpixels with R = E/π (denoised), `albedo`, `glow` (emission, and sky where nothing is
hit), `normal`, and `seen` [h, w], the share of the pixel that has a surface whose front, or either
side if double-sided, is seen.  Radiance is albedo · light + glow.  Further what the bake's view is
drawn from: `hits`, see `primary`.
Subpixels are a fixed grid of 2 × 2, the same for truth and bake, so that both have the same edges.
"""
import hashlib
import os
import time

import numpy as np

from . import scene as scenes
from .trace import GOLDEN, LUMINANCE, Tracer, dr, mi

SIDE = 2                        # subpixels along each side of a pixel
VERSION = 5                     # of the pictures; part of the cache's key
BATCHES = 4                     # of paths, from which the noise of a view's mean is told
NOISE = 0.003                   # standard error of that mean, relative; paths are added until ...
MOST = 8                        # ... there are this many times as many


def camera_rays(camera, width, height, centre):
    """-> origins, directions of SIDE² rays a pixel, subpixels next to each other"""
    y, x, sy, sx = np.meshgrid(np.arange(height), np.arange(width), np.arange(SIDE),
                               np.arange(SIDE), indexing="ij")
    t = np.tan(camera.yfov / 2)
    px = ((x + (sx + 0.5) / SIDE) / width * 2 - 1).ravel() * t * width / height
    py = (1 - (y + (sy + 0.5) / SIDE) / height * 2).ravel() * t
    d = np.stack([px, py, -np.ones_like(px)], 1)
    turn = camera.matrix[:3, :3] / np.linalg.norm(camera.matrix[:3, :3], axis=0)
    d = d / np.linalg.norm(d, axis=1, keepdims=True) @ turn.T
    o = np.broadcast_to(camera.matrix[:3, 3] - centre, d.shape)
    return o, d


def point3(kind, a):
    a = np.ascontiguousarray(np.asarray(a, np.float32).T)
    return kind(*[mi.Float(c) for c in a])


def primary(tracer, camera, width, height):
    """what each subpixel sees: dict of device arrays, and `np_`* copies of some of them"""
    o, d = camera_rays(camera, width, height, tracer.centre)
    o, d = point3(mi.Point3f, o), point3(mi.Vector3f, d)
    ok, triangle, uv, distance = tracer.hits(o, d)
    triangle = dr.select(ok, triangle, 0)
    face = dr.gather(mi.Vector3f, tracer.face, triangle, ok)
    mat = dr.gather(mi.UInt32, tracer.material, triangle, ok)
    back = dr.dot(face, d) > 0
    shows = ok & (~back | dr.gather(mi.Bool, tracer.two, mat, ok))
    albedo, cover, tau, _ = tracer.surface(mat, triangle, uv, shows)
    glow = dr.select(shows, tracer.emission(mat, triangle, uv, shows) * cover, mi.Color3f(0))
    glow = dr.select(ok, glow, tracer.sky)
    albedo = dr.select(shows, albedo * (1 - tau), mi.Color3f(0))
    p, n, side = tracer.receiver(triangle, uv, back, shows)
    out = dict(p=p, n=n, side=side, shows=shows, albedo=albedo, glow=glow, triangle=triangle,
               uv=uv, back=back, distance=distance, ok=ok, d=d)
    dr.eval(out)
    return out


def pixels(values, width, height):
    """mean over subpixels, [h, w, channels]"""
    a = values.numpy().astype(np.float32)
    a = a.reshape(1, -1) if a.ndim == 1 else a
    return a.reshape(len(a), height, width, -1).mean(3).transpose(1, 2, 0)


def gather(tracer, hit, width, height, paths, seed):
    """Σ albedo R of each pixel, and the sum for demodulation; `paths` a subpixel"""
    count = width * height * SIDE * SIDE
    lane = dr.arange(mi.UInt32, count)
    sub, pixel = lane % (SIDE * SIDE), lane // (SIDE * SIDE)
    key = np.random.SeedSequence(seed).generate_state(2, np.uint64)
    # Opaque, and evaluated before the loop: one kernel for all passes and all views
    key = [dr.opaque(mi.UInt64, int(x)) for x in key]
    rng = mi.PCG32(size=count, initstate=key[0], initseq=key[1])
    shift = mi.PCG32(size=width * height, initstate=key[1], initseq=key[0])
    shift = [dr.gather(mi.UInt32, shift.next_uint32(), pixel) for _ in range(4)]
    total = dr.zeros(mi.Color3f, count)
    dr.eval(rng, shift, total)
    for k in range(paths):
        n = sub + dr.opaque(mi.UInt32, k * SIDE * SIDE)
        u = [mi.Float((s + n * g) >> 8) * 2.0 ** -24 for s, g in zip(shift, GOLDEN)]
        total += tracer.radiance(hit["p"], hit["n"], hit["side"], mi.Point2f(u[0], u[1]),
                                 mi.Point2f(u[2], u[3]), rng, hit["shows"])
        dr.eval(total, rng)
    total = dr.select(dr.isfinite(total), total, 0) / paths
    return pixels(hit["albedo"] * total, width, height)


def denoised(colour, albedo, normal):
    """OIDN; albedo and normal have no noise of their own"""
    import pyoidn
    return pyoidn.denoise(*[np.ascontiguousarray(a, np.float32) for a in
                            (colour, np.clip(albedo, 0, 1), normal)], hdr=True, clean_aux=True)


def size_of(camera, width):
    return width, max(16, round(width / camera.aspect))


def view(tracer, camera, width=480, paths=8, seed=0):
    """-> images (see the head), `halves`: two independent `light` of half the paths each, denoised
    one by one, whose difference tells what noise is left in `light`; and `hits`"""
    width, height = size_of(camera, width)
    hit = primary(tracer, camera, width, height)
    albedo = pixels(hit["albedo"], width, height)
    normal = pixels(dr.select(hit["shows"], hit["n"], mi.Vector3f(0)), width, height)
    over = np.where(albedo > 1e-6, 1 / np.maximum(albedo, 1e-6), 0)
    batches = []
    while not batches or error > NOISE and len(batches) < MOST * BATCHES:
        for _ in range(max(BATCHES, len(batches))):
            batches.append(gather(tracer, hit, width, height, max(1, paths // BATCHES),
                                  (seed, len(batches))))
        light, error = unbiased(batches, over, albedo, normal)
    halves = [unbiased(batches[i::2], over, albedo, normal)[0] for i in (0, 1)]
    return dict(light=light, albedo=albedo, normal=normal,
                glow=pixels(hit["glow"], width, height),
                seen=pixels(mi.Float(hit["shows"]), width, height)[..., 0],
                halves=halves, raw=np.mean(batches, 0), hits=hit)


def unbiased(batches, over, albedo, normal):
    """-> the denoised light of batches of paths, as bright as they are on average, and the relative
    standard error of how bright that is. OIDN takes the few bright paths of a small flame for noise,
    and darkens the whole view by up to 2 %, which FLIP would hold against a bake"""
    light = denoised(np.mean(batches, 0) * over, albedo, normal)
    clean = (light * albedo) @ LUMINANCE
    lit = clean > 0.01 * clean.mean()
    if not lit.any():
        return light, 0.0
    means = [np.mean((b @ LUMINANCE)[lit] / clean[lit]) for b in batches]
    return light * np.mean(means), np.std(means, ddof=1) / len(means) ** 0.5


def key(path, width, paths):
    h = hashlib.sha256(repr((VERSION, width, paths)).encode())
    h.update(open(path, "rb").read())
    toml = os.path.splitext(path)[0] + ".lumel.toml"
    h.update(open(toml, "rb").read() if os.path.exists(toml) else b"")
    return h.hexdigest()[:20]


def references(path, cache, width=480, paths=8, log=print):
    """the truth of all cameras of a level, a list of dicts of view()'s images, from the cache if
    it is there"""
    name = os.path.join(cache, key(path, width, paths) + ".npz")
    if os.path.exists(name):
        z = np.load(name)
        return [{k[2:]: z[k].astype(np.float32) for k in z.files if k.startswith("%d/" % i)}
                for i in range(int(z["count"]))]
    level, start = scenes.load(path), time.time()
    if not level.cameras:
        raise scenes.Unsupported("no cameras")
    tracer, store, out = Tracer(level), dict(count=len(level.cameras)), []
    for i, camera in enumerate(level.cameras):
        v = view(tracer, camera, width, paths)
        v["half0"], v["half1"] = v.pop("halves")
        del v["hits"], v["raw"], v["normal"]
        # Half floats, here too: the same figures whether the cache was filled or not
        half = {k: np.minimum(a, 65504).astype(np.float16) for k, a in v.items()}
        out.append({k: a.astype(np.float32) for k, a in half.items()})
        store.update({"%d/%s" % (i, k): a for k, a in half.items()})
    os.makedirs(cache, exist_ok=True)
    np.savez_compressed(name + ".part.npz", **store)
    os.replace(name + ".part.npz", name)
    log("%s: truth of %d views in %.0f s" % (path, len(out), time.time() - start))
    return out


def digest(path):
    return hashlib.sha256(open(path, "rb").read()).hexdigest()[:16]
