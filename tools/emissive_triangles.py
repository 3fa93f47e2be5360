"""Compares ten thousand emissive triangles with one rectangle of the same size: time and error of whole bakes (lab/emitters.md).

    python3 tools/emissive_triangles.py [--rho 0.5] [--quality draft,preview,production] [--only one,grid,...] [OUT]

A room of 12 × 12 × 4 m with three boxes, and under its ceiling a lamp of 4 × 2 m, which is one rectangle or many pieces:

    one        2 triangles
    grid       100 × 50 squares that share their corners: 10,000 triangles in one plane
    loose      the same with eight identical materials in turn, so that nothing can be joined
    wavy       the grid with its corners moved up and down by 0.03 mm: not planar, but the same light
    million    1000 × 500 squares, wavy: a million triangles
    scattered  5,000 lamps of 4 × 4 cm all over the ceiling (different light, so its error is against its own production bake)

Every mesh has its own TEXCOORD_1, so all bakes have the same lumels. Errors are those of `lumel diff` over all lumels against
`one` at production. Needs numpy and `lumel` (environment: LUMEL)."""
import argparse
import json
import os
import resource
import struct

import numpy as np

import common

LAMP = (4.0, 2.0, 3.9)          # size in x and z, height


class Glb:
    """A .glb of flat quads and grids."""

    def __init__(self):
        self.bin, self.doc = bytearray(), dict(
            asset=dict(version="2.0"), scene=0, scenes=[dict(nodes=[])], nodes=[], meshes=[], materials=[], accessors=[],
            bufferViews=[], buffers=[{}], extensionsUsed=["KHR_materials_emissive_strength"])

    def accessor(self, a, kind, target):
        self.doc["bufferViews"].append(dict(buffer=0, byteOffset=len(self.bin), byteLength=a.nbytes, target=target))
        self.bin += a.tobytes() + b"\0" * (-a.nbytes % 4)
        d = dict(bufferView=len(self.doc["bufferViews"]) - 1, componentType=5126 if a.dtype == np.float32 else 5125, count=len(a), type=kind)
        if kind == "VEC3":
            d.update(min=a.min(0).tolist(), max=a.max(0).tolist())
        self.doc["accessors"].append(d)
        return len(self.doc["accessors"]) - 1

    def material(self, rho, radiance=0.0):
        m = dict(name="m%d" % len(self.doc["materials"]), pbrMetallicRoughness=dict(baseColorFactor=[rho, rho, rho, 1], metallicFactor=0))
        if radiance:
            m.update(emissiveFactor=[1, 1, 1], extensions=dict(KHR_materials_emissive_strength=dict(emissiveStrength=radiance)))
        self.doc["materials"].append(m)
        return len(self.doc["materials"]) - 1

    def mesh(self, name, positions, uv, primitives):
        p = self.accessor(np.asarray(positions, np.float32), "VEC3", 34962)
        t = self.accessor(np.asarray(uv, np.float32), "VEC2", 34962)
        self.doc["meshes"].append(dict(name=name, primitives=[
            dict(attributes=dict(POSITION=p, TEXCOORD_0=t, TEXCOORD_1=t), indices=self.accessor(np.asarray(i, np.uint32).ravel(), "SCALAR", 34963), material=m)
            for i, m in primitives]))
        self.doc["nodes"].append(dict(name=name, mesh=len(self.doc["meshes"]) - 1))
        self.doc["scenes"][0]["nodes"].append(len(self.doc["nodes"]) - 1)

    def write(self, path):
        self.doc["buffers"] = [dict(byteLength=len(self.bin))]
        text = json.dumps(self.doc).encode()
        text += b" " * (-len(text) % 4)
        with open(path, "wb") as f:
            f.write(struct.pack("<4sII", b"glTF", 2, 28 + len(text) + len(self.bin)))
            f.write(struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(self.bin), b"BIN\0") + self.bin)


def grid(origin, u, v, nu, nv):
    """Positions, uv and triangles (front u × v) of a parallelogram with nu × nv cells."""
    s, t = np.meshgrid(np.arange(nu + 1) / nu, np.arange(nv + 1) / nv, indexing="ij")
    uv = np.stack([s.ravel(), t.ravel()], 1)
    pos = np.asarray(origin, float) + uv[:, :1] * np.asarray(u, float) + uv[:, 1:] * np.asarray(v, float)
    i, j = [a.ravel() for a in np.meshgrid(np.arange(nu), np.arange(nv), indexing="ij")]
    a, b = i * (nv + 1) + j, (i + 1) * (nv + 1) + j
    return pos, uv, np.stack([np.stack([a, b, b + 1], 1), np.stack([a, b + 1, a + 1], 1)], 1).reshape(-1, 3)


def scene(kind, rho, path):
    g = Glb()
    grey = g.material(rho)

    def quad(name, o, u, v):
        p, t, i = grid(o, u, v, 1, 1)
        g.mesh(name, p, t, [(i, grey)])
    quad("floor", (-6, 0, 6), (12, 0, 0), (0, 0, -12))
    quad("ceiling", (-6, 4, -6), (12, 0, 0), (0, 0, 12))
    quad("back", (-6, 0, -6), (12, 0, 0), (0, 4, 0))
    quad("front", (6, 0, 6), (-12, 0, 0), (0, 4, 0))
    quad("left", (-6, 0, 6), (0, 0, -12), (0, 4, 0))
    quad("right", (6, 0, -6), (0, 0, 12), (0, 4, 0))
    for k, (x, z, s, h) in enumerate([(-2.5, 0.5, 1.0, 1.5), (2.0, -1.5, 0.8, 2.4), (3.5, 3.0, 1.6, 0.8)]):
        quad("top%d" % k, (x, h, z + s), (s, 0, 0), (0, 0, -s))
        quad("a%d" % k, (x, 0, z + s), (s, 0, 0), (0, h, 0))
        quad("b%d" % k, (x + s, 0, z), (-s, 0, 0), (0, h, 0))
        quad("c%d" % k, (x + s, 0, z + s), (0, 0, -s), (0, h, 0))
        quad("d%d" % k, (x, 0, z), (0, 0, s), (0, h, 0))
    a, b, h = LAMP
    nu, nv = dict(one=(1, 1), million=(1000, 500)).get(kind, (100, 50))
    p, t, i = grid((-a / 2, h, -b / 2), (a, 0, 0), (0, 0, b), nu, nv)
    if kind in ("wavy", "million"):
        p[:, 1] += 0.00003 * np.sin(np.arange(len(p)) * 1.7)
    if kind == "scattered":
        rng = np.random.default_rng(1)
        corner = np.stack([rng.uniform(-5.9, 5.86, 5000), rng.uniform(3.5, h, 5000), rng.uniform(-5.9, 5.86, 5000)], 1)
        one, _, i = grid((0, 0, 0), (0.04, 0, 0), (0, 0, 0.04), 1, 1)
        p = (corner[:, None] + one[None]).reshape(-1, 3)
        t = np.stack([p[:, 0] / 12 + 0.5, p[:, 2] / 12 + 0.5], 1)
        i = (4 * np.arange(5000)[:, None, None] + i[None]).reshape(-1, 3)
    kinds = 8 if kind == "loose" else 1
    lamps = [g.material(0.0, 10.0) for _ in range(kinds)]
    g.mesh("lamp", p, t, [(i[k::kinds], m) for k, m in enumerate(lamps)])
    g.write(path)


def main():
    a = argparse.ArgumentParser()
    a.add_argument("out", nargs="?", default="/tmp/lumel-emitters")
    a.add_argument("--rho", type=float, default=0.5)
    a.add_argument("--quality", default="draft,preview,production")
    a.add_argument("--only", default="one,grid,loose,wavy,million,scattered")
    a.add_argument("--density", default="8")
    a = a.parse_args()
    os.makedirs(a.out, exist_ok=True)

    def bake(kind, quality):
        path, out = ["%s/%s-%g%s" % (a.out, kind, a.rho, s) for s in (".glb", "-" + quality)]
        scene(kind, a.rho, path)
        before = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
        r = common.run([common.LUMEL, "bake", path, "-o", out, "--texels-per-unit", a.density, "--quality", quality, "-q", *common.COMPARABLE])
        if r["code"] != 0:
            raise SystemExit(r["err"])
        cpu = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime - before
        name = "%s-%g" % (kind, a.rho)
        return dict(map="%s/%s.lightmap.exr" % (out, name), report=json.load(open("%s/%s.report.json" % (out, name))), peak=r["peak_mb"], cpu=cpu)
    truth = bake("one", "production")
    base = {}
    print("| scene | quality | wall s | processor s | times `one` | relRMSE % | bias % | p99 % | emitters | peak MB |\n|---|---|---|---|---|---|---|---|---|---|")
    for kind in a.only.split(","):
        reference = bake(kind, "production") if kind == "scattered" else truth
        for quality in a.quality.split(","):
            b = truth if (kind, quality) == ("one", "production") else bake(kind, quality)
            s = b["report"]["measured"]["seconds"]
            base.setdefault(quality, b["cpu"])
            r = common.run([common.LUMEL, "diff", reference["map"], b["map"], "--json"])
            d = json.loads(r["out"])
            d = d.get("all", d)
            print("| %s | %s | %.2f | %.2f | %.2f | %.3f | %+.3f | %.2f | %s | %.0f |" % (
                kind, quality, s, b["cpu"], b["cpu"] / base[quality], 100 * d["relRMSE"], 100 * d["bias"], 100 * d["p99"],
                b["report"]["solve"]["emitters"], b["peak"]), flush=True)


main()
