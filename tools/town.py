#!/usr/bin/env python3
"""A large level: generated levels in a grid, with finely tessellated rocks between them.

    tools/town.py OUT.glb [--levels N] [--triangles N] [--seed N] [--make PATH]

Levels are full-size ones of make-level's families (default 64, all families in turn but foliage,
lods and uv1); rocks, each a mesh of its own with 20,480 triangles, are added until there are
--triangles (default 5 million). The first directional lamp is kept, the others are left out.
Needs numpy and make-level (--make, default target/release/make-level)."""
import argparse
import copy
import os
import subprocess
import sys
import tempfile

import numpy as np

import common

FAMILIES = ["suite", "kit", "archviz", "furniture", "lamps", "blocks", "maze", "greybox", "stairs", "cave"]
APART = 60.0  # metres between the levels' middles
ROCK = 5  # level of a rock's icosphere: 20 · 4⁵ triangles


class Town:
    """A document that grows, and its binary buffer."""

    def __init__(self):
        self.bin = bytearray()
        self.js = {"asset": {"version": "2.0", "generator": "lumel tools/town.py"}, "scene": 0, "scenes": [{"nodes": []}]}
        for name in ("nodes", "cameras", "meshes", "materials", "accessors", "bufferViews"):
            self.js[name] = []
        self.lights = []
        self.used = set()
        self.sun = False

    def add(self, js, data, at):
        """Puts a copy of a document's scene at a place."""
        base = {k: len(self.js[k]) for k in ("nodes", "cameras", "meshes", "materials", "accessors", "bufferViews")}
        lights = len(self.lights)
        start = len(self.bin)
        self.bin += data + b"\0" * (-len(data) % 4)
        self.used |= set(js.get("extensionsUsed", []))
        for view in js["bufferViews"]:
            self.js["bufferViews"].append({**view, "byteOffset": view.get("byteOffset", 0) + start})
        for accessor in js["accessors"]:
            self.js["accessors"].append({**accessor, "bufferView": accessor["bufferView"] + base["bufferViews"]})
        self.js["materials"] += copy.deepcopy(js["materials"])
        self.js["cameras"] += js.get("cameras", [])
        for mesh in copy.deepcopy(js["meshes"]):
            for p in mesh["primitives"]:
                p["attributes"] = {k: v + base["accessors"] for k, v in p["attributes"].items()}
                p["indices"] += base["accessors"]
                p["material"] += base["materials"]
            self.js["meshes"].append(mesh)
        own = js.get("extensions", {}).get("KHR_lights_punctual", {}).get("lights", [])
        self.lights += own
        for node in copy.deepcopy(js["nodes"]):
            for key, many in (("mesh", "meshes"), ("camera", "cameras")):
                if key in node:
                    node[key] += base[many]
            if "children" in node:
                node["children"] = [c + base["nodes"] for c in node["children"]]
            lamp = node.get("extensions", {}).get("KHR_lights_punctual")
            if lamp and own[lamp["light"]]["type"] == "directional" and self.sun:
                del node["extensions"]
            elif lamp:
                self.sun |= own[lamp["light"]]["type"] == "directional"
                lamp["light"] += lights
            self.js["nodes"].append(node)
        roots = [r + base["nodes"] for r in js["scenes"][js.get("scene", 0)]["nodes"]]
        self.js["nodes"].append({"translation": at, "children": roots})
        self.js["scenes"][0]["nodes"].append(len(self.js["nodes"]) - 1)

    def mesh(self, name, points, triangles, material, at):
        """Puts a mesh at a place."""
        views = [np.asarray(points, "<f4"), np.asarray(triangles, "<u4").ravel()]
        ids = []
        for k, view in enumerate(views):
            self.js["bufferViews"].append({"buffer": 0, "byteOffset": len(self.bin), "byteLength": view.nbytes})
            self.bin += view.tobytes()
            a = {"bufferView": len(self.js["bufferViews"]) - 1, "componentType": 5126 if k == 0 else 5125,
                 "count": len(view), "type": "VEC3" if k == 0 else "SCALAR"}
            if k == 0:
                a.update(min=view.min(axis=0).tolist(), max=view.max(axis=0).tolist())
            self.js["accessors"].append(a)
            ids.append(len(self.js["accessors"]) - 1)
        self.js["meshes"].append({"name": name, "primitives": [
            {"attributes": {"POSITION": ids[0]}, "indices": ids[1], "material": material}]})
        self.js["nodes"].append({"name": name, "mesh": len(self.js["meshes"]) - 1, "translation": at})
        self.js["scenes"][0]["nodes"].append(len(self.js["nodes"]) - 1)

    def write(self, path):
        self.js["buffers"] = [{"byteLength": len(self.bin)}]
        if self.lights:
            self.js["extensions"] = {"KHR_lights_punctual": {"lights": self.lights}}
        if self.used:
            self.js["extensionsUsed"] = sorted(self.used)
        common.write_glb(path, self.js, bytes(self.bin))

    def triangles(self):
        meshes = [sum(self.js["accessors"][p["indices"]]["count"] // 3 for p in m["primitives"]) for m in self.js["meshes"]]
        return sum(meshes[n["mesh"]] for n in self.js["nodes"] if "mesh" in n)


def icosphere(level):
    """-> points (n, 3) on the unit sphere, triangles (m, 3)"""
    g = (1 + 5 ** 0.5) / 2
    p = [[-1, g, 0], [1, g, 0], [-1, -g, 0], [1, -g, 0], [0, -1, g], [0, 1, g],
         [0, -1, -g], [0, 1, -g], [g, 0, -1], [g, 0, 1], [-g, 0, -1], [-g, 0, 1]]
    t = [[0, 11, 5], [0, 5, 1], [0, 1, 7], [0, 7, 10], [0, 10, 11], [1, 5, 9], [5, 11, 4], [11, 10, 2], [10, 7, 6],
         [7, 1, 8], [3, 9, 4], [3, 4, 2], [3, 2, 6], [3, 6, 8], [3, 8, 9], [4, 9, 5], [2, 4, 11], [6, 2, 10], [8, 6, 7], [9, 8, 1]]
    p, t = np.array(p, float), np.array(t)
    for _ in range(level):
        edges = np.sort(np.concatenate([t[:, [0, 1]], t[:, [1, 2]], t[:, [2, 0]]]), axis=1)
        unique, which = np.unique(edges, axis=0, return_inverse=True)
        a, b, c = which.reshape(3, -1) + len(p)
        p = np.concatenate([p, p[unique].mean(axis=1)])
        t = np.concatenate([np.stack(s, axis=1) for s in
                            ((t[:, 0], a, c), (a, t[:, 1], b), (c, b, t[:, 2]), (a, b, c))])
    return p / np.linalg.norm(p, axis=1)[:, None], t


def rock(rng, sphere):
    """-> the sphere's points, squeezed and bumped"""
    bump = np.ones(len(sphere))
    for octave in range(5):
        for _ in range(4):
            along = rng.normal(size=3)
            wave = 2.0 * 2 ** octave * along / np.linalg.norm(along)
            bump += 0.06 / 2 ** octave * np.sin(sphere @ wave + rng.uniform(0, 6.28))
    return sphere * bump[:, None] * rng.uniform([0.7, 0.5, 0.7], [1.3, 0.9, 1.3])


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("out")
    parser.add_argument("--levels", type=int, default=64)
    parser.add_argument("--triangles", type=int, default=5_000_000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--make", default=os.path.join(common.HERE, "../target/release/make-level"))
    args = parser.parse_args()
    rng = np.random.default_rng(args.seed)
    side = int(np.ceil(args.levels ** 0.5))
    town = Town()
    with tempfile.TemporaryDirectory() as scratch:
        for k in range(args.levels):
            family, seed = FAMILIES[k % len(FAMILIES)], args.seed * 1000 + k
            subprocess.run([args.make, family, str(seed), "-o", scratch], check=True, stdout=subprocess.DEVNULL)
            js, data = common.read_glb(os.path.join(scratch, "%s_%d.glb" % (family, seed)))
            town.add(js, data, [APART * (k % side), 0.0, APART * (k // side)])
    town.js["materials"].append({"name": "stone", "pbrMetallicRoughness": {"baseColorFactor": [0.4, 0.38, 0.36, 1], "metallicFactor": 0}})
    stone = len(town.js["materials"]) - 1
    sphere, triangles = icosphere(ROCK)
    rocks = max(0, -(-(args.triangles - town.triangles()) // len(triangles)))
    for k in range(rocks):
        # On the lines halfway between the levels.
        at = [rng.uniform(-0.5, side - 0.5) * APART, 0.0, (rng.integers(side) + 0.5) * APART]
        town.mesh("rock_%d" % k, rock(rng, sphere), triangles, stone, at)
    town.write(args.out)
    print("%d levels, %d rocks, %d triangles, %d lamps, %.0f MB" % (
        args.levels, rocks, town.triangles(), len(town.lights), len(town.bin) / 1e6), file=sys.stderr)


if __name__ == "__main__":
    main()
