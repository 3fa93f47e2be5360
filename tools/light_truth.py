"""The path tracer of truth.py with more features: surfaces that transmit light, suns with a disc,
spherical lamps, a limit on reflectance.

Usage : python light_truth.py SCENE.glb POINTS.npz OUT.npz [--spp 4096] [--batch 1024]
              [--target 0.002] [--time 300] [--sky R,G,B] [--honour-range]
              [--max-reflectance 0.98] [--sun-angle DEGREES] [--eps 5e-6] [--seed 0]
        python light_truth.py --check          tiny scenes with known answers
Input : as truth.py --area; POINTS.npz may have sub_face, the face normals: nothing arrives from
        below a face whose interpolated normal leans over it (Lumel's rule; in truth.py, such rays
        hit the face itself)
Output: as truth.py.
Model : with coverage α (1 if opaque, 0 or 1 for MASK, alpha for BLEND), transmission τ (factor ×
        red of its texture) and base colour c, a surface
        reflects  a share α (1 − τ), with min(c, max_reflectance)
        transmits T = (1 − α) + α τ c per channel, straight on: shadow rays multiply T over all
                  crossings; a path continues with probability 1 − α (1 − τ) and the weight
                  T / (1 − α (1 − τ))
        emits     α × emission: emissive glass adds it to the light that it transmits
                  (KHR_materials_emissive and _transmission)
        This is the same from both sides; the back of a single-sided material absorbs what it
        neither reflects nor transmits.
        Lamps with `radius` r are spheres of uniform radiance I / (π r²); suns with `angle`
        (diameter) are discs of uniform radiance with the given lux on a surface that faces them.
        Both are visible to shadow rays only and block nothing. A receiver inside a spherical lamp
        gets no light from it.
Method: that of truth.Tracer, next event estimation with MIS for triangles; when a path crosses a
        surface, it keeps the vertex from which it started.
"""
import argparse
import json
import sys
import time

import numpy as np

import common

sys.path.insert(0, common.SHARED)
import gltf_scene       # noqa: E402
import truth            # noqa: E402
from truth import dr, mi      # noqa: E402

# Up to this many lamps are all sampled at a receiver, or at later vertices. With more lamps, one is
# chosen by power, which is noisy next to a weak lamp.
ALL_LAMPS, ALL_LAMPS_FURTHER = 16, 4


def load(path, sun_angle=0.0):
    """gltf_scene.load(path) with `transmission`, `transmission_tex` on the materials and the sun's `angle` (diameter, degrees) on directional lights"""
    sc, doc = gltf_scene.load(path), gltf_scene._Doc(path)
    sc.linear = {}
    for m, js in zip(sc.materials, doc.js.get("materials", []) + [{}]):
        glass = js.get("extensions", {}).get("KHR_materials_transmission", {})
        m["transmission"] = float(glass.get("transmissionFactor", 0.0))
        m["transmission_tex"] = gltf_scene._tex(doc.js, glass.get("transmissionTexture")) if m["transmission"] > 0 else None
        if m["transmission_tex"]:
            i = m["transmission_tex"]["image"]
            sc.linear[i] = picture(doc, i)
    for lamp in sc.lights:
        lamp["angle"] = sun_angle if lamp["type"] == "directional" else 0.0
    return sc


def picture(doc, i):
    """image i as stored, float32 [H, W, 4] in 0..1"""
    import io
    from PIL import Image
    im = doc.js["images"][i]
    data = doc.view(im["bufferView"])[0] if "bufferView" in im else doc.uri(im["uri"])
    return np.asarray(Image.open(io.BytesIO(data)).convert("RGBA"), np.float32) / 255.0


class Tracer(truth.Tracer):
    """truth.Tracer of a scene of load()"""

    def __init__(self, sc, max_reflectance=0.98, **kw):
        super().__init__(sc, **kw)
        if self.through:
            raise ValueError("backface='through' is not supported here")
        self.limit = float(max_reflectance)
        m, used = sc.materials, np.unique(sc.mat)
        self.isblend = mi.Bool(np.array([x["alpha_mode"] == "BLEND" for x in m]))
        self.tau = mi.Float(np.array([x["transmission"] for x in m], np.float32))
        self.open = any(m[i]["alpha_mode"] in ("MASK", "BLEND") or m[i]["transmission"] > 0 for i in used)
        self._transmission_textures(sc, used)
        if self.nl:
            self.lradius = mi.Float(np.array([x.get("radius", 0.0) for x in sc.lights], np.float32))
            self.lcos = mi.Float(np.array([np.cos(np.radians(x.get("angle", 0.0)) / 2) for x in sc.lights], np.float32))

    def _transmission_textures(self, sc, used):
        m = sc.materials
        idx, flt = np.zeros((len(m), 7), np.uint32), np.zeros((len(m), 5), np.float32)
        flat = [self.tex.numpy()] if self.slot else []
        total = len(flat[0]) // 4 if flat else 0
        for i in used:
            t = m[i]["transmission_tex"]
            if t is None:
                continue
            im = sc.linear[t["image"]]
            idx[i] = (total + 1, im.shape[1], im.shape[0], t["wrap"][0], t["wrap"][1], t["texcoord"], t["nearest"])
            flt[i] = (*t["offset"], *t["scale"], t["rot"])
            flat.append(im.ravel())
            total += im.shape[0] * im.shape[1]
        if idx[:, 0].any():
            self.slot["transmission_tex"] = ([mi.UInt32(np.ascontiguousarray(idx[:, k])) for k in range(7)], [mi.Float(np.ascontiguousarray(flt[:, k])) for k in range(5)])
            self.tex = mi.Float(np.concatenate(flat))
            self.uv = [mi.Float(np.nan_to_num(u).astype(np.float32).ravel()) for u in sc.uv[:2]]

    def surface(self, mat, prim, uv, active):
        """-> base colour c, coverage α, transmission τ at hits"""
        b = mi.Vector4f(dr.gather(mi.Vector4f, self.base, mat, active))
        if "base_tex" in self.slot:
            b *= self.texture("base_tex", mat, prim, uv, active)
        if self.has_col:
            b *= self.bary(self.col, 4, prim, uv, active)
        b = dr.clip(b, 0, 1)
        if not self.open:
            return mi.Color3f(b.x, b.y, b.z), mi.Float(1), mi.Float(0)
        hole = dr.gather(mi.Bool, self.ismask, mat, active) & (b.w < dr.gather(mi.Float, self.cut, mat, active))
        cover = dr.select(dr.gather(mi.Bool, self.isblend, mat, active), b.w, dr.select(hole, 0.0, 1.0))
        tau = mi.Float(dr.gather(mi.Float, self.tau, mat, active))
        if "transmission_tex" in self.slot:
            tau *= self.texture("transmission_tex", mat, prim, uv, active).x
        return mi.Color3f(b.x, b.y, b.z), cover, dr.clip(tau, 0, 1)

    @dr.syntax
    def passes(self, o, d, dist, active):
        """transmittance per channel from the distance dist along d to o"""
        share = mi.Color3f(1)
        if dr.hint(self.open, mode="scalar"):
            done = mi.Float(0)
            go = mi.Bool(active)
            i = mi.UInt32(0)
            while go & (i < 256):
                ray = mi.Ray3f(mi.Point3f(o + d * done), d)
                ray.maxt = dist - done
                pi = self.scene.ray_intersect_preliminary(ray, coherent=False, active=go)
                ok = pi.is_valid() & go
                mat = dr.gather(mi.UInt32, self.mat, pi.prim_index, ok)
                c, a, t = self.surface(mat, pi.prim_index, pi.prim_uv, ok)
                share *= dr.select(ok, (1 - a) + c * (a * t), mi.Color3f(1))
                done += dr.select(ok, pi.t + self.eps, 0)
                go = ok & (dr.max(share) > 0) & (done < dist)
                i += 1
        else:
            ray = mi.Ray3f(o, d)
            ray.maxt = dist
            share = dr.select(self.scene.ray_test(ray, coherent=False, active=active), mi.Color3f(0), mi.Color3f(1))
        return dr.select(active, share, mi.Color3f(0))

    def lit_by_triangles(self, p, n, face, u, active):
        prim, ru, _ = self.table.sample_reuse_pmf(u.x, active)
        s = dr.sqrt(1 - ru)
        uv = mi.Point2f(u.y * s, 1 - s)
        q = mi.Point3f(self.bary(self.tri, 3, prim, uv, active))
        gn = dr.gather(mi.Vector3f, self.gn, prim, active)
        mat = dr.gather(mi.UInt32, self.mat, prim, active)
        v = q - p
        d2 = dr.maximum(dr.squared_norm(v), 1e-20)
        dist = dr.sqrt(d2)
        d = v / dist
        cr, cl = dr.dot(n, d), -dr.dot(gn, d)
        cl = dr.select(dr.gather(mi.Bool, self.two, mat, active), dr.abs(cl), cl)
        ok = active & (cr > 0) & (cl > 1e-6) & (dr.dot(face, d) > 0)
        pw = dr.gather(mi.Float, self.tripdf, prim, active) * d2 / dr.maximum(cl, 1e-6)
        pb = cr / dr.pi
        w = pw * pw / (pw * pw + pb * pb)
        _, a, _ = self.surface(mat, prim, uv, ok)
        share = self.passes(p, d, dist - self.eps, ok)
        return dr.select(ok, share * self.emission(mat, prim, uv, ok) * (a * pb * w / pw), mi.Color3f(0))

    def lit_by_lamp(self, p, n, face, i, u, active):
        lp = dr.gather(mi.Point3f, self.lp, i, active)
        ld = dr.gather(mi.Vector3f, self.ld, i, active)
        far = dr.gather(mi.Bool, self.lk, i, active)
        r = dr.gather(mi.Float, self.lradius, i, active)
        v = lp - p
        d2 = dr.maximum(dr.squared_norm(v), 1e-12)
        centre = dr.sqrt(d2)
        axis = dr.select(far, -ld, v / centre)
        # Uniform in the cone of the lamp: solid angle times L is 2 / (1 + cos θ) times the
        # contribution of a point lamp.
        edge = dr.select(far, dr.gather(mi.Float, self.lcos, i, active), dr.sqrt(dr.maximum(1 - r * r / d2, 0)))
        # 1 − cos θ without cancellation for a distant lamp
        span = dr.select(far, 1 - edge, (r * r / d2) / (1 + edge))
        fall = u.x * span
        sin = dr.sqrt(dr.maximum(fall * (2 - fall), 0))
        phi = 2 * dr.pi * u.y
        d = dr.normalize(mi.Frame3f(axis).to_world(mi.Vector3f(sin * dr.cos(phi), sin * dr.sin(phi), 1 - fall)))
        d = dr.select(span > 0, d, axis)
        dist = dr.select(far, 8 * self.radius, centre * (1 - fall) - dr.sqrt(dr.maximum(r * r - d2 * sin * sin, 0)))
        att = dr.clip(-dr.dot(axis, ld) * dr.gather(mi.Float, self.lscale, i, active) + dr.gather(mi.Float, self.loff, i, active), 0, 1)
        att = att * att * dr.select(far, 1, 1 / d2) * 2 / (1 + edge)
        if self.honour_range:
            reach = dr.gather(mi.Float, self.lrange, i, active)
            att *= dr.select(far | (reach <= 0), 1, dr.clip(1 - dr.square(dr.square(centre / reach)), 0, 1))
        cr = dr.dot(n, d)
        ok = active & (cr > 0) & (att > 0) & (dr.dot(face, d) > 0) & (far | (d2 > r * r))
        share = self.passes(p, d, dist, ok)
        return dr.select(ok, share * mi.Color3f(dr.gather(mi.Vector3f, self.lc, i, active)) * (att * cr / dr.pi), mi.Color3f(0))

    def lit(self, p, n, face, u, rng, active, all_lamps):
        """radiance · cos / π of light directly on p"""
        r = mi.Color3f(0)
        if self.has_area:
            r += self.lit_by_triangles(p, n, face, u, active)
        if self.nl and all_lamps:
            for i in range(self.nl):
                r += self.lit_by_lamp(p, n, face, mi.UInt32(i), mi.Point2f(rng.next_float32(), rng.next_float32()), active)
        elif self.nl:
            i, pmf = self.ltable.sample_pmf(rng.next_float32(), active)
            r += self.lit_by_lamp(p, n, face, i, mi.Point2f(rng.next_float32(), rng.next_float32()), active) / pmf
        return r

    @dr.syntax
    def gathered(self, p, n, face, rng, u1, u2, active, bounces):
        """E/π at p (already offset), one path per lane"""
        L = self.lit(p, n, face, u2, rng, active, self.nl <= ALL_LAMPS)
        d = self.cosine(n, u1)
        pb = dr.maximum(dr.dot(n, d), 0) / dr.pi
        T = mi.Color3f(1)
        o = mi.Point3f(p)
        start = mi.Point3f(p)
        depth = mi.UInt32(0)
        crossed = mi.UInt32(0)
        act = active & (pb > 0) & (dr.dot(face, d) > 0)
        sky = mi.Color3f(*self.sky)
        while act:
            pi = self.scene.ray_intersect_preliminary(mi.Ray3f(o, d), coherent=False, active=act)
            ok = pi.is_valid() & act
            L += dr.select(act & ~ok, T * sky, mi.Color3f(0))
            act &= ok
            prim = mi.UInt32(pi.prim_index)
            uv = mi.Point2f(pi.prim_uv)
            gn = dr.gather(mi.Vector3f, self.gn, prim, act)
            mat = dr.gather(mi.UInt32, self.mat, prim, act)
            back = dr.dot(gn, d) > 0
            acts = act & (~back | dr.gather(mi.Bool, self.two, mat, act))
            q = mi.Point3f(self.bary(self.tri, 3, prim, uv, act))
            c, a, t = self.surface(mat, prim, uv, act)
            if dr.hint(self.has_area, mode="scalar"):
                pa = dr.gather(mi.Float, self.tripdf, prim, act)
                pl = pa * dr.squared_norm(q - start) / dr.maximum(dr.abs(dr.dot(gn, d)), 1e-6)
                w = pb * pb / (pb * pb + pl * pl)
                L += dr.select(acts, T * self.emission(mat, prim, uv, acts) * (a * w), mi.Color3f(0))
            on = act
            turn = acts & (depth < bounces)
            if dr.hint(self.open, mode="scalar"):
                rest = 1 - a * (1 - t)
                on = act & (rng.next_float32() < rest) & (crossed < 512)
                turn &= ~on
                T *= dr.select(on, ((1 - a) + c * (a * t)) / dr.maximum(rest, 1e-8), mi.Color3f(1))
                crossed += dr.select(on, 1, 0)
            else:
                on = mi.Bool(False)
            T *= dr.select(turn, dr.minimum(c, self.limit), mi.Color3f(1))
            depth += dr.select(turn, 1, 0)
            rr = dr.select(turn & (depth >= 6), dr.minimum(dr.max(T), 0.95), 1)
            turn &= (dr.max(T) > 0) & (rng.next_float32() < rr)
            T /= dr.maximum(rr, 1e-8)
            fn = dr.select(back, -gn, gn)
            here = mi.Point3f(q + fn * self.eps)
            L += T * self.lit(here, fn, fn, mi.Point2f(rng.next_float32(), rng.next_float32()), rng, turn, self.nl <= ALL_LAMPS_FURTHER)
            away = self.cosine(fn, mi.Point2f(rng.next_float32(), rng.next_float32()))
            o = dr.select(turn, here, mi.Point3f(q + d * self.eps))
            start = dr.select(turn, here, start)
            d = dr.select(turn, away, d)
            pb = dr.select(turn, dr.maximum(dr.dot(fn, away), 0) / dr.pi, pb)
            act &= (turn | on) & (pb > 0) & (dr.max(T) > 0)
        return L

    def batch(self, pos, nrm, k, seed, bounces):
        """As truth.Tracer.batch; nrm [n, S, 6] holds the hemisphere's axis and the face's normal"""
        n, S = pos.shape[:2]
        a = int(np.sqrt(k))
        while k % a:
            a -= 1
        b = k // a
        i = dr.arange(mi.UInt32, n * k)
        pt, s = i // k, i % k
        a64, b64 = [int(x) for x in np.random.SeedSequence(seed).generate_state(2, np.uint64)]
        rng = mi.PCG32(size=n * k, initstate=dr.opaque(mi.UInt64, a64), initseq=dr.opaque(mi.UInt64, b64))
        P, N, F = [mi.Float(np.ascontiguousarray(x, np.float32).ravel()) for x in (pos - self.centre, nrm[..., :3], nrm[..., 3:])]
        odd = 2 * int(b64 % 512) + 1
        while np.gcd(odd, S) > 1:
            odd += 2
        pick = pt * S + (s * dr.opaque(mi.UInt32, odd) + dr.opaque(mi.UInt32, int(a64 % S))) % S
        p, nn, face = dr.gather(mi.Point3f, P, pick), dr.gather(mi.Vector3f, N, pick), dr.gather(mi.Vector3f, F, pick)
        p += face * self.eps
        r = [rng.next_float32() for _ in range(4)]
        u1 = mi.Point2f((mi.Float(s % a) + r[0]) / a, (mi.Float(s // a) + r[1]) / b)
        u2 = mi.Point2f(dr.minimum((mi.Float(s) + r[2]) / k, 0.99999994), r[3])
        L = self.gathered(p, nn, face, rng, u1, u2, mi.Bool(True), mi.UInt32(bounces))
        out = [dr.block_sum(c, k) for c in (L.x, L.y, L.z)]
        dr.eval(*out)
        return np.stack([np.asarray(c.numpy(), np.float64) for c in out], 1) * (np.pi / k)


# -- tiny scenes with known answers -----------------------------------------------------------------------------------------------
def quad(height, half, up=True):
    """two triangles of a square parallel to the floor"""
    c = np.array([[-half, height, -half], [-half, height, half], [half, height, half], [half, height, -half]], float)
    return c[[[0, 1, 2], [0, 2, 3]]] if up else c[[[0, 2, 1], [0, 3, 2]]]


def material(**kw):
    m = dict(name="", base=np.array([0.5, 0.5, 0.5, 1.0]), base_tex=None, emissive=np.zeros(3), emissive_tex=None, double_sided=True, alpha_mode="OPAQUE",
             alpha_cutoff=0.5, transmission=0.0, transmission_tex=None)
    m.update(kw)
    return m


def tiny(parts, lights=()):
    """a scene of [(triangles, material)]"""
    sc = gltf_scene.Scene()
    sc.tri = np.concatenate([t for t, _ in parts])
    g = np.cross(sc.tri[:, 1] - sc.tri[:, 0], sc.tri[:, 2] - sc.tri[:, 0])
    sc.nrm = np.repeat((g / np.linalg.norm(g, axis=1, keepdims=True))[:, None], 3, 1)
    sc.uv = [np.zeros((len(sc.tri), 3, 2))] * 4
    sc.col = np.ones((len(sc.tri), 3, 4))
    sc.mat = np.concatenate([np.full(len(t), k, np.int32) for k, (t, _) in enumerate(parts)])
    sc.materials, sc.images, sc.linear = [m for _, m in parts], [], {}
    sc.lights = [dict(dict(type="point", color=np.ones(3), intensity=10.0, range=None, inner=0.0, outer=np.pi / 4, pos=np.array([0.0, 2, 0]),
                           dir=np.array([0.0, -1, 0])), **x) for x in lights]
    return sc


def answer(sc, spp=1 << 18, **kw):
    """E at the origin of the floor, its standard error, and how far from the floor the receiver stands"""
    up = np.array([[[0.0, 1, 0, 0, 1, 0]]])
    tracer = Tracer(sc, **kw)
    e, se, _ = tracer.irradiance(np.zeros((1, 1, 3)), up, spp, 4096)
    return e[0], se[0], tracer.eps


def check():
    """Prints name, expected, found, standard error of each; -> True if all are within 4 standard errors plus the known deviation"""
    floor = (quad(0, 5), material(base=np.array([0.0, 0, 0, 1])))

    def pane(h=1.0, base=(0, 0, 0), alpha=1.0, mode="BLEND", tau=0.0, emit=0.0):
        return quad(h, 5, up=False), material(base=np.array([*base, alpha], float), alpha_mode=mode, transmission=tau, emissive=np.full(3, emit))
    point = [dict()]
    e0 = 10 / 4     # I / d²
    sphere = lambda r: [dict(radius=r)]     # noqa: E731
    sun = lambda a: [dict(type="directional", intensity=3.0, angle=a)]     # noqa: E731
    wide = (quad(1.0, 300, up=False),)
    white = material(base=np.array([0.99, 0.99, 0.99, 1]), emissive=np.ones(3))
    red = np.array([0.8, 0.4, 0.1])
    cases = [
        ("point over a floor", tiny([floor], point), {}, [e0] * 3),
        ("pane of alpha 0.25", tiny([floor, pane(alpha=0.25)], point), {}, [0.75 * e0] * 3),
        ("two panes of alpha 0.25", tiny([floor, pane(alpha=0.25), pane(1.5, alpha=0.25)], point), {}, [0.75 ** 2 * e0] * 3),
        ("glass τ = 0.7, coloured", tiny([floor, pane(base=red, mode="OPAQUE", tau=0.7)], point), {"max_reflectance": 0.0}, list(0.7 * red * e0)),
        ("BLEND glass α = 0.5, τ = 0.7", tiny([floor, pane(base=red, alpha=0.5, tau=0.7)], point), {"max_reflectance": 0.0}, list((0.5 + 0.35 * red) * e0)),
        ("sky through BLEND glass", tiny([(quad(0, 300), floor[1]), (wide[0], material(base=np.array([*red, 0.5]), alpha_mode="BLEND", transmission=0.7))]),
         {"sky": (1, 1, 1), "max_reflectance": 0.0}, list((0.5 + 0.35 * red) * np.pi)),
        ("glowing glass, τ = 1, α = 0.5", tiny([(quad(0, 300), floor[1]), (wide[0], material(base=np.array([*red, 0.5]), alpha_mode="BLEND", transmission=1.0, emissive=np.full(3, 2.0)))]),
         {"max_reflectance": 0.0}, [np.pi * 2 * 0.5] * 3),
        # a sphere entirely above the horizon is equivalent to a point
        ("sphere lamp r = 0.5", tiny([floor], sphere(0.5)), {}, [e0] * 3),  # a
        ("sphere lamp r = 1.9", tiny([floor], sphere(1.9)), {}, [e0] * 3),
        ("sun of 20°", tiny([floor], sun(20.0)), {}, [3.0] * 3),
        ("furnace, ρ = 0.99 held to 0.5", tiny([(quad(0, 300), white), (wide[0], white)]), {"max_reflectance": 0.5}, [2 * np.pi] * 3),
        ("range of 3", tiny([floor], [dict(range=3.0)]), {"honour_range": True}, [e0 * (1 - (2 / 3) ** 4)] * 3),
    ]
    fine = True
    for name, sc, kw, want in cases:
        e, se, lift = answer(sc, **kw)
        # The receiver stands `lift` above the floor: I / d² grows by 2 lift / d, d = 2, and a window of range by less. A pane 600 wide at height 1 leaves
        # out what comes from below 0.19° above the horizon: 1.1e-5 of the cosine-weighted hemisphere. The rest is rounding of f32.
        good = bool((np.abs(e - want) <= 4 * se + (lift + 1.1e-5 + 1e-6) * np.array(want)).all())
        fine &= good
        print("%-34s want %s  found %s  ± %s  %s" % (name, np.round(want, 5), np.round(e, 5), np.round(se, 6), "ok" if good else "WRONG"))
    return fine


def main():
    ap = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ap.add_argument("scene", nargs="?")
    ap.add_argument("points", nargs="?")
    ap.add_argument("out", nargs="?")
    ap.add_argument("--check", action="store_true")
    ap.add_argument("--spp", type=int, default=4096)
    ap.add_argument("--batch", type=int, default=1024)
    ap.add_argument("--target", type=float)
    ap.add_argument("--time", type=float)
    ap.add_argument("--sky", default="0,0,0")
    ap.add_argument("--honour-range", action="store_true")
    ap.add_argument("--max-reflectance", type=float, default=0.98)
    ap.add_argument("--sun-angle", type=float, default=0.0)
    ap.add_argument("--eps", type=float, default=5e-6)
    ap.add_argument("--seed", type=int, default=0)
    ap.add_argument("--threads", type=int, default=0)
    a = ap.parse_args()
    truth.setup()
    if a.threads:
        dr.set_thread_count(a.threads)
    if a.check:
        sys.exit(0 if check() else 1)
    sc = load(a.scene, a.sun_angle)
    tr = Tracer(sc, a.max_reflectance, sky=[float(x) for x in a.sky.split(",")], honour_range=a.honour_range, eps=a.eps)
    z = dict(np.load(a.points))
    pos, nrm = z["sub_position"].astype(np.float64), z["sub_normal"].astype(np.float64)
    face = z["sub_face"].astype(np.float64) if "sub_face" in z else nrm
    t = time.time()
    e, se, spp = tr.irradiance(pos, np.concatenate([nrm, face], 2), a.spp, a.batch, a.target, a.time, seed=a.seed, log=lambda s: print(s, file=sys.stderr, flush=True))
    z.pop("sub_position"), z.pop("sub_normal"), z.pop("sub_face", None)
    z.update(irradiance=e, stderr=se, spp=spp, seconds=time.time() - t, meta=json.dumps(dict(vars(a), triangles=len(sc.tri), lights=len(sc.lights))))
    np.savez_compressed(a.out, **z)
    print(json.dumps(dict(points=len(pos), spp=spp, seconds=round(time.time() - t, 1), mean_E=e.mean(0).round(6).tolist())))


if __name__ == "__main__":
    main()
