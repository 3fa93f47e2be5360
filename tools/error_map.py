"""Signed error of a lightmap as a picture in page space: too dark is blue, too bright is red.

Usage : python error_map.py REF.npz MAP.exr OUT.png [--crop ROW0,ROW1,COL0,COL1] [--range 0.1]
                            [--title TEXT]
Input : a reference of reference.py or truth.py (texel, irradiance, stderr); a map of E/π whose
        row 0 is the top.
Output: the bake's own luminance next to (x − ref)/(ref + 0.01 mean ref) of every lumel in the
        reference. Errors within two standard errors of the truth are shown as 0; texels without a
        lumel are white, and unlit ones are grey. A selection of single lumels is drawn as dots.
        Prints one line of figures, which include all errors and the truth's noise.
"""
import argparse
import os

import numpy as np

import common
import reference


def draw(ref, exr, png, crop=None, limit=0.1, title=None):
    """-> dict(n, rms, darker, brighter): of the lit lumels drawn, root mean square and the shares off by more than `limit`"""
    import matplotlib
    matplotlib.use("Agg")
    import matplotlib.pyplot as plt
    img = common.read_exr(exr) @ reference.LUMINANCE
    r0, r1, c0, c1 = crop or (0, img.shape[0], 0, img.shape[1])
    r, c = ref["texel"].T
    inside = (r >= r0) & (r < r1) & (c >= c0) & (c < c1)
    error, lit = reference.signed(ref, exr), reference.lit(ref)
    shown = inside & lit
    e = error[shown]
    error = np.where(np.abs(error) > 2 * reference.relative_noise(ref), error, 0.0)
    box = (c0 - 0.5, c1 - 0.5, r1 - 0.5, r0 - 0.5)
    fig, (left, right) = plt.subplots(1, 2, figsize=(10, 4.1 * max(0.4, min(1.6, (r1 - r0) / (c1 - c0))) + 0.9), layout="constrained")
    seen = img[r0:r1, c0:c1]
    left.imshow(np.clip(seen / max(np.percentile(seen[seen > 0], 98), 1e-9), 0, 1) ** (1 / 2.2), cmap="gray", extent=box, interpolation="nearest")
    left.set_title("the bake (luminance)")
    dense = inside.sum() > 0.2 * (r1 - r0) * (c1 - c0)
    if dense:
        field = np.full(img.shape, np.nan)
        field[r[shown], c[shown]] = error[shown]
        dark = np.full(img.shape, np.nan)
        dark[r[inside & ~lit], c[inside & ~lit]] = 0.5
        right.imshow(dark[r0:r1, c0:c1], cmap="gray", vmin=0, vmax=1, extent=box, interpolation="nearest")
        shot = right.imshow(100 * field[r0:r1, c0:c1], cmap="RdBu_r", vmin=-100 * limit, vmax=100 * limit, extent=box, interpolation="nearest")
    else:
        order = np.argsort(np.abs(error[shown]))
        right.scatter(c[inside & ~lit], r[inside & ~lit], s=6, color="#888888", marker="s")
        shot = right.scatter(c[shown][order], r[shown][order], c=100 * error[shown][order], s=10, cmap="RdBu_r", vmin=-100 * limit, vmax=100 * limit, edgecolors="#bbbbbb", linewidths=0.2)
        right.set(xlim=box[:2], ylim=box[2:], aspect="equal")
    right.set_title("signed error (0 where it is within two s.e. of the truth)", fontsize=10)
    for ax in (left, right):
        ax.set(xlabel="column", ylabel="row")
    fig.colorbar(shot, ax=right, label="% of the truth (red: too bright)", extend="both", shrink=0.8)
    if title:
        fig.suptitle(title, fontsize=10)
    os.makedirs(os.path.dirname(os.path.abspath(png)), exist_ok=True)
    fig.savefig(png, dpi=90, metadata={"Software": None})
    plt.close(fig)
    return dict(n=int(shown.sum()), rms=float(np.sqrt(np.mean(e * e))), darker=float(np.mean(e < -limit)), brighter=float(np.mean(e > limit)))


def main():
    ap = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ap.add_argument("ref")
    ap.add_argument("map")
    ap.add_argument("png")
    ap.add_argument("--crop", type=lambda s: tuple(int(x) for x in s.split(",")))
    ap.add_argument("--range", type=float, default=0.1)
    ap.add_argument("--title")
    a = ap.parse_args()
    print(draw(reference.load(a.ref), a.map, a.png, a.crop, a.range, a.title))


if __name__ == "__main__":
    main()
