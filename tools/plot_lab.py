"""Plots the results of `lumel-lab form-factors`: error against time for each method, one panel per scene, on logarithmic axes. One
figure has the error of single form factors, the other that of the resulting irradiance.

Usage : python plot_lab.py form-factors CSV OUT_WITHOUT_SUFFIX
        python plot_lab.py convergence CSV OUT_WITHOUT_SUFFIX          errors of the baker's parts, with the promised curves dashed
Output: OUT.png, OUT.svg, and for form factors OUT_irradiance.png and OUT_irradiance.svg.  Needs matplotlib.
"""
import csv
import sys

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt

# No date and fixed IDs, so that the same data gives the same bytes.
plt.rcParams["svg.hashsalt"] = "lumel"

# One colour and marker per method. The colours (Okabe and Ito) are distinguishable for colour-blind readers, the markers in greyscale.
STYLE = {
    "point to point": ("#000000", "x"),
    "point to disc": ("#8c8c8c", "+"),
    "point to polygon": ("#0072b2", "s"),
    "contour": ("#d55e00", "D"),
    "Nusselt": ("#cc79a7", "v"),
    "hemicube": ("#009e73", "^"),
    "area to area": ("#e69f00", "p"),
    "rays": ("#56b4e9", "o"),
}
TITLE = {
    "opposed": "opposed squares, distance 1",
    "near": "opposed squares, distance 0.1",
    "perpendicular": "perpendicular squares",
    "cube": "cube",
    "room": "room with a box",
    "l-shape": "L-shaped room",
    "spheres": "concentric spheres",
}
# Differences below this are within the reference's own uncertainty.
FLOOR = 1e-6


def form_factors(rows, column, label, out):
    scenes = list(dict.fromkeys(r["scene"] for r in rows))
    columns = 4
    lines = (len(scenes) + columns) // columns
    figure, axes = plt.subplots(lines, columns, figsize=(15, 3.7 * lines + 0.3), sharey=True, layout="constrained")
    axes = list(axes.flat)
    for axis, scene in zip(axes, scenes):
        for method, (colour, marker) in STYLE.items():
            points = [r for r in rows if r["scene"] == scene and r["method"] == method]
            points = sorted((float(r["seconds"]) * 1e3, max(float(r[column]), FLOOR)) for r in points)
            if points:
                # The line joins the Pareto front: settings that no faster one of the same method
                # beats.
                front = [p for k, p in enumerate(points) if all(q[1] > p[1] for q in points[:k])]
                axis.loglog(*zip(*points), color=colour, marker=marker, markersize=6, linestyle="none", label=method)
                axis.loglog(*zip(*front), color=colour, linewidth=1.2)
        patches = next(r["patches"] for r in rows if r["scene"] == scene)
        axis.set_title("%s, %s patches" % (TITLE.get(scene, scene), patches), fontsize=10)
        axis.set_xlabel("time, ms")
        axis.grid(True, which="major", color="#dddddd", linewidth=0.6)
        axis.set_axisbelow(True)
        axis.set_ylim(FLOOR * 0.7, 20)
    for k in range(0, len(scenes), columns):
        axes[k].set_ylabel(label)
    handles, labels = axes[0].get_legend_handles_labels()
    for axis in axes[len(scenes):]:
        axis.axis("off")
    axes[len(scenes)].legend(handles, labels, loc="center", frameon=False, fontsize=11)
    axes[len(scenes)].text(0.5, 0.04, "down and left is better;\nbelow 1e-6 drawn at 1e-6", ha="center", va="bottom",
                           transform=axes[len(scenes)].transAxes, fontsize=9, color="#555555")
    figure.savefig(out + ".png", dpi=110, metadata={"Software": None})
    figure.savefig(out + ".svg", metadata={"Date": None})


def convergence(rows, out):
    studies = list(dict.fromkeys(r["study"] for r in rows))
    colours = ["#0072b2", "#d55e00", "#009e73", "#cc79a7"]
    labels = {"patches": "patches", "solver": "tolerance asked for"}
    figure, axes = plt.subplots(1, len(studies), figsize=(4.2 * len(studies), 4.4), layout="constrained")
    for axis, study in zip(axes, studies):
        series = list(dict.fromkeys(r["series"] for r in rows if r["study"] == study))
        for k, name in enumerate(series):
            points = [(float(r["x"]), float(r["y"]), float(r["promised"])) for r in rows if r["study"] == study and r["series"] == name]
            x, y, promised = zip(*points)
            if study == "solver":
                axis.loglog(x, y, color=colours[k // 2], marker="o" if name.endswith("error") else None, markersize=4, linewidth=1.2,
                            linestyle="none" if name.endswith("error") else "-", label=name)
                continue
            axis.loglog(x, y, color=colours[k], marker="o", markersize=4, linewidth=1.2, label=name)
            # Fitted through the geometric mean of the finer half.
            half = len(x) // 2
            shift = 1.0
            for a, b in zip(y[half:], promised[half:]):
                shift *= (a / b) ** (1.0 / (len(x) - half))
            # ln √(x/6) is meaningless for patches as large as a face.
            drawn = [(a, shift * b) for a, b in zip(x, promised) if study != "patches" or a >= 96]
            axis.loglog(*zip(*drawn), color=colours[k], linewidth=1, linestyle="--")
        axis.set_title(study, fontsize=10)
        axis.set_xlabel(labels.get(study, "rays"))
        axis.grid(True, which="major", color="#dddddd", linewidth=0.6)
        axis.legend(fontsize=7, frameon=False)
    axes[0].set_ylabel("relative error (dashed: the promised order)")
    figure.savefig(out + ".png", dpi=110, metadata={"Software": None})
    figure.savefig(out + ".svg", metadata={"Date": None})


def main():
    if len(sys.argv) != 4 or sys.argv[1] not in ("form-factors", "convergence"):
        raise SystemExit(__doc__)
    with open(sys.argv[2], newline="") as file:
        rows = list(csv.DictReader(file))
    if sys.argv[1] == "convergence":
        return convergence(rows, sys.argv[3])
    form_factors(rows, "rms_error", "RMS error / RMS form factor", sys.argv[3])
    form_factors(rows, "irradiance_error", "RMS error / RMS irradiance", sys.argv[3] + "_irradiance")


if __name__ == "__main__":
    main()
