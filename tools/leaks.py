"""The leak suite: light where there should be none, and black spots where there should be light, as
a viewer of the lightmap sees them.

Usage : python leaks.py --out DIR [--lumel BIN] [--quality preview] [--scenes DIR]
                        [--only NAME,...] [--bake-options "..."] [--no-pictures]
Scenes: written by `make-assets --leaks DIR` (runs cargo unless --scenes is given), with leaks.json:
        which parts of which nodes are dark (E is 0 by construction), dim (light through an
        opening) or lit.
Steps : 1 points on the regions, chosen by area with a fixed seed. With the distance d to the
          nearest surface that stands on the point's own (from exact intersections of the planes),
          they are sorted into d < ½, < 1, < 2 and ≥ 2 lumels, and an equal number of each is kept
        2 truth.py at the lit and dim points (cached under LUMEL_REF by content of scene and
          points), and at some dark points, which must be 0
        3 the bake; bilinear lookups of the EXR at the points with the TEXCOORD_1 of the written
          .glb, as in an engine; and the lumels themselves, each with the part of the surface that
          it covers (texel clipped against triangles and regions)
Output: DIR/leaks.md, DIR/leaks.csv, DIR/NAME.png: floors from above (baked, truth, difference);
        DIR/NAME/: the bake.
        Errors are relative to the mean truth over a scene's lit regions. Environment: common.py.
"""
import argparse
import csv
import json
import os
import subprocess
import sys

import numpy as np

import common
import lumels as surfaces
import truth as tracing
from judge import scene as scenes

LUM = tracing.LUMINANCE
BINS = [0.0, 0.5, 1.0, 2.0, np.inf]         # distance to a wall, lumels
NAMES = ["<½", "½–1", "1–2", "≥2"]
EACH = 300                                  # lit points of a region kind and bin
EACH_DARK = 1500
LIFT = 0.003                                # walls are looked for that far above a surface, m
LEAST = 2e-3                                # points nearer than this to a wall are left out, m: below a ray's offset and a baker's
SHARE = 2e-4                                # of a texel: less surface than this is rounding of coordinates (as LEAST_COVERAGE in tests/src/path_tracer)
ROUNDING = 1e-3         # of the yardstick: the effect of one float32 ray in 10⁶ that slips through an edge, on 400 points of 256 paths
SPP, TARGET, SECONDS = 16384, 0.004, 40     # of a truth


class Scene:
    """A scene of the suite: world triangles and regions."""

    def __init__(self, folder, what):
        self.path = os.path.join(folder, what["name"] + ".glb")
        self.name, self.what, self.sky, self.density = what["name"], what["what"], what["sky"], what["texels_per_unit"]
        self.shared, self.even, self.received, self.regions = what["shared_lumels"], what["even"], what["received"], what["regions"]
        level = scenes.load(self.path, images=False)
        self.tri, self.nrm, self.node = level.corners, level.normals, np.array(level.names)[level.node]
        g = surfaces.face_normals(self.tri)
        self.area, self.face = 0.5 * np.linalg.norm(g, axis=1), surfaces.unit(g)
        self.cuts = {}

    def triangles(self, region):
        """mask of the triangles that a region can be on"""
        m = self.node == region["node"]
        if region["facing"]:
            m &= self.face @ np.array(region["facing"]) > 0.5
        if not m.any():
            raise SystemExit("%s: no triangle of %s" % (self.name, region["node"]))
        return np.nonzero(m)[0]

    def walls(self, t):
        """segments [m, 2, 3] where other surfaces intersect the plane LIFT above triangle t"""
        key = tuple(np.round(np.append(self.face[t], self.face[t] @ self.tri[t, 0]), 5))
        if key not in self.cuts:
            n, d = self.face[t], self.face[t] @ self.tri[t, 0] + LIFT
            h = self.tri @ n - d
            out = []
            for k in np.nonzero((h.min(1) < 0) & (h.max(1) > 0) & (np.abs(self.face @ n) < 0.87))[0]:
                p = []
                for i in range(3):
                    a, b = h[k, i], h[k, (i + 1) % 3]
                    if (a < 0) != (b < 0):
                        p.append(self.tri[k, i] + (self.tri[k, (i + 1) % 3] - self.tri[k, i]) * (a / (a - b)))
                out.append(p)
            self.cuts[key] = np.array(out).reshape(-1, 2, 3)
        return self.cuts[key]

    def distance(self, p, t):
        """metres from points p on triangles t to the nearest wall on the same surface"""
        d = np.full(len(p), np.inf)
        for k in np.unique(t):
            s, mine = self.walls(k), t == k
            if len(s) == 0:
                continue
            q = p[mine] + LIFT * self.face[k]
            a, e = s[:, 0], s[:, 1] - s[:, 0]
            u = np.clip(np.einsum("nmk,mk->nm", q[:, None] - a, e) / np.maximum((e * e).sum(1), 1e-30), 0, 1)
            d[mine] = np.linalg.norm(q[:, None] - (a + u[..., None] * e), axis=2).min(1)
        return d


def member(region, p):
    """mask of the points inside the bodies of a region"""
    def inside(hull):
        h = np.array(hull).reshape(-1, 4)
        return (p @ h[:, :3].T <= h[:, 3]).all(1)
    m = inside(region["within"])
    for hull in region["without"]:
        m &= ~inside(hull)
    return m


def draw(scene, kind, each):
    """Points on the regions of one kind -> dict(position, normal, triangle, bary, bin, weight), or None without such regions.
    weight: area that a point stands for."""
    rng, parts = np.random.default_rng(1), []
    regions = [r for r in scene.regions if r["kind"] == kind]
    if not regions:
        return None
    for r in regions:
        tris = scene.triangles(r)
        share = scene.area[tris] / scene.area[tris].sum()
        n = int(min(200000, 4000 + 4000 * scene.area[tris].sum()))
        t = rng.choice(tris, n, p=share)
        u = rng.random((n, 2))
        u = np.where(u.sum(1, keepdims=True) > 1, 1 - u, u)
        b = np.stack([1 - u.sum(1), u[:, 0], u[:, 1]], 1)
        p = np.einsum("nk,nkc->nc", b, scene.tri[t])
        keep = member(r, p)
        parts.append((p[keep], t[keep], b[keep], np.full(keep.sum(), scene.area[tris].sum() / n)))
    p, t, b, w = (np.concatenate(x) for x in zip(*parts))
    if len(p) == 0:
        raise SystemExit("%s: no point is %s" % (scene.name, kind))
    few = rng.permutation(len(p))[:60000]
    w = w[few] * len(p) / len(few)
    p, t, b = p[few], t[few], b[few]
    d = scene.distance(p, t)
    ok = d > LEAST
    bins = np.digitize(d * scene.density, BINS[1:-1])
    chosen, weight = [], np.zeros(len(p))
    for k in range(len(NAMES)):
        mine = np.nonzero(ok & (bins == k))[0]
        some = mine[:each]
        if len(some):
            weight[some] = w[mine].sum() / len(some)
        chosen.append(some)
    c = np.sort(np.concatenate(chosen))
    n = np.einsum("nk,nkc->nc", b[c], scene.nrm[t[c]])
    return dict(position=p[c], normal=n / np.linalg.norm(n, axis=1, keepdims=True), triangle=t[c], bin=bins[c], weight=weight[c])


def truth(scene, position, normal, label, spp=SPP, target=TARGET, seconds=SECONDS):
    """E and its standard error (luminance) at points: in closed form where it is uniform, else from the cache or truth.py"""
    if scene.even:
        return np.full(len(position), scene.even), np.zeros(len(position))
    os.makedirs(common.REF, exist_ok=True)
    key = common.digest(scene.path, position.tobytes(), normal.tobytes(), "%g %d %g %s" % (scene.sky, spp, target, tracing.MODEL))
    path = os.path.join(common.REF, "leaks-%s-%s-%s.npz" % (scene.name, label, key))
    if not os.path.exists(path):
        points = path + ".points.npz"
        np.savez(points, position=position, normal=normal)
        common.tool("truth.py", scene.path, points, path + ".new.npz", "--paths", spp, "--target", target, "--time", seconds, "--sky", "%g,%g,%g" % ((scene.sky,) * 3))
        os.replace(path + ".new.npz", path)
        os.remove(points)
    z = np.load(path)
    return z["irradiance"] @ LUM, z["stderr_y"]


def read_exr(path):
    return common.read_exr(path) @ LUM * np.pi


class Baked:
    """Lightmap of a written .glb: its triangles by node, in texels."""

    def __init__(self, directory):
        files = common.outputs(directory)
        level = scenes.load(files["glb"], images=False)
        places = {n: x["lightmap"] for n, x in zip(level.names, level.extras) if "lightmap" in x}
        self.pages = {p["page"]: read_exr(os.path.join(directory, p["uri"])) for p in places.values()}
        self.tri, self.node = level.corners, np.array(level.names)[level.node]
        self.page = np.array([places[n]["page"] if n in places else -1 for n in self.node])
        self.uv = np.full((len(self.tri), 3, 2), np.nan)
        for n, place in places.items():
            m = self.node == n
            self.uv[m] = (level.uv[1][m] * place["scale"] + place["offset"]) * self.pages[place["page"]].shape[::-1]
        self.face = surfaces.unit(surfaces.face_normals(self.tri))

    def find(self, node, p, face):
        """uv in texels and page of points p on a node's surface with the unit normal `face` [n, 3]"""
        uv, page, best = np.full((len(p), 2), np.nan), np.full(len(p), -1), np.full(len(p), -np.inf)
        for t in np.nonzero(self.node == node)[0]:
            a, e1, e2 = self.tri[t, 0], self.tri[t, 1] - self.tri[t, 0], self.tri[t, 2] - self.tri[t, 0]
            n = np.cross(e1, e2)
            u, v = np.cross(p - a, e2) @ n / (n @ n), np.cross(e1, p - a) @ n / (n @ n)
            least = np.minimum(np.minimum(u, v), 1 - u - v)
            least[(np.abs((p - a) @ self.face[t]) > 1e-4) | (face @ self.face[t] < 0.9)] = -np.inf
            better = (least > best) & (least > -1e-4)
            best[better], page[better] = least[better], self.page[t]
            uv[better] = self.uv[t, 0] + u[better, None] * (self.uv[t, 1] - self.uv[t, 0]) + v[better, None] * (self.uv[t, 2] - self.uv[t, 0])
        return uv, page

    def lookup(self, uv, page):
        """bilinear, clamped to the page; E"""
        out = np.full(len(uv), np.nan)
        for k, img in self.pages.items():
            m = page == k
            h, w = img.shape
            x, y = uv[m, 0] - 0.5, uv[m, 1] - 0.5
            x0, y0 = np.floor(x).astype(int), np.floor(y).astype(int)
            fx, fy = x - x0, y - y0
            cx, cy = (lambda i: np.clip(i, 0, w - 1)), (lambda i: np.clip(i, 0, h - 1))
            out[m] = (img[cy(y0), cx(x0)] * (1 - fx) + img[cy(y0), cx(x0 + 1)] * fx) * (1 - fy) + (img[cy(y0 + 1), cx(x0)] * (1 - fx) + img[cy(y0 + 1), cx(x0 + 1)] * fx) * fy
        return out

    def at(self, scene, pts):
        out = np.full(len(pts["position"]), np.nan)
        nodes = scene.node[pts["triangle"]]
        for n in np.unique(nodes):
            m = nodes == n
            out[m] = self.lookup(*self.find(n, pts["position"][m], scene.face[pts["triangle"][m]]))
        if np.isnan(out).any():
            i = int(np.nonzero(np.isnan(out))[0][0])
            raise SystemExit("%s: %d points have no lightmap, first %s on %s" % (scene.name, np.isnan(out).sum(), pts["position"][i], nodes[i]))
        return out


def clip(poly, normal, d):
    """part of a convex polygon (list of points) where p · normal ≤ d (Sutherland and Hodgman 1974)"""
    out = []
    h = [float(p @ normal) - d for p in poly]
    for i, p in enumerate(poly):
        q, a, b = poly[(i + 1) % len(poly)], h[i], h[(i + 1) % len(poly)]
        if a <= 0:
            out.append(p)
        if (a <= 0) != (b <= 0):
            out.append(p + (q - p) * (a / (a - b)))
    return out


def area(poly):
    if len(poly) < 3:
        return 0.0
    p = np.array(poly)
    return 0.5 * float(np.linalg.norm(np.cross(p[1:-1] - p[0], p[2:] - p[0]).sum(0)))


def shared(region, poly):
    """area of a polygon's part inside a region"""
    for a, b, c, d in region["within"]:
        poly = clip(poly, np.array([a, b, c]), d)
        if len(poly) < 3:
            return 0.0
    parts = [poly]
    for hull in region["without"]:
        rest = []
        for part in parts:
            for a, b, c, d in hull:
                n = np.array([a, b, c])
                outside = clip(part, -n, -d)
                if len(outside) >= 3:
                    rest.append(outside)
                part = clip(part, n, d)
                if len(part) < 3:
                    break
        parts = rest
    return sum(area(x) for x in parts)


def lumels(scene, baked, kind):
    """Lumels that touch regions of `kind` -> {(page, row, column): [share in regions of kind, share in lit ones]}"""
    found = {}
    nodes = {r["node"] for r in scene.regions if r["kind"] == kind}
    for t in np.nonzero(np.isin(baked.node, list(nodes)) & (baked.page >= 0))[0]:
        uv = baked.uv[t]
        mine = [r for r in scene.regions if r["node"] == baked.node[t] and r["kind"] in (kind, "lit") and (not r["facing"] or baked.face[t] @ np.array(r["facing"]) > 0.5)]
        e = np.stack([uv[1] - uv[0], uv[2] - uv[0]])
        if abs(np.linalg.det(e)) < 1e-9:
            continue
        # Texels to space: barycentrics are affine in the page.
        inverse, edges = np.linalg.inv(e), baked.tri[t, 1:] - baked.tri[t, 0]
        per_texel = np.linalg.norm(np.cross(*(inverse @ edges)))
        low, high = np.floor(uv.min(0)).astype(int), np.ceil(uv.max(0)).astype(int)
        x = [np.array([1.0, 0]), np.array([0, 1.0])]
        for row in range(low[1], high[1]):
            strip = clip(clip(list(uv), -x[1], -row), x[1], row + 1)
            for column in range(low[0], high[0]):
                cell = clip(clip(strip, -x[0], -column), x[0], column + 1) if len(strip) >= 3 else []
                if len(cell) < 3:
                    continue
                world = [baked.tri[t, 0] + (p - uv[0]) @ inverse @ edges for p in cell]
                shares = found.setdefault((int(baked.page[t]), row, column), [0.0, 0.0])
                for r in mine:
                    shares[r["kind"] == "lit"] += shared(r, world) / per_texel
    return {k: v for k, v in found.items() if v[0] > SHARE}


def bake(scene, a, lumel):
    out = os.path.join(a.out, scene.name)
    args = [lumel, "bake", scene.path, "-o", out, "-q", "--quality", a.quality, "--texels-per-unit", "%g" % scene.density, *a.bake_options.split()]
    r = common.run(args + (["--sky", "%g" % scene.sky] if scene.sky else []))
    if r["code"] != 0:
        raise SystemExit("%s: lumel failed (%d)\n%s" % (scene.name, r["code"], r["err"][-2000:]))
    return Baked(out)


def measure(scene, a, lumel):
    """-> the scene's row: a dict"""
    row = dict(scene=scene.name, shared_lumels=scene.shared)
    baked = bake(scene, a, lumel)
    lit = draw(scene, "lit", EACH)
    e, se = truth(scene, lit["position"], lit["normal"], "lit")
    yard = row["yard"] = float((e * lit["weight"]).sum() / lit["weight"].sum())
    value = baked.at(scene, lit)
    if scene.received:
        # Points nearer than LEAST to walls are not drawn; the truth's mean says what share they
        # stand for.
        row["received"] = float((value * lit["weight"]).sum() / (e * lit["weight"]).sum())
        row["truth received"] = float((e * lit["weight"]).sum() / scene.received)
    some = e > 0.02 * yard        # A relative error of a tiny value is meaningless.
    wrong = np.where(some, (e - value) / np.maximum(e, 1e-9), 0)
    for k, n in enumerate(NAMES):
        w = wrong[some & (lit["bin"] == k)]
        if len(w):
            row.update({"lit n " + n: len(w), "lit p50 " + n: np.median(w), "lit p95 " + n: np.percentile(w, 95), "lit max " + n: w.max(), "lit brightest " + n: -w.min()})
    row["truth noise"] = float(np.median((se / np.maximum(e, 1e-9))[some]))
    i = int(np.argmax(wrong))
    row["blackest"] = [round(float(x), 3) for x in lit["position"][i]] + [scene.node[lit["triangle"][i]]]
    for kind in ("dark", "dim"):
        pts = draw(scene, kind, EACH_DARK if kind == "dark" else EACH)
        if pts is None:
            continue
        n = len(pts["position"])
        if kind == "dark":
            few = np.random.default_rng(3).permutation(n)[:400]
            seen, _ = truth(scene, pts["position"][few], pts["normal"][few], "dark", 256, 0, 20)
            row["truth in the dark"] = float(seen.max() / yard)
            if seen.max() > ROUNDING * yard:
                j = few[int(np.argmax(seen))]
                row["not dark"] = "%g at %s on %s" % (seen.max(), pts["position"][j].round(4), scene.node[pts["triangle"][j]])
            e, se = np.zeros(n), np.zeros(n)
        else:
            e, se = truth(scene, pts["position"], pts["normal"], "dim")
            row["dim truth"] = float((e * pts["weight"]).sum() / pts["weight"].sum() / yard)
        over = (baked.at(scene, pts) - e) / yard
        for k, name in enumerate(NAMES):
            m = pts["bin"] == k
            if m.any():
                row.update({"leak n " + name: int(m.sum()), "leak mean " + name: float(over[m].mean()), "leak max " + name: float(over[m].max()), "leak min " + name: float(over[m].min())})
        i = int(np.argmax(over))
        row["worst leak"] = [round(float(x), 3) for x in pts["position"][i]] + [scene.node[pts["triangle"][i]]]
        if kind == "dark":
            cells = lumels(scene, baked, kind)
            for label, pick in (("dark", [c for c, s in cells.items() if s[1] <= SHARE]), ("shared", [c for c, s in cells.items() if s[1] > SHARE])):
                v = np.array([baked.pages[p][r, c] for p, r, c in pick]) / yard
                row.update({label + " lumels": len(v), label + " lumels lit": int((v > 0).sum()), label + " max": float(v.max(initial=0)), label + " mean": float(v.mean()) if len(v) else 0.0})
    return row, baked


def picture(scene, baked, yard, a):
    """floors from above: baked, truth, difference; areas without a region (under walls and
    props) are white"""
    import matplotlib
    matplotlib.use("Agg")
    import matplotlib.pyplot as plt
    floor = np.array([n.startswith(("floor", "ground")) for n in scene.node]) & (scene.face[:, 1] > 0.9)
    if not floor.any():
        return
    tri = scene.tri[floor]
    lo, hi = tri.reshape(-1, 3).min(0), tri.reshape(-1, 3).max(0)
    step = max(0.5 / scene.density, float((hi - lo).max()) / 150)
    x, z = np.meshgrid(np.arange(lo[0] + step / 2, hi[0], step), np.arange(lo[2] + step / 2, hi[2], step))
    shape, x, z = x.shape, x.ravel(), z.ravel()
    p, n, t = np.zeros((len(x), 3)), np.zeros((len(x), 3)), np.full(len(x), -1)
    for k in np.nonzero(floor)[0]:
        c = scene.tri[k]
        m = np.stack([c[1] - c[0], c[2] - c[0]])[:, [0, 2]]
        uv = np.stack([x - c[0, 0], z - c[0, 2]], 1) @ np.linalg.inv(m)
        ok = (uv >= 0).all(1) & (uv.sum(1) <= 1)
        w = np.stack([1 - uv.sum(1), uv[:, 0], uv[:, 1]], 1)[ok]
        p[ok], n[ok], t[ok] = w @ c, w @ scene.nrm[k], k
    ok = t >= 0
    n[ok] /= np.linalg.norm(n[ok], axis=1, keepdims=True)
    pts = dict(position=p[ok], normal=n[ok], triangle=t[ok])
    seen, true = np.full(len(x), np.nan), np.full(len(x), np.nan)
    seen[ok] = baked.at(scene, pts)
    # Some 400,000 samples per second; more are reserved for the table's points.
    true[ok], _ = truth(scene, pts["position"], pts["normal"], "plan", 512, 0, 60)
    shown = np.zeros(len(x), bool)
    for r in scene.regions:
        on = np.zeros(len(scene.tri), bool)
        on[scene.triangles(r)] = True
        shown |= ok & on[t] & member(r, p)
    seen[~shown], true[~shown] = np.nan, np.nan
    fig, axes = plt.subplots(1, 3, figsize=(15, 1.2 + 5 * min(1.4, shape[0] / shape[1])), layout="constrained")
    box = (lo[0], hi[0], hi[2], lo[2])
    for ax, v, label in zip(axes, (seen, true), ("baked, bilinear", "truth")):
        ax.imshow(np.clip(v.reshape(shape) / yard / 1.5, 0, 1) ** (1 / 2.2), cmap="gray", vmin=0, vmax=1, extent=box, interpolation="nearest")
        ax.set_title(label)
    shot = axes[2].imshow(100 * ((seen - true) / yard).reshape(shape), cmap="RdBu_r", vmin=-10, vmax=10, extent=box, interpolation="nearest")
    axes[2].set_title("baked − truth, % of the yardstick")
    fig.colorbar(shot, ax=axes[2], shrink=0.8, extend="both")
    fig.suptitle("%s: %s" % (scene.name, scene.what), fontsize=10)
    fig.savefig(os.path.join(a.out, scene.name + ".png"), dpi=70, metadata={"Software": None})
    plt.close(fig)


def percent(x, signed=False):
    if x is None:
        return "–"
    return "0" if x == 0 else ("%+.2f" if signed else "%.2f" if abs(x) < 0.1 else "%.1f") % (100 * x) if abs(x) >= 5e-5 else "%.0e" % (100 * x)


def tables(rows):
    get = lambda r, k: r.get(k)         # noqa: E731
    out = ["Leaks, % of the lit room's mean: lumels in the dark (those that no lit surface shares), lumels that both share, and what is seen (bilinear lookup at points of the dark side, mean / max, by distance to the nearest wall in lumels). Dim scenes: baked − truth.", "",
           "| scene | dark lumels | of them lit | max | shared | max | " + " | ".join(NAMES) + " | worst at |", "|---" * (7 + len(NAMES)) + "|"]
    for r in rows:
        if "worst leak" not in r:
            continue
        cells = [r["scene"] + (" *" if r["shared_lumels"] else ""), str(r.get("dark lumels", "–")), str(r.get("dark lumels lit", "–")), percent(get(r, "dark max")), str(r.get("shared lumels", "–")), percent(get(r, "shared max"))]
        cells += ["%s / %s" % (percent(get(r, "leak mean " + n)), percent(get(r, "leak max " + n))) for n in NAMES]
        out.append("| " + " | ".join(cells + ["%s %s" % (r["worst leak"][3], tuple(r["worst leak"][:3]))]) + " |")
    out += ["", "Black spots on the lit side: (truth − baked) / truth in %, p50 / p95 / max, and how much too bright at most, by distance to the nearest wall in lumels.", "",
            "| scene | " + " | ".join(NAMES) + " | too bright " + NAMES[0] + " | " + NAMES[1] + " | " + NAMES[3] + " | truth's noise | blackest at |", "|---" * (len(NAMES) + 6) + "|"]
    for r in rows:
        cells = [r["scene"]] + [" / ".join(percent(get(r, "lit %s %s" % (q, n)), q == "p50") for q in ("p50", "p95", "max")) for n in NAMES]
        cells += [percent(get(r, "lit brightest " + NAMES[k])) for k in (0, 1, 3)]
        out.append("| " + " | ".join(cells + [percent(r["truth noise"]), "%s %s" % (r["blackest"][3], tuple(r["blackest"][:3]))]) + " |")
    for r in rows:
        if "received" in r:
            out += ["", "%s: its visible surfaces hold %+.2f %% of the light that truth says (truth of the closed form, by these points: %.2f %%)." % (r["scene"], 100 * (r["received"] - 1), 100 * r["truth received"])]
    return "\n".join(out) + "\n"


def main():
    ap = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ap.add_argument("--out", required=True)
    ap.add_argument("--lumel", default=common.LUMEL)
    ap.add_argument("--quality", default="preview")
    ap.add_argument("--scenes")
    ap.add_argument("--only")
    ap.add_argument("--bake-options", default="")
    ap.add_argument("--no-pictures", action="store_true")
    a = ap.parse_args()
    os.makedirs(a.out, exist_ok=True)
    if not a.scenes:
        a.scenes = os.path.join(a.out, "scenes")
        subprocess.run(["cargo", "run", "-q", "--release", "-p", "lumel-tests", "--bin", "make-assets", "--", "--leaks", os.path.abspath(a.scenes)], check=True, cwd=os.path.dirname(common.HERE), stdout=subprocess.DEVNULL)
    rows = []
    for what in json.load(open(os.path.join(a.scenes, "leaks.json"))):
        if a.only and what["name"] not in a.only.split(","):
            continue
        scene = Scene(a.scenes, what)
        row, baked = measure(scene, a, a.lumel)
        rows.append(row)
        print(json.dumps({k: (float("%.4g" % v) if isinstance(v, float) else v) for k, v in row.items()}), file=sys.stderr, flush=True)
        if "not dark" in row:
            print("%s: TRUTH FINDS LIGHT IN THE DARK: %s" % (scene.name, row["not dark"]), file=sys.stderr, flush=True)
        if not a.no_pictures:
            picture(scene, baked, row["yard"], a)
    text = tables(rows)
    open(os.path.join(a.out, "leaks.md"), "w").write(text)
    keys = list(dict.fromkeys(k for r in rows for k in r))
    with open(os.path.join(a.out, "leaks.csv"), "w", newline="") as f:
        w = csv.DictWriter(f, keys)
        w.writeheader()
        w.writerows({k: ("%.6g" % v if isinstance(v, float) else v) for k, v in r.items()} for r in rows)
    print(text)


if __name__ == "__main__":
    main()
