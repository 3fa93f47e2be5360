"""Contact sheets of the worst crops, and the page of best, middle and worst views."""
import os

import numpy as np
from PIL import Image, ImageDraw

from . import score, table

CROP, SCALE, GAP = 96, 2, 4


def names(out, row):
    """paths of truth, bake, FLIP's map"""
    name = "%s.%s" % (row["level"], row["view"])
    base = os.path.join(out, "pictures", row["label"], row["quality"], name)
    return [os.path.join(out, "pictures", "truth", name + ".png"), base + ".bake.png",
            base + ".flip.png"]


def load(path):
    return np.asarray(Image.open(path).convert("RGB"))


def heat(gray):
    """FLIP's map in black, violet, orange, white"""
    stops = np.array([[0, 0, 0], [80, 20, 120], [240, 110, 30], [255, 255, 220]], float)
    x = np.clip(gray[..., 0] / 255.0 * 1.5, 0, 1) * 3
    i = np.minimum(x.astype(int), 2)
    f = (x - i)[..., None]
    return (stops[i] * (1 - f) + stops[i + 1] * f).astype(np.uint8)


def crops(out, rows, count, each=3):
    """the worst windows, -> list of (FLIP's mean, row, three pictures)"""
    found = []
    for row in rows:
        if row["status"] != "ok" or not os.path.exists(names(out, row)[1]):
            continue
        pictures = [load(p) for p in names(out, row)]
        m = pictures[2][..., 0] / 255.0
        # Squared: a thin bright line counts for more than the same sum spread out.
        mean = score.box(m * m, min(CROP, *m.shape))
        for _ in range(each):
            y, x = np.unravel_index(np.argmax(mean), mean.shape)
            if mean[y, x] <= 0:
                break
            part = [p[y:y + CROP, x:x + CROP] for p in pictures]
            found.append((float(np.sqrt(mean[y, x])), row, part))
            mean[max(0, y - CROP):y + CROP, max(0, x - CROP):x + CROP] = -1
    return sorted(found, key=lambda c: -c[0])[:count]


def draw(found, path, columns=3):
    side = CROP * SCALE
    wide, high = 3 * side + 2 * GAP, side + 14
    lines = (len(found) + columns - 1) // columns
    sheet = Image.new("RGB", (columns * (wide + 3 * GAP), lines * (high + GAP)), (24, 24, 24))
    pen = ImageDraw.Draw(sheet)
    for i, (value, row, part) in enumerate(found):
        x, y = i % columns * (wide + 3 * GAP), i // columns * (high + GAP)
        pen.text((x + 2, y + 1), "%s view %s %s  %.3f" % (
            row["level"].split(":")[0], row["view"], row["quality"], value), (230, 230, 230))
        for k, a in enumerate(part):
            a = heat(a) if k == 2 else a
            big = Image.fromarray(a).resize((a.shape[1] * SCALE, a.shape[0] * SCALE), 0)
            sheet.paste(big, (x + k * (side + GAP), y + 14))
    sheet.save(path)


def main(a):
    rows = table.selected(a)
    folder = os.path.join(a.out, "sheets")
    os.makedirs(folder, exist_ok=True)
    for label in sorted({r["label"] for r in rows}):
        for quality in sorted({r["quality"] for r in rows}):
            for family in sorted({r["family"] for r in rows}):
                mine = [r for r in rows if (r["label"], r["quality"], r["family"])
                        == (label, quality, family)]
                found = crops(a.out, mine, a.count)
                if found:
                    path = os.path.join(folder, "%s_%s_%s.png" % (label, quality, family))
                    draw(found, path)
                    print(path)


def triple(out, row, path, width=320):
    pictures = [load(p) for p in names(out, row)]
    pictures[2] = heat(pictures[2])
    h = round(width * pictures[0].shape[0] / pictures[0].shape[1])
    page = Image.new("RGB", (3 * width + 2 * GAP, h), (24, 24, 24))
    for k, p in enumerate(pictures):
        page.paste(Image.fromarray(p).resize((width, h), Image.LANCZOS), (k * (width + GAP), 0))
    page.save(path, quality=88)


def page(a):
    """lab/tables/unseen_levels.md: the table, and best, middle and worst view of each family"""
    rows = table.selected(a)
    label = a.label[-1] if a.label else rows[-1]["label"]
    quality = a.quality[0] if a.quality else "preview"
    folder = os.path.join(a.docs, "images", "unseen_levels")
    os.makedirs(folder, exist_ok=True)
    text = ["# Tables of [unseen_levels.md](../unseen_levels.md)", "",
            "Written by `tools/judge page`; what each figure means: "
            "[tools/judge](../../tools/judge/README.md).",
            "Seeds: %s. Mean (largest) over views." % a.seeds, "", table.text(a), "",
            "## Pictures", "", "Build `%s`, `%s`: truth, bake, FLIP's map; the view with the least,"
            % (label, quality), "the middle and the largest FLIP of each family.", ""]
    for family in sorted({r["family"] for r in rows}):
        mine = sorted((r for r in rows if (r["family"], r["label"], r["quality"], r["status"])
                       == (family, label, quality, "ok")), key=lambda r: float(r["flip"]))
        if not mine:
            continue
        text += ["### " + family, ""]
        for word, row in zip(("best", "middle", "worst"),
                             (mine[0], mine[len(mine) // 2], mine[-1])):
            name = "%s_%s.jpg" % (family, word)
            triple(a.out, row, os.path.join(folder, name))
            text += ["%s: %s view %s, FLIP %.3f" % (
                word.capitalize(), row["level"].split(":")[0], row["view"], float(row["flip"])),
                "", "![%s %s](../images/unseen_levels/%s)" % (family, word, name), ""]
    path = os.path.join(a.docs, "tables", "unseen_levels.md")
    os.makedirs(os.path.dirname(path), exist_ok=True)
    with open(path, "w", encoding="utf-8") as f:
        f.write("\n".join(text))
    print(path)
