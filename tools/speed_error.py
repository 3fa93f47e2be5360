"""Speed against error: lumel's quality settings and Cycles' sample counts over several scenes, each with its path-traced reference.

After Willmott and Heckbert, "An empirical comparison of progressive and wavelet radiosity", 1997: every method, every setting, the same scenes,
one measure of error, time beside it.

Usage : python speed_error.py [--scenes cornell,room,demo,dense,sponza] [--lumel-only] [--full] [--smoke]
              [--references-only] [--reference-time 1.0] [--refine SECONDS] [--repeat 3] [--threads N] [--work DIR]
        python speed_error.py --page-only          plots and page again from the CSV
Steps : for each scene (speed_scenes.py): 1 a draft bake fixes the atlas; 2 its references are looked up under LUMEL_REF or made
          (reference.py; their time is bounded in the scene table, --reference-time scales it, --refine adds to what is there); 3 all settings of lumel and
          Cycles in turn; settings under 5 s three times, longer ones once; 4 errors of every map; 5 the CSV; then the plots and the page (speed_page.py).
Output: docs/data/speed_error.csv       a row for every run and family of lumels; scenes that were not run keep their rows
        docs/images/speed_error.png .svg  one panel a scene;  docs/images/weakness_*.png
        docs/speed_error.md             the parts between <!-- generated:NAME --> and <!-- end --> are written anew, the rest stays
Needs : the lumel binary (LUMEL) built for release; Mitsuba for references that are not cached; bpy for Cycles, else its points are left out,
        with a warning.  The machine should be quiet: the load average goes into the CSV and onto the page.
Time  : on a quiet machine of 2 cores with cached references about 15 minutes; --full adds the settings that take minutes each.
"""
import argparse
import os
import sys

import common
import cycles_peer
import error_map
import reference
import speed_page
import speed_scenes

CSV = os.path.join(common.HERE, "..", "docs", "data", "speed_error.csv")
COLUMNS = ("scene method setting run seconds process_seconds peak_mb n relRMSE p50 p95 p99 bias own family rays threads load versions "
           "relRMSE_se side lumels texels_per_unit triangles backs machine").split()

# lumel's settings: name → options of `lumel bake`; a scene's slow_lumel need --full.
LUMEL = {
    "draft": ["--quality", "draft"],
    "draft, error 0.1": ["--quality", "draft", "--error", 0.1],
    "preview": ["--quality", "preview"],
    "preview, error 0.02": ["--quality", "preview", "--error", 0.02],
    "production": ["--quality", "production"],
    "production, error 0.005": ["--quality", "production", "--error", 0.005],
}
MOST_ZEROS = 0.02   # a peer's map with more lit lumels at exactly 0 shows a fault of its bake, not noise
LONG = 5.0      # s; what takes longer is run once


def machine():
    """processor and cores, for the record"""
    name = next((line.split(":", 1)[1].strip() for line in open("/proc/cpuinfo") if line.startswith("model name")), "unknown") if os.path.exists("/proc/cpuinfo") else "unknown"
    return "%s, %d cores" % (name, os.cpu_count())


def say(text):
    print(text, file=sys.stderr, flush=True)


class Scene:
    """One scene made ready: its file, its atlas, its three references."""

    def __init__(self, name, path, a):
        self.name, self.path, self.a = name, path, a
        self.table = speed_scenes.SCENES[name]
        self.flat, self.side = speed_scenes.flat_atlas(name, path, a.work, a.threads)
        refs = speed_scenes.references(name, self.flat, self.side, log=say)
        if a.smoke:
            refs.count, refs.target = 100, 0.02
        self.refs = refs
        self.paths = speed_scenes.three_truths(refs, name, a.reference_time, a.refine)
        self.whole, self.half, self.edges = [reference.load(p) for p in self.paths]
        on = [refs.reflecting(ref) for ref in (self.whole, self.half, self.edges)]
        # Which lumels of which reference: lumel's and Cycles' families.
        self.families = {
            "lumel": [("all", self.whole, reference.lit(self.whole) & on[0]), ("clear", self.whole, reference.clear(self.whole, self.half) & on[0]),
                      ("edges", self.edges, reference.lit(self.edges) & on[2])],
            "cycles": [("all", self.half, reference.lit(self.half) & on[1]), ("clear", self.half, reference.clear(self.half, self.whole) & on[1])]}
        # What two-sided surfaces add to the mean, over lumels whose footprint does not matter.
        keep = reference.clear(self.whole, self.half)
        one, two = [float((r["irradiance"][keep] @ [0.2126, 0.7152, 0.0722]).mean()) for r in (self.whole, self.half)]
        self.backs, self.maps = two / one - 1, {}

    def lumel(self, setting, run):
        out = os.path.join(self.a.work, "%s.%s" % (self.name, setting.replace(", ", "_").replace(" ", "")))
        load = os.getloadavg()[0]
        r = common.bake(self.path, out, *common.AREA_MEAN, *LUMEL[setting], "--texels-per-unit", self.table["density"], "--max-page", 2048, "--threads", self.a.threads,
                        *speed_scenes.sky_options(self.name))
        if r["code"] != 0:
            raise SystemExit("lumel failed (%d): %s" % (r["code"], r["err"]))
        report, exr = r["report_json"], r["pages"][0]
        self.maps[setting] = exr
        base = dict(method="lumel", setting=setting, run=run, seconds=report["measured"]["seconds"], process_seconds=r["seconds"], peak_mb=r["peak_mb"],
                    rays=report["gather"]["lumel_rays"], load=load,
                    versions="%s, binary %s" % (report["generator"], common.digest(common.LUMEL)[:8]))
        return [self.row(base, family, reference.errors(ref, exr, keep)) for family, ref, keep in self.families["lumel"]]

    def map_of(self, setting):
        """the lightmap of a setting that this run has baked, or None"""
        return self.maps.get(setting)

    def cycles(self, samples, denoise, run):
        out = os.path.join(self.a.work, "%s.cycles%d" % (self.name, samples))
        load = os.getloadavg()[0]
        p = cycles_peer.bake(self.flat, out, self.side, samples, self.a.threads, self.table["sky"], denoise, self.table.get("light_tree", False))
        if p["unwrapped"]:
            raise SystemExit("%s: Cycles unwrapped %d meshes anew, so its lumels are not the same" % (self.name, p["unwrapped"]))
        dark = self.zeros(p["map"])
        if dark > MOST_ZEROS:
            say("WARNING: %s, Cycles %d samples: %.0f %% of the lit lumels hold exactly 0: its bake of this scene is broken, and LEFT OUT" % (self.name, samples, 100 * dark))
            return []
        rows = []
        for method, exr, seconds in [("Cycles", p["map"], p["bake_s"]), ("Cycles + OIDN", p["denoised"], p["bake_s"] + p["denoise_s"])]:
            if exr is None:
                continue
            base = dict(method=method, setting="%d samples" % samples, run=run, seconds=seconds, process_seconds=p["process_s"], peak_mb=p["peak_rss_mb"],
                        rays=samples * p["texels_covered"], load=load, versions="Blender %s" % p["version"])
            rows += [self.row(base, family, reference.errors(ref, exr, keep)) for family, ref, keep in self.families["cycles"]]
        return rows

    def zeros(self, exr):
        """share of the lit lumels in which a map holds nothing"""
        c = reference._compare()
        keep = self.families["cycles"][0][2]
        r, k = self.half["texel"][keep].T
        return float((c.read_exr(exr)[r, k] @ c.LUM == 0).mean())

    def row(self, base, family, e):
        return dict(base, scene=self.name, family=family, n=e["n"], threads=self.a.threads, side=self.side,
                    lumels=int(self.whole["covered"]), texels_per_unit=self.table["density"], triangles=self.triangles, backs=self.backs, machine=machine(),
                    **{k: e[k] for k in ("relRMSE", "relRMSE_se", "p50", "p95", "p99", "bias", "own")})

    @property
    def triangles(self):
        if not hasattr(self, "_triangles"):
            self._triangles = len(reference.gltf_scene.load(self.flat, images=False).tri)
        return self._triangles

    def sweep(self, with_cycles):
        """Every setting in turn, then those under LONG seconds again."""
        a, jobs = self.a, []
        lumel = [s for s in LUMEL if a.full or s not in self.table.get("slow_lumel", ())]
        samples = list(self.table["cycles"]) + (list(self.table["slow_cycles"]) if a.full else []) if with_cycles else []
        if a.smoke:
            lumel, samples = lumel[:3:2], [2, 8] if samples else []
        for k in range(max(len(lumel), len(samples))):
            jobs += [("lumel", s) for s in lumel[k:k + 1]] + [("cycles", s) for s in samples[k:k + 1]]
        rows, again = [], jobs
        for run in range(1 if a.smoke else a.repeat):
            jobs, again = again, []
            for kind, s in jobs:
                new = self.lumel(s, run) if kind == "lumel" else self.cycles(s, s <= 256, run)
                if not new:
                    continue
                rows += new
                say("%s, %s %s: %.2f s, relRMSE %.2f %%" % (self.name, new[0]["method"], new[0]["setting"], new[0]["seconds"], 100 * new[0]["relRMSE"]))
                if new[0]["seconds"] < LONG:
                    again.append((kind, s))
        return rows


def main():
    ap = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ap.add_argument("--scenes", default=",".join(speed_scenes.SCENES))
    ap.add_argument("--lumel-only", action="store_true", help="no Cycles; its rows of an earlier run are kept")
    ap.add_argument("--full", action="store_true", help="the slow settings too")
    ap.add_argument("--smoke", action="store_true", help="few settings, few lumels, bad references: does it run?  Writes into --work only")
    ap.add_argument("--references-only", action="store_true")
    ap.add_argument("--reference-time", type=float, default=1.0, help="scales the time limits of references that are made")
    ap.add_argument("--refine", type=float, default=0, help="seconds of further paths for the hard lumels of each scene's references; with --references-only a quarter as much for each picture's too")
    ap.add_argument("--page-only", action="store_true")
    ap.add_argument("--repeat", type=int, default=3)
    ap.add_argument("--threads", type=int, default=os.cpu_count())
    ap.add_argument("--work", default="/tmp/lumel-speed")
    a = ap.parse_args()
    docs = a.work if a.smoke else os.path.join(common.HERE, "..", "docs")
    table = os.path.join(a.work, "data", "speed_error.csv") if a.smoke else CSV
    if a.smoke:
        a.reference_time = min(a.reference_time, 0.1)
    os.makedirs(a.work, exist_ok=True)
    if a.page_only:
        return speed_page.write(speed_page.read_csv(table), docs)
    if reference.gltf_scene is None:
        raise SystemExit("no truth.py and its companions in %s: set LUMEL_SHARED_TOOLS" % common.SHARED)
    with_cycles = not a.lumel_only and cycles_peer.available()
    if not with_cycles and not a.lumel_only:
        say("WARNING: no module bpy in this Python: Cycles is LEFT OUT; tools/setup.sh installs it")
    ready = []
    unknown = set(a.scenes.split(",")) - set(speed_scenes.SCENES)
    if unknown:
        raise SystemExit("no such scene: %s; there are %s" % (", ".join(sorted(unknown)), ", ".join(speed_scenes.SCENES)))
    for name in a.scenes.split(","):
        path, trouble = speed_scenes.prepare(name, a.work)
        if path is None:
            say("WARNING: scene %s is LEFT OUT: %s" % (name, trouble))
            continue
        ready.append(Scene(name, path, a))
    if a.references_only:
        for s in ready:
            for w in speed_page.WEAKNESSES:
                if w["scene"] == s.name and not a.smoke:
                    error_map.truth_of(s.refs, w, a.refine / 4)
        return
    for scene in ready:
        new = scene.sweep(with_cycles)
        fresh = {(r["scene"], r["method"]) for r in new}
        rows = [r for r in speed_page.read_csv(table) if (r["scene"], r["method"]) not in fresh] + new
        order = list(speed_scenes.SCENES)
        rows.sort(key=lambda r: (order.index(r["scene"]), r["method"] != "lumel", r["method"]))
        speed_page.write_csv(table, COLUMNS, rows)
    if not a.smoke:
        speed_page.weaknesses({s.name: s for s in ready}, docs, say)
    speed_page.write(speed_page.read_csv(table), docs)


if __name__ == "__main__":
    main()
