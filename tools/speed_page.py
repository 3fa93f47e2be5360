"""Writes the page of speed_error.py: medians, Pareto fronts and ratios from the CSV's rows, as
Markdown tables and plots.

The prose in lab/speed_error.md is written by hand; the tables go to lab/tables/speed_error.md.
"""
import csv
import os
import statistics

import common
import speed_scenes

LUMEL, CYCLES, OIDN = "lumel", "Cycles", "Cycles + OIDN"
# lumel's bake without vertex colours and the time of charts: what Cycles' bake does.
EQUAL = "lumel, equal work"
PRESETS = ("draft", "quick", "preview", "production")
# Okabe and Ito's palette, distinguishable with all common colour deficiencies; markers differ too.
STYLE = {LUMEL: ("#0072B2", "o"), CYCLES: ("#E69F00", "s"), OIDN: ("#009E73", "^")}
TARGETS = (("relRMSE", "relRMSE over lit lumels", 0.007), ("p50", "median", 0.003), ("bias", "bias", 0.001))


def of_work(rows, equal):
    """The rows with lumel's whole bakes, or (`equal`) with its bakes of equal work as lumel's."""
    if equal:
        return [dict(r, method=LUMEL) if r["method"] == EQUAL else r for r in rows if r["method"] != LUMEL]
    return [r for r in rows if r["method"] != EQUAL]


def points(rows, scene, family="all"):
    """-> [dict(method, setting, seconds (median), runs, relRMSE, p50, …)] of a scene, by method and time"""
    groups = {}
    for r in rows:
        if r["scene"] == scene and r["family"] == family:
            groups.setdefault((r["method"], r["setting"]), []).append(r)
    out = []
    for (method, setting), g in groups.items():
        p = {k: float(g[0][k]) for k in ("n", "relRMSE", "relRMSE_se", "p50", "p95", "p99", "bias", "own", "rays")}
        p.update(method=method, setting=setting, runs=len(g), seconds=statistics.median(float(r["seconds"]) for r in g),
                 process_seconds=statistics.median(float(r["process_seconds"]) for r in g), peak_mb=max(float(r["peak_mb"]) for r in g))
        out.append(p)
    return sorted(out, key=lambda p: (list(STYLE).index(p["method"]), p["seconds"]))


def front(ps):
    """The Pareto front: points that no other point beats in both speed and error, by time."""
    out = []
    for p in sorted(ps, key=lambda p: (p["seconds"], p["relRMSE"])):
        if not out or p["relRMSE"] < out[-1]["relRMSE"]:
            out.append(p)
    return out


def time_at(ps, error, extrapolate):
    """Seconds at which a method's points reach an error -> (seconds, kind).

    kind is "" if interpolated in log-log between neighbours; "<" if the fastest point is already
    better; "extrapolated" if beyond the last point, with the Monte Carlo slope −1/2, if allowed;
    and "not reached" otherwise (seconds of the best point).
    """
    import math
    ps = front(ps)
    if not ps:
        return None, "not measured"
    if error >= ps[0]["relRMSE"]:
        return ps[0]["seconds"], "<" if error > ps[0]["relRMSE"] else ""
    for a, b in zip(ps, ps[1:]):
        if b["relRMSE"] <= error:
            w = math.log(a["relRMSE"] / error) / math.log(a["relRMSE"] / b["relRMSE"])
            return a["seconds"] * (b["seconds"] / a["seconds"]) ** w, ""
    last = ps[-1]
    if extrapolate:
        return last["seconds"] * (last["relRMSE"] / error) ** 2, "extrapolated"
    return last["seconds"], "not reached"


def _percent(x, digits=2):
    return "%.*f %%" % (digits, 100 * x)


def _seconds(x):
    return "%.2f" % x if x < 10 else "%.1f" % x if x < 100 else "%.0f" % x


def _table(head, rows):
    return "\n".join("| " + " | ".join(str(c) for c in r) + " |" for r in [head, ["---"] * len(head)] + rows) + "\n"


def scenes_of(rows):
    return [s for s in speed_scenes.SCENES if any(r["scene"] == s for r in rows)]


def setup_text(rows):
    loads = [float(r["load"]) for r in rows if r["scene"] in speed_scenes.FIVE]
    most = max(loads, default=0.0)
    by_version = {}
    for s in scenes_of(rows):
        mine = sorted({r["versions"] for r in rows if r["scene"] == s and r["method"] == LUMEL})
        by_version.setdefault("; ".join(mine), []).append(speed_scenes.SCENES[s]["title"])
    text = "Measured on %s, %s threads; %s; %s. Load average at the start of a run, over the five scenes: %.2f to %.2f%s.\n" % (
        "; ".join(sorted({r["machine"] for r in rows})), ", ".join(sorted({r["threads"] for r in rows})), "; ".join(sorted({r["versions"] for r in rows if r["method"] != LUMEL})),
        "; ".join("%s: %s" % (", ".join(titles), version) for version, titles in by_version.items()), min(loads, default=0.0), most,
        # a previous run contributes up to its number of threads to the one-minute average
        "" if most < 1.5 * max(int(r["threads"]) for r in rows) else ". **The machine was busy with other work: the times below are not to be quoted**")
    return text


def scenes_text(rows):
    out = []
    for s in scenes_of(rows):
        r, t = next(r for r in rows if r["scene"] == s), speed_scenes.SCENES[s]
        own = {m: next((p["own"] for p in points(rows, s) if p["method"] == m), None) for m in (LUMEL, CYCLES)}
        out.append([t["title"], "{:,}".format(int(r["triangles"])), "%s per metre: %s" % (r["texels_per_unit"], t["why"]), "{:,}".format(int(r["lumels"])),
                    ("yes" if t["fair"] else "**no**") + ", %+.2f %%" % (100 * float(r["backs"])), int(float(next(x["n"] for x in rows if x["scene"] == s and x["family"] == "all"))),
                    " / ".join(_percent(x) for x in own.values() if x is not None)])
    return _table(["scene", "triangles", "density", "lumels", "backs unseen, mean light two-sided − one-sided", "compared", "truth's own noise (for lumel / for Cycles)"], out)


def targets_text(rows):
    out = []
    for s in ("cornell", "demo"):
        for family, what in (("all", "all lit"), ("clear", "lit, no edge")):
            p = next((p for p in points(rows, s, family) if p["method"] == LUMEL and p["setting"] == "production"), None)
            if p is None:
                out.append([speed_scenes.SCENES[s]["title"], what] + ["not measured"] * 6)
                continue
            cells = []
            for key, _, limit in TARGETS:
                figure = "%+.2f %%" % (100 * p[key]) if key == "bias" else _percent(p[key]) + (" ± %.2f" % (100 * p["relRMSE_se"]) if key == "relRMSE" else "")
                cells.append("%s %s" % (figure, "met" if abs(p[key]) <= limit else "**missed**"))
            less = max(p["relRMSE"] ** 2 - p["own"] ** 2, 0.0) ** 0.5
            out.append([speed_scenes.SCENES[s]["title"], what] + cells + [_percent(p["own"]), _percent(less), _seconds(p["seconds"])])
    return _table(["scene, `production`", "lumels"] + ["%s ≤ %s" % (t, _percent(x, 1)) for _, t, x in TARGETS] + ["truth's own noise", "relRMSE less that", "s"], out)


def results_text(rows):
    text = []
    for s in scenes_of(rows):
        every, clear = points(rows, s), {(p["method"], p["setting"]): p for p in points(rows, s, "clear")}
        edges = {(p["method"], p["setting"]): p for p in points(rows, s, "edges")}
        best = {id(p) for p in front(every)}
        out = []
        for p in every:
            k = (p["method"], p["setting"])
            out.append([p["method"], p["setting"] + (" ◆" if id(p) in best else ""), _seconds(p["seconds"]), p["runs"], _percent(p["relRMSE"]), _percent(p["p50"]), _percent(p["p95"]),
                        _percent(p["p99"]), "%+.2f %%" % (100 * p["bias"]), _percent(clear[k]["relRMSE"]) if k in clear else "–",
                        _percent(edges[k]["relRMSE"]) if k in edges else "–", "%.0f" % (p["rays"] / 1e6), "%.0f" % p["peak_mb"]])
        n = {f: next((int(p["n"]) for p in points(rows, s, f)), 0) for f in ("all", "clear", "edges")}
        text.append("### %s\n\n%d lit lumels; no edge: %d; with chart edges: %d others.\n\n" % (speed_scenes.SCENES[s]["title"], n["all"], n["clear"], n["edges"]) + _table(
            ["method", "setting (◆ on the front)", "s", "runs", "relRMSE", "p50", "p95", "p99", "bias", "no edge", "chart edges too", "Mrays", "MB"], out))
    return "\n".join(text)


def _ratio(ours, theirs, kind):
    mark = {"": "", "<": "<", "extrapolated": "≈"}.get(kind)
    if mark is None:
        return "–", "–"
    return "%s%s s" % (mark + " " if mark else "", _seconds(theirs)), "%s%.2g ×" % (mark + " " if mark else "", theirs / ours)


def ratios_text(rows):
    out, back = [], []
    for s in scenes_of(rows):
        ps, title = points(rows, s), speed_scenes.SCENES[s]["title"]
        mine, raw, oidn = [[p for p in ps if p["method"] == m] for m in (LUMEL, CYCLES, OIDN)]
        for p in mine if raw else []:
            a, b = time_at(raw, p["relRMSE"], True), time_at(oidn, p["relRMSE"], False)
            denoised = _ratio(p["seconds"], *b)
            if b[1] == "not reached":
                denoised = ("not reached: %s in %s s" % (_percent(min(q["relRMSE"] for q in oidn)), _seconds(b[0])), "–")
            out.append([title, p["setting"], _percent(p["relRMSE"]), _seconds(p["seconds"]), *_ratio(p["seconds"], *a), *denoised])
        for p in raw + oidn if mine else []:
            t, kind = time_at(mine, p["relRMSE"], False)
            if kind == "not reached":
                back.append([title, p["method"], p["setting"], _percent(p["relRMSE"]), _seconds(p["seconds"]), "not reached: %s in %s s" % (_percent(min(q["relRMSE"] for q in mine)), _seconds(t)), "–"])
            else:
                mark = kind + " " if kind else ""
                back.append([title, p["method"], p["setting"], _percent(p["relRMSE"]), _seconds(p["seconds"]), "%s%s s" % (mark, _seconds(t)),
                             "%s%.2g ×" % ("> " if kind else "", p["seconds"] / t)])
    return ("Time that Cycles takes for lumel's error:\n\n" + _table(["scene", "lumel", "relRMSE", "s", "Cycles", "ratio", "Cycles + OIDN", "ratio"], out) +
            "\nTime that lumel takes for Cycles' error:\n\n" + _table(["scene", "method", "setting", "relRMSE", "s", "lumel", "ratio"], back))


# At Cycles' error with 1024 samples, and with 64 denoised samples, lumel should be this many times
# faster: in the geometric mean, and on every scene.
GOALS = ((CYCLES, "1024 samples", 100, 20), (OIDN, "64 samples", 10, 2))


def goal(rows, scene, method, setting):
    """-> dict(seconds, relRMSE, estimated, ours, kind, ratio) of a peer's setting and lumel's time for its error, or None.

    A setting that was not run is `estimated` from the one with most samples: time grows with samples, and error falls with their square root.  This favours the peer.
    kind   "" if interpolated; "<" if lumel's fastest point is already more accurate, so that the ratio is a lower bound; ">" if lumel does not get
           as accurate, so that the ratio is an upper bound, against its most accurate point"""
    ps = points(rows, scene)
    mine, peers = [p for p in ps if p["method"] == LUMEL], [p for p in ps if p["method"] == method]
    if not mine or not peers:
        return None
    samples = lambda text: float(text.split()[0])      # noqa: E731
    p = next((p for p in peers if p["setting"] == setting), None)
    estimated = p is None
    if estimated:
        last = max(peers, key=lambda q: samples(q["setting"]))
        more = samples(setting) / samples(last["setting"])
        p = dict(last, seconds=more * last["seconds"], relRMSE=last["relRMSE"] / more ** 0.5)
    ours, kind = time_at(mine, p["relRMSE"], False)
    kind = ">" if kind == "not reached" else kind
    return dict(seconds=p["seconds"], relRMSE=p["relRMSE"], estimated=estimated, ours=ours, kind=kind, ratio=p["seconds"] / ours)


def _verdict(gs, wanted, each):
    """The geometric mean of goals, and whether the goal is met."""
    ratios, bounds = [g["ratio"] for g in gs], {g["kind"] for g in gs}
    mean, least = statistics.geometric_mean(ratios), min(ratios)
    bound = "" if not bounds - {""} else "at least " if ">" not in bounds else "at most " if "<" not in bounds else "about "
    # A mean of lower bounds that falls short does not mean "missed": lumel has no setting that is
    # fast and coarse enough to tell.
    met = "**missed**" if ">" in bounds else "met" if mean >= wanted else "**not shown**" if "<" in bounds else "**missed**"
    return "geometric mean over %d scenes %s%.3g (asked: %d, %s); the least: %.3g (asked: %g, %s)" % (
        len(ratios), bound, mean, wanted, met, least, each, "met" if least >= each and ">" not in bounds else "**not shown**" if "<" in bounds and ">" not in bounds else "**missed**")


def goals_text(rows):
    """The goals at both densities, then memory and the share of equal work."""
    every = scenes_of(rows)
    at = [[s for s in names if s in every] for names in (speed_scenes.FIVE, speed_scenes.FINER)]
    both = [of_work(rows, equal) for equal in (False, True)]
    text = [_goals_of(both, names) for names in at if names]
    names = [s for those in at for s in those]
    return "\n".join(text + [_memory(both[0], names), _shares(*both, names)])


def _goals_of(both, names):
    """The goals for whole bakes and, next to them, for equal work."""
    text = []
    for method, setting, wanted, each in GOALS:
        out, measured = [], ([], [])
        for s in names:
            cells = [speed_scenes.SCENES[s]["title"], "not measured", "–"]
            for k, kind_rows in enumerate(both):
                g = goal(kind_rows, s, method, setting)
                if g is None:
                    cells += ["not measured", "–"]
                    continue
                measured[k].append(g)
                mark = "≈ " if g["estimated"] else ""
                cells[1:3] = [mark + _seconds(g["seconds"]) + " s", mark + _percent(g["relRMSE"])]
                cells += [{"": "%s s", "<": "under %s s", ">": "not reached; its closest in %s s"}[g["kind"]] % _seconds(g["ours"]),
                          {"": "", "<": "at least ", ">": "under "}[g["kind"]] + "%.3g" % g["ratio"]]
            out.append(cells)
        text.append(_table(["scene", "%s, %s" % (method, setting), "its relRMSE", "lumel at that error, whole bake", "times quicker (asked: %d)" % wanted, "equal work", "times quicker"], out))
        for what, gs in zip(("Whole bake", "Equal work"), measured):
            if gs:
                text.append("%s: %s.\n" % (what, _verdict(gs, wanted, each)))
    return "\n".join(text)


def _memory(rows, names):
    out = []
    for s in names:
        ps = points(rows, s)
        most = {m: max((p["peak_mb"] for p in ps if p["method"] == m), default=None) for m in (LUMEL, CYCLES)}
        settings = [p["setting"] for p in ps if p["method"] == LUMEL and p["peak_mb"] == most[LUMEL]]
        cell = lambda x: "not measured" if x is None else "%.0f" % x      # noqa: E731
        verdict = "–" if None in most.values() else "met" if most[LUMEL] <= most[CYCLES] else "**missed**"
        out.append([speed_scenes.SCENES[s]["title"], cell(most[LUMEL]) + (" (%s)" % settings[0] if settings else ""), cell(most[CYCLES]), verdict])
    return ("Peak memory of the process, MB, of lumel's hungriest setting here; Cycles' holds Blender:\n\n" +
            _table(["scene", "lumel", "Cycles", "no more than Cycles"], out))


def _shares(whole, equal, names):
    """Seconds of whole bakes, and of equal work."""
    out = []
    for s in names:
        of = [{p["setting"]: p for p in points(rows, s) if p["method"] == LUMEL} for rows in (whole, equal)]
        pairs = [(of[0][k]["seconds"], of[1][k]["seconds"]) for k in PRESETS if k in of[0] and k in of[1]]
        names = [k for k in PRESETS if k in of[0] and k in of[1]]
        cell = dict(zip(names, ("%s, %s (%.0f %%)" % (_seconds(a), _seconds(b), 100 * b / a) for a, b in pairs)))
        out.append([speed_scenes.SCENES[s]["title"]] + [cell.get(k, "–") for k in PRESETS])
    if all(c == "–" for r in out for c in r[1:]):
        return "Equal work was not measured yet.\n"
    return "Seconds of the whole bake and of equal work (which is so much of it):\n\n" + _table(["scene"] + ["`%s`" % k for k in PRESETS], out)


def presets_text(rows):
    """The error of each preset and its position: on the front of all methods, on that of lumel's
    own settings, or on neither."""
    out = []
    for s in scenes_of(rows):
        ps = points(rows, s)
        best, own = front(ps), front([p for p in ps if p["method"] == LUMEL])
        cells = []
        for preset in PRESETS:
            p = next((p for p in ps if p["method"] == LUMEL and p["setting"] == preset), None)
            if p is None:
                cells.append("–")
                continue
            where = "◆" if p in best else "◇" if p in own else "no"
            cells.append("%s (%s), %s s %s" % (_percent(p["relRMSE"], 1), _percent(p["p50"]), _seconds(p["seconds"]), where))
        if cells != ["–"] * len(PRESETS):
            out.append([speed_scenes.SCENES[s]["title"]] + cells)
    return _table(["scene", "`%s`: relRMSE (median), time" % PRESETS[0]] + ["`%s`" % k for k in PRESETS[1:]], out)


def losses_text(rows):
    out = []
    for s in scenes_of(rows):
        for p in front(points(rows, s)):
            if p["method"] != LUMEL:
                out.append([speed_scenes.SCENES[s]["title"], p["method"], p["setting"], _seconds(p["seconds"]), _percent(p["relRMSE"])])
    if not out:
        return "No point of Cycles, raw or denoised, lies on the front of any scene in this run.\n"
    return "Points of the fronts that are not lumel's:\n\n" + _table(["scene", "method", "setting", "s", "relRMSE"], out)


def plot(rows, png, svg):
    import matplotlib
    matplotlib.use("Agg")
    # Text as text and no dates, so that the same CSV gives the same SVG.
    matplotlib.rcParams.update({"svg.fonttype": "none", "svg.hashsalt": "lumel", "font.size": 9})
    import matplotlib.pyplot as plt
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter
    names = scenes_of(rows)
    columns = min(3, len(names) + 1)
    lines = -(-(len(names) + 1) // columns)
    fig, axes = plt.subplots(lines, columns, figsize=(4.3 * columns, 3.7 * lines), squeeze=False, layout="constrained")
    cells = list(axes.ravel())
    for ax, s in zip(cells, names):
        every, clear = points(rows, s), points(rows, s, "clear")
        pareto = front(every)
        ax.plot([p["seconds"] for p in pareto], [100 * p["relRMSE"] for p in pareto], color="#999999", lw=5, alpha=0.45, zorder=1, solid_capstyle="round")
        for method, (colour, marker) in STYLE.items():
            ps = [p for p in every if p["method"] == method]
            qs = [p for p in clear if p["method"] == method]
            ax.plot([p["seconds"] for p in qs], [100 * p["relRMSE"] for p in qs], color=colour, marker=marker, mfc="none", ms=4, lw=0.8, ls=":", zorder=2)
            ax.plot([p["seconds"] for p in ps], [100 * p["relRMSE"] for p in ps], color=colour, marker=marker, ms=6, lw=1.2, zorder=3)
            for p in ps:
                ax.annotate(p["setting"].replace(" samples", "").replace("production", "prod.").replace(", error ", "\nε "), (p["seconds"], 100 * p["relRMSE"]), xytext=(4, 4), textcoords="offset points",
                            fontsize=7, color=colour)
        mine = [p["own"] for p in every if p["method"] == LUMEL]
        if mine:
            ax.axhline(100 * mine[0], color="black", lw=0.8, ls="--", zorder=0)
        ax.set(xscale="log", yscale="log", title=speed_scenes.SCENES[s]["title"], xlabel="bake time, s", ylabel="relative RMSE, lit lumels, %")
        ax.margins(x=0.2, y=0.08)
        ax.grid(True, which="both", lw=0.3, color="#cccccc")
        for axis in (ax.xaxis, ax.yaxis):
            axis.set_major_locator(LogLocator(subs=(1, 2, 5), numticks=15))
            axis.set_major_formatter(FuncFormatter(lambda x, _: "%g" % x))
            axis.set_minor_formatter(NullFormatter())
    key = cells[len(names)]
    for ax in cells[len(names):]:
        ax.axis("off")
    for method, (colour, marker) in STYLE.items():
        key.plot([], [], color=colour, marker=marker, label=method)
    key.plot([], [], color="#666666", marker="o", mfc="none", ms=4, lw=0.8, ls=":", label="the same, lumels that no shadow\nor contact edge crosses")
    key.plot([], [], color="#999999", lw=5, alpha=0.45, label="Pareto front")
    key.plot([], [], color="black", lw=0.8, ls="--", label="the truth's own noise")
    key.legend(loc="center", frameon=False)
    os.makedirs(os.path.dirname(png), exist_ok=True)
    fig.savefig(svg, metadata={"Date": None})
    fig.savefig(png, dpi=100, metadata={"Software": None})
    plt.close(fig)


def read_csv(path):
    if not os.path.exists(path):
        return []
    with open(path, newline="") as f:
        return list(csv.DictReader(f))


def write_csv(path, columns, rows):
    os.makedirs(os.path.dirname(path), exist_ok=True)
    with open(path, "w", newline="") as f:
        w = csv.DictWriter(f, columns, lineterminator="\n")
        w.writeheader()
        w.writerows([{k: "%.5g" % r[k] if isinstance(r.get(k), float) else r.get(k, "") for k in columns} for r in rows])


def write(rows, docs):
    if not rows:
        raise SystemExit("no rows: run the sweep first")
    every = [{k: str(v) for k, v in r.items()} for r in rows]
    # Where all methods are compared, lumel's rows are whole bakes.
    rows = of_work(every, False)
    plot(rows, os.path.join(docs, "images", "speed_error.png"), os.path.join(docs, "images", "speed_error.svg"))
    parts = dict(setup=setup_text(rows), goals=goals_text(every), presets=presets_text(rows), scenes=scenes_text(rows), targets=targets_text(rows), results=results_text(rows), ratios=ratios_text(rows), losses=losses_text(rows))
    common.write_tables(docs, "speed_error", parts)
