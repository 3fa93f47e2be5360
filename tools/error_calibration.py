"""Is a bake's own error estimate right? Compares estimated with true error, lumel by lumel, over five
scenes.

Usage : python error_calibration.py [--scenes cornell,demo,garage,godot,sponza]
              [--settings draft,quick,preview,error] [--lumel BINARY] [--truth bake|paths]
              [--references-only] [--pictures] [--docs DIR] [--work DIR]
        python error_calibration.py --page-only          lab/tables/error.md from the CSV
Steps : for each scene of speed_scenes.py, at its density there, 1 fix the atlas with a draft bake;
        2 find its reference under LUMEL_REF or make it; 3 bake every setting with
        `--layers direct,indirect,error,coverage`; 4 compare the error channel with
        (bake − reference), lumel by lumel.
        `--truth bake` (default): all lumels, compared with a bake of BINARY at `production`, cached
        by the content of the scene and its atlas but not by the binary. Errors that both have do
        not show.
        `--truth paths`: area means of randomly chosen lumels from a path tracer that shares no code
        with the baker, those of speed_error.py (including chart edges). Only lumels entirely on the
        surface, because for others, the two average over different parts.
        Settings: a preset; `error`: preview with the scene's own `--error` from the table below;
        0.02: preview with that error; draft+0.1.
Output: one line per setting, and how the deciles of the estimate perform;
        lab/data/error_calibration.csv; lab/tables/error.md;
        with --pictures lab/images/error_*.png: estimated and true error of a whole page.
Errors: (bake − truth)/(truth + 1 % of the mean truth) on luminance, over lit lumels; the estimate
        (channel error.Y) over the same. `report` is the bake's own figure, relative to its own
        light. With --truth paths, the truth's own noise is subtracted from the squared error.
Time  : on two idle cores, five minutes with cached references; those of --truth bake take ten.
Needs : OpenEXR, numpy, scipy; Mitsuba for path-traced references that are not cached;
        matplotlib for pictures.
"""
import argparse
import csv
import json
import os
import re
import shutil
import sys

import numpy as np

import common
import reference
import speed_scenes

DOCS = common.LAB
CSV = os.path.join(DOCS, "data", "error_calibration.csv")
COLUMNS = ("scene truth setting wanted reached n lumels report_rms estimated true own ratio spearman p50_estimated p50_true "
           "bias within1 within2 deciles_estimated deciles_true mrays instructions versions atlas").split()

# The target of `error` for each scene: slightly less than `preview` claims, so that there is work
# to do.
ERROR = {"cornell": "0.01", "demo": "0.05", "garage": "0.2", "godot": "0.03", "sponza": "0.1"}
WHOLE = 0.999
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])


def say(text):
    print(text, file=sys.stderr, flush=True)


def options_of(setting):
    """`0.02` is `--error 0.02` at preview; `draft+0.1` at draft"""
    quality, _, error = setting.partition("+")
    if not quality[0].isalpha():
        quality, error = "preview", setting
    return ["--quality", quality] + (["--error", error] if error else []), float(error) if error else None


def bake(binary, scene, out, *options):
    """common.bake() with another binary, and `instructions` (millions) if `perf` counts them"""
    os.makedirs(out, exist_ok=True)
    for old in common.outputs(out)["pages"]:
        os.remove(old)
    perf = [p for p in [shutil.which("perf")] if p]
    r = common.run([*perf, *(["stat", "-x,", "-e", "instructions:u", "--"] if perf else []), binary, "bake", scene, "-o", out, "-q", *map(str, options)])
    if r["code"] != 0:
        raise SystemExit("lumel failed (%d): %s" % (r["code"], r["err"]))
    r.update(common.outputs(out))
    r["report_json"] = json.load(open(r["report"]))
    count = re.search(r"^(\d+),", r["err"], re.M)
    r["instructions"] = int(count.group(1)) / 1e6 if count else ""
    return r


class Scene:
    def __init__(self, name, a):
        self.name, self.a, self.table = name, a, speed_scenes.SCENES[name]
        self.path, trouble = speed_scenes.prepare(name, a.work)
        if self.path is None:
            raise FileNotFoundError(trouble)
        self.options = ["--texels-per-unit", self.table["density"], "--max-page", 2048] + speed_scenes.sky_options(name)
        flat, side, _ = speed_scenes.flat_atlas(name, self.path, a.work, a.threads)
        self.refs = speed_scenes.references(name, flat, side, log=say)
        if a.truth == "paths":
            self.truth = reference.load(speed_scenes.three_truths(self.refs, name)[2])
        else:
            finest = os.path.join(common.REF, "bakes", "%s-%s" % (name, self.refs.digest))
            if not os.path.exists(os.path.join(finest, "done")):
                self.bake("production", finest)
                open(os.path.join(finest, "done"), "w").close()
            page = channels(common.outputs(finest)["pages"][0])
            texel = np.argwhere(page["coverage"] > 0)
            t = page["rgb"][tuple(texel.T)] * np.pi
            self.truth = dict(texel=texel, irradiance=t, stderr=np.zeros_like(t), share=page["coverage"][tuple(texel.T)])

    def bake(self, setting, out):
        """out: a folder, absolute or of `work`"""
        opts, _ = self.asked(setting)
        out = os.path.join(self.a.work, out)
        stamp = json.dumps([common.digest(self.a.lumel), common.digest(self.path), opts, self.options])
        if os.path.exists(out + ".done") and open(out + ".done").read() == stamp and self.a.keep:
            r = dict(common.outputs(out), report_json=json.load(open(common.outputs(out)["report"])), instructions="")
            return r
        r = bake(self.a.lumel, self.path, out, *common.COMPARABLE, "--layers", "direct,indirect,error,coverage", *opts, *self.options,
                 "--threads", self.a.threads)
        open(out + ".done", "w").write(stamp)
        return r

    def asked(self, setting):
        return options_of(ERROR[self.name] if setting == "error" else setting)

    def row(self, setting):
        r = self.bake(setting, "%s.%s" % (self.name, setting))
        report, page = r["report_json"], channels(r["pages"][0])
        at = tuple(self.truth["texel"].T)
        # For a texel across a chart's border, lumels.py and the baker average over different parts.
        whole = page["coverage"][at] > WHOLE if self.a.truth == "paths" else np.ones(len(at[0]), bool)
        m = measure(page["rgb"][at] @ LUMINANCE * np.pi, page["error"][at] * np.pi, self.truth, whole)
        gather = report["gather"]
        if self.a.truth == "bake":
            # The bake promises this figure, and it covers all of its lumels.
            m["ratio"] = gather["estimated_error"] / max(m["true"], 1e-12)
        return dict(m, scene=self.name, truth=self.a.truth, setting=ERROR[self.name] if setting == "error" else setting, wanted=self.asked(setting)[1] or "", reached=gather.get("error_reached", ""),
                    lumels=gather["lumels"], report_rms=gather["estimated_error"], mrays=gather["lumel_rays"] / 1e6, instructions=r.get("instructions") or "",
                    atlas=self.refs.digest, versions="%s, binary %s" % (report["generator"], common.digest(self.a.lumel)[:8]))


def channels(path):
    """{rgb, error, coverage, direct, indirect} of an EXR, [row, column(, 3)]"""
    data = common.exr_channels(path)
    three = lambda prefix: np.stack([data[prefix + c] for c in "RGB"], -1)      # noqa: E731
    return dict(rgb=three(""), direct=three("direct."), indirect=three("indirect."), error=data["error.Y"], coverage=data["coverage.Y"])


def measure(x, e, truth, keep):
    """x: irradiance of the bake, e: its estimated standard error, keep: lumels to compare"""
    from scipy.stats import spearmanr
    t, s = truth["irradiance"] @ LUMINANCE, truth["stderr"] @ LUMINANCE
    # The bake's own measure: the mean is over the surface, so a lumel partly on it counts in part.
    mean = np.average(t, weights=truth.get("share"))
    lit = keep & (t > reference.LIT * mean)
    scale = t + 0.01 * mean
    err, noise = ((x - t) / scale)[lit], (s / scale)[lit]
    est = (e / scale)[lit]
    rms = lambda v: float(np.sqrt(np.mean(v * v)))     # noqa: E731
    square = err * err - noise * noise
    true = float(np.sqrt(max(square.mean(), 0.0)))
    order = np.argsort(est, kind="stable")
    tenths = np.array_split(order, 10)
    dec_e = [rms(est[k]) for k in tenths]
    dec_t = [float(np.sqrt(max(square[k].mean(), 0.0))) for k in tenths]
    both = np.hypot(est, noise)
    return dict(n=int(lit.sum()), estimated=rms(est), true=true, own=rms(noise), ratio=rms(est) / max(true, 1e-12), spearman=float(spearmanr(est, abs(err)).statistic),
                p50_estimated=float(np.median(est)), p50_true=float(np.median(abs(err))), bias=float((x[lit].mean() / t[lit].mean()) - 1),
                within1=float((abs(err) <= both).mean()), within2=float((abs(err) <= 2 * both).mean()),
                deciles_estimated=" ".join("%.5f" % v for v in dec_e), deciles_true=" ".join("%.5f" % v for v in dec_t))


def show(r):
    say("%-8s %-16s est %6.2f %%  true %6.2f %%  ratio %5.2f   (own %.2f %%, report %.2f %%) median %.2f / %.2f %%  rank %.2f  within 1σ %.0f %%, 2σ %.0f %%  %s" % (
        r["scene"], r["setting"], 100 * r["estimated"], 100 * r["true"], r["ratio"], 100 * r["own"], 100 * r["report_rms"], 100 * r["p50_estimated"], 100 * r["p50_true"],
        r["spearman"], 100 * r["within1"], 100 * r["within2"], "reached: %s" % r["reached"] if r["wanted"] else ""))
    say("         deciles: estimated " + " ".join("%6.2f" % (100 * float(v)) for v in r["deciles_estimated"].split()))
    say("                  true      " + " ".join("%6.2f" % (100 * float(v)) for v in r["deciles_true"].split()))


def keep_rows(rows):
    """Adds rows to the CSV. They replace those of the same scene, truth and setting, and those
    of the scene with another atlas."""
    key = lambda r: (r["scene"], r["truth"], r["setting"])     # noqa: E731
    old = read_rows()
    fresh = {key(r) for r in rows}
    order = list(speed_scenes.FIVE)
    atlas = {r["scene"]: r["atlas"] for r in rows}
    new = sorted([r for r in old if key(r) not in fresh and r.get("atlas") == atlas.get(r["scene"], r.get("atlas"))] + rows, key=lambda r: (r["truth"], order.index(r["scene"]), {"draft": 0, "quick": 1, "preview": 2, "production": 3}.get(r["setting"], 4)))
    os.makedirs(os.path.dirname(CSV), exist_ok=True)
    with open(CSV, "w", newline="") as f:
        out = csv.DictWriter(f, COLUMNS, extrasaction="ignore")
        out.writeheader()
        out.writerows({k: "%.6g" % v if isinstance(v, float) else v for k, v in r.items()} for r in new)


def read_rows():
    return list(csv.DictReader(open(CSV, newline=""))) if os.path.exists(CSV) else []


def page():
    """lab/tables/error.md from the CSV"""
    rows = read_rows()
    percent = lambda x: "%.2f %%" % (100 * float(x))      # noqa: E731
    name = lambda s: s if s[0].isalpha() else "`--error %s`" % s      # noqa: E731
    parts = {}
    for truth in ("bake", "paths"):
        lines = ["| scene | setting | lumels | claimed | layer | true | ratio | median, estimated | true | rank correlation | within 1σ, 2σ | reached | M instructions |", "|" + " --- |" * 13]
        for r in rows:
            if r["truth"] == truth:
                good = 1 / 1.5 <= float(r["ratio"]) <= 1.5
                lines.append("| %s | %s | %s | %s | %s | %s | %s | %s | %s | %.2f | %.0f, %.0f %% | %s | %s |" % (
                    speed_scenes.SCENES[r["scene"]]["title"], name(r["setting"]), r["n"], percent(r["report_rms"]), percent(r["estimated"]), percent(r["true"]), ("%.2f" if good else "**%.2f**") % float(r["ratio"]),
                    percent(r["p50_estimated"]), percent(r["p50_true"]), float(r["spearman"]), 100 * float(r["within1"]), 100 * float(r["within2"]),
                    {"True": "yes", "False": "no"}.get(r["reached"], ""), "%.0f" % float(r["instructions"]) if r["instructions"] else ""))
        parts[truth] = "\n".join(lines)
    lines = ["| scene | setting | |" + " %d |" * 10 % tuple(range(1, 11)), "|" + " --- |" * 13]
    for r in rows:
        if r["truth"] == "bake":
            for what in ("estimated", "true"):
                cells = ["%.2f" % (100 * float(v)) for v in r["deciles_" + what].split()]
                lines.append("| %s | %s | %s | %s |" % (speed_scenes.SCENES[r["scene"]]["title"], name(r["setting"]), what, " | ".join(cells)))
    parts["deciles"] = "\n".join(lines)
    common.write_tables(DOCS, "error", parts)


def picture(scene, setting):
    """estimated and true error of the page, from the reference of all lumels"""
    import matplotlib
    matplotlib.use("Agg")
    from matplotlib import pyplot as plt
    page = channels(common.outputs(os.path.join(scene.a.work, "%s.%s" % (scene.name, setting)))["pages"][0])
    t = np.zeros(page["coverage"].shape)
    at = tuple(scene.truth["texel"].T)
    t[at] = scene.truth["irradiance"] @ LUMINANCE
    scale = t + 0.01 * t[at].mean()
    on = t > reference.LIT * t[at].mean()
    show_me = [np.where(on, page["error"] * np.pi / scale, np.nan), np.where(on, abs(page["rgb"] @ LUMINANCE * np.pi - t) / scale, np.nan)]
    fig, axes = plt.subplots(1, 2, figsize=(12, 6), constrained_layout=True)
    for ax, data, title in zip(axes, show_me, ("estimated standard error", "true error")):
        shown = ax.imshow(np.maximum(data, 1e-4), norm=matplotlib.colors.LogNorm(1e-3, 1), cmap="magma", interpolation="nearest")
        ax.set_title("%s, %s: %s" % (speed_scenes.SCENES[scene.name]["title"], setting, title))
        ax.set_axis_off()
    fig.colorbar(shown, ax=axes, label="relative error", shrink=0.8)
    fig.savefig(os.path.join(DOCS, "images", "error_%s.png" % scene.name), dpi=80)


def main():
    ap = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ap.add_argument("--scenes", default=",".join(speed_scenes.FIVE))
    ap.add_argument("--settings", default="draft,quick,preview,error")
    ap.add_argument("--lumel", default=common.LUMEL)
    ap.add_argument("--truth", choices=("paths", "bake"), default="bake")
    ap.add_argument("--pictures", action="store_true", help="of the first of the settings")
    ap.add_argument("--page-only", action="store_true")
    ap.add_argument("--references-only", action="store_true")
    ap.add_argument("--keep", action="store_true", help="bakes of an earlier run by the same binary are used again (without their instructions)")
    ap.add_argument("--threads", type=int, default=os.cpu_count())
    ap.add_argument("--work", default="/tmp/lumel-calibration")
    ap.add_argument("--docs", help="folder of data/error_calibration.csv, images/ and the page [default: the project's]")
    a = ap.parse_args()
    global DOCS, CSV
    if a.docs:
        DOCS = os.path.abspath(a.docs)
        CSV = os.path.join(DOCS, "data", "error_calibration.csv")
    if a.page_only:
        return page()
    a.lumel = os.path.abspath(a.lumel)
    os.makedirs(a.work, exist_ok=True)
    for name in a.scenes.split(","):
        scene = Scene(name, a)
        if a.references_only:
            continue
        for setting in a.settings.split(","):
            row = scene.row(setting)
            show(row)
            keep_rows([row])
        if a.pictures:
            picture(scene, a.settings.split(",")[0])
    page()


if __name__ == "__main__":
    main()
