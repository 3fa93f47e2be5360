"""Split every triangle of a .glb into n² and interpolate all corner attributes: the same surface, light
and lightmap with more triangles.

Usage : python subdivide.py IN.glb OUT.glb [--parts 3]
Note  : Corners on shared edges stay shared. Every attribute is written as float and interpolated
        linearly. Only triangle lists are split; Draco and meshopt are not read. To measure the
        cost of triangles at the same lumels (lab/profile.md):
        lumel bake LEVEL.glb -o once;  subdivide.py once/LEVEL.glb dense.glb;
        compare lumel bake dense.glb --uv keep … with lumel bake once/LEVEL.glb --uv keep …
"""
import argparse
import sys

import numpy as np

import common

KIND = {5120: np.int8, 5121: np.uint8, 5122: np.int16, 5123: np.uint16, 5125: np.uint32, 5126: np.float32}
WIDTH = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}


def read(js, bin_, index):
    """accessor -> [n, width], as floats if it contains floats or normalised integers"""
    a = js["accessors"][index]
    kind, width = np.dtype(KIND[a["componentType"]]), WIDTH[a["type"]]
    if "bufferView" not in a or "sparse" in a:
        raise SystemExit("accessor %d has no plain data" % index)
    view = js["bufferViews"][a["bufferView"]]
    start = view.get("byteOffset", 0) + a.get("byteOffset", 0)
    stride = view.get("byteStride", kind.itemsize * width)
    raw = np.lib.stride_tricks.as_strided(np.frombuffer(bin_, np.uint8, offset=start), (a["count"], kind.itemsize * width), (stride, 1))
    data = np.ascontiguousarray(raw).view(kind).reshape(a["count"], width)
    if a.get("normalized"):
        data = np.maximum(data.astype(np.float64) / np.iinfo(kind).max, -1)
    return data


def split(triangles, parts):
    """[n, 3] corners -> list of (corner numbers [m, 3], weights [m, 3]) of the new vertices, and triangles of them"""
    keys, table, out = {}, [], []

    def vertex(corners, weights):
        # A vertex on an edge is identified by the edge's corners alone, so that both triangles find
        # the same one.
        key = tuple(sorted((c, w) for c, w in zip(corners, weights) if w))
        if key not in keys:
            keys[key] = len(table)
            table.append((corners, weights))
        return keys[key]
    for corners in triangles.tolist():
        at = {(i, j): vertex(corners, (parts - i - j, i, j)) for i in range(parts + 1) for j in range(parts + 1 - i)}
        for i in range(parts):
            for j in range(parts - i):
                out.append((at[i, j], at[i + 1, j], at[i, j + 1]))
                if i + j + 2 <= parts:
                    out.append((at[i + 1, j], at[i + 1, j + 1], at[i, j + 1]))
    corner, weight = np.array([t[0] for t in table]), np.array([t[1] for t in table], float) / parts
    return corner, weight, np.array(out, np.uint32)


def main():
    ap = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ap.add_argument("input")
    ap.add_argument("output")
    ap.add_argument("--parts", type=int, default=3, help="parts of an edge; n² triangles for each")
    a = ap.parse_args()
    js, bin_ = common.read_glb(a.input)
    new, before, after = bytearray(bin_), 0, 0

    def add(data, kind, **more):
        new.extend(b"\0" * (-len(new) % 4))
        js["bufferViews"].append(dict(buffer=0, byteOffset=len(new), byteLength=data.nbytes))
        new.extend(data.tobytes())
        js["accessors"].append(dict(bufferView=len(js["bufferViews"]) - 1, componentType=kind, count=len(data), **more))
        return len(js["accessors"]) - 1
    for mesh in js.get("meshes", []):
        for p in mesh["primitives"]:
            if p.get("mode", 4) != 4 or p.get("targets") or p.get("extensions"):
                print("left as it is: a primitive of %s" % mesh.get("name", "?"), file=sys.stderr)
                continue
            at = {k: read(js, bin_, v).astype(np.float64) for k, v in p["attributes"].items()}
            n = len(at["POSITION"])
            index = read(js, bin_, p["indices"]).ravel().astype(np.int64) if "indices" in p else np.arange(n)
            corner, weight, triangles = split(index.reshape(-1, 3), a.parts)
            before, after = before + len(index) // 3, after + len(triangles)
            for k, v in at.items():
                data = np.einsum("nk,nkc->nc", weight, v[corner]).astype(np.float32)
                extent = dict(min=data.min(0).tolist(), max=data.max(0).tolist()) if k == "POSITION" else {}
                p["attributes"][k] = add(data, 5126, type="VEC%d" % data.shape[1], **extent)
            p["indices"] = add(triangles.reshape(-1, 1), 5125, type="SCALAR")
    js["buffers"][0]["byteLength"] = len(new)
    common.write_glb(a.output, js, new)
    print("%d triangles, now %d" % (before, after))


if __name__ == "__main__":
    main()
