"""Speed against error: lumel's quality settings and Cycles' sample counts over several scenes, each
with a path-traced reference.

After Willmott and Heckbert, "An empirical comparison of progressive and wavelet radiosity", 1997:
every method and every setting on the same scenes, with one measure of error and the time.

Usage : python speed_error.py [--scenes cornell,demo,garage,godot,sponza] [--lumel-only] [--full]
              [--resume] [--smoke] [--references-only] [--reference-time 1.0] [--refine SECONDS]
              [--repeat 3] [--threads N] [--work DIR] [--docs DIR]
        python speed_error.py --final                the five scenes, resuming where an earlier call
                                                     of the same binary was interrupted
        python speed_error.py --final --lumel-only   both kinds of lumel's rows again, with a new
                                                     binary, on the same five scenes; Cycles' rows
                                                     are kept
        python speed_error.py --page-only            plots and page again from the CSV
Steps : for each scene (speed_scenes.py): 1 a draft bake fixes the atlas; 2 its references are found
          under LUMEL_REF or made (reference.py; the scene table limits their time,
          --reference-time scales it, --refine adds to it); 3 all settings of lumel and Cycles run
          in turn, lumel's twice: the whole bake, and equal work (`--no-vertex-colors --in-turn`,
          minus the time for creating and packing charts in that run, because Cycles does neither);
          settings under 5 s run three times, longer ones once; 4 errors of every map; 5 the CSV;
          then the plots and the page (speed_page.py).
Output: lab/data/speed_error.csv          a row for every run and family of lumels, written after
                                          each run; rows that were not run are kept unless they are
                                          of another atlas or, for lumel, of another binary
        lab/images/speed_error.png .svg   one panel per scene
        lab/tables/speed_error.md         tables of lab/speed_error.md
Needs : the lumel binary (LUMEL) built for release; Mitsuba for references that are not cached; bpy
        for Cycles, without which its points are left out with a warning. The machine should be
        idle: the load average is recorded in the CSV and on the page.
Time  : about 25 minutes on an idle machine with 2 cores and cached references; --full adds the
        settings that take minutes each.
"""
import argparse
import json
import os
import sys

import common
import cycles_peer
import reference
import speed_page
import speed_scenes

COLUMNS = ("scene method setting run seconds process_seconds peak_mb n relRMSE p50 p95 p99 bias own family rays threads load versions "
           "relRMSE_se side lumels texels_per_unit triangles backs machine atlas").split()

# lumel's settings: name → options of `lumel bake`; a scene's slow_lumel need --full.
LUMEL = {
    "draft": ["--quality", "draft"],
    "quick": ["--quality", "quick"],
    "quick, error 0.1": ["--quality", "quick", "--error", 0.1],
    "preview": ["--quality", "preview"],
    "preview, error 0.02": ["--quality", "preview", "--error", 0.02],
    "production": ["--quality", "production"],
    "production, error 0.005": ["--quality", "production", "--error", 0.005],
}
# No goal depends on these, so losing them matters least if time runs out. All others of a scene are
# measured in turn, within a quarter of an hour.
LAST = ("production", "production, error 0.005")
# A peer's map in which more than this share of the well-lit lumels is exactly 0 is faulty, not
# noisy. Well-lit means above a third of the mean. In darker lumels, few samples find no light at
# all: on Sponza, 12 % of the lumels between a thousandth and a hundredth of the mean are 0 after
# 256 samples.
MOST_ZEROS, WELL_LIT = 0.01, 0.3
# a lumel counts as lit by a back if two-sided surfaces make it this many times brighter, by more
# than the mean light
BACK_LIT = 10
# Equal work excludes vertex colours and the time for creating and packing charts.  `--uv keep` on the lightmapped level would not be equal: it takes a mesh's
# coordinates as square and packs them again, which gives other lumels (demo level: 43 of 80 nodes get rectangles of another shape).
EQUAL_WORK, NOT_THEIRS = ("--no-vertex-colors", "--in-turn"), "atlas"
LONG = 5.0  # s; settings that take longer are run once


def machine():
    """processor and cores, for the record"""
    name = next((line.split(":", 1)[1].strip() for line in open("/proc/cpuinfo") if line.startswith("model name")), "unknown") if os.path.exists("/proc/cpuinfo") else "unknown"
    return "%s, %d cores" % (name, os.cpu_count())


def say(text):
    print(text, file=sys.stderr, flush=True)


class Scene:
    """One prepared scene: its file, its atlas, its three references."""

    def __init__(self, name, path, a):
        self.name, self.path, self.a = name, path, a
        self.table = speed_scenes.SCENES[name]
        self.flat, self.side, self.draft = speed_scenes.flat_atlas(name, path, a.work, a.threads)
        refs = speed_scenes.references(name, self.flat, self.side, log=say)
        if a.smoke:
            refs.count, refs.target = 100, 0.02
        self.refs = refs
        self.paths = speed_scenes.three_truths(refs, name, a.reference_time, a.refine)
        self.whole, self.half, self.edges = [reference.load(p) for p in self.paths]
        # Two scenes in one: lumels that only a back lights (behind the garage's window pane, 800
        # times the mean) are irrelevant, and would raise the two-sided mean that weights errors in
        # the dark.
        y, z = [r["irradiance"] @ reference.LUMINANCE for r in (self.whole, self.half)]
        same = z <= BACK_LIT * y + y.mean()
        self.whole, self.half = [{k: v[same] if v.ndim and len(v) == len(same) else v for k, v in r.items()} for r in (self.whole, self.half)]
        self.back_lit = int((~same).sum())
        on = [refs.reflecting(ref) for ref in (self.whole, self.half, self.edges)]
        # The lumels that belong to each reference: lumel's and Cycles' families.
        self.families = {
            "lumel": [("all", self.whole, reference.lit(self.whole) & on[0]), ("clear", self.whole, reference.clear(self.whole, self.half) & on[0]),
                      ("edges", self.edges, reference.lit(self.edges) & on[2])],
            "cycles": [("all", self.half, reference.lit(self.half) & on[1]), ("clear", self.half, reference.clear(self.half, self.whole) & on[1])]}
        # What two-sided surfaces add to the mean, over lumels whose footprint does not matter.
        keep = reference.clear(self.whole, self.half)
        one, two = [float((r["irradiance"][keep] @ reference.LUMINANCE).mean()) for r in (self.whole, self.half)]
        self.backs = two / one - 1

    def lumel(self, setting, run, equal=False):
        """rows of a bake; with `equal`, of the same work as in Cycles"""
        out = os.path.join(self.a.work, "%s.%s%s" % (self.name, setting.replace(", ", "_").replace(" ", ""), ".equal" if equal else ""))
        load = os.getloadavg()[0]
        less = EQUAL_WORK if equal else ()
        r = common.bake(self.path, out, *common.COMPARABLE, *less, *LUMEL[setting], "--texels-per-unit", self.table["density"], "--max-page", 2048, "--threads", self.a.threads,
                        *speed_scenes.sky_options(self.name))
        if r["code"] != 0:
            raise SystemExit("lumel failed (%d): %s" % (r["code"], r["err"]))
        report, exr = r["report_json"], r["pages"][0]
        if self.places(r) != self.places(self.draft):
            raise SystemExit("%s: the atlas is not the draft's, so its lumels are not the same" % self.name)
        not_theirs = common.phases(report)[NOT_THEIRS] if equal else 0.0
        base = dict(method=speed_page.EQUAL if equal else speed_page.LUMEL, setting=setting, run=run, seconds=report["measured"]["seconds"] - not_theirs, process_seconds=r["seconds"], peak_mb=r["peak_mb"],
                    rays=report["gather"]["lumel_rays"], load=load,
                    versions="%s, binary %s" % (report["generator"], common.digest(common.LUMEL)[:8]))
        return [self.row(base, family, reference.errors(ref, exr, keep)) for family, ref, keep in self.families["lumel"]]

    def places(self, bake):
        """the lightmap rectangle of each node in a bake"""
        with open(bake["manifest"]) as f:
            return json.load(f)["nodes"]

    def cycles(self, samples, denoise, run):
        out = os.path.join(self.a.work, "%s.cycles%d" % (self.name, samples))
        load = os.getloadavg()[0]
        p = cycles_peer.bake(self.flat, out, self.side, samples, self.a.threads, self.table["sky"], denoise, self.table.get("light_tree", False),
                             self.table.get("bounces", 32))
        dark = self.zeros(p["map"])
        if dark > MOST_ZEROS:
            say("WARNING: %s, Cycles %d samples: %.0f %% of the well-lit lumels hold exactly 0: its bake of this scene is broken, and LEFT OUT" % (self.name, samples, 100 * dark))
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
        """share of the well-lit lumels that are 0 in a map"""
        x, y = reference.values(self.half, exr)
        return float((x[self.families["cycles"][0][2] & (y > WELL_LIT * y.mean())] == 0).mean())

    def row(self, base, family, e):
        return dict(base, scene=self.name, family=family, n=e["n"], threads=self.a.threads, side=self.side,
                    lumels=int(self.whole["covered"]), texels_per_unit=self.table["density"], triangles=len(self.refs.scene.corners), backs=self.backs, machine=machine(), atlas=self.refs.digest,
                    **{k: e[k] for k in ("relRMSE", "relRMSE_se", "p50", "p95", "p99", "bias", "own")})

    def sweep(self, with_cycles, book, last=False):
        """Runs every setting in turn, then those under LONG seconds again, and gives each run's rows to `book` immediately.  With --final, a scene's LAST settings need a separate call"""
        a, jobs = self.a, []
        slow = self.table.get("slow_lumel", ())
        lumel = [s for s in LUMEL if a.full or s not in slow or (a.final and s == "production")]
        samples = list(self.table["cycles"]) + (list(self.table["slow_cycles"]) if a.full or a.final else []) if with_cycles else []
        if a.smoke:
            lumel, samples = lumel[:3:2], [2, 8] if samples else []
        if a.final:
            lumel, samples = [s for s in lumel if (s in LAST) == last], [] if last else samples
        for k in range(max(len(lumel), len(samples))):
            jobs += [(kind, s) for kind in ("lumel", "equal") for s in lumel[k:k + 1]] + [("cycles", s) for s in samples[k:k + 1]]
        book.start(self, jobs)
        again = jobs
        for run in range(1 if a.smoke else a.repeat):
            jobs, again = again, []
            for kind, s in jobs:
                rows = book.of(self, kind, s, run)
                if not rows:
                    rows = self.cycles(s, s <= 256, run) if kind == "cycles" else self.lumel(s, run, kind == "equal")
                    book.add(rows)
                    for r in rows:
                        if r["family"] == "all":
                            say("%s, %s %s: %.2f s, relRMSE %.2f %%, median %.2f %%" % (self.name, r["method"], r["setting"], r["seconds"], 100 * r["relRMSE"], 100 * r["p50"]))
                if rows and float(rows[0]["seconds"]) < LONG:
                    again.append((kind, s))


def kind_of(row):
    """the kind of job that a row belongs to"""
    return {speed_page.LUMEL: "lumel", speed_page.EQUAL: "equal"}.get(row["method"], "cycles")


class Book:
    """The CSV, written after each run, so that an interrupted run keeps its measurements."""

    def __init__(self, path, resume):
        self.path, self.resume, self.rows = path, resume, speed_page.read_csv(path)

    def start(self, scene, jobs):
        """Drops a scene's rows of another atlas or another lumel binary and, unless resuming,
        those of the jobs."""
        name, binary = scene.name, "binary %s" % common.digest(common.LUMEL)[:8]
        mine = {(kind, "%d samples" % s if kind == "cycles" else s) for kind, s in jobs}
        runs_lumel = any(kind != "cycles" for kind, _ in jobs)

        def stays(r):
            if r["scene"] != name:
                return True
            kind = kind_of(r)
            stale = r.get("atlas") != scene.refs.digest or (kind != "cycles" and runs_lumel and not r["versions"].endswith(binary))
            return not stale and (self.resume or (kind, r["setting"]) not in mine)
        self.rows = [r for r in self.rows if stays(r)]

    def of(self, scene, kind, setting, run):
        """the rows of a run that was made before"""
        setting = "%d samples" % setting if kind == "cycles" else setting
        return [r for r in self.rows if r["scene"] == scene.name and kind_of(r) == kind and r["setting"] == setting and str(r["run"]) == str(run)]

    def add(self, rows):
        self.rows += rows
        scenes, methods = list(speed_scenes.SCENES), (speed_page.LUMEL, speed_page.EQUAL, speed_page.CYCLES, speed_page.OIDN)
        self.rows.sort(key=lambda r: (scenes.index(r["scene"]), methods.index(r["method"])))
        new = self.path + ".new"
        speed_page.write_csv(new, COLUMNS, self.rows)
        os.replace(new, self.path)


def main():
    ap = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ap.add_argument("--scenes", help="[default: %s]" % ",".join(speed_scenes.FIVE))
    ap.add_argument("--final", action="store_true", help="--resume, with the slow ones but for `--error`, and lumel's `production` after all else; the page is written after each scene")
    ap.add_argument("--resume", action="store_true", help="runs of the same atlas (and binary, lumel's) that the CSV holds already are not made again")
    ap.add_argument("--lumel-only", action="store_true", help="no Cycles; its rows of an earlier run are kept")
    ap.add_argument("--full", action="store_true", help="the slow settings too")
    ap.add_argument("--smoke", action="store_true", help="few settings, few lumels, bad references: does it run?  Writes into --work only")
    ap.add_argument("--references-only", action="store_true")
    ap.add_argument("--reference-time", type=float, default=1.0, help="scales the time limits of references that are made")
    ap.add_argument("--refine", type=float, default=0, help="seconds of further paths for the hard lumels of each scene's references")
    ap.add_argument("--docs", help="folder of data/speed_error.csv, images/ and the page [default: the project's; with --smoke --work]")
    ap.add_argument("--page-only", action="store_true")
    ap.add_argument("--repeat", type=int, default=3)
    ap.add_argument("--threads", type=int, default=os.cpu_count())
    ap.add_argument("--work", default="/tmp/lumel-speed")
    a = ap.parse_args()
    a.scenes, a.resume = a.scenes or ",".join(speed_scenes.FIVE), a.resume or a.final
    docs = os.path.abspath(a.docs or (a.work if a.smoke else common.LAB))
    table = os.path.join(docs, "data", "speed_error.csv")
    if a.smoke:
        a.reference_time = min(a.reference_time, 0.1)
    os.makedirs(a.work, exist_ok=True)
    if a.page_only:
        return speed_page.write(speed_page.read_csv(table), docs)
    with_cycles = not a.lumel_only and cycles_peer.available()
    if not with_cycles and not a.lumel_only:
        say("WARNING: no module bpy in this Python: Cycles is LEFT OUT; tools/setup.sh installs it")
    unknown = set(a.scenes.split(",")) - set(speed_scenes.SCENES)
    if unknown:
        raise SystemExit("no such scene: %s; there are %s" % (", ".join(sorted(unknown)), ", ".join(speed_scenes.SCENES)))
    ready = []
    for name in a.scenes.split(","):
        path, trouble = speed_scenes.prepare(name, a.work)
        if path is None:
            say("WARNING: scene %s is LEFT OUT: %s" % (name, trouble))
            continue
        ready.append(Scene(name, path, a))
    if a.references_only:
        return
    book = Book(table, a.resume)
    for scene in ready:
        scene.sweep(with_cycles, book)
        speed_page.write(speed_page.read_csv(table), docs)
    for scene in ready if a.final else []:
        scene.sweep(with_cycles, book, last=True)
    speed_page.write(speed_page.read_csv(table), docs)


if __name__ == "__main__":
    main()
