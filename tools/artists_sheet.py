#!/usr/bin/env python3
"""Draws what the pictures of tools/artists.py do not show: levels of detail, `--only`, page groups,
knobs, culling, small pages.

    python3 tools/artists_sheet.py LUMEL OUT SHEET.jpg

Bakes the level of tools/artists.py several times at `draft`.
"""

import json
import subprocess
import sys
from pathlib import Path

from PIL import Image, ImageChops, ImageDraw

from artists import make

BASE = "--quality draft --texels-per-unit 10 --sky 0.5 --no-vertex-colors -q"
GREY, BLUE = (0.4, 0.4, 0.4), (0.1, 0.2, 0.6)
CELL = (480, 190)


class Bakes:
    def __init__(self, lumel, out):
        self.lumel, self.out = lumel, out
        (out / "level").mkdir(parents=True, exist_ok=True)

    def bake(self, name, options="", pillar=BLUE, png="rgbm"):
        """Bakes with these options into a folder of this name; returns the folder."""
        file = self.out / "level" / "artists.glb"
        file.write_bytes(make(pillar))
        folder = self.out / name
        words = f"bake {file} -o {folder} {BASE} --png {png} --preview {folder}.png {options}".split()
        subprocess.run([self.lumel, *words], check=True)
        return folder

    def view(self, name, options="", pillar=BLUE):
        """The preview of such a bake."""
        return Image.open(f"{self.bake(name, options, pillar)}.png").convert("RGB")


def decoded(folder, page, exposure, kind="rgbm"):
    """A page of `--png` as a screen shows it."""
    manifest = json.loads((folder / "artists.lightmap.json").read_text())
    png = manifest["pages"][page]["png"]
    picture = Image.open(folder / png["uri"])
    scale = png["scale"] * exposure

    def curve(x):
        x = min(max(x, 0.0), 1.0)
        return round(255 * (12.92 * x if x <= 0.0031308 else 1.055 * x ** (1 / 2.4) - 0.055))

    def texel(r, g, b, a):
        if kind == "rgbm":
            return tuple(curve((v * a / 65025) ** 2 * scale) for v in (r, g, b))
        return tuple(curve((v / 255) ** 2 * 255 / max(a, 1) * scale) for v in (r, g, b))

    data = picture.convert("RGBA").get_flattened_data()
    out = Image.new("RGB", picture.size)
    out.putdata([texel(*t) for t in data])
    return out


def node_of(folder, name):
    manifest = json.loads((folder / "artists.lightmap.json").read_text())
    return next(n for n in manifest["nodes"] if n["name"] == name)


def lumels_of(folder, name, exposure):
    """The part of its page that a node has, at its own size."""
    node = node_of(folder, name)
    page = decoded(folder, node["page"], exposure)
    (x, y), (w, h) = node["offset"], node["scale"]
    box = [x * page.width, y * page.height, (x + w) * page.width, (y + h) * page.height]
    return page.crop([round(v) for v in box])


def cell(label, *pictures):
    out = Image.new("RGB", CELL, (30, 32, 38))
    width = CELL[0] // len(pictures)
    for i, picture in enumerate(pictures):
        room = (width - 6, CELL[1] - 26)
        factor = min(room[0] / picture.width, room[1] / picture.height)
        size = [max(1, round(factor * v)) for v in picture.size]
        small = picture.resize(size, Image.NEAREST if factor > 2 else Image.LANCZOS)
        out.paste(small, (i * width + 3, 23))
    ImageDraw.Draw(out).text((6, 5), label, "white")
    return out


def main():
    lumel, out, sheet = sys.argv[1], Path(sys.argv[2]).resolve(), sys.argv[3]
    bakes = Bakes(lumel, out)
    plain = bakes.bake("plain")
    seen = Image.open(f"{plain}.png").convert("RGB")
    exposure = json.loads((plain / "artists.lightmap.json").read_text())["exposure"]
    without = bakes.bake("no_lods", "--no-lods")
    grey = bakes.view("only", pillar=GREY)
    blue = bakes.view("only", "--only pillar_blue --only floor_b")
    culled = bakes.bake("culled", "--cull-unseen --walkable floor*")
    rgbd = bakes.bake("rgbd", png="rgbd")
    knobs = ["--indirect-boost 3", "--ambient-floor 0.05 --ao-multiply 1"]
    names = ["walls_a", "walls_b", "outside", "pillar_blue"]
    pages = [decoded(plain, node_of(plain, name)["page"], exposure) for name in names]
    room = node_of(plain, "walls_a")["page"]
    [room, coarse] = [decoded(plain, room, exposure), decoded(rgbd, room, exposure, "rgbd")]
    remain = [decoded(culled, node_of(culled, n)["page"], exposure) for n in names if n != "outside"]
    apart = ImageChops.difference(room, coarse).point(lambda v: min(255, 50 * v))
    cells = [
        cell("1  the lumels of globe_LOD2: --no-lods | by default",
             lumels_of(without, "globe_LOD2", exposure), lumels_of(plain, "globe_LOD2", exposure)),
        cell("3  a grey pillar | --only pillar_blue --only floor_b", grey, blue),
        cell("4  pages of room_a, room_b, the outside, the rest", *pages),
        cell("5  plain | --indirect-boost 3", seen, bakes.view("boost", knobs[0])),
        cell("5  plain | --ambient-floor 0.05 --ao-multiply 1", seen, bakes.view("floor", knobs[1])),
        cell("7  the pages with --cull-unseen: nobody sees the outside", *remain),
        cell("9  room_a as RGBM | as RGBD | 50 times the difference", room, coarse, apart),
    ]
    rows = -(-len(cells) // 2)
    picture = Image.new("RGB", (2 * CELL[0], rows * CELL[1]), (30, 32, 38))
    for i, one in enumerate(cells):
        picture.paste(one, (i % 2 * CELL[0], i // 2 * CELL[1]))
    picture.save(sheet, quality=88)


main()
