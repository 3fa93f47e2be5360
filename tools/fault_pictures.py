#!/usr/bin/env python3
"""Pictures of faults in bakes and in engines, for docs/troubleshooting.md.

Usage : python fault_pictures.py [NAME ...]
Steps : bakes the demo level with and without each fault, and draws both as an engine does, with the
        judge's lookups: the fault on the left, the remedy on the right, at one exposure. Faults of
        engines are applied to the page.
Output: docs/images/faults/NAME.jpg
Needs : LUMEL; the judge's requirements (tools/judge/requirements.txt)
"""
import argparse
import os
import subprocess
import tempfile

import numpy as np
from PIL import Image

import common
from judge import score, truth, view

DEMO = os.path.join(common.HERE, "..", "assets", "demo_level.glb")
OUT = os.path.join(common.HERE, "..", "docs", "images", "faults")
SKY = ["--sky", "0.25,0.35,0.5"]
PLAIN = SKY + ["--quality", "quick", "--texels-per-unit", "6"]
WIDTH = 360
GAP = 6


def inside_out(source, target, name):
    """a copy in which the triangles of the mesh with that name are flipped"""
    js, data = common.read_glb(source)
    data = bytearray(data)
    mesh = next(m for m in js["meshes"] if m.get("name") == name)
    for primitive in mesh["primitives"]:
        accessor = js["accessors"][primitive["indices"]]
        kind = {5121: np.uint8, 5123: np.uint16, 5125: np.uint32}[accessor["componentType"]]
        start = js["bufferViews"][accessor["bufferView"]].get("byteOffset", 0) + accessor.get("byteOffset", 0)
        indices = np.frombuffer(data, kind, accessor["count"], start).reshape(-1, 3)
        turned = indices[:, ::-1].tobytes()
        data[start:start + len(turned)] = turned
    common.write_glb(target, js, bytes(data))
    return target


def bake(scene, folder, options):
    """-> the baked glb"""
    subprocess.run([common.LUMEL, "bake", scene, "-o", folder, "-q", "--no-vertex-colors"] + options, check=True)
    return os.path.join(folder, os.path.basename(scene).rsplit(".", 1)[0] + ".glb")


def blurred(page, size=8):
    """a mip level, magnified"""
    h, w = (n // size * size for n in page.shape[:2])
    small = page[:h, :w].reshape(h // size, size, w // size, size, 3).mean((1, 3))
    out = page.copy()
    out[:h, :w] = small.repeat(size, 0).repeat(size, 1)
    return out


# name: options of the faulty bake, options of the correct one
BAKES = {
    "black": (["--quality", "draft", "--texels-per-unit", "2", "--exclude-light", "*"], PLAIN),
    "blotches": (SKY + ["--quality", "draft", "--texels-per-unit", "6"], SKY + ["--quality", "preview", "--texels-per-unit", "6"]),
    "coarse": (SKY + ["--quality", "quick", "--texels-per-unit", "1.5"], PLAIN),
}
# name: what an engine does to a page
PAGES = {
    "pi": lambda page: page * np.pi,
    "srgb": lambda page: np.where(page < 1, page, 1) ** 2.2,
    "flipped": lambda page: page[::-1],
    "mips": blurred,
}


def draw(bad, good, name, change=None):
    """both pictures side by side"""
    pictures, exposed = [], None
    for glb, turn in ((good, None), (bad, change)):
        baked = view.Baked(glb)
        camera = baked.scene.cameras[0]
        hit = baked.hits(camera, WIDTH)
        pages = {k: np.ascontiguousarray(turn(p)) for k, p in baked.pages.items()} if turn else None
        light = baked.light(hit, pages)
        radiance = hit["albedo"].numpy().T * light + hit["glow"].numpy().T
        width, height = truth.size_of(camera, WIDTH)
        radiance = radiance.reshape(height, width, truth.SIDE ** 2, 3).mean(2)
        exposed = exposed or score.exposure(radiance)
        pictures.insert(0, (score.picture(radiance, exposed) * 255).astype(np.uint8))
    gap = np.full((pictures[0].shape[0], GAP, 3), 255, np.uint8)
    os.makedirs(OUT, exist_ok=True)
    Image.fromarray(np.concatenate([pictures[0], gap, pictures[1]], 1)).save(os.path.join(OUT, name + ".jpg"), quality=85)


def main():
    ap = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    known = [*BAKES, "inside_out", *PAGES]
    ap.add_argument("names", nargs="*", metavar="NAME", help="of " + ", ".join(known))
    wanted = ap.parse_args().names or known
    with tempfile.TemporaryDirectory() as t:
        at = lambda name: os.path.join(t, name)      # noqa: E731
        for name in wanted:
            if name in BAKES:
                bad, good = (bake(DEMO, at(name + str(i)), o) for i, o in enumerate(BAKES[name]))
                draw(bad, good, name)
            elif name == "inside_out":
                bad = bake(inside_out(DEMO, at("demo_level.glb"), "pillar"), at("turned"), PLAIN)
                draw(bad, bake(DEMO, at("plain"), PLAIN), name)
            else:
                good = bake(DEMO, at("plain"), PLAIN)
                draw(good, good, name, PAGES[name])
            print(name, flush=True)


if __name__ == "__main__":
    main()
