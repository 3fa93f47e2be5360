"""The table of families, presets and labels."""
import numpy as np

from . import runs

ORDER = ["draft", "quick", "preview", "production"]
SHOWN = [("flip", 1, "%.4f"), ("patch", 1, "%.3f"), ("dark", 100, "%.3f"), ("bright", 100, "%.3f"),
         ("blotches", 100, "%.2f"), ("error_median", 100, "%.2f"), ("error_p95", 100, "%.1f")]


def selected(a):
    want = {"all": (0, 1), "even": (0,), "odd": (1,)}[a.seeds]
    return [r for r in runs.rows(a.out) if int(r["seed"]) % 2 in want
            and (not a.label or r["label"] in a.label) and (not a.family or r["family"] in a.family)
            and (not a.quality or r["quality"] in a.quality)]


def column(rows, key):
    x = [float(r[key]) for r in rows if r["status"] == "ok" and r[key] not in ("", None)]
    return np.array(x) if x else np.array([np.nan])


def cell(rows, key, factor, form):
    """mean (maximum), and what the best lightmap of that atlas has"""
    x = column(rows, key) * factor
    x = x[~np.isnan(x)]                             # blotches need a flat open surface
    if not len(x):
        return "–"
    return (form + " (" + form + ")") % (x.mean(), x.max())


def text(a):
    rows = selected(a)
    labels = a.label or sorted({r["label"] for r in rows})
    head = ["family", "preset", "build", "levels", "FLIP", "worst patch", "dark %", "bright %",
            "blotches %", "median %", "p95 %", "FLIP best", "dark best %", "bright best %",
            "noise FLIP", "processor s", "failed"]
    out = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    for family in sorted({r["family"] for r in rows}) + ["all"]:
        for quality in ORDER:
            for label in labels:
                mine = [r for r in rows if family in (r["family"], "all")
                        and r["quality"] == quality and r["label"] == label]
                if not mine:
                    continue
                one = {r["level"]: float(r["seconds"]) for r in mine}
                bad = sum(r["status"] != "ok" for r in mine)
                line = [family, quality, label, str(len(one))]
                line += [cell(mine, *s) for s in SHOWN]
                line += ["%.4f" % column(mine, "best_flip").mean(),
                         "%.3f" % (100 * column(mine, "best_dark").mean()),
                         "%.3f" % (100 * column(mine, "best_bright").mean()),
                         "%.4f" % column(mine, "noise_flip").mean(),
                         "%.1f" % np.mean(list(one.values())), str(bad)]
                out.append("| " + " | ".join(line) + " |")
    return "\n".join(out)


def main(a):
    print("Mean (largest) over views.  best: the same of the best lightmap of that atlas.\n")
    print(text(a))
