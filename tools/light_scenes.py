"""Error of lumel on levels with typical lights and materials: suns, sky, lamps with a range, emissive
boxes, leaves, glass, cut-outs.

Usage : python light_scenes.py [--scenes gi_demo,truck_town,house,lamp,emissive,sponza]
              [--quality preview,production] [--references-only] [--reference-time 1.0]
              [--refine SECONDS] [--threads N] [--work /tmp/light_scenes] [--pictures]
        python light_scenes.py --page-only          the page again from the CSV
Steps : for each scene (SCENES below): 1 a copy with the sun added; 2 a draft bake, whose atlas is
        flattened; 3 a selection of its lumels and their reference (light_truth.py), found under
        LUMEL_REF by content; 4 a bake of every quality; 5 errors, and with --pictures an error map
        and lumel's own preview of the lit level under --work
Output: lab/data/light_scenes.csv    a row for every scene, quality and family of lumels; rows of
                                     scenes that were not run are kept
        lab/tables/light_scenes.md   tables of lab/light_scenes.md
        WORK/SCENE.QUALITY.json      the worst lumels and the error by node
        Pictures show third-party assets: they stay under --work and are not committed.
Needs : the lumel binary (LUMEL) built for release; Mitsuba for references that are not cached; the
        measurement scenes (LUMEL_SCENES).
"""
import argparse
import json
import os
import sys

import numpy as np

import common
import error_map
import reference
import speed_page
import speed_scenes

CSV = os.path.join(common.LAB, "data", "light_scenes.csv")
COLUMNS = ("scene quality family n relRMSE relRMSE_se p50 p95 p99 bias own truth_se zeros seconds lumels texels_per_unit sky sun options triangles threads "
           "load versions").split()
MODEL = "light_truth 1"  # increase whenever the results of light_truth.py change
SUB = 16                    # points along a lumel's side
LIMIT = 0.98  # both limit reflectance to this
# a lumel is curved if an interpolated normal differs by more than this from the face normal
CURVED = np.cos(np.radians(1.0))  #

# file    under LUMEL_SCENES;  density: texels per metre, and why; None leaves it to lumel, which only then lowers it on huge meshes
# sky     radiance;  sun: (direction of travel, lux, diameter in degrees), added to the document as a punctual light
# range   whether a lamp has one;  eps: ray offset of the truth, in units of half the scene's diagonal
# count   lumels drawn;  target: median relative standard error;  seconds: limit of the reference
SCENES = {
    "gi_demo": dict(
        title="godot_gi_demo", file="godot_gi_demo/godot_gi_demo.glb", density=2.61, why="what `lumel bake` chooses: 38 cm a lumel", sky="0,0,0", range=True,
        light="its own sun (1 lx), two point lamps, a spot with a cone of 90°, all three with a range, and a glowing box; no sky; every other surface is white",
        count=1000, target=0.003, seconds=150),
    "truck_town": dict(
        title="godot_truck_town", file="godot_truck_town/godot_truck_town.glb", density=None, why="what `lumel bake` chooses: 2.48, and 0.109 for the plane of 2048 m", sky="0.2,0.25,0.3", range=True,
        light="its own sun (1.45 lx) and ten street lamps with a range, and a sky; leaves are BLEND", eps=1e-6, count=1000, target=0.001, seconds=120),
    "house": dict(
        title="playcanvas_house", file="playcanvas_house/house.glb", density=454, why="what `lumel bake` chooses: 2.2 mm a lumel, the scene is half a metre wide", sky="0.5,0.6,0.8",
        sun=((-0.4, -1, -0.3), 6.0, 0.0), light="none of its own: a sky and a sun; one material is MASK", count=1000, target=0.001, seconds=100),
    "lamp": dict(
        title="LightsPunctualLamp", file="features/LightsPunctualLamp/LightsPunctualLamp.gltf", density=262, why="what `lumel bake` chooses: 3.8 mm a lumel", sky="0,0,0",
        light="five point lamps, an emissive texture, glass (KHR_materials_transmission with a texture) and a BLEND material", count=1000, target=0.002, seconds=120),
    "emissive": dict(
        title="EmissiveStrengthTest", file="features/EmissiveStrengthTest/EmissiveStrengthTest.glb", density=None, why="what `lumel bake` chooses: 70.7, and 11.3 for the backdrop", sky="0,0,0",
        light="five boxes of emissive strength 1 to 16, which are black otherwise", count=1000, target=0.001, seconds=80),
    "sponza": dict(
        title="Sponza", file="sponza/sponza.glb", density=4.97, why="that of lab/speed_error.md: 20 cm a lumel", sky="0.5,0.6,0.8", sun=((-0.3, -1, 0.2), 6.0, 0.0),
        light="a sky and a sun; leaves and chains are MASK", count=1000, target=0.0005, seconds=150),
}


def say(text):
    print(text, file=sys.stderr, flush=True)


class Scene:
    """One prepared scene: its file, its atlas, its reference."""

    def __init__(self, name, a):
        self.name, self.a, self.table = name, a, SCENES[name]
        path = os.path.join(common.SCENES, self.table["file"])
        if "sun" in self.table:
            sunny = os.path.join(a.work, name + ".glb")
            speed_scenes.with_sun(path, *self.table["sun"][:2], sunny)
            path = sunny
        self.path = path
        r = self.bake("draft", "flat")  # the atlas is the same at every quality
        if len(r["pages"]) != 1:
            raise SystemExit("%s: %d pages, expected one" % (name, len(r["pages"])))
        self.flat = os.path.join(a.work, name + ".flat.glb")
        self.side = reference.flatten(r["glb"], self.flat)["res"]
        self.scene = reference.gltf_scene.load(self.flat, images=False)
        self.ref = reference.load(self.truth())

    def bake(self, quality, folder, *more):
        t = self.table
        sky = [] if t["sky"] == "0,0,0" else ["--sky", t["sky"]]
        out = os.path.join(self.a.work, "%s.%s" % (self.name, folder))
        r = common.bake(self.path, out, "--quality", quality, *common.AREA_MEAN, *(["--texels-per-unit", t["density"]] if t["density"] else []), "--max-page", 2048, "--threads", self.a.threads,
                        "--max-reflectance", LIMIT, *sky, *more)
        if r["code"] != 0:
            raise SystemExit("%s: lumel failed (%d): %s" % (self.name, r["code"], r["err"]))
        return r

    def truth(self):
        """-> path of the reference, named by everything that it depends on; made if it is
        missing"""
        t = self.table
        sun = t.get("sun", (None, None, 0.0))[2]
        key = common.digest(" ".join(str(x) for x in (MODEL, reference.scene_digest(self.flat), self._glass(), self.side, t["count"], t["target"], t["sky"], sun,
                                                      t.get("eps"), t.get("range"), LIMIT, SUB, *(["slivers left out"] if slivers(self.scene.tri).any() else []))))
        path = os.path.join(common.REF, "light_%s-%s.npz" % (self.name, key))
        os.makedirs(common.REF, exist_ok=True)
        if not os.path.exists(path):
            self._keep(path, self._trace(path, None, 0, t["seconds"] * self.a.reference_time, t["target"]))
        for _ in range(int(np.ceil(self.a.refine / 60))):
            # Choosing lumels by the noise of their own earlier paths biases a lumel by at most a
            # part of its standard error (reference.py).
            ref = reference.load(path)
            some = reference.relative_noise(ref) > 0.5 * reference.own(ref)
            self._keep(path, reference.merge(ref, some, self._trace(path, some, int(ref["parts"]), 60, 0.0)))
        return path

    def _trace(self, path, some, seed, seconds, target):
        """light_truth.py at all lumels of the draw, or at `some` of them"""
        t, points, out = self.table, path + ".points.npz", path + ".part.npz"
        draw_points(self.scene, points, self.side, t["count"], None if some is None else reference.load(path)["texel"][some])
        # As many strata per point as fit into a launch: the error falls faster than with the number
        # of paths.
        n = len(reference.load(points)["texel"])
        batch = 1 << max(6, min(13, int(np.log2((1 << 20) / n))))
        r = common.run(["nice", "-n", "19", sys.executable, os.path.join(common.HERE, "light_truth.py"), self.flat, points, out, "--sky", t["sky"], "--spp", str(1 << 24),
                        "--batch", str(batch), "--target", str(target), "--time", str(seconds), "--sun-angle", str(t.get("sun", (0, 0, 0.0))[2]), "--max-reflectance", str(LIMIT),
                        "--seed", str(seed), "--threads", str(self.a.threads)] + (["--honour-range"] if t.get("range") else []) + (["--eps", str(t["eps"])] if "eps" in t else []))
        if r["code"] != 0:
            raise SystemExit("light_truth.py failed (%d):\n%s" % (r["code"], (r["err"] or r["out"])[-2000:]))
        new = reference.load(out)
        os.remove(out), os.remove(points)
        if some is None:
            new["paths"], new["parts"] = np.full(n, int(new["spp"])), 1
        return new

    def _keep(self, path, ref):
        np.savez_compressed(path + ".new.npz", **ref)
        os.replace(path + ".new.npz", path)
        say("reference %s: %d lumels, %d to %d paths each, own noise %.3f %%, median %.3f %%, %.0f s in all" % (
            os.path.basename(path), len(ref["texel"]), ref["paths"].min(), ref["paths"].max(), 100 * reference.own(ref),
            100 * np.median(reference.relative_noise(ref)[reference.lit(ref)]), float(ref["seconds"])))

    def _glass(self):
        """the parts of materials that scene_digest does not include"""
        js, _ = common.read_glb(self.flat)
        return json.dumps([m.get("extensions", {}).get("KHR_materials_transmission") for m in js.get("materials", [])], sort_keys=True)

    def families(self):
        """{name: mask of the reference's lumels}: all lit lumels; those of them on triangles that repeat an earlier one; and of the others those on
        flat faces away from chart edges, those on flat faces at chart edges, and those with bent normals"""
        lit = reference.lit(self.ref)
        copy = self.copies[self.ref["triangle"]]
        bent, whole, rest = self.ref["bend"] < CURVED, self.ref["holes"] == 0, lit & ~copy
        return {"all": lit, "copies": lit & copy, "flat": rest & ~bent & whole, "cut": rest & ~bent & ~whole, "curved": rest & bent}

    @property
    def copies(self):
        """mask of the scene's triangles with the same three corners as an earlier one"""
        if not hasattr(self, "_copies"):
            _, corner = np.unique(self.scene.tri.reshape(-1, 3).astype(np.float32), axis=0, return_inverse=True)
            _, first = np.unique(np.sort(corner.reshape(-1, 3), axis=1), axis=0, return_index=True)
            self._copies = np.ones(len(self.scene.tri), bool)
            self._copies[first] = False
        return self._copies

    def measure(self, quality):
        load = os.getloadavg()[0]
        shot = os.path.join(self.a.work, "%s.%s.lit.png" % (self.name, quality))
        r = self.bake(quality, quality, *(["--preview", shot] if self.a.pictures else []))
        report, exr, ref, t = r["report_json"], r["pages"][0], self.ref, self.table
        lum = reference._compare().LUM
        rows = []
        for family, keep in self.families().items():
            if keep.sum() < 20:
                continue
            e = reference.errors(ref, exr, keep)
            y, s = ref["irradiance"][keep] @ lum, ref["stderr"][keep] @ lum
            r_, c_ = ref["texel"][keep].T
            zeros = float((reference._compare().read_exr(exr)[r_, c_] @ lum == 0).mean())
            rows.append(dict(scene=self.name, quality=quality, family=family, truth_se=float(np.median(s / y)), zeros=zeros, seconds=report["measured"]["seconds"], lumels=int(ref["covered"]),
                             texels_per_unit=t["density"] or "auto", sky=t["sky"], sun=" ".join(str(x) for x in t.get("sun", ())), options="--max-reflectance %g" % LIMIT,
                             triangles=len(self.scene.tri), threads=self.a.threads, load=load, versions="%s, binary %s" % (report["generator"], common.digest(common.LUMEL)[:8]),
                             **{k: e[k] for k in ("n", "relRMSE", "relRMSE_se", "p50", "p95", "p99", "bias", "own")}))
        say("%s, %s: %.1f s, " % (self.name, quality, rows[0]["seconds"]) + "; ".join("%s relRMSE %.2f %% median %.2f %% p95 %.1f %% bias %+.2f %%" % (
            x["family"], 100 * x["relRMSE"], 100 * x["p50"], 100 * x["p95"], 100 * x["bias"]) for x in rows))
        self.diagnose(quality, exr)
        if self.a.pictures:
            error_map.draw(ref, exr, os.path.join(self.a.work, "%s.%s.error.png" % (self.name, quality)), None, 0.1, "%s, %s" % (t["title"], quality))
        return rows

    def diagnose(self, quality, exr):
        """WORK/SCENE.QUALITY.json: error by node and the worst lumels"""
        ref, sc = self.ref, self.scene
        lit, lum = reference.lit(ref), reference._compare().LUM
        error = reference.signed(ref, exr)
        square = np.where(lit, error ** 2, 0)
        names = np.array([o[0] for o in sc.objects])[ref["object"]]
        mats = np.array([m["name"] or "material %d" % i for i, m in enumerate(sc.materials)])[sc.mat[ref["triangle"]]]
        groups = {}
        for key in sorted(set(zip(names, mats))):
            k = (names == key[0]) & (mats == key[1]) & lit
            if k.any():
                groups["%s / %s" % key] = dict(n=int(k.sum()), relRMSE=float(np.sqrt(square[k].mean())), bias=float(error[k].mean()), share_of_square=float(square[k].sum() / max(square.sum(), 1e-300)))
        img = reference._compare().read_exr(exr)
        worst = []
        for i in np.argsort(-square)[:25]:
            r, c = ref["texel"][i]
            worst.append(dict(node=str(names[i]), material=str(mats[i]), texel=[int(r), int(c)], position=[round(float(x), 4) for x in ref["position"][i]],
                              normal=[round(float(x), 3) for x in ref["normal"][i]], truth=float(ref["irradiance"][i] @ lum / np.pi), found=float(img[r, c] @ lum),
                              truth_se=float(ref["stderr"][i] @ lum / np.pi), bend=float(ref["bend"][i]), holes=float(ref["holes"][i]),
                              copy=bool(self.copies[ref["triangle"][i]])))
        unlit = ~lit
        r, c = ref["texel"][unlit].T
        bright = dict(n=int(unlit.sum()), brightest=float((img[r, c] @ lum).max()) if unlit.any() else 0.0, mean_truth=float((ref["irradiance"] @ lum).mean() / np.pi))
        with open(os.path.join(self.a.work, "%s.%s.json" % (self.name, quality)), "w") as f:
            json.dump(dict(groups=dict(sorted(groups.items(), key=lambda g: -g[1]["share_of_square"])), worst=worst, unlit=bright), f, indent=1)


def draw_points(sc, points, side, count, at=None):
    """A draw (texels.py's, seed 0, inset 0: chart edges too) of the lumels of a flattened scene, with SUB² points spread over the part of each that is on
    the surface, interpolated normals (sub_normal) and the faces' own (sub_face).  Adds `bend` (least cosine between the two) and `holes` (share of the
    lumel off the surface).  The points of texels.py, which would scan every triangle of the page for them: minutes on large scenes.
    `at`: these lumels (row, column) instead of a draw."""
    import texels
    tri, uv = sc.tri, np.where(slivers(sc.tri)[:, None, None], np.nan, sc.uv[1])
    tid, bary = texels.rasterise(uv, side)
    r, c = np.nonzero(tid >= 0)
    covered = len(r)
    some = np.sort(np.random.default_rng(0).permutation(covered)[:count])
    r, c = (r[some], c[some]) if at is None else at.T
    t, (b1, b2) = tid[r, c], bary[r, c].T
    face = np.cross(tri[:, 1] - tri[:, 0], tri[:, 2] - tri[:, 0])
    face /= np.linalg.norm(face, axis=1, keepdims=True)
    w = np.stack([1 - b1 - b2, b1, b2], 1)
    pos, nrm = [np.einsum("nk,nkc->nc", w, x[t]) for x in (tri, sc.nrm)]
    nrm /= np.linalg.norm(nrm, axis=1, keepdims=True)
    p, n, f = spread(tri, sc.nrm, face, uv * side, r, c)
    holes = ~np.isfinite(p[..., 0])
    rng = np.random.default_rng(2)
    for i in np.nonzero(holes.any(1))[0]:
        on = np.nonzero(~holes[i])[0]
        if len(on):
            put = rng.choice(on, int(holes[i].sum()))
            for x in (p[i], n[i], f[i]):
                x[holes[i]] = x[put]
        else:
            p[i], n[i], f[i] = pos[i], nrm[i], face[t[i]]
    bend = np.einsum("nsk,nsk->ns", n, f).min(1)
    np.savez(points, texel=np.stack([r, c], 1), position=pos, normal=nrm, triangle=t, object=sc.obj[t], res=side, footprint=1.0, covered=covered, sub_position=p.astype(np.float32),
             sub_normal=n.astype(np.float32), sub_face=f.astype(np.float32), bend=bend, holes=holes.mean(1))
    reference.jitter(points)


def slivers(tri):
    """mask of triangles with practically no area.  Lumel drops them and creates no chart for them. They stay in the document, where their corners
    may be in charts at opposite ends of the page.  (Without them, the lumels are those that lumel counts; on godot_gi_demo the numbers are equal.)"""
    longest = np.linalg.norm(tri - np.roll(tri, 1, axis=1), axis=2).max(1)
    return np.linalg.norm(np.cross(tri[:, 1] - tri[:, 0], tri[:, 2] - tri[:, 0]), axis=1) < 1e-6 * longest ** 2


def spread(tri, nrm, face, px, r, c):
    """positions, interpolated normals and face normals [n, SUB², 3] at the centres of SUB² cells of the lumels (r, c), NaN off the surface; px: corners in
    texels.  Where triangles overlap, the last one counts, as in texels.subpoints."""
    lo, hi = px.min(1), px.max(1)
    e1, e2 = px[:, 1] - px[:, 0], px[:, 2] - px[:, 0]
    det = e1[:, 0] * e2[:, 1] - e1[:, 1] * e2[:, 0]
    cell = (np.arange(SUB) + 0.5) / SUB
    down, right = [x.ravel() for x in np.meshgrid(cell, cell, indexing="ij")]
    out = np.full((3, len(r), SUB * SUB, 3), np.nan)
    for i in range(len(r)):
        for t in np.nonzero((lo[:, 0] <= c[i] + 1) & (hi[:, 0] >= c[i]) & (lo[:, 1] <= r[i] + 1) & (hi[:, 1] >= r[i]) & (det != 0))[0]:
            x, y = c[i] + right - px[t, 0, 0], r[i] + down - px[t, 0, 1]
            u, v = (x * e2[t, 1] - y * e2[t, 0]) / det[t], (y * e1[t, 0] - x * e1[t, 1]) / det[t]
            on = (u >= 0) & (v >= 0) & (u + v <= 1)
            w = np.stack([1 - u[on] - v[on], u[on], v[on]], 1)
            q = w @ nrm[t]
            out[0, i, on], out[1, i, on], out[2, i, on] = w @ tri[t], q / np.linalg.norm(q, axis=1, keepdims=True), face[t]
    return out


def page(rows):
    """The tables of lab/light_scenes.md."""
    percent = lambda x, d=2: "%.*f %%" % (d, 100 * float(x))      # noqa: E731
    out = ["| scene | texels a metre, lumels | light |", "|---|---|---|"]
    seen = [n for n in SCENES if any(r["scene"] == n for r in rows)]
    for n in seen:
        t, r = SCENES[n], next(r for r in rows if r["scene"] == n)
        light = t["light"] + ("; sky %s" % t["sky"] if t["sky"] != "0,0,0" else "") + ("; sun %s, %g lx%s" % (t["sun"][0], t["sun"][1], ", %g°" % t["sun"][2] if t["sun"][2] else "") if "sun" in t else "")
        out.append("| %s | %s, %s (%s) | %s |" % (t["title"], t["density"] or "auto", r["lumels"], t["why"], light))
    parts = dict(scenes="\n".join(out))
    out = ["| scene | quality | lumels compared | seconds | relRMSE | median | p95 | bias | own noise of the truth | median s.e. of the truth |", "|---|---|---|---|---|---|---|---|---|---|"]
    for r in rows:
        out.append("| %s | %s | %s, %s | %.1f | %s ± %s | %s | %s | %+.2f %% | %s | %s |" % (
            SCENES[r["scene"]]["title"], r["quality"], r["n"], r["family"], float(r["seconds"]), percent(r["relRMSE"]), percent(r["relRMSE_se"]), percent(r["p50"]), percent(r["p95"], 1),
            100 * float(r["bias"]), percent(r["own"]), percent(r["truth_se"])))
    parts["results"] = "\n".join(out)
    parts["setup"] = "%s; %s threads; load average at the start of the bakes %.1f to %.1f." % (
        ", ".join(sorted({r["versions"] for r in rows})), ", ".join(sorted({str(r["threads"]) for r in rows})), min(float(r["load"]) for r in rows), max(float(r["load"]) for r in rows))
    common.write_tables(common.LAB, "light_scenes", parts)


def main():
    ap = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ap.add_argument("--scenes", default=",".join(SCENES))
    ap.add_argument("--quality", default="preview,production")
    ap.add_argument("--references-only", action="store_true")
    ap.add_argument("--reference-time", type=float, default=1.0, help="scales the time limits of references that are made")
    ap.add_argument("--refine", type=float, default=0, help="seconds of further paths for the hard lumels of each scene's reference")
    ap.add_argument("--pictures", action="store_true", help="error maps and lumel's own previews, under --work")
    ap.add_argument("--page-only", action="store_true")
    ap.add_argument("--threads", type=int, default=os.cpu_count())
    ap.add_argument("--work", default="/tmp/light_scenes")
    a = ap.parse_args()
    if a.page_only:
        return page(speed_page.read_csv(CSV))
    if reference.gltf_scene is None:
        raise SystemExit("no truth.py and its companions in %s: set LUMEL_SHARED_TOOLS" % common.SHARED)
    unknown = set(a.scenes.split(",")) - set(SCENES)
    if unknown:
        raise SystemExit("no such scene: %s; there are %s" % (", ".join(sorted(unknown)), ", ".join(SCENES)))
    os.makedirs(a.work, exist_ok=True)
    for name in a.scenes.split(","):
        if not os.path.exists(os.path.join(common.SCENES, SCENES[name]["file"])):
            say("WARNING: scene %s is LEFT OUT: no %s in %s" % (name, SCENES[name]["file"], common.SCENES))
            continue
        scene = Scene(name, a)
        if a.references_only:
            continue
        new = [row for q in a.quality.split(",") for row in scene.measure(q)]
        fresh = {(r["scene"], r["quality"]) for r in new}
        rows = [r for r in speed_page.read_csv(CSV) if (r["scene"], r["quality"]) not in fresh] + new
        order = list(SCENES)
        rows.sort(key=lambda r: (order.index(r["scene"]), ["draft", "quick", "preview", "production"].index(r["quality"])))
        speed_page.write_csv(CSV, COLUMNS, rows)
        page(speed_page.read_csv(CSV))


if __name__ == "__main__":
    main()
