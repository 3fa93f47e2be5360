"""Error of lumel on levels with typical lights and materials: suns, sky, lamps with a range, emissive
boxes, leaves, glass, cut-outs.

Usage : python light_scenes.py [--scenes gi_demo,truck_town,house,lamp,emissive,sponza]
              [--quality preview,production] [--references-only] [--reference-time 1.0]
              [--refine SECONDS] [--threads N] [--work /tmp/light_scenes] [--pictures]
        python light_scenes.py --page-only          the page again from the CSV
Steps : for each scene (SCENES below): 1 a copy with the sun added; 2 a draft bake, whose atlas is
        flattened; 3 a selection of its lumels and their reference (reference.py), found under
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
LIMIT = 0.98  # both limit reflectance to this (judge/scene.py)
# a lumel is curved if an interpolated normal differs by more than this from the face normal
CURVED = np.cos(np.radians(1.0))

# file    under LUMEL_SCENES;  density: texels per metre, and why; None leaves it to lumel, which only then lowers it on huge meshes
# sky     radiance;  sun: (direction of travel, lux), added to the document as a punctual light
# lift    offset of the truth's rays, see truth.py
# count   lumels drawn;  target: median relative standard error;  seconds: limit of the reference
SCENES = {
    "gi_demo": dict(
        title="godot_gi_demo", file="godot_gi_demo/godot_gi_demo.glb", density=2.61, why="what `lumel bake` chooses: 38 cm a lumel", sky="0,0,0",
        light="its own sun (1 lx), two point lamps, a spot with a cone of 90°, all three with a range, and a glowing box; no sky; every other surface is white",
        count=1000, target=0.003, seconds=150),
    "truck_town": dict(
        title="godot_truck_town", file="godot_truck_town/godot_truck_town.glb", density=None, why="what `lumel bake` chooses: 2.48, and 0.109 for the plane of 2048 m", sky="0.2,0.25,0.3",
        light="its own sun (1.45 lx) and ten street lamps with a range, and a sky; leaves are BLEND", lift=1e-6, count=1000, target=0.001, seconds=120),
    "house": dict(
        title="playcanvas_house", file="playcanvas_house/house.glb", density=454, why="what `lumel bake` chooses: 2.2 mm a lumel, the scene is half a metre wide", sky="0.5,0.6,0.8",
        sun=((-0.4, -1, -0.3), 6.0), light="none of its own: a sky and a sun; one material is MASK", count=1000, target=0.001, seconds=100),
    "lamp": dict(
        title="LightsPunctualLamp", file="features/LightsPunctualLamp/LightsPunctualLamp.gltf", density=262, why="what `lumel bake` chooses: 3.8 mm a lumel", sky="0,0,0",
        light="five point lamps, an emissive texture, glass (KHR_materials_transmission with a texture) and a BLEND material", count=1000, target=0.002, seconds=120),
    "emissive": dict(
        title="EmissiveStrengthTest", file="features/EmissiveStrengthTest/EmissiveStrengthTest.glb", density=None, why="what `lumel bake` chooses: 70.7, and 11.3 for the backdrop", sky="0,0,0",
        light="five boxes of emissive strength 1 to 16, which are black otherwise", count=1000, target=0.001, seconds=80),
    "sponza": dict(
        title="Sponza", file="sponza/sponza.glb", density=4.97, why="that of lab/speed_error.md: 20 cm a lumel", sky="0.5,0.6,0.8", sun=((-0.3, -1, 0.2), 6.0),
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
            speed_scenes.with_sun(path, *self.table["sun"], sunny)
            path = sunny
        self.path = path
        r = self.bake("draft", "flat")  # the atlas is the same at every quality
        if len(r["pages"]) != 1:
            raise SystemExit("%s: %d pages, expected one" % (name, len(r["pages"])))
        self.flat = os.path.join(a.work, name + ".flat.glb")
        self.side = reference.flatten(r["glb"], self.flat)["res"]
        t = self.table
        refs = reference.References("light_" + name, self.flat, self.side, t["count"], t["target"], t["seconds"] * a.reference_time, t["sky"], lift=t.get("lift", 5e-6), log=say)
        self.scene = refs.scene
        self.ref = reference.load(refs.truth(two_sided=False, inset=0, refine=a.refine))

    def bake(self, quality, folder, *more):
        t = self.table
        sky = [] if t["sky"] == "0,0,0" else ["--sky", t["sky"]]
        out = os.path.join(self.a.work, "%s.%s" % (self.name, folder))
        r = common.bake(self.path, out, "--quality", quality, *common.COMPARABLE, *(["--texels-per-unit", t["density"]] if t["density"] else []), "--max-page", 2048, "--threads", self.a.threads,
                        "--max-reflectance", LIMIT, *sky, *more)
        if r["code"] != 0:
            raise SystemExit("%s: lumel failed (%d): %s" % (self.name, r["code"], r["err"]))
        return r

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
            _, corner = np.unique(self.scene.corners.reshape(-1, 3).astype(np.float32), axis=0, return_inverse=True)
            _, first = np.unique(np.sort(corner.reshape(-1, 3), axis=1), axis=0, return_index=True)
            self._copies = np.ones(len(self.scene.corners), bool)
            self._copies[first] = False
        return self._copies

    def measure(self, quality):
        load = os.getloadavg()[0]
        shot = os.path.join(self.a.work, "%s.%s.lit.png" % (self.name, quality))
        r = self.bake(quality, quality, *(["--preview", shot] if self.a.pictures else []))
        report, exr, ref, t = r["report_json"], r["pages"][0], self.ref, self.table
        rows = []
        for family, keep in self.families().items():
            if keep.sum() < 20:
                continue
            e = reference.errors(ref, exr, keep)
            x, y = [v[keep] for v in reference.values(ref, exr)]
            rows.append(dict(scene=self.name, quality=quality, family=family, truth_se=float(np.median(ref["stderr_y"][keep] / y)), zeros=float((x == 0).mean()), seconds=report["measured"]["seconds"], lumels=int(ref["covered"]),
                             texels_per_unit=t["density"] or "auto", sky=t["sky"], sun=" ".join(str(x) for x in t.get("sun", ())), options="--max-reflectance %g" % LIMIT,
                             triangles=len(self.scene.corners), threads=self.a.threads, load=load, versions="%s, binary %s" % (report["generator"], common.digest(common.LUMEL)[:8]),
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
        lit, error, (found, true) = reference.lit(ref), reference.signed(ref, exr), reference.values(ref, exr)
        square = np.where(lit, error ** 2, 0)
        names, mats = np.array(sc.names)[sc.node[ref["triangle"]]], np.array(["material %d" % i for i in sc.material[ref["triangle"]]])
        groups = {}
        for key in sorted(set(zip(names, mats))):
            k = (names == key[0]) & (mats == key[1]) & lit
            if k.any():
                groups["%s / %s" % key] = dict(n=int(k.sum()), relRMSE=float(np.sqrt(square[k].mean())), bias=float(error[k].mean()), share_of_square=float(square[k].sum() / max(square.sum(), 1e-300)))
        worst = []
        for i in np.argsort(-square)[:25]:
            r, c = ref["texel"][i]
            worst.append(dict(node=str(names[i]), material=str(mats[i]), texel=[int(r), int(c)], position=[round(float(x), 4) for x in ref["centre"][i]],
                              truth=float(true[i] / np.pi), found=float(found[i] / np.pi), truth_se=float(ref["stderr_y"][i] / np.pi), bend=float(ref["bend"][i]), holes=float(ref["holes"][i]),
                              copy=bool(self.copies[ref["triangle"][i]])))
        unlit = ~lit
        bright = dict(n=int(unlit.sum()), brightest=float(found[unlit].max(initial=0) / np.pi), mean_truth=float(true.mean() / np.pi))
        with open(os.path.join(self.a.work, "%s.%s.json" % (self.name, quality)), "w") as f:
            json.dump(dict(groups=dict(sorted(groups.items(), key=lambda g: -g[1]["share_of_square"])), worst=worst, unlit=bright), f, indent=1)


def page(rows):
    """The tables of lab/light_scenes.md."""
    percent = lambda x, d=2: "%.*f %%" % (d, 100 * float(x))      # noqa: E731
    out = ["| scene | texels a metre, lumels | light |", "|---|---|---|"]
    seen = [n for n in SCENES if any(r["scene"] == n for r in rows)]
    for n in seen:
        t, r = SCENES[n], next(r for r in rows if r["scene"] == n)
        light = t["light"] + ("; sky %s" % t["sky"] if t["sky"] != "0,0,0" else "") + ("; sun %s, %g lx" % t["sun"] if "sun" in t else "")
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
