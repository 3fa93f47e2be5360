#!/usr/bin/env python3
"""Tries hostile inputs one by one through the binary, and prints a Markdown table.

    tools/hostile_table.py [--lumel PATH] [--reproducers DIR] [--only PATTERN] [--keep]

Needs only python3 and a release build. Each case says which exit codes are right. A row is wrong if
the code is another, a failure gives more or less than one error, the terminal gets characters that
it obeys, a failed bake leaves files, an input changes, or a limit of processor time or memory is
exceeded. Exits with 1 if a row is wrong.
"""

import argparse
import base64
import hashlib
import json
import os
import random
import re
import resource
import shutil
import socket
import struct
import subprocess
import sys
import tempfile
import time
import urllib.error
import urllib.request
import zlib
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
MEMORY = 1024  # MiB, what every bake is allowed
SECONDS = 60  # of processor time
CASES = []


def case(item, name, *codes, says="", seconds=SECONDS):
    """Declares a case: a function that fills a folder and returns the arguments of lumel."""

    def add(make):
        CASES.append((item, name, set(codes), says, seconds, make))
        return make

    return add


# Inputs.


def data(binary, kind="application/octet-stream"):
    return f"data:{kind};base64," + base64.b64encode(binary).decode()


def square(half=1.0):
    h = half
    points = [(-h, 0, h), (h, 0, h), (h, 0, -h), (-h, 0, -h)]
    return b"".join(struct.pack("<3f", *p) for p in points) + struct.pack("<6H", 0, 1, 2, 0, 2, 3)


def level(**parts):
    """A square and a lamp, with members replaced or added."""
    binary = square()
    document = {
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0, 1]}],
        "nodes": [{"mesh": 0, "name": "floor"}, lamp(0, [0, 1, 0])],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1, "material": 0}]}],
        "materials": [{"doubleSided": True}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3", "min": [-1, 0, -1], "max": [1, 0, 1]},
            {"bufferView": 1, "componentType": 5123, "count": 6, "type": "SCALAR"}],
        "bufferViews": [{"buffer": 0, "byteLength": 48}, {"buffer": 0, "byteOffset": 48, "byteLength": 12}],
        "buffers": [{"uri": data(binary), "byteLength": len(binary)}],
        "extensionsUsed": ["KHR_lights_punctual", "EXT_lights_area", "EXT_mesh_gpu_instancing"],
        "extensions": {"KHR_lights_punctual": {"lights": [{"type": "point", "intensity": 10}]}},
    }
    document.update(parts)
    return document


def lamp(k, at, **more):
    return {"translation": at, "extensions": {"KHR_lights_punctual": {"light": k}}, **more}


def lights(*list_):
    return {"KHR_lights_punctual": {"lights": list(list_)}}


def save(folder, document, name="level.gltf"):
    path = folder / name
    path.write_text(document if isinstance(document, str) else json.dumps(document))
    return path


def bake(folder, scene, *options):
    return ["bake", scene, "-o", folder / "out", "-q", "--quality=draft", f"--memory={MEMORY}M", "--no-config", *options]


def simple(folder, *options, **parts):
    parts = {"texels": True, **parts}
    density = ["--texels-per-unit=4"] if parts.pop("texels") else []
    return bake(folder, save(folder, level(**parts)), *density, *options)


def many(count, node):
    """`nodes` and `scenes` with the floor and `count` others."""
    return {"nodes": [{"mesh": 0, "name": "floor"}] + [node(k) for k in range(count)],
            "scenes": [{"nodes": list(range(count + 1))}]}


def png(width, height, rows=b""):
    def chunk(kind, body):
        return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))
    head = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b"")


SMALL = png(2, 2, b"\0" + b"\xff" * 6 + b"\0" + b"\x80" * 6)


def textured(uri, **more):
    return {"images": [{"uri": uri}], "textures": [{"source": 0}],
            "materials": [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0, **more}}}],
            "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "TEXCOORD_0": 2}, "indices": 1, "material": 0}]}],
            "accessors": level()["accessors"] + [{"componentType": 5126, "count": 4, "type": "VEC2"}]}


# 1: structure.

for file in ["hang_node_own_child.gltf", "oom_node_own_child_twice.gltf", "hang_child_listed_twice_60_deep.gltf"]:
    case("1 hierarchy", file, 3, seconds=5)(lambda f, file=file: bake(f, reproducer(file)))


@case("1 hierarchy", "100,000 nodes in a loop", 3, seconds=10)
def _(f):
    return simple(f, nodes=[{"children": [(k + 1) % 100_000]} for k in range(100_000)], scenes=[{"nodes": [0]}])


@case("1 hierarchy", "chain of 50,000 nodes", 0, seconds=20)
def _(f):
    nodes = [{"children": [k + 1]} for k in range(50_000)] + [{"mesh": 0}]
    return simple(f, "--sky=1", nodes=nodes, scenes=[{"nodes": [0]}])


@case("1 hierarchy", "one node with a million equal children", 3, seconds=10)
def _(f):
    return simple(f, nodes=[{"children": [1] * 1_000_000}, {"mesh": 0}], scenes=[{"nodes": [0]}])


# 2 and 3.

case("2 stitching", "slow_dive_level.glb", 0)(lambda f: bake(f, reproducer("slow_dive_level.glb"), "--sky=1"))
case("3 EXR that wraps", "--sky", 3, seconds=5)(lambda f: simple(f, f"--sky={reproducer('exr_2p30.exr')}"))
case("3 EXR that wraps", "diff", 2, 3, seconds=5)(
    lambda f: ["diff", reproducer("exr_2p30.exr"), reproducer("exr_2p30.exr")])


@case("3 EXR that wraps", "report", 2, 3, seconds=5)
def _(f):
    baked(f)
    shutil.copy(reproducer("exr_2p30.exr"), f / "baked/level.lightmap.exr")
    return ["report", f / "baked", "-o", "-"]


# 4: inputs among outputs.


def beside(f, buffer="level.bin", **parts):
    (f / buffer).write_bytes(square())
    return save(f, level(buffers=[{"uri": buffer, "byteLength": 60}], **parts))


def into(f, *options):
    return ["bake", f / "level.gltf", "-o", f, "-q", "--quality=draft", "--texels-per-unit=4", "--no-config", *options]


for option in ["--preview", "--first-picture", "--depfile", "--report"]:
    @case("4 overwriting", f"{option} named like a buffer", 2, seconds=5)
    def _(f, option=option):
        beside(f, "b.png")
        return into(f, f"{option}={f / 'b.png'}")

for name in ["level.glb", "level.vertex.glb", "level.lightmap.exr", "level.lightmap.json", "level.report.json"]:
    @case("4 overwriting", f"a buffer named {name}", 2, seconds=5)
    def _(f, name=name):
        beside(f, name)
        return into(f)


@case("4 overwriting", "the sky named like the lightmap", 2, 3, seconds=5)
def _(f):
    beside(f)
    shutil.copy(baked_folder(f) / "level.lightmap.exr", f / "level.lightmap.exr")
    return into(f, f"--sky={f / 'level.lightmap.exr'}")


@case("4 overwriting", "the scene is a link to what the bake writes", 2, seconds=5)
def _(f):
    (f / "out").mkdir()
    baked(f)
    shutil.copy(f / "baked/level.glb", f / "out/level.glb")
    (f / "level.glb").symlink_to("out/level.glb")
    return bake(f, f / "level.glb")


@case("4 overwriting", "an unrelated level.glb beside level.gltf, -o .", 2, seconds=5)
def _(f):
    beside(f)
    (f / "level.glb").write_bytes(b"mine")
    return into(f)


# 6: valid.

case("6 valid", "a child of a node outside of the scene", 0)(
    lambda f: simple(f, nodes=[{"mesh": 0}, {"children": [0]}], scenes=[{"nodes": [0]}], extensions={}))
case("6 valid", "children: [1.0]", 0)(
    lambda f: simple(f, "--sky=1", nodes=[{"children": [1.0]}, {"mesh": 0}], scenes=[{"nodes": [0]}], extensions={}))


@case("6 valid", "KTX2 without a fallback", 0)
def _(f):
    picture = (ROOT / "crates/mesh-ingest/tests/ingest/ktx2/uastc.ktx2").read_bytes()
    parts = textured(data(picture, "image/ktx2"))
    parts["textures"] = [{"extensions": {"KHR_texture_basisu": {"source": 0}}}]
    return simple(f, **parts, extensionsUsed=["KHR_texture_basisu"], extensionsRequired=["KHR_texture_basisu"])


@case("6 valid", "all meshes animated", 2, 3, says="extras.lumel.bake", seconds=5)
def _(f):
    return simple(f, **moving(1))


def moving(channels):
    """The floor and the lamp, moved."""
    return {"animations": [{"samplers": [{"input": 2, "output": 3}],
                            "channels": [{"sampler": 0, "target": {"node": k % 2, "path": "translation"}}
                                         for k in range(channels)]}],
            "accessors": level()["accessors"] + [
                {"componentType": 5126, "count": 2, "type": "SCALAR", "min": [0], "max": [0]},
                {"componentType": 5126, "count": 2, "type": "VEC3"}]}


# 7: late faults.

for file in ["late_error_joints.glb", "late_error_custom_attr.glb", "bad_target.glb", "broken_meshopt_animation.glb"]:
    case("7 late faults", file, 3, seconds=5)(lambda f, file=file: bake(f, reproducer(file)))
    case("7 late faults", f"{file} --dry-run", 3, seconds=5)(lambda f, file=file: bake(f, reproducer(file), "--dry-run"))
    case("7 late faults", f"inspect {file}", 3, seconds=5)(lambda f, file=file: ["inspect", reproducer(file)])

# 8: pipes and devices.


def pipe(f, name="pipe"):
    os.mkfifo(f / name)
    return f / name


PIPES = {
    "scene": lambda f: bake(f, pipe(f, "a.glb")),
    "buffer": lambda f: (pipe(f), simple(f, buffers=[{"uri": "pipe", "byteLength": 60}]))[1],
    "image": lambda f: (pipe(f, "pipe.png"), simple(f, **textured("pipe.png")))[1],
    "sky": lambda f: simple(f, f"--sky={pipe(f, 'a.hdr')}"),
    "probes": lambda f: simple(f, f"--probes={pipe(f, 'a.json')}"),
    "settings": lambda f: ["inspect", save(f, level()), "--config", pipe(f)],
    "diff": lambda f: ["diff", pipe(f, "a.exr"), f / "a.exr"],
    "report.json": lambda f: (baked(f), (f / "baked/level.report.json").unlink(),
                              pipe(f, "baked/level.report.json"), ["report", f / "baked", "-o", "-"])[3],
    "work folder": lambda f: ["gather", pipe(f), "--shard=1/2"],
    "sky /dev/zero": lambda f: simple(f, "--sky=/dev/zero"),
    "scene /dev/zero": lambda f: bake(f, "/dev/zero"),
    "config /dev/zero": lambda f: ["inspect", save(f, level()), "--config", "/dev/zero"],
    "probes /dev/stdin": lambda f: simple(f, "--probes=/dev/stdin"),
    "output": lambda f: ["bake", save(f, level()), "-o", pipe(f), "-q", "--quality=draft"],
    "cache": lambda f: simple(f, f"--cache={pipe(f)}"),
}
for name, make in PIPES.items():
    # A report that cannot be read is not needed for a page, and a cache not for a bake.
    fine = [0] if name in ("report.json", "cache") else []
    case("8 pipes, devices", name, 1, 2, 3, 4, *fine, seconds=5)(make)

# 9: outside of the folder.

for uri in ["/etc/passwd", "../secret.bin", "%2e%2e/secret.bin", "a/../../secret.bin", "file:///etc/passwd",
            "//host/x", "http://localhost/x", "C:/x", "..\\secret.bin", "link/secret.bin", "link.bin", "~/x", "\0",
            "/proc/self/environ"]:
    @case("9 outside", f"buffer {uri!r}", 2, 3, 4, seconds=5)
    def _(f, uri=uri):
        inner = f / "inner"
        inner.mkdir()
        (f / "secret.bin").write_bytes(square())
        (inner / "link").symlink_to("..")
        (inner / "link.bin").symlink_to("../secret.bin")
        return bake(f, save(inner, level(buffers=[{"uri": uri, "byteLength": 60}])))

for option, codes in [("--allow-outside", [0]), ("-q", [2, 3, 4])]:
    @case("9 outside", f"../secret.bin, {option}", *codes, seconds=20)
    def _(f, option=option):
        (f / "inner").mkdir()
        (f / "secret.bin").write_bytes(square())
        scene = save(f / "inner", level(buffers=[{"uri": "../secret.bin", "byteLength": 60}]))
        return [a for a in bake(f, scene, "--texels-per-unit=4", option) if a != "-q"]

# 10: too bright.

for option in ["--sky=3e38", "--sky=1e39", "--sky=nan", "--sky=-1", "--light=*=1e38", "--sun=0,-1,0,1e30",
               "--sun=0,0,0,1", "--sky-intensity=1e38", "--indirect-boost=1e38", "--emissive-boost=-1",
               "--ambient-floor=1e38", "--albedo-boost=1e38"]:
    case("10 light", option, 1, 3, seconds=10)(
        lambda f, option=option: simple(f, option, *(["--sky=1"] if "intensity" in option else [])))
case("10 light", "--sky=1e6: clamped all over", 0, says="65504", seconds=20)(
    lambda f: [a for a in simple(f, "--sky=1e6") if a != "-q"])
case("10 light", "a lamp of 1e38 candela", 1, 3, seconds=5)(
    lambda f: simple(f, extensions=lights({"type": "point", "intensity": 1e38})))

# 11: memory.

case("11 memory", "jpg_20000x20000.glb", 3, 4, seconds=5)(lambda f: bake(f, reproducer("jpg_20000x20000.glb")))
case("11 memory", "PNG of 16384² in 300 bytes", 3, 4, seconds=5)(
    lambda f: simple(f, **textured(data(png(16384, 16384), "image/png"))))
case("11 memory", "--memory 20M", 3, says="would fit", seconds=10)(
    lambda f: [a for a in simple(f, "--memory=20M", "--texels-per-unit=500", texels=False) if a != f"--memory={MEMORY}M"])
case("11 memory", "--texels-per-unit 1e9", 1, 2, 4, seconds=5)(lambda f: simple(f, "--texels-per-unit=1e9", texels=False))
case("11 memory", "--max-image 1K", 4, 3, seconds=5)(
    lambda f: simple(f, "--max-image=1K", **textured(data(png(64, 64, b"\0" * 64 * 193), "image/png"))))


@case("11 memory", "7.7 million instanced triangles", 3, says="--memory is", seconds=20)
def _(f):
    return simple(f, accessors=level()["accessors"] + [{"componentType": 5126, "count": 3_850_000, "type": "VEC3"}],
                  nodes=[{"mesh": 0, "extensions": {"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": 2}}}}],
                  scenes=[{"nodes": [0]}])


# 13: the terminal, the viewer.

case("13 terminal", "ansi_in_error.glb", 2, 3, seconds=5)(lambda f: bake(f, reproducer("ansi_in_error.glb")))
case("13 terminal", "3 MB of a name in an error", 2, 3, seconds=5)(
    lambda f: simple(f, nodes=[{"name": "\x1b[31m" + "n" * 3_000_000, "mesh": 7}], scenes=[{"nodes": [0]}]))
case("13 terminal", "100,000 unknown extensions required", 2, 3, 4, seconds=5)(
    lambda f: simple(f, extensionsRequired=[f"E\x1b]0;x\x07{k}" for k in range(100_000)]))
case("13 terminal", "a name that is not UTF-8", 1, 2, 3, seconds=5)(
    lambda f: bake(f, shutil.copy(ROOT / "assets/cornell_box.glb", os.fsencode(f) + b"/\xff\xfe.glb")))


@case("13 terminal", "warnings and progress with names that it obeys", 0, seconds=20)
def _(f):
    name = "\x1b[2J\x9b31m\u202e\r\n\x07"
    return [a for a in simple(f, "-v", nodes=[{"mesh": 0, "name": name, "extras": {"lumel": {name: 1}}}],
                              scenes=[{"nodes": [0]}], extensions={}, materials=[{"name": name}]) if a != "-q"]


# New: levels of detail, variants, lamps, cookies, masks, captures, probes, pages, groups.

NEW = "14 "
case(NEW + "LODs", "MSFT_lod of itself", 0, 2, 3, seconds=10)(
    lambda f: simple(f, nodes=[{"mesh": 0, "extensions": {"MSFT_lod": {"ids": [0]}}}], scenes=[{"nodes": [0]}]))
case(NEW + "LODs", "MSFT_lod in a loop of 1,000", 0, 2, 3, seconds=20)(
    lambda f: simple(f, **many(1000, lambda k: {"mesh": 0, "extensions": {"MSFT_lod": {"ids": [(k + 1) % 1000 + 1]}}})))
case(NEW + "LODs", "MSFT_lod with ids out of range", 0, 2, 3, seconds=10)(
    lambda f: simple(f, nodes=[{"mesh": 0, "extensions": {"MSFT_lod": {"ids": [9, -1, 2**40, "x"]}}}], scenes=[{"nodes": [0]}]))
case(NEW + "LODs", "5,000 levels of one group", 0, 2, 3, 4)(
    lambda f: simple(f, **many(5000, lambda k: {"mesh": 0, "name": f"tree_LOD{k}"})))
case(NEW + "LODs", "20,000 nodes with LOD names, all level 0", 0, 2, 3, 4)(
    lambda f: simple(f, "--texels-per-unit=0.5", **many(20000, lambda k: {"mesh": 0, "name": "tree_LOD0", "translation": [3 * k, 0, 0]}), texels=False))
case(NEW + "variants", "1,000 in one group", 0, 2, 3, 4)(
    lambda f: simple(f, **many(1000, lambda k: {"mesh": 0, "extras": {"lumel": {"variant": {"group": "g", "index": k % 1000}}}})))
case(NEW + "lamps", "20,000 in one place", 0, 4)(lambda f: simple(f, **many(20000, lambda k: lamp(0, [0, 1, 0]))))
case(NEW + "lamps", "100,000 spread out", 0, 4)(
    lambda f: simple(f, **many(100_000, lambda k: lamp(0, [k % 316, 1 + k % 7, k // 316]))))
case(NEW + "lamps", "2,000 suns", 0, 2, 3, 4)(
    lambda f: simple(f, **many(2000, lambda k: lamp(0, [0, 1, 0], rotation=[-0.7071068, 0, 0, 0.7071068])),
                     extensions=lights({"type": "directional", "intensity": 1})))
case(NEW + "lamps", "--sun, 500 times", 0, 1, 4)(lambda f: simple(f, *["--sun=0,-1,0.1,1,1"] * 500))
case(NEW + "lamps", "inside each other, scaled by 1e-30 and 1e30", 0, 2, 3)(
    lambda f: simple(f, **many(4, lambda k: lamp(0, [0, 0, 0], scale=[[1e-30, 1e30][k % 2]] * 3))))
case(NEW + "area lights", "10,000, of 1e-30 and 1e30 m", 0, 2, 3, 4)(
    lambda f: simple(f, **many(10000, lambda k: {"translation": [0, 1, 0], "extensions": {"EXT_lights_area": {"light": k % 3}}}),
                     extensions={"EXT_lights_area": {"lights": [
                         {"type": "rect", "intensity": 1, "size": s, "rect": {"aspect": 1e30}} for s in (1e-30, 1e30, 1.0)]}}))


def cookies(count, **more):
    return {"images": [{"uri": data(SMALL, "image/png")}], "textures": [{"source": 0}],
            **many(count, lambda k: lamp(k % 5000, [0, 1, 0], rotation=[-0.7071068, 0, 0, 0.7071068])),
            "extensions": lights(*[{"type": "spot", "intensity": 5, "spot": {"outerConeAngle": 1},
                                    "extras": {"lumel": {"cookie": 0, **more}}}] * min(count, 5000))}


case(NEW + "cookies", "5,000 lamps with one", 0, 4)(lambda f: simple(f, **cookies(5000)))
for value in [-1, 7, 1e300, 0.5, "x", [0], 2**63]:
    case(NEW + "cookies", f"cookie: {value!r}", 0, 2, 3, seconds=10)(lambda f, value=value: simple(f, **cookies(1, cookie=value)))
for value in [0, -1, 1e-30, 1e30]:
    case(NEW + "cookies", f"a sun's cookieSize: {value!r}", 0, 2, 3, seconds=10)(lambda f, value=value: simple(
        f, **{**cookies(1), "extensions": lights({"type": "directional", "intensity": 1,
              "extras": {"lumel": {"cookie": 0, "cookieSize": value}}})}))
case(NEW + "masks", "1,000 mixed lamps, --mode shadowmask", 0, 1, 3, 4)(
    lambda f: simple(f, "--mode=shadowmask", "--mixed=*", **many(1000, lambda k: lamp(0, [k % 30, 1, k // 30], name=f"l{k}"))))
case(NEW + "masks", "20,000 mixed lamps in one place", 0, 1, 3, 4)(
    lambda f: simple(f, "--mode=shadowmask", "--mixed=*", **many(20000, lambda k: lamp(0, [0, 1, 0]))))
case(NEW + "captures", "2,000", 0, 3, 4)(
    lambda f: simple(f, **many(2000, lambda k: {"translation": [k * 1e-3, 1, 0], "extras": {"lumel": {"reflection": True}}})))
case(NEW + "captures", "10 at 1e30", 0, 2, 3, 4)(
    lambda f: simple(f, **many(10, lambda k: {"translation": [1e30, 1, 0], "extras": {"lumel": {"reflection": True}}})))
case(NEW + "probes", "a million points", 0, 3, 4)(
    lambda f: simple(f, f"--probes={save(f, json.dumps({'points': [[k * 1e-6, 1, 0] for k in range(1_000_000)]}), 'p.json')}"))
case(NEW + "probes", "points at 1e38 and 1e-38", 0, 3)(
    lambda f: simple(f, f"--probes={save(f, dict(points=[[1e38, 0, 0], [1e-38, 1, 0]]), 'p.json')}"))
case(NEW + "probes", "100,000 brackets", 3, seconds=5)(
    lambda f: simple(f, f"--probes={save(f, '[' * 100_000, 'p.json')}"))
for spacing in ["1e-9", "1e-3", "1e9", "0", "nan"]:
    case(NEW + "probes", f"--probes={spacing} --probe-volume", 0, 1, 2, 3, 4)(
        lambda f, spacing=spacing: simple(f, f"--probes={spacing}", "--probe-volume"))
case(NEW + "pages", "5,000 nodes with a page each", 0, 2, 3, 4)(
    lambda f: simple(f, **many(5000, lambda k: {"mesh": 0, "translation": [3 * k, 0, 0], "extras": {"lumel": {"page": f"p{k}"}}})))
case(NEW + "pages", "names of pages that are paths", 0, 2, 3, seconds=20)(
    lambda f: simple(f, **many(4, lambda k: {"mesh": 0, "extras": {"lumel": {"page": ["../../x", "/etc/x", "a\0b", "CON"][k]}}})))
case(NEW + "groups", "--group, 300 times", 0, 1, 3, 4)(lambda f: simple(f, *[f"--group=g{k}=*" for k in range(300)]))
case(NEW + "groups", "names of groups that are paths", 1, 2, 3, seconds=10)(lambda f: simple(f, "--group=../../x=*"))
case(NEW + "patterns", "2,500 stars against 20,000 letters", 0, 1, 2)(
    lambda f: simple(f, "--page-by=" + "*a" * 2500 + "b", nodes=[{"mesh": 0, "name": "a" * 20000}], scenes=[{"nodes": [0]}], extensions={}))
case(NEW + "walkable", "volumes of 1e30 and 0 m", 0, 2, 3)(
    lambda f: simple(f, "--cull-unseen", "--sky=1", **many(3, lambda k: {"mesh": 0, "scale": [[1e30, 1, 1], [0, 0, 0], [1, 1, 1]][k],
                                                            "extras": {"lumel": {"walkable": True}}})))
case(NEW + "walkable", "3,000 volumes", 0, 2, 3, 4)(
    lambda f: simple(f, "--cull-unseen", "--sky=1", **many(3000, lambda k: {"mesh": 0, "scale": [9, 9, 9], "extras": {"lumel": {"walkable": True}}})))
case(NEW + "tiles", "a square of 1 km at 100 lumels/m, pages of 16384", 1, 3, 4)(
    lambda f: simple(f, "--texels-per-unit=100", "--max-page=16384", nodes=[{"mesh": 0, "scale": [500, 1, 500]}],
                     scenes=[{"nodes": [0]}], texels=False))
case(NEW + "tiles", "50,000 squares of 8 texels", 0, 4, seconds=200)(
    lambda f: simple(f, "--no-vertex-colors", "--sky=1", accessors=level()["accessors"] + [{"componentType": 5126, "count": 50_000, "type": "VEC3"}],
                     nodes=[{"mesh": 0, "extensions": {"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": 2}}}}],
                     scenes=[{"nodes": [0]}], extensions={}))
case(NEW + "vertices", "--vertex-error 1e-6 of 1,000 instances", 0, 4, seconds=120)(
    lambda f: simple(f, "--vertex-error=1e-6", "--texels-per-unit=16", **many(1000, lambda k: {"mesh": 0, "translation": [3 * k, 0, 0]}), texels=False))
case(NEW + "transforms", "scales of 1e38 in each other", 0, 2, 3)(
    lambda f: simple(f, nodes=[{"children": [1], "scale": [1e38] * 3}, {"mesh": 0, "scale": [1e38] * 3}], scenes=[{"nodes": [0]}]))
case(NEW + "transforms", "scales of 1e-38 in each other", 0, 2, 3)(
    lambda f: simple(f, nodes=[{"children": [1], "scale": [1e-38] * 3}, {"mesh": 0, "scale": [1e-38] * 3}], scenes=[{"nodes": [0]}]))
case(NEW + "textures", "repeated 1e30 times under a mask", 0, 2, 3)(
    lambda f: simple(f, **{**textured(data(SMALL, "image/png"), extensions={"KHR_texture_transform": {"scale": [1e30, 1e30]}}),
                           "extensionsUsed": ["KHR_texture_transform"]}))
case(NEW + "animations", "200,000 channels", 0, 2, 3, 4)(lambda f: simple(f, **moving(200_000)))
case(NEW + "names", "patterns, empty, 1 MB, from right to left", 0, 2, 3)(
    lambda f: simple(f, "--only=*", **many(4, lambda k: {"mesh": 0, "name": ["*?", "", "n" * 1_000_000, "\u202eexe"][k]})))
case(NEW + "JSON", "a million brackets in the document", 2, 3, seconds=5)(
    lambda f: bake(f, save(f, '{"asset":{"version":"2.0"},"extras":' + "[" * 1_000_000)))
case(NEW + "JSON", "extras 100,000 deep, closed", 0, 2, 3, seconds=10)(
    lambda f: bake(f, save(f, '{"extras":' + "[" * 100_000 + "]" * 100_000 + "," + json.dumps(level())[1:]), "--texels-per-unit=4"))
for text in ["a = " + "[" * 100_000, "sky = " + "9" * 100_000, "[" + "a." * 100_000 + "b]", "light = [" + "{}," * 100_000 + "]",
             "threads = -1", "quality = 7", "max-image = '1T'"]:
    case(NEW + "settings", text[:20] + ("…" if len(text) > 20 else ""), 1, 2, 3, seconds=10)(
        lambda f, text=text: ["inspect", save(f, level()), "--config", save(f, text, "a.toml")])
case(NEW + "folders", "levels of one name, and a link to the folder itself", 0, 1, 2, 3)(
    lambda f: (save(f, level()), (f / "sub").mkdir(), save(f / "sub", level()), (f / "sub/loop").symlink_to(".."),
               ["bake", f, "-o", f / "out", "-q", "--quality=draft", "--texels-per-unit=4"])[-1])
for out in ["/dev/null", "/dev/null/x", "n" * 5000, "/proc/x", ""]:
    case(NEW + "output", f"-o {out[:20]!r}", 1, 2, 3, seconds=10)(
        lambda f, out=out: ["bake", save(f, level()), "-o", out, "-q", "--quality=draft", "--texels-per-unit=4"])
case(NEW + "cache", "folder of links and folders, of 0 bytes", 0, 1, 2, seconds=20)(
    lambda f: ((f / "cache").mkdir(), (f / "cache/x.charts").symlink_to("../level.gltf"), (f / "cache/dir.charts").mkdir(),
               simple(f, f"--cache={f / 'cache'}", "--cache-size=1"))[-1])
case(NEW + "lamps", "IES of 1,000,000 angles in 60 bytes", 0, 2, 3, seconds=5)(
    lambda f: simple(f, extensions={**lights({"type": "spot", "intensity": 1}), "EXT_lights_ies": {"lights": [
        {"uri": data(b"IESNA:LM-63-2002\nTILT=NONE\n1 1 1 1000000 1000000 1 2 0 0 0\n1 1 1\n0")}]}},
        nodes=[{"mesh": 0}, {"translation": [0, 1, 0], "extensions": {"EXT_lights_ies": {"light": 0}}}]))

# New: an earlier bake, shards, and finished bakes that lie.


def only(f, *options):
    return ["bake", f / "level.gltf", "-o", f / "baked", "-q", "--quality=draft", "--texels-per-unit=4", "--no-config",
            "--only=floor", *options]


case(NEW + "--only", "without an earlier bake", 1, 2, 3, seconds=5)(lambda f: simple(f, "--only=floor"))
case(NEW + "--only", "matches nothing", 1, 2, 3, seconds=5)(lambda f: (baked(f), only(f)[:-1] + ["--only=nothing"])[1])
case(NEW + "--only", "after a sound bake", 0, seconds=20)(lambda f: (baked(f), only(f))[1])


def spoil(name, how):
    def make(f):
        baked(f)
        path = f / "baked" / name
        how(path)
        return only(f)
    return make


def cut(path):
    path.write_bytes(path.read_bytes()[:-20])


def text(find, put):
    def how(path):
        before = path.read_text()
        path.write_text(re.sub(find, lambda _: put, before, count=1))
        assert path.read_text() != before, f"{find} is not in {path}"
    return how


for name, label, how in [
    ("level.lightmap.exr", "lightmap cut short", cut),
    ("level.lightmap.exr", "lightmap is a folder", lambda p: (p.unlink(), p.mkdir())),
    ("level.lightmap.json", "manifest of another file's name", text(r"level\.lightmap\.exr", "../../etc/passwd")),
    ("level.lightmap.json", "manifest of brackets", lambda p: p.write_text("[" * 100_000)),
    ("level.lightmap.json", "manifest with a page of 2^31 texels", text(r'"width":\s*\d+', '"width": 2147483647')),
    ("level.report.json", "report cut short", cut),
    ("level.report.json", "report of brackets", lambda p: p.write_text("[" * 1_000_000)),
]:
    # A manifest is written anew.
    codes = [0] if name == "level.lightmap.json" else [2, 3]
    case(NEW + "--only", label, *codes, seconds=10)(spoil(name, how))
    case(NEW + "finished bakes", f"report: {label}", 0, 1, 2, 3, seconds=10)(
        lambda f, make=spoil(name, how): (make(f), ["report", f / "baked", "-o", "-"])[1])


def work(f):
    """A solved bake."""
    if not (f / "work").exists():
        scene = save(f, level())
        run = [LUMEL, "solve", scene, "-o", f / "work", "-q", "--quality=draft", "--texels-per-unit=4", "--no-config"]
        subprocess.run(run, check=True)
    return f / "work"


for shard in ["0/0", "0/3", "4/3", "1/99999999999", "1/0", "-1/2", "1", "a/b", "1/1000000"]:
    case(NEW + "shards", f"--shard={shard}", 1, 2, 3, 4, *([0] if shard == "1/1000000" else []), seconds=10)(
        lambda f, shard=shard: ["gather", work(f), f"--shard={shard}", "-q"])
case(NEW + "shards", "merge without shards", 1, 2, 3, seconds=5)(lambda f: ["merge", work(f), "-o", f / "out", "-q"])
case(NEW + "shards", "gather in a folder of results", 1, 2, 3, seconds=5)(lambda f: (baked(f), ["gather", f / "baked", "--shard=1/2", "-q"])[1])
case(NEW + "shards", "merge into the work folder", 0, 1, 2, 3, seconds=10)(
    lambda f: (gathered(f), ["merge", f / "work", "-o", f / "work", "-q"])[1])
case(NEW + "shards", "solve into a work folder of another level", 0, 1, 2, 3, seconds=10)(
    lambda f: (work(f), ["solve", save(f, level(scenes=[{"nodes": [0]}]), "other.gltf"), "-o", f / "work", "-q", "--quality=draft", "--sky=1"])[1])
case(NEW + "shards", "the level changed before gather", 0, 1, 2, 3, seconds=10)(
    lambda f: (work(f), save(f, level(materials=[{}])), ["gather", f / "work", "--shard=1/2", "-q"])[2])
case(NEW + "shards", "work folder with a link out of it", 0, 1, 2, 3, seconds=10)(
    lambda f: ([(p.rename(f / "moved"), p.symlink_to(f / "moved")) for p in sorted(work(f).iterdir())[:1]],
               ["gather", f / "work", "--shard=1/2", "-q"])[1])


def gathered(f):
    for shard in ("1/2", "2/2"):
        subprocess.run([LUMEL, "gather", work(f), f"--shard={shard}", "-q"], check=True)


def flips(f, part, count=40):
    """Bits flipped in one file of a work folder, `count` times: each run must give the sound bytes or one error."""
    gathered(f) if part == "merge" else work(f)
    folder, wrong = f / "work", []
    (f / "sound").mkdir()
    shutil.copytree(folder, f / "sound/work")
    command = {"gather": ["gather", folder, "--shard=1/2", "-q"], "merge": ["merge", folder, "-o", f / "out", "-q"]}[part]
    rng = random.Random(28)
    sound = None
    for k in range(count + 1):
        shutil.rmtree(folder)
        shutil.copytree(f / "sound/work", folder)
        shutil.rmtree(f / "out", ignore_errors=True)
        files = sorted(p for p in folder.rglob("*") if p.is_file())
        if k:
            path = rng.choice(files)
            content = bytearray(path.read_bytes())
            content[rng.randrange(len(content))] ^= 1 << rng.randrange(8)
            path.write_bytes(content[:rng.randrange(len(content))] if k % 4 == 0 else content)
        code, seconds, peak, said = execute(command, f)
        made = sorted(p for p in (folder if part == "gather" else f / "out").rglob("*") if p.is_file() and "report" not in p.name)
        made = [p for p in made if p.name not in {q.name for q in files}] if part == "gather" else made
        bytes_ = hashlib.sha256(b"".join(p.read_bytes() for p in made)).hexdigest()
        if k == 0:
            assert code == 0, said
            sound = bytes_
        if code not in (0, 2, 3, 4) or (code and errors(said) != 1) or (code == 0 and bytes_ != sound):
            wrong.append(f"flip {k} in {path.name}: code {code}, {said[:200]}")
    return wrong


# Everything that needs more than one command.


def view(f):
    """64 idle connections and a bad EXR: the viewer still answers."""
    baked(f)
    shutil.copytree(f / "baked", f / "bad")
    shutil.copy(reproducer("exr_2p30.exr"), f / "bad/level.lightmap.exr")
    wrong = []
    for folder in ("baked", "bad"):
        server = subprocess.Popen([LUMEL, "view", f / folder], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
        try:
            url = re.search(r"http://\S+", server.stdout.readline()).group().rstrip("/.")
            host, port = url.split("//")[1].split(":")
            idle = [socket.create_connection((host, int(port))) for _ in range(464)]
            start = time.monotonic()
            with urllib.request.urlopen(url, timeout=20) as answer:
                assert answer.status == 200
            if time.monotonic() - start > 5:
                wrong.append(f"{time.monotonic() - start:.0f} s beside idle connections")
            for path in ["/api/plane?bake=level&page=0&layer=direct", "/files/..%2f..%2fetc/passwd", "/files//etc/passwd",
                         "/api/plane?bake=../level&page=99999999999", "/api/report?bake=%00", "/" + "a" * 100_000]:
                try:
                    with urllib.request.urlopen(url + path, timeout=20) as answer:
                        if b"root:" in answer.read():
                            wrong.append(f"{path[:40]} is served")
                except urllib.error.HTTPError as e:
                    if not 400 <= e.code <= 500:
                        wrong.append(f"{path[:40]}: {e.code}")
                except (urllib.error.URLError, ConnectionError):
                    pass  # It may close the connection.
            if server.poll() is not None:
                wrong.append(f"the viewer ended with {server.returncode}")
            for s in idle:
                s.close()
        finally:
            server.terminate()
            server.wait()
    return wrong


def kernels(f):
    scene, hashes = ROOT / "assets/cornell_box.glb", set()
    for kernel in ["portable", None]:
        environment = {**os.environ, **({"LUMEL_KERNEL": kernel} if kernel else {})}
        out = f / f"out_{kernel}"
        subprocess.run([LUMEL, "bake", scene, "-o", out, "-q", "--quality=draft", "--texels-per-unit=2"], env=environment, check=True)
        hashes.add(tuple(hashlib.sha256(p.read_bytes()).hexdigest() for p in sorted(out.iterdir()) if "report" not in p.name))
    return [] if len(hashes) == 1 else ["other bytes"]


def estimates(f):
    """`--dry-run` against the bake: memory and processor time within a factor of two."""
    wrong = []
    for name in ("cornell_box", "classic_room_1014"):
        scene = ROOT / f"assets/{name}.glb"
        options = ["-q", "--quality=preview", "--texels-per-unit=12"]
        plan = subprocess.run([LUMEL, "bake", scene, "-o", f / "x", *options, "--dry-run", "--json"], capture_output=True, text=True, check=True)
        plan = json.loads(plan.stdout)["estimate"]
        code, seconds, peak, said = execute(["bake", scene, "-o", f / name, *options], f)
        # `peak` is at least that of this program, which started the bake.
        peak = json.loads((f / name / f"{name}.report.json").read_text())["measured"]["peak_bytes"] / 2**20
        told = plan["bytes"] / 2**20
        NOTES.append(f"{name}: memory foretold {told:.0f} MiB, used {peak:.0f}; seconds foretold {plan['seconds']:.1f}, {seconds:.1f} of processor time")
        if not 0.5 < told / peak < 2:
            wrong.append(NOTES[-1])
    return wrong


MANY = [
    ("3, 13 viewer", "464 idle connections, an EXR that wraps, paths", view),
    ("5 other bytes", "LUMEL_KERNEL=portable", kernels),
    ("demand 2", "--dry-run against the bake", estimates),
    (NEW + "shards", "40 flipped bits or cuts before gather", lambda f: flips(f, "gather")),
    (NEW + "shards", "40 flipped bits or cuts before merge", lambda f: flips(f, "merge")),
]
NOTES = []

# Running.

LUMEL = REPRODUCERS = BAKED = None


def reproducer(name):
    return REPRODUCERS / name


def baked_folder(f):
    return BAKED / "baked"


def baked(f):
    """A copy of a finished bake of `level()` and its scene."""
    save(f, level())
    shutil.copytree(BAKED / "baked", f / "baked")


def errors(said):
    return sum(line.startswith("error") for line in said.splitlines())


def execute(arguments, folder, limit=SECONDS):
    """Exit code, processor seconds, peak MiB, and what was said. A run is killed after a time that a busy machine needs."""
    with open(folder.parent / "said", "wb") as said:
        child = subprocess.Popen([LUMEL, *arguments], stdin=subprocess.DEVNULL, stdout=said, stderr=said, cwd=folder)
        start = time.monotonic()
        while True:
            pid, status, usage = os.wait4(child.pid, os.WNOHANG)
            if pid:
                code = os.waitstatus_to_exitcode(status)
                break
            if time.monotonic() - start > 20 * limit or cpu(child.pid) > 2 * limit:
                child.kill()
                _, _, usage = os.wait4(child.pid, 0)
                code = "killed"
                break
            time.sleep(0.02)
        child.returncode = 0
    text = (folder.parent / "said").read_bytes().decode(errors="replace")
    return code, usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024, text


def cpu(pid):
    try:
        fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
    except OSError:
        return 0


def snapshot(folder):
    skip = ("out", "work", "baked", "cache")
    return {p: hashlib.sha256(p.read_bytes()).hexdigest() for p in folder.rglob("*")
            if p.is_file() and p.relative_to(folder).parts[0] not in skip}


OBEYED = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069]")


def main():
    global LUMEL, REPRODUCERS, BAKED
    ap = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ap.add_argument("--lumel", default=str(ROOT / "target/release/lumel"))
    ap.add_argument("--reproducers", type=Path, default=ROOT.parent / "shared/scenes/reproducers")
    ap.add_argument("--only", default="", help="cases whose item and name this regular expression finds")
    ap.add_argument("--keep", action="store_true", help="keep the folders")
    a = ap.parse_args()
    LUMEL, REPRODUCERS = str(Path(a.lumel).resolve()), a.reproducers.resolve()
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    scratch = Path(tempfile.mkdtemp(prefix="lumel-hostile-"))
    BAKED = scratch / "sound"
    BAKED.mkdir()
    command = [LUMEL, "bake", save(BAKED, level()), "-o", BAKED / "baked", "-q", "--quality=draft", "--texels-per-unit=4",
               "--no-config"]
    subprocess.run(command, check=True)
    print("| what was found | input | code | s | MiB | first line |\n|---|---|---|---|---|---|")
    wrongs = count = 0
    longest, largest = (0, ""), (0, "")
    for item, name, codes, says, limit, make in CASES:
        if not re.search(a.only, f"{item} {name}"):
            continue
        folder = scratch / f"{count:03}" / "in"
        folder.mkdir(parents=True)
        count += 1
        arguments = [x if isinstance(x, (str, bytes)) else str(x) for x in make(folder)]
        before = snapshot(folder)
        code, seconds, peak, said = execute(arguments, folder, limit)
        wrong = []
        if code not in codes:
            wrong.append(f"code {code} instead of {sorted(codes)}")
        if code not in (0, 5) and errors(said) != 1:
            wrong.append(f"{errors(said)} errors")
        if says not in said:
            wrong.append(f"does not say {says!r}")
        if OBEYED.search(said.replace("\n", "")):
            wrong.append("the terminal obeys")
        if len(said) > 40_000 and "report" not in arguments:
            wrong.append(f"says {len(said)} bytes")
        if seconds > limit:
            wrong.append("too long")
        if peak > 1.1 * MEMORY:
            wrong.append("too much memory")
        after = snapshot(folder)
        if any(after.get(p) != h for p, h in before.items()):
            wrong.append("an input changed")
        left = [p.name for p in folder.rglob("*") if ".lumel-" in p.name]
        if code != 0 and (folder / "out").is_dir() and "scene is a link" not in name:
            left += [p.name for p in (folder / "out").rglob("*") if p.is_file()]
        if left:
            wrong.append(f"left {left[:3]}")
        longest, largest = max(longest, (seconds, name)), max(largest, (peak, name))
        first = next((l for l in said.splitlines() if l.startswith(("error", "warning"))), "")
        first = first.replace(str(folder), "").replace(str(REPRODUCERS), "").replace("|", "\\|")
        print(f"| {item} | {name} | {code} | {seconds:.1f} | {peak:.0f} | {first[:110]} |", flush=True)
        if wrong:
            wrongs += 1
            print(f"WRONG {item}: {name}: {', '.join(wrong)}: {' '.join(map(str, arguments))[:300]}\n{said[:600]}", file=sys.stderr, flush=True)
        elif not a.keep:
            shutil.rmtree(folder.parent)
    for item, name, check in MANY:
        if not re.search(a.only, f"{item} {name}"):
            continue
        folder = scratch / f"{count:03}" / "in"
        folder.mkdir(parents=True)
        count += 1
        wrong = check(folder)
        print(f"| {item} | {name} | {'wrong' if wrong else 'as it should be'} | | | |", flush=True)
        if wrong:
            wrongs += 1
            print(f"WRONG {item}: {name}: {'; '.join(wrong)}", file=sys.stderr, flush=True)
    print(f"\n{count} cases, {wrongs} wrong. Longest {longest[0]:.1f} s of processor time: {longest[1]}. Largest {largest[0]:.0f} MiB: {largest[1]}.")
    print("\n".join(NOTES))
    if not a.keep and not wrongs:
        shutil.rmtree(scratch)
    sys.exit(1 if wrongs else 0)


if __name__ == "__main__":
    main()
