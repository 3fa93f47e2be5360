"""Light at points of a Scene by path tracing; Mitsuba casts the rays, the estimator is ours.

Model (Lumel's): every surface is Lambertian, reflects min(base colour × texture × COLOR_0, limit)
and emits on its front, or on both sides if double-sided; the back of a single-sided face blocks and
is black.  With coverage α (MASK: 0 or 1) and transmission τ a share (1 − α) + α τ c passes straight
on and α (1 − τ) reflects.  Spheres (radius) and discs (angle) shine with uniform radiance and are
seen by shadow rays only.  Where normals describe a round surface, light is gathered on that one
(lab/smooth.md); further along a path faces are flat.
Method: cosine-weighted directions and samples of emissive triangles joined by MIS (power
heuristic), lamps drawn by resampling among candidates, unlimited bounces with Russian roulette
from the first.  Samples of one pixel are an additive recurrence in four dimensions, shifted at
random.
Faces that coincide: single-sided ones are moved out along their normal by a fifth of the offset of
rays, so that of two that stand back to back each side sees the front.  Of two that face the same way
the first in the file is seen, as in Lumel: later ones are moved in by a tenth.
"""
import glob
import os

import numpy as np

from . import coincide

for _found in sorted(glob.glob("/usr/lib/*/libLLVM*19*so*")):
    os.environ.setdefault("DRJIT_LIBLLVM_PATH", _found)

import drjit as dr          # noqa: E402
import mitsuba as mi        # noqa: E402

mi.set_variant("llvm_ad_rgb")

LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
# Of so many candidates one lamp is asked.
CANDIDATES = 4
EMITTER_CANDIDATES = 6
# α_j = g^-j with g⁵ = g + 1 (Roberts 2018): the four-dimensional golden ratio, in 32-bit fractions.
GOLDEN = [int((1.1673039782614187 ** -j) * 2 ** 32) for j in (1, 2, 3, 4)]
REPEAT_CLAMP, REPEAT_MIRROR = 33071, 33648


def floats(a):
    return mi.Float(np.ascontiguousarray(a, np.float32).ravel())


def average_emission(scene, material, triangles):
    """mean luminance that triangles of a material emit, by 64 points each; sampling weights only"""
    m = scene.materials[material]
    full = float(m.emissive @ LUMINANCE)
    t = m.emissive_texture
    if t is None:
        return np.full(len(triangles), full)
    image, total = scene.images[t.image], np.zeros(len(triangles))
    rng = np.random.default_rng(1)
    for _ in range(64):
        b = rng.dirichlet([1, 1, 1], len(triangles))
        uv = np.einsum("nk,nkc->nc", b, scene.uv[t.coordinates][triangles])
        uv = (uv @ t.matrix[:, :2].T + t.matrix[:, 2]) % 1
        x = (uv * image.shape[1::-1]).astype(int) % image.shape[1::-1]
        total += image[x[:, 1], x[:, 0], :3] @ (m.emissive * LUMINANCE)
    return np.maximum(total / 64, 0.02 * full)


class Tracer:
    """the scene on the device; see `hits`, `receivers` and `radiance`"""

    def __init__(self, scene, lift=5e-6, candidates=EMITTER_CANDIDATES, roulette=1):
        """lift        offset of rays, in halves of the scene's diagonal
        candidates  points of emissive triangles of which one is asked
        roulette    bounces from which on paths end at random"""
        self.candidates, self.roulette = candidates, roulette
        points = scene.corners.reshape(-1, 3)
        low, high = points.min(0), points.max(0)
        self.centre = 0.5 * (low + high)
        radius = max(0.5 * float(np.linalg.norm(high - low)), 1e-3)
        offset = lift * radius
        self.far, self.eps = dr.opaque(mi.Float, 8 * radius), dr.opaque(mi.Float, offset)
        self.sky = mi.Color3f(*[dr.opaque(mi.Float, float(c)) for c in scene.sky])
        mats, count = scene.materials, len(scene.corners)
        corners = scene.corners - self.centre
        face = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        area = 0.5 * np.linalg.norm(face, axis=1)
        face /= np.maximum(2 * area, 1e-300)[:, None]
        two = np.array([m.double_sided for m in mats])
        out = np.where(two[scene.material], 0, 0.2)
        out[coincide.later(corners, face, 1e-7 * radius)] = -0.1
        corners = corners + offset * out[:, None, None] * face[:, None]
        mesh = mi.Mesh("level", 3 * count, count)
        parameters = mi.traverse(mesh)
        parameters["vertex_positions"] = floats(corners)
        parameters["faces"] = mi.UInt32(np.arange(3 * count, dtype=np.uint32))
        parameters.update()
        self.rays = mi.load_dict({"type": "scene", "mesh": mesh})
        self.corners, self.face = floats(corners), floats(face)
        self.smooth, self.curved = floats(scene.normals), mi.Bool(scene.curved)
        self.material, self.two = mi.UInt32(scene.material.astype(np.uint32)), mi.Bool(two)
        self.base = floats([m.base for m in mats])
        self.emissive = floats([m.emissive for m in mats])
        self.limit = floats([m.limit for m in mats])
        self.is_mask = mi.Bool([m.alpha_mode == "MASK" for m in mats])
        self.is_blend = mi.Bool([m.alpha_mode == "BLEND" for m in mats])
        self.cutoff = floats([m.cutoff for m in mats])
        self.tau = floats([m.transmission for m in mats])
        seen = [mats[i] for i in np.unique(scene.material)]
        self.open = any(m.alpha_mode in ("MASK", "BLEND") or m.transmission > 0 for m in seen)
        self.coloured = not np.allclose(scene.colours, 1)
        self.colours = floats(scene.colours if self.coloured else np.zeros(12))
        self._textures(scene, mats)
        self._emitters(scene, mats, area)
        self._lamps(scene, radius)

    # -- upload ---------------------------------------------------------------------------------
    def _textures(self, scene, mats):
        at, total, flat = {}, 0, []
        for number, image in scene.images.items():
            at[number] = total
            total += image.shape[0] * image.shape[1]
            flat.append(image.ravel())
        self.slots = {}
        for slot in ("base_texture", "emissive_texture", "transmission_texture"):
            rows, moves = np.zeros((len(mats), 7), np.uint32), np.zeros((len(mats), 6), np.float32)
            for i, m in enumerate(mats):
                t = getattr(m, slot)
                if t is None or t.image not in at:
                    continue
                h, w = scene.images[t.image].shape[:2]
                rows[i] = (at[t.image] + 1, w, h, *t.wrap, t.coordinates, t.nearest)
                moves[i] = t.matrix.ravel()
            if rows[:, 0].any():
                self.slots[slot] = ([mi.UInt32(np.ascontiguousarray(c)) for c in rows.T],
                                    [floats(c) for c in moves.T])
        if self.slots:
            self.texels = floats(np.concatenate(flat))
            self.uv = [floats(np.nan_to_num(u)) for u in scene.uv]

    def _emitters(self, scene, mats, area):
        power = np.zeros(len(area))
        for i in np.unique(scene.material):
            if mats[i].emissive.any():
                where = np.flatnonzero(scene.material == i)
                power[where] = area[where] * average_emission(scene, i, where)
        self.emitters = power.sum() > 0
        if self.emitters:
            share = power / power.sum()
            self.brightness = floats([max(m.emissive @ LUMINANCE, 1e-20) for m in mats])
            self.emitter = mi.DiscreteDistribution(share.astype(np.float32))
            self.density = floats(np.where(area > 0, share / np.maximum(area, 1e-300), 0))

    def _lamps(self, scene, radius):
        self.lamps = lamps = len(scene.lamps)
        if not lamps:
            return
        sun = np.array([x.kind == "directional" for x in scene.lamps])
        spot = np.array([x.kind == "spot" for x in scene.lamps])
        inner = np.cos([x.inner for x in scene.lamps])
        outer = np.cos([x.outer for x in scene.lamps])
        slope = 1 / np.maximum(0.001, inner - outer)
        intensity = np.array([x.intensity for x in scene.lamps])
        self.lamp_sun = mi.Bool(sun)
        self.lamp_at = floats([x.position - self.centre for x in scene.lamps])
        self.lamp_along = floats([x.direction for x in scene.lamps])
        self.lamp_power = floats(intensity)
        self.lamp_slope = floats(np.where(spot, slope, 0))
        self.lamp_shift = floats(np.where(spot, -outer * slope, 1))
        self.lamp_range = floats([x.range for x in scene.lamps])
        self.lamp_radius = floats([x.radius for x in scene.lamps])
        angle = np.radians([x.angle for x in scene.lamps]) / 2
        self.lamp_edge, self.lamp_sine = floats(np.cos(angle)), floats(np.sin(angle))
        self.lamp_bright = floats(intensity @ LUMINANCE)
        weight = intensity @ LUMINANCE * np.where(sun, 1, 100 / radius ** 2)
        weight = weight + 0.02 * weight.mean() + 1e-12
        self.lamp = mi.DiscreteDistribution((weight / weight.sum()).astype(np.float32))

    # -- surfaces -------------------------------------------------------------------------------
    def inside(self, array, width, triangle, uv, active):
        """what corners have, between them"""
        kind = {2: mi.Point2f, 3: mi.Vector3f, 4: mi.Vector4f}[width]
        a, b, c = [dr.gather(kind, array, triangle * 3 + k, active) for k in range(3)]
        return a * (1 - uv.x - uv.y) + b * uv.x + c * uv.y

    def texture(self, slot, mat, triangle, uv, active):
        rows, moves = self.slots[slot]
        start, w, h, ws, wt, channel, nearest = [dr.gather(mi.UInt32, r, mat, active) for r in rows]
        a, b, c, d, e, f = [dr.gather(mi.Float, m, mat, active) for m in moves]
        has = active & (start > 0)
        t = dr.select(channel == 1, self.inside(self.uv[1], 2, triangle, uv, has),
                      self.inside(self.uv[0], 2, triangle, uv, has))
        near = nearest == 1
        half = dr.select(near, 0.0, 0.5)
        x = (a * t.x + b * t.y + c) * mi.Float(w) - half
        y = (d * t.x + e * t.y + f) * mi.Float(h) - half
        fx, fy = x - dr.floor(x), y - dr.floor(y)
        fx, fy = dr.select(near, 0, fx), dr.select(near, 0, fy)

        def wrapped(x, size, mode):
            size = mi.Int32(dr.maximum(size, 1))
            i = mi.Int32(dr.floor(x))
            repeat = i - size * mi.Int32(dr.floor(mi.Float(i) / mi.Float(size)))
            mirror = i - 2 * size * mi.Int32(dr.floor(mi.Float(i) / mi.Float(2 * size)))
            mirror = dr.select(mirror < size, mirror, 2 * size - 1 - mirror)
            i = dr.select(mode == REPEAT_CLAMP, i,
                          dr.select(mode == REPEAT_MIRROR, mirror, repeat))
            return mi.UInt32(dr.clip(i, 0, size - 1))

        x0, x1 = wrapped(x, w, ws), wrapped(x + 1, w, ws)
        y0, y1 = wrapped(y, h, wt), wrapped(y + 1, h, wt)
        first = dr.select(has, start - 1, 0)

        def tap(i, j):
            return dr.gather(mi.Vector4f, self.texels, first + j * w + i, has)
        out = (tap(x0, y0) * (1 - fx) + tap(x1, y0) * fx) * (1 - fy) \
            + (tap(x0, y1) * (1 - fx) + tap(x1, y1) * fx) * fy
        return dr.select(has, out, mi.Vector4f(1))

    def surface(self, mat, triangle, uv, active):
        """-> reflectance, coverage α, transmission τ, tint c of what is transmitted"""
        b = mi.Vector4f(dr.gather(mi.Vector4f, self.base, mat, active))
        if "base_texture" in self.slots:
            b *= self.texture("base_texture", mat, triangle, uv, active)
        if self.coloured:
            b *= self.inside(self.colours, 4, triangle, uv, active)
        tint = mi.Color3f(b.x, b.y, b.z)
        c = dr.clip(tint, 0, dr.gather(mi.Float, self.limit, mat, active))
        if not self.open:
            return c, mi.Float(1), mi.Float(0), c
        hole = dr.gather(mi.Bool, self.is_mask, mat, active) \
            & (b.w < dr.gather(mi.Float, self.cutoff, mat, active))
        blend = dr.gather(mi.Bool, self.is_blend, mat, active)
        cover = dr.select(blend, dr.clip(b.w, 0, 1), dr.select(hole, 0.0, 1.0))
        tau = mi.Float(dr.gather(mi.Float, self.tau, mat, active))
        if "transmission_texture" in self.slots:
            tau *= self.texture("transmission_texture", mat, triangle, uv, active).x
        return c, cover, tau, dr.maximum(tint, 0)

    def emission(self, mat, triangle, uv, active):
        e = mi.Color3f(dr.gather(mi.Vector3f, self.emissive, mat, active))
        if "emissive_texture" in self.slots:
            t = self.texture("emissive_texture", mat, triangle, uv, active & (dr.max(e) > 0))
            e *= mi.Color3f(t.x, t.y, t.z)
        return e

    def cast(self, o, d, active):
        return self.rays.ray_intersect_preliminary(mi.Ray3f(o, d), coherent=False, active=active)

    @dr.syntax
    def passes(self, o, d, distance, active):
        """share of light, per channel, that reaches o from that far along d"""
        share = mi.Color3f(1)
        if dr.hint(self.open, mode="scalar"):
            done, go, i = mi.Float(0), mi.Bool(active), mi.UInt32(0)
            while go & (i < 256):
                ray = mi.Ray3f(mi.Point3f(o + d * done), d)
                ray.maxt = distance - done
                hit = self.rays.ray_intersect_preliminary(ray, coherent=False, active=go)
                ok = hit.is_valid() & go
                mat = dr.gather(mi.UInt32, self.material, hit.prim_index, ok)
                _, a, t, c = self.surface(mat, hit.prim_index, hit.prim_uv, ok)
                share *= dr.select(ok, (1 - a) + c * (a * t), mi.Color3f(1))
                done += dr.select(ok, hit.t + self.eps, 0)
                go = ok & (dr.max(share) > 0) & (done < distance)
                i += 1
        else:
            ray = mi.Ray3f(o, d)
            ray.maxt = distance
            blocked = self.rays.ray_test(ray, coherent=False, active=active)
            share = dr.select(blocked, mi.Color3f(0), mi.Color3f(1))
        return dr.select(active, share, mi.Color3f(0))

    # -- light ----------------------------------------------------------------------------------
    def triangle_point(self, p, n, face, u, active):
        """a point of the emissive triangles -> triangle, place in it, direction, distance, density
        per solid angle, and whether light may go that way"""
        triangle, rest, _ = self.emitter.sample_reuse_pmf(dr.minimum(u.x, 0.99999994), active)
        s = dr.sqrt(dr.maximum(1 - rest, 0))
        uv = mi.Point2f(u.y * s, 1 - s)
        v = mi.Point3f(self.inside(self.corners, 3, triangle, uv, active)) - p
        other = dr.gather(mi.Vector3f, self.face, triangle, active)
        mat = dr.gather(mi.UInt32, self.material, triangle, active)
        d2 = dr.maximum(dr.squared_norm(v), 1e-20)
        distance = dr.sqrt(d2)
        d = v / distance
        there = -dr.dot(other, d)
        there = dr.select(dr.gather(mi.Bool, self.two, mat, active), dr.abs(there), there)
        ok = active & (dr.dot(n, d) > 0) & (there > 1e-6) & (dr.dot(face, d) > 0)
        density = dr.gather(mi.Float, self.density, triangle, ok) * d2 / dr.maximum(there, 1e-6)
        return triangle, uv, d, distance, density, ok

    def by_light(self, pl, pc):
        """MIS weight of a sample by light against one by direction"""
        pl = pl * self.candidates
        return pl * pl / dr.maximum(pl * pl + pc * pc, 1e-30)

    def from_triangles(self, p, n, face, u, rng, active):
        """radiance · cos / π of emissive triangles, weighed by MIS; of some candidates one is
        asked, by what it would send without shadow"""
        total, value = mi.Float(0), mi.Float(1)
        best = (mi.UInt32(0), mi.Point2f(0), mi.Vector3f(n), mi.Float(1), mi.Float(0))
        for k in range(self.candidates):
            uk = u if k == 0 else mi.Point2f(rng.next_float32(), rng.next_float32())
            if k == 0:
                first = uk.x
            x = first + k / self.candidates
            x = dr.select(x >= 1, x - 1, x)
            triangle, uv, d, distance, pl, ok = self.triangle_point(
                p, n, face, mi.Point2f(x, uk.y), active)
            pc = dr.maximum(dr.dot(n, d), 0) / dr.pi
            sends = dr.select(ok, pc * self.by_light(pl, pc) / pl, 0)
            mat = dr.gather(mi.UInt32, self.material, triangle, ok)
            y = sends * dr.gather(mi.Float, self.brightness, mat, ok)
            total += y
            take = (y > 0) & (rng.next_float32() * total <= y)
            new = (triangle, uv, d, distance, sends)
            best = tuple(dr.select(take, a, b) for a, b in zip(new, best))
            value = dr.select(take, y, value)
        triangle, uv, d, distance, sends = best
        ok = active & (total > 0)
        mat = dr.gather(mi.UInt32, self.material, triangle, ok)
        _, a, _, _ = self.surface(mat, triangle, uv, ok)
        share = self.passes(p, d, distance - self.eps, ok)
        weight = a * sends * total / (self.candidates * value)
        return dr.select(ok, share * self.emission(mat, triangle, uv, ok) * weight, mi.Color3f(0))

    def lamp_unshadowed(self, p, n, face, i, u, active):
        """-> colour · cos / π without shadow, direction, distance, of one point of lamp i"""
        g = lambda kind, a: dr.gather(kind, a, i, active)     # noqa: E731
        sun, along, r = g(mi.Bool, self.lamp_sun), g(mi.Vector3f, self.lamp_along), \
            g(mi.Float, self.lamp_radius)
        v = g(mi.Point3f, self.lamp_at) - p
        d2 = dr.maximum(dr.squared_norm(v), 1e-12)
        centre = dr.sqrt(d2)
        axis = dr.select(sun, -along, v / centre)
        # Uniform in the cone that the lamp fills.
        edge = dr.select(sun, g(mi.Float, self.lamp_edge),
                         dr.sqrt(dr.maximum(1 - r * r / d2, 0)))
        span = dr.select(sun, 1 - edge, (r * r / d2) / (1 + edge))
        fall = u.x * span
        sine = dr.sqrt(dr.maximum(fall * (2 - fall), 0))
        phi = 2 * dr.pi * u.y
        d = mi.Frame3f(axis).to_world(
            mi.Vector3f(sine * dr.cos(phi), sine * dr.sin(phi), 1 - fall))
        d = dr.select(span > 0, dr.normalize(d), axis)
        front = centre * (1 - fall) - dr.sqrt(dr.maximum(r * r - d2 * sine * sine, 0))
        distance = dr.select(sun, self.far, front)
        cone = dr.clip(-dr.dot(axis, along) * g(mi.Float, self.lamp_slope)
                       + g(mi.Float, self.lamp_shift), 0, 1)
        reach = g(mi.Float, self.lamp_range)
        window = dr.clip(1 - dr.square(d2 / dr.square(dr.maximum(reach, 1e-20))), 0, 1)
        window = dr.select(sun | (reach <= 0), 1, window)
        fade = cone * cone * window * dr.select(sun, 1, 1 / d2) * 2 / (1 + edge)
        here = dr.dot(n, d)
        ok = active & (here > 0) & (fade > 0) & (dr.dot(face, d) > 0) & (sun | (d2 > r * r))
        power = mi.Color3f(g(mi.Vector3f, self.lamp_power))
        return dr.select(ok, power * (fade * here / dr.pi), mi.Color3f(0)), d, distance

    def lamp_promise(self, p, n, i, active):
        """a lamp's luminance at p by its centre, as if unshadowed; above 0 wherever it may shine"""
        g = lambda kind, a: dr.gather(kind, a, i, active)     # noqa: E731
        sun, along = g(mi.Bool, self.lamp_sun), g(mi.Vector3f, self.lamp_along)
        v = g(mi.Point3f, self.lamp_at) - p
        d2 = dr.maximum(dr.squared_norm(v), 1e-12)
        near = dr.rsqrt(d2)
        axis = dr.select(sun, -along, v * near)
        cone = dr.clip(-dr.dot(axis, along) * g(mi.Float, self.lamp_slope)
                       + g(mi.Float, self.lamp_shift), 0, 1)
        sine = dr.select(sun, g(mi.Float, self.lamp_sine), g(mi.Float, self.lamp_radius) * near)
        here = dr.maximum(dr.dot(n, axis) + dr.minimum(sine, 1), 0)
        return g(mi.Float, self.lamp_bright) * cone * cone * here * dr.select(sun, 1, 1 / d2)

    def from_lamps(self, p, n, face, rng, active, first):
        i, weight = mi.UInt32(0), mi.Float(1)
        if self.lamps > 1:
            # Resampled importance sampling (Talbot 2005): of some candidates one, by its promise.
            # Stratified over the table, so that of few lamps all are candidates.
            start, total, value = rng.next_float32(), mi.Float(0), mi.Float(1)
            for k in range(CANDIDATES):
                candidate, pmf = self.lamp.sample_pmf(
                    dr.minimum((start + k) / CANDIDATES, 0.99999994), active)
                y = self.lamp_promise(p, n, candidate, active)
                total += y / pmf
                take = (y > 0) & (rng.next_float32() * total * pmf <= y)
                i, value = dr.select(take, candidate, i), dr.select(take, y, value)
            weight = total / (CANDIDATES * value)
        u = mi.Point2f(rng.next_float32(), rng.next_float32())
        light, d, distance = self.lamp_unshadowed(p, n, face, i, u, active & (weight > 0))
        ok = active & (dr.max(light) > 0) & (weight > 0)
        return dr.select(ok, self.passes(p, d, distance, ok) * light * weight, mi.Color3f(0))

    def direct(self, p, n, face, u, rng, active, first):
        total = mi.Color3f(0)
        if self.emitters:
            total += self.from_triangles(p, n, face, u, rng, active)
        if self.lamps:
            total += self.from_lamps(p, n, face, rng, active, first)
        return total

    # -- paths ----------------------------------------------------------------------------------
    @dr.syntax
    def radiance(self, p, n, face, u1, u2, rng, active):
        """R = E/π at p, already off its face, one sample a lane"""
        total = self.direct(p, n, face, u2, rng, active, True)
        d = mi.Frame3f(n).to_world(mi.warp.square_to_cosine_hemisphere(u1))
        density = dr.maximum(dr.dot(n, d), 0) / dr.pi
        weight, o, last = mi.Color3f(1), mi.Point3f(p), mi.Point3f(p)
        depth, steps = mi.UInt32(0), mi.UInt32(0)
        go = active & (density > 0) & (dr.dot(face, d) > 0)
        while go:
            steps += 1
            hit = self.cast(o, d, go)
            ok = hit.is_valid() & go
            total += dr.select(go & ~ok, weight * self.sky, mi.Color3f(0))
            go = ok & (steps < 1024)
            triangle, uv = mi.UInt32(hit.prim_index), mi.Point2f(hit.prim_uv)
            side = dr.gather(mi.Vector3f, self.face, triangle, go)
            mat = dr.gather(mi.UInt32, self.material, triangle, go)
            q = mi.Point3f(self.inside(self.corners, 3, triangle, uv, go))
            back = dr.dot(side, d) > 0
            shows = go & (~back | dr.gather(mi.Bool, self.two, mat, go))
            c, a, t, tint = self.surface(mat, triangle, uv, go)
            if dr.hint(self.emitters, mode="scalar"):
                pl = dr.gather(mi.Float, self.density, triangle, shows) \
                    * dr.squared_norm(q - last) / dr.maximum(dr.abs(dr.dot(side, d)), 1e-6)
                share = a * (1 - self.by_light(pl, density))
                glow = self.emission(mat, triangle, uv, shows)
                total += dr.select(shows, weight * glow * share, mi.Color3f(0))
            stops = a * (1 - t)
            through = mi.Bool(False)
            if dr.hint(self.open, mode="scalar"):
                through = go & (rng.next_float32() >= stops)
                passed = ((1 - a) + tint * (a * t)) / dr.maximum(1 - stops, 1e-6)
                weight *= dr.select(through, passed, mi.Color3f(1))
            bounce = shows & ~through
            weight *= dr.select(bounce, c, mi.Color3f(1))
            depth += dr.select(bounce, mi.UInt32(1), mi.UInt32(0))
            survive = dr.select(bounce & (depth >= self.roulette), dr.minimum(dr.max(weight), 0.95), 1)
            go = (bounce | through) & (dr.max(weight) > 0) & (rng.next_float32() < survive)
            weight /= dr.maximum(survive, 1e-8)
            bounce &= go
            front = dr.select(back, -side, side)
            start = mi.Point3f(q + front * self.eps)
            u = mi.Point2f(rng.next_float32(), rng.next_float32())
            total += weight * self.direct(start, front, front, u, rng, bounce, False)
            turned = mi.Frame3f(front).to_world(mi.warp.square_to_cosine_hemisphere(
                mi.Point2f(rng.next_float32(), rng.next_float32())))
            d = dr.select(bounce, turned, d)
            density = dr.select(bounce, dr.maximum(dr.dot(front, d), 0) / dr.pi, density)
            o = dr.select(bounce, start, mi.Point3f(q + d * self.eps))
            last = dr.select(bounce, start, last)
        return total

    @dr.syntax
    def hits(self, o, d):
        """first surface a viewer sees -> valid, triangle, uv, distance.  BLEND counts from ½."""
        hit = self.cast(o, d, mi.Bool(True))
        ok, triangle = hit.is_valid(), mi.UInt32(hit.prim_index)
        uv, distance = mi.Point2f(hit.prim_uv), mi.Float(hit.t)
        if dr.hint(self.open, mode="scalar"):
            go, i = mi.Bool(ok), mi.UInt32(0)
            while go & (i < 256):
                mat = dr.gather(mi.UInt32, self.material, triangle, go)
                _, a, _, _ = self.surface(mat, triangle, uv, go)
                go &= a < 0.5
                more = self.cast(mi.Point3f(o + d * (distance + self.eps)), d, go)
                triangle = dr.select(go, more.prim_index, triangle)
                uv = dr.select(go, more.prim_uv, uv)
                distance = dr.select(go, distance + self.eps + more.t, distance)
                ok = dr.select(go, more.is_valid(), ok)
                go &= ok
                i += 1
        return ok, triangle, uv, distance

    def receiver(self, triangle, uv, back, active):
        """-> point of the gathering surface off its face, its normal, the face's, on the side"""
        face = dr.gather(mi.Vector3f, self.face, triangle, active)
        n = dr.normalize(self.inside(self.smooth, 3, triangle, uv, active))
        q = mi.Point3f(self.inside(self.corners, 3, triangle, uv, active))
        turned = dr.select(back, -1.0, 1.0)
        weights = [1 - uv.x - uv.y, uv.x, uv.y]
        at = [dr.gather(mi.Point3f, self.corners, triangle * 3 + k, active) for k in range(3)]
        rise, mean = mi.Float(0), mi.Vector3f(0)
        for k, w in enumerate(weights):
            nk = dr.gather(mi.Vector3f, self.smooth, triangle * 3 + k, active) * turned
            rise += w * dr.maximum(dr.dot(at[k] - q, nk), 0)
            mean += w * nk
        edges = [dr.norm(at[k] - at[(k + 1) % 3]) for k in range(3)]
        doubled = dr.norm(dr.cross(at[1] - at[0], at[2] - at[0]))
        longest = dr.maximum(dr.maximum(edges[0], edges[1]), edges[2])
        rise = dr.minimum(rise / (1 + dr.norm(mean)), 0.5 * doubled / dr.maximum(longest, 1e-20))
        rise = dr.select(dr.gather(mi.Bool, self.curved, triangle, active), rise, 0)
        n, face = n * turned, face * turned
        ok = dr.dot(n, face) > 1e-3
        n = dr.select(ok, n, face)
        start = mi.Point3f(q + face * self.eps)
        above = active & (rise > 0)
        hit = self.cast(start, n, above)
        rise = dr.select(above & (hit.t < 2 * rise), 0.5 * hit.t, rise)
        return mi.Point3f(start + n * rise), n, face
