#!/usr/bin/env python3
"""Makes a level that uses what artists ask for, bakes it, and shows it in three.js and Bevy.

    python3 tools/artists.py LUMEL OUT

LUMEL is the program. OUT gets the level, its bake, and two pictures of it by Chromium with the
loaders of tools/engines/three; if LUMEL_BEVY names the program of tools/engines/bevy, two by Bevy
as well. Needs only Python, Chromium and Pillow.

The level is baked with a grey pillar first. Then the pillar gets its colour, and `--only` bakes it
and the floor beside it.
"""

import http.server
import io
import json
import math
import os
import struct
import subprocess
import sys
import threading
from pathlib import Path

from PIL import Image, ImageDraw

REPOSITORY = Path(__file__).resolve().parent.parent


class Level:
    """A glTF level of boxes and quads."""

    def __init__(self):
        self.bin = b""
        self.json = {
            "asset": {"version": "2.0"},
            "scene": 0,
            "scenes": [{"nodes": []}],
            "nodes": [],
            "meshes": [],
            "materials": [],
            "accessors": [],
            "bufferViews": [],
            "cameras": [],
            "images": [],
            "textures": [],
            "extensionsUsed": ["KHR_lights_punctual", "EXT_lights_area"],
            "extensions": {"KHR_lights_punctual": {"lights": []}, "EXT_lights_area": {"lights": []}},
        }

    def add(self, key, item):
        self.json[key].append(item)
        return len(self.json[key]) - 1

    def view(self, data):
        self.bin += b"\0" * (-len(self.bin) % 4)
        at = len(self.bin)
        self.bin += data
        return self.add("bufferViews", {"buffer": 0, "byteOffset": at, "byteLength": len(data)})

    def material(self, name, colour, **more):
        pbr = {"baseColorFactor": [*colour, 1], "metallicFactor": more.pop("metal", 0)}
        pbr["roughnessFactor"] = more.pop("rough", 0.9)
        return self.add("materials", {"name": name, "pbrMetallicRoughness": pbr, **more})

    def mesh(self, name, positions, normals, triangles, material):
        def vectors(rows):
            view = self.view(b"".join(struct.pack("<3f", *r) for r in rows))
            item = {"bufferView": view, "componentType": 5126, "count": len(rows), "type": "VEC3"}
            item["min"] = [min(r[i] for r in rows) for i in range(3)]
            item["max"] = [max(r[i] for r in rows) for i in range(3)]
            return self.add("accessors", item)

        # glTF's numbers are floats; bounds must be those of the rounded ones.
        rounded = [struct.unpack("<3f", struct.pack("<3f", *p)) for p in positions]
        attributes = {"POSITION": vectors(rounded), "NORMAL": vectors(normals)}
        flat = [i for t in triangles for i in t]
        view = self.view(struct.pack(f"<{len(flat)}H", *flat))
        item = {"bufferView": view, "componentType": 5123, "count": len(flat), "type": "SCALAR"}
        primitive = {"attributes": attributes, "indices": self.add("accessors", item)}
        return self.add("meshes", {"name": name, "primitives": [{**primitive, "material": material}]})

    def node(self, name, lumel=None, **more):
        if lumel:
            more["extras"] = {"lumel": lumel}
        index = self.add("nodes", {"name": name, **more})
        self.json["scenes"][0]["nodes"].append(index)
        return index

    def box(self, name, low, high, material, inside=False, skip=(), lumel=None):
        positions, normals, triangles = [], [], []
        for axis in range(3):
            for side in (0, 1):
                if (axis, side) in skip:
                    continue
                u, v = (axis + 1) % 3, (axis + 2) % 3
                normal = [0.0] * 3
                normal[axis] = (1.0 if side else -1.0) * (-1.0 if inside else 1.0)
                first = len(positions)
                for du, dv in ((0, 0), (1, 0), (1, 1), (0, 1)):
                    p = [0.0] * 3
                    p[axis] = (low, high)[side][axis]
                    p[u], p[v] = (low, high)[du][u], (low, high)[dv][v]
                    positions.append(p)
                    normals.append(normal)
                order = [(0, 1, 2), (0, 2, 3)]
                if (side == 0) != inside:
                    order = [(a, c, b) for a, b, c in order]
                triangles += [tuple(first + i for i in t) for t in order]
        mesh = self.mesh(name, positions, normals, triangles, material)
        return self.node(name, lumel, mesh=mesh)

    def ball(self, name, at, radius, rings, material, lumel=None):
        positions, normals, triangles = [], [], []
        for i in range(rings + 1):
            for j in range(2 * rings + 1):
                a, b = math.pi * i / rings, math.pi * j / rings
                n = [math.sin(a) * math.cos(b), math.cos(a), -math.sin(a) * math.sin(b)]
                normals.append(n)
                positions.append([radius * x for x in n])
        row = 2 * rings + 1
        for i in range(rings):
            for j in range(2 * rings):
                a = i * row + j
                if i > 0:
                    triangles.append((a, a + row, a + 1))
                if i < rings - 1:
                    triangles.append((a + 1, a + row, a + row + 1))
        mesh = self.mesh(name, positions, normals, triangles, material)
        return self.node(name, lumel, mesh=mesh, translation=at)

    def light(self, name, kind, at, along, lumel=None, **more):
        lights = self.json["extensions"]["KHR_lights_punctual"]["lights"]
        lights.append({"name": name, "type": kind, **more})
        extension = {"KHR_lights_punctual": {"light": len(lights) - 1}}
        turn = look_along(along)
        self.node(name, lumel, translation=at, rotation=turn, extensions=extension)

    def camera(self, at, to, degrees):
        x, y, z = (b - a for a, b in zip(at, to))
        yaw, pitch = math.atan2(-x, -z) / 2, math.atan2(y, math.hypot(x, z)) / 2
        turn = [math.sin(pitch) * math.cos(yaw), math.cos(pitch) * math.sin(yaw)]
        turn += [-math.sin(pitch) * math.sin(yaw), math.cos(pitch) * math.cos(yaw)]
        view = {"yfov": math.radians(degrees), "znear": 0.01}
        index = self.add("cameras", {"type": "perspective", "perspective": view})
        self.node("camera", camera=index, translation=at, rotation=turn)

    def texture(self, picture):
        png = io.BytesIO()
        picture.save(png, "PNG")
        image = {"bufferView": self.view(png.getvalue()), "mimeType": "image/png"}
        return self.add("textures", {"source": self.add("images", image)})

    def glb(self):
        used = {k: v for k, v in self.json.items() if v != []}
        data = self.bin + b"\0" * (-len(self.bin) % 4)
        used["buffers"] = [{"byteLength": len(data)}]
        text = json.dumps(used).encode()
        text += b" " * (-len(text) % 4)
        total = 12 + 8 + len(text) + 8 + len(data)
        return (
            struct.pack("<4sII", b"glTF", 2, total)
            + struct.pack("<I4s", len(text), b"JSON") + text
            + struct.pack("<I4s", len(data), b"BIN\0") + data
        )


def look_along(d):
    """The shortest rotation from −Z to a direction."""
    length = math.sqrt(sum(x * x for x in d))
    x, y, z = (v / length for v in d)
    q = [y, -x, 0.0, 1.0 - z]
    if q[3] < 1e-9:
        return [0.0, 1.0, 0.0, 0.0]
    length = math.sqrt(sum(v * v for v in q))
    return [v / length for v in q]


def window():
    """The picture that the spot projects: a window with a cross of bars."""
    picture = Image.new("RGB", (256, 256), "black")
    draw = ImageDraw.Draw(picture)
    colours = ["#ffd9a0", "#ffb060", "#a0c8ff", "#ffe8c8"]
    for k, colour in enumerate(colours):
        x, y = 48 + 84 * (k % 2), 48 + 84 * (k // 2)
        draw.rectangle([x, y, x + 72, y + 72], fill=colour)
    return picture


def make(pillar):
    level = Level()
    white = level.material("white", (0.75, 0.73, 0.7))
    red = level.material("red", (0.65, 0.12, 0.08))
    blue = level.material("pillar", pillar)
    wood = level.material("wood", (0.45, 0.28, 0.15), rough=0.25)
    metal = level.material("metal", (0.9, 0.85, 0.75), metal=1, rough=0.05)
    # Two rooms, each with pages of its own, open to each other at x = 0.
    skip = {"a": [(0, 1)], "b": [(0, 0)]}
    for name, low, high in [("a", (-4, 0, -3), (0, 3, 3)), ("b", (0, 0, -3), (4, 3, 3))]:
        page = {"page": f"room_{name}"}
        floor = [*skip[name], (1, 1), (0, 0), (0, 1), (2, 0), (2, 1)]
        level.box(f"floor_{name}", low, high, wood, True, floor, page)
        level.box(f"walls_{name}", low, high, white, True, [*skip[name], (1, 0)], page)
    # The building from outside, which nobody in it sees.
    level.box("outside", (-4.2, -0.2, -3.2), (4.2, 3.2, 3.2), white, lumel={"page": "outside"})
    level.box("pillar_red", (-2.6, 0, -1.2), (-2.2, 3, -0.8), red)
    level.box("pillar_blue", (1.9, 0, -1.5), (2.3, 3, -1.1), blue)
    level.box("table", (-1.2, 0.7, 0.2), (0.2, 0.8, 1.2), wood)
    # Three levels of detail at one place.
    for k, rings in enumerate((24, 10, 5)):
        level.ball(f"globe_LOD{k}", [-0.5, 1.15, 0.7], 0.35, rings, white)
    # A crate in two states.
    for k, (inset, top) in enumerate(((0, 0.8), (0.05, 0.3))):
        variant = {"variant": {"group": "crate", "index": k}}
        low, high = (2.6 + inset, 0, 0.6 + inset), (3.4 - inset, top, 1.4 - inset)
        level.box(f"crate_{k}", low, high, red, lumel=variant)
    level.ball("mirror", [1.2, 0.6, 0.4], 0.6, 32, metal)
    cookie = {"cookie": level.texture(window())}
    spot = {"innerConeAngle": 0.4, "outerConeAngle": 0.62}
    level.light("projector", "spot", [-1.0, 2.7, 1.6], (-0.8, -0.75, -1.6), cookie, color=[1, 0.9, 0.75], intensity=60, spot=spot)
    mixed = {"mode": "mixed", "radius": 0.05}
    level.light("lamp", "point", [2.9, 2.3, -0.2], (0, -1, 0), mixed, color=[1, 0.85, 0.6], intensity=3)
    areas = level.json["extensions"]["EXT_lights_area"]["lights"]
    areas.append({"name": "panel", "type": "rect", "intensity": 8, "size": 0.5, "rect": {"aspect": 3}})
    level.node("panel", translation=[-2, 2.95, 1.5], rotation=look_along((0, -1, 0)), extensions={"EXT_lights_area": {"light": 0}})
    for name, at in [("here_a", [-1.8, 1.4, 0.8]), ("here_b", [1.2, 1.4, 0.4])]:
        level.node(name, {"reflection": True}, translation=at)
    level.camera([-0.9, 1.6, 2.7], [1.9, 0.9, -0.6], 70)
    return level.glb()


OPTIONS = """--quality quick --texels-per-unit 20 --sky 0 --mode shadowmask --probes 0.5 --probe-volume
    --indirect-boost 1.2 --cull-unseen --walkable floor*
    --ktx2 rgb9e5 --png rgbm --layers ao"""


def serve(out):
    """Serves the loaders, three.js and the bake."""
    crates = REPOSITORY / "crates/lumel/vendor/three"
    folders = [
        ("/engines/node_modules/three/build/", crates / "build"),
        ("/engines/node_modules/three/examples/jsm/", crates / "addons"),
        ("/engines/", REPOSITORY / "tools/engines/three"),
        ("/bake/", out),
    ]

    class Handler(http.server.SimpleHTTPRequestHandler):
        def translate_path(self, path):
            path = path.split("?")[0]
            for prefix, folder in folders:
                if path.startswith(prefix):
                    return str(folder / path[len(prefix):])
            return str(out / "none")

        def log_message(self, *_):
            pass

    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    return server.server_address[1]


def shoot(port, query, picture):
    url = f"http://127.0.0.1:{port}/engines/index.html?glb=/bake/artists.glb&{query}"
    subprocess.run(
        ["chromium", "--headless=new", "--no-sandbox", "--enable-unsafe-swiftshader", "--use-angle=swiftshader",
         "--hide-scrollbars", "--window-size=1280,720", "--virtual-time-budget=60000", f"--screenshot={picture}", url],
        check=True, timeout=180, capture_output=True,
    )


VIEWS = {
    "room_a": ("0.6,1.7,2.9,-1.6,1,-0.8,75", "-1.9,0.35,1.6,0.35"),
    "room_b": ("-0.9,1.6,2.7,1.9,0.9,-0.6,70", None),
}


def show_in_bevy(program, out):
    for name, (cam, ball) in VIEWS.items():
        more = ["--ball", ball] if ball else []
        picture = out / f"{name}.bevy.png"
        glb = out / "artists.glb"
        subprocess.run([program, glb, picture, "--ktx2", "--cam", cam, *more], check=True, timeout=600)


def bake(lumel, file, out, pillar, *more):
    file.write_bytes(make(pillar))
    subprocess.run([lumel, "bake", str(file), "-o", str(out), *OPTIONS.split(), *more], check=True)
    return json.loads((out / "artists.report.json").read_text())


def main():
    lumel, out = sys.argv[1], Path(sys.argv[2]).resolve()
    (out / "level").mkdir(parents=True, exist_ok=True)
    file = out / "level" / "artists.glb"
    report = bake(lumel, file, out, (0.4, 0.4, 0.4))
    print("--cull-unseen left out", ", ".join(report["culled"]["nodes"]))
    report = bake(lumel, file, out, (0.1, 0.2, 0.6), "--only", "pillar_blue", "--only", "floor_b")
    print("--only baked", report["only"])
    port = serve(out)
    for name, (cam, ball) in VIEWS.items():
        ball = f"&ball={ball}" if ball else ""
        shoot(port, f"ktx2=1&reflect=1{ball}&cam={cam}", out / f"{name}.png")
    if program := os.environ.get("LUMEL_BEVY"):
        show_in_bevy(program, out)


if __name__ == "__main__":
    main()
