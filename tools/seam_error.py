"""Measure the seams of a finished bake: the difference between bilinear lookups on the two sides of
chart borders.

Usage : python seam_error.py OUT_DIR ... [--angle 8] [--fold 65] [--no-rays] [--worst N] [--json]
Input : folders written by `lumel bake`: the lightmapped .glb (TEXCOORD_1, and extras.lightmap with
        page, offset and scale) and its EXR pages. The report is not read, and no code of the baker
        is used.
Output: one line per folder: number of samples, metres of seam, and the median, 99th percentile and
        maximum of |a - b| / (mean of both + 1 % of the map's mean), by luminance and weighted by
        the seam's length in texels, and the share above 1 %.

Border edges are edges of lightmap triangles that no other triangle on the page shares. Random points
are spread along each, half a texel apart. A point makes a sample with every other border edge that
- runs along it through the same point (to 0.05 texels and 1 % of the shorter edge),
- has a shading normal within --angle degrees and a plane within --fold degrees (across a sharper
  fold, each side has a different horizon), and
- has its triangle on the other side.
Samples with something standing on the seam are left out unless --no-rays is given, because light
may jump there. This is tested with a Mitsuba ray from half a texel on this side to half a texel on
the other, 0.2 texels above the surface. Samples with a side inside or behind something, which rays
that hit backfaces detect, are also left out. Each side searches for its own partners, so every seam
is measured twice, at different points.
"""
import argparse
import glob
import json
import os

import numpy as np
from scipy.spatial import cKDTree

import common
import flatten_lightmap
from judge import scene as scenes

LUM = np.array([0.2126, 0.7152, 0.0722])


def unit(v):
    return v / np.maximum(np.linalg.norm(v, axis=-1, keepdims=True), 1e-300)


def surfaces(path):
    """-> tri [n,3,3] world, nrm [n,3,3], texel [n,3,2] (NaN without a lightmap), page [n], two-sided [n], images by page"""
    doc = scenes.Document(path)
    js, folder = doc.js, os.path.dirname(os.path.abspath(path))
    flatten_lightmap.expand_instances(js, doc)
    images, out = {}, []

    def walk(ni, parent):
        node = js["nodes"][ni]
        m = parent @ scenes.local(node)
        place = node["extras"].get("lightmap") if isinstance(node.get("extras"), dict) else None
        if place and place["page"] not in images:
            images[place["page"]] = common.read_exr(os.path.join(folder, place["uri"])) @ LUM
        if "mesh" in node:
            for p in js["meshes"][node["mesh"]]["primitives"]:
                if p.get("mode", 4) != 4 or "POSITION" not in p["attributes"]:
                    continue
                at = {k: doc.accessor(v).astype(np.float64) for k, v in p["attributes"].items() if k in ("POSITION", "NORMAL", "TEXCOORD_1")}
                pos = at["POSITION"] @ m[:3, :3].T + m[:3, 3]
                f = (doc.accessor(p["indices"]).ravel().astype(int) if "indices" in p else np.arange(len(pos))).reshape(-1, 3)
                if np.linalg.det(m[:3, :3]) < 0:
                    f = f[:, [0, 2, 1]]
                tri = pos[f]
                geo = unit(np.cross(tri[:, 1] - tri[:, 0], tri[:, 2] - tri[:, 0]))
                nrm = np.repeat(geo[:, None], 3, 1)
                if "NORMAL" in at:
                    n = unit(at["NORMAL"] @ np.linalg.inv(m[:3, :3]))[f]
                    side = np.sign((n.mean(1) * geo).sum(-1))
                    nrm = n * np.where(side == 0, 1, side)[:, None, None]
                uv = np.full((len(f), 3, 2), np.nan)
                if place and "TEXCOORD_1" in at:
                    img = images[place["page"]]
                    uv = (at["TEXCOORD_1"] * place["scale"] + place["offset"])[f] * [img.shape[1], img.shape[0]]
                two = js["materials"][p["material"]].get("doubleSided", False) if "material" in p else False
                out.append((tri, nrm, uv, np.full(len(f), place["page"] if place else -1), np.full(len(f), two)))
        for c in node.get("children", []):
            walk(c, m)

    for r in js["scenes"][js.get("scene", 0)]["nodes"]:
        walk(r, np.eye(4))
    return [np.concatenate([o[k] for o in out]) for k in range(5)] + [images]


def bilinear(images, page, at):
    out = np.zeros(len(at))
    for p, img in images.items():
        k = page == p
        x, y = (at[k] - 0.5).T
        x0, y0 = np.floor(x).astype(int), np.floor(y).astype(int)
        fx, fy = x - x0, y - y0
        g = lambda r, c: img[np.clip(r, 0, img.shape[0] - 1), np.clip(c, 0, img.shape[1] - 1)]     # noqa: E731
        out[k] = (g(y0, x0) * (1 - fx) + g(y0, x0 + 1) * fx) * (1 - fy) + (g(y0 + 1, x0) * (1 - fx) + g(y0 + 1, x0 + 1) * fx) * fy
    return out


def ray_scene(tri):
    """-> Mitsuba, its scene of these triangles, the point that is its origin"""
    from judge.trace import mi
    mesh = mi.Mesh("all", 3 * len(tri), len(tri))
    centre = tri.reshape(-1, 3).mean(0)
    params = mi.traverse(mesh)
    params["vertex_positions"] = (tri.reshape(-1, 3) - centre).astype(np.float32).ravel()
    params["faces"] = np.arange(3 * len(tri), dtype=np.uint32)
    params.update()
    return mi, mi.load_dict(dict(type="scene", mesh=mesh)), centre


def free_between(scene, a, b):
    """whether the segments a-b hit no triangle"""
    mi, scene, centre = scene
    out = []
    for k in range(0, len(a), 1 << 18):
        o, d = (a[k:k + (1 << 18)] - centre).astype(np.float32), (b - a)[k:k + (1 << 18)].astype(np.float32)
        out.append(~np.array(scene.ray_test(mi.Ray3f(mi.Point3f(o.T), mi.Vector3f(d.T), 1.0, 0.0, []))))
    return np.concatenate(out)


def inside(scene, tri, two_sided, at, normal, cover, rng, rays=32):
    """whether the ray straight up from these points within the distance `cover`, or at least 90
    % of the rays in all directions, hit backs of single-sided faces, so that nobody sees the
    place"""
    mi, scene, centre = scene
    geo = np.cross(tri[:, 1] - tri[:, 0], tri[:, 2] - tri[:, 0])
    backs = np.zeros(len(at))
    above = np.zeros(len(at), bool)
    for i in range(rays + 1):
        v = rng.normal(size=at.shape)
        d = unit(normal + 0.999 * unit(v)) if i else normal
        hit = scene.ray_intersect_preliminary(mi.Ray3f(mi.Point3f((at - centre).astype(np.float32).T), mi.Vector3f(d.astype(np.float32).T)))
        met, t = np.array(hit.is_valid()), np.array(hit.prim_index).astype(int)
        t = np.where(met, t, 0)
        back = met & ~two_sided[t] & ((geo[t] * d).sum(1) > 0)
        if i:
            backs += back
        else:
            above = back & (np.array(hit.t) < cover)
    return above | (backs >= 0.9 * rays)


def mean_light(images, page, uv, rng, n=200000):
    """mean over the map's surface, from random points"""
    area = np.abs(np.cross(uv[:, 1] - uv[:, 0], uv[:, 2] - uv[:, 0]))
    t = rng.choice(len(uv), n, p=area / area.sum())
    b = rng.random((n, 2))
    b = np.where(b.sum(1, keepdims=True) > 1, 1 - b, b)
    at = uv[t, 0] + (uv[t, 1] - uv[t, 0]) * b[:, :1] + (uv[t, 2] - uv[t, 0]) * b[:, 1:]
    return bilinear(images, page[t], at).mean()


def seams(path, angle=8.0, rays=True, seed=1, fold=65.0):
    """-> dict of arrays by sample (relative difference, weight in texels, metres, position, page
    and texel of both sides), mean light"""
    rng = np.random.default_rng(seed)
    tri, nrm, uv, page, two_sided, images = surfaces(path)
    everything = tri
    # Of coincident triangles, whatever way they face, the baker lights one and leaves the others
    # black, as its report says.
    size = 1e-5 * np.abs(tri).max() if len(tri) else 1.0
    corners = np.sort(np.round(tri / size).astype(np.int64).view([("x", np.int64), ("y", np.int64), ("z", np.int64)])[..., 0], axis=1)
    _, inv, count = np.unique(corners, axis=0, return_inverse=True, return_counts=True)
    twin = count[inv.ravel()] > 1
    flat = np.abs(np.cross(uv[:, 1] - uv[:, 0], uv[:, 2] - uv[:, 0]))
    keep = ~twin & np.isfinite(uv).all((1, 2)) & (flat > 0) & (np.linalg.norm(np.cross(tri[:, 1] - tri[:, 0], tri[:, 2] - tri[:, 0]), axis=1) > 0)
    tri, nrm, uv, page, flat = tri[keep], nrm[keep], uv[keep], page[keep], flat[keep]
    mean = mean_light(images, page, uv, rng)
    # Edges: triangle t, from corner k to k + 1.
    t, k = np.repeat(np.arange(len(tri)), 3), np.tile(np.arange(3), len(tri))
    k1, k2 = (k + 1) % 3, (k + 2) % 3
    a, b, c = tri[t, k], tri[t, k1], tri[t, k2]
    ua, ub = uv[t, k], uv[t, k1]
    key = np.concatenate([page[t][:, None], np.round(ua * 2048), np.round(ub * 2048)], 1).astype(np.int64)
    swap = np.array([tuple(r[1:3]) > tuple(r[3:5]) for r in key])
    key[swap] = key[swap][:, [0, 3, 4, 1, 2]]
    _, inv, count = np.unique(key, axis=0, return_inverse=True, return_counts=True)
    le, lu = np.linalg.norm(b - a, axis=1), np.linalg.norm(ub - ua, axis=1)
    e = np.flatnonzero((count[inv.ravel()] == 1) & (le > 0) & (lu > 0))
    t, k, k1, a, b, c, ua, ub, le, lu = (x[e] for x in (t, k, k1, a, b, c, ua, ub, le, lu))
    geo = unit(np.cross(tri[t, 1] - tri[t, 0], tri[t, 2] - tri[t, 0]))
    along = (b - a) / le[:, None]
    up = (c - a) - along * ((c - a) * along).sum(1, keepdims=True)
    altitude = np.linalg.norm(up, axis=1)
    inward = unit(up)
    size = np.sqrt(np.linalg.norm(np.cross(tri[t, 1] - tri[t, 0], tri[t, 2] - tri[t, 0]), axis=1) / flat[t])
    rounding = 4e-6 * np.abs(tri).max()
    tol = np.maximum(np.minimum(0.05 * size, 0.01 * le), rounding)
    # Samples along the edges, jittered.
    n = np.maximum(1, np.ceil(2 * lu)).astype(int)
    edge = np.repeat(np.arange(len(e)), n)
    first = np.repeat(np.cumsum(n) - n, n)
    s = (np.arange(len(edge)) - first + rng.random(len(edge))) / n[edge]
    p = a[edge] + (b - a)[edge] * s[:, None]
    # Partners: nearby samples of other edges, by classes of their spacing.
    spacing = (le / n)[edge]
    level = np.ceil(np.log2(spacing)).astype(int)
    pairs = []
    for q in np.unique(level):
        other = np.flatnonzero(level == q)
        tree = cKDTree(p[other])
        near = tree.query_ball_point(p, 1.01 * 2.0 ** q + tol[edge])
        counts = np.array([len(x) for x in near])
        if counts.sum():
            pairs.append(np.stack([np.repeat(np.arange(len(p)), counts), edge[other[np.concatenate([x for x in near if x]).astype(int)]]], 1))
    i, j = np.unique(np.concatenate(pairs), axis=0).T
    ei = edge[i]
    ok = ei != j
    i, j, ei = i[ok], j[ok], ei[ok]
    r = ((p[i] - a[j]) * along[j]).sum(1) / le[j]
    at_j = a[j] + (b - a)[j] * r[:, None]
    texel_i, texel_j = ua[ei] + (ub - ua)[ei] * s[i, None], ua[j] + (ub - ua)[j] * r[:, None]
    limit = np.minimum(tol[ei], tol[j])
    shade = lambda e, w: unit(nrm[t[e], k[e]] * (1 - w)[:, None] + nrm[t[e], k1[e]] * w[:, None])    # noqa: E731
    ok = (r > 0) & (r < 1) & (np.linalg.norm(at_j - p[i], axis=1) <= limit)
    ok &= np.abs((along[ei] * along[j]).sum(1)) > np.sqrt(1 - 0.02 ** 2)
    ok &= (page[t[ei]] != page[t[j]]) | (np.linalg.norm(texel_i - texel_j, axis=1) > 2e-3)
    ok &= (inward[ei] * inward[j]).sum(1) <= 0.5
    ok &= (geo[ei] * geo[j]).sum(1) >= np.cos(np.radians(fold))
    ok &= (shade(ei, s[i]) * shade(j, np.clip(r, 0, 1))).sum(1) >= np.cos(np.radians(angle))
    i, j, ei, texel_i, texel_j = i[ok], j[ok], ei[ok], texel_i[ok], texel_j[ok]
    if rays and len(i):
        cosine = (geo[ei] * geo[j]).sum(1)
        top = np.linalg.norm(np.cross(geo[ei], geo[j]), axis=1) / np.maximum(1 + cosine, 0.1)
        ends = []
        for x in (ei, j):
            off = np.minimum(0.5 * size[x], np.maximum(altitude[x], 0.1 * size[x]))
            ends.append(p[i] + inward[x] * off[:, None] + geo[x] * ((0.4 + top) * off + rounding)[:, None])
        scene = ray_scene(everything)
        shown = free_between(scene, *ends)
        sides = []
        for x in (ei, j):
            off = np.minimum(0.5 * size[x], np.maximum(altitude[x] / 3, 0.1 * size[x]))
            sides.append(inside(scene, everything, two_sided, p[i] + inward[x] * off[:, None] + geo[x] * (1e-3 * size[x] + rounding)[:, None], geo[x], 1.5 * size[x], rng))
        shown &= ~(sides[0] | sides[1])
        i, j, ei, texel_i, texel_j = i[shown], j[shown], ei[shown], texel_i[shown], texel_j[shown]
    x, y = bilinear(images, page[t[ei]], texel_i), bilinear(images, page[t[j]], texel_j)
    return dict(difference=np.abs(x - y) / (0.5 * (x + y) + 0.01 * mean), weight=(lu / n)[ei], metres=0.5 * (le / n)[ei], place=p[i], values=np.stack([x, y], 1),
                page=np.stack([page[t[ei]], page[t[j]]], 1), texel=np.stack([texel_i, texel_j], 1)), mean


def quantile(x, w, q):
    o = np.argsort(x)
    return x[o][np.searchsorted(np.cumsum(w[o]), q * w.sum())] if len(x) else 0.0


def main():
    ap = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ap.add_argument("folder", nargs="+")
    ap.add_argument("--angle", type=float, default=8.0)
    ap.add_argument("--fold", type=float, default=65.0)
    ap.add_argument("--no-rays", action="store_true")
    ap.add_argument("--worst", type=int, default=0)
    ap.add_argument("--json", action="store_true")
    args = ap.parse_args()
    for folder in args.folder:
        path, = [g for g in glob.glob(os.path.join(folder, "*.glb")) if not g.endswith(".vertex.glb")]
        s, mean = seams(path, args.angle, not args.no_rays, fold=args.fold)
        d, w = s["difference"], s["weight"]
        row = dict(scene=os.path.basename(path), samples=len(d), metres=float(s["metres"].sum()), median=float(quantile(d, w, 0.5)),
                   p99=float(quantile(d, w, 0.99)), max=float(d.max(initial=0)), above=float(w[d > 0.01].sum() / max(w.sum(), 1e-300)), mean=float(mean))
        if args.json:
            print(json.dumps(row))
        else:
            print("%-24s %7d samples %8.1f m   median %.3f %%   p99 %.3f %%   max %.1f %%   above 1 %%: %.2f %%" %
                  (row["scene"], row["samples"], row["metres"], *(100 * row[k] for k in ("median", "p99", "max", "above"))))
        for o in np.argsort(-d)[:args.worst]:
            print("   %.3f  values/mean %.4f %.4f  at %s  page/texel %s %s | %s %s" % (
                d[o], *(s["values"][o] / mean), s["place"][o].round(3), s["page"][o][0], s["texel"][o][0].round(2), s["page"][o][1], s["texel"][o][1].round(2)))


if __name__ == "__main__":
    main()
