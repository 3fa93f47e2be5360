"""Convert the lightmap coordinates of a baked scene to page space, for tools that support one atlas and
no instances.

Usage : python flatten_lightmap.py BAKED.glb FLAT.glb [--page 0]
Input : a .glb written by `lumel bake`: nodes with extras.lightmap {uri, page, texCoord, offset,
        scale}, or a list of them on a node with EXT_mesh_gpu_instancing. The EXR next to it gives
        the page's size.
Output: FLAT.glb, in which every mesh node has its own mesh with TEXCOORD_1 in page space (offset
        and scale applied; a page that is not square is in the top left of a square one, so that
        texel (row, column) keeps its indices), and TEXCOORD_0 if the document had none. Nodes on
        other pages or without a lightmap get no TEXCOORD_1: they cast shadows and do not receive
        light. GPU instances become nodes. Triangles without area in space but with area in the
        lightmap are left out. The baker drops them, so their corners are in whatever charts their
        vertices are in, and a peer that draws them overwrites other lumels (on Sponza, 430 of them
        covered a third of the lit area). Prints one JSON line: res (side of the square), page
        size, nodes, receivers, left_out.
"""
import argparse
import copy
import json
import os

import numpy as np

import common
from judge import scene as scenes


def expand_instances(js, doc):
    """EXT_mesh_gpu_instancing copies as child nodes, each with its own extras.lightmap"""
    for node in list(js.get("nodes", [])):
        ext = node.get("extensions", {}).pop("EXT_mesh_gpu_instancing", None)
        if ext is None or "mesh" not in node:
            continue
        at = {k: doc.accessor(v).astype(np.float64) for k, v in ext["attributes"].items()}
        places = node.get("extras", {}).pop("lightmap", None)
        mesh = node.pop("mesh")
        for k in range(len(next(iter(at.values())))):
            placed = scenes.placed(**{a.lower(): v[k] for a, v in at.items() if a in ("TRANSLATION", "ROTATION", "SCALE")})
            child = dict(name="%s[%d]" % (node.get("name", "node"), k), mesh=mesh, matrix=placed.T.ravel().tolist())
            place = places[k] if isinstance(places, list) else places
            if place:
                child["extras"] = {"lightmap": place}
            node.setdefault("children", []).append(len(js["nodes"]))
            js["nodes"].append(child)
        if not node.get("extensions"):
            node.pop("extensions", None)
    for key in ("extensionsUsed", "extensionsRequired"):
        if "EXT_mesh_gpu_instancing" in js.get(key, []):
            js[key].remove("EXT_mesh_gpu_instancing")
            if not js[key]:
                del js[key]


NO_AREA = 1e-12  # of the longest side squared: the limit of mesh-ingest
DRAWN = 0.01  # texels²; less of a page belongs to no lumel


def painters(corners, uv, side):
    """Mask of triangles [n, 3, 3] without area in space but with area in the lightmap [n, 3, 2]"""
    cross2 = lambda a, b: a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]      # noqa: E731
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(1)
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    drawn = 0.5 * side ** 2 * abs(cross2(uv[:, 1] - uv[:, 0], uv[:, 2] - uv[:, 0]))
    return (area <= NO_AREA * longest ** 2) & (drawn > DRAWN)


def main():
    ap = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ap.add_argument("baked")
    ap.add_argument("flat")
    ap.add_argument("--page", type=int, default=0)
    a = ap.parse_args()
    doc = scenes.Document(a.baked)
    js, bin_ = common.read_glb(a.baked)
    bin_ = bytearray(bin_)
    if len(js.get("buffers", [])) != 1 or "uri" in js["buffers"][0]:
        raise SystemExit("expected one embedded buffer")
    expand_instances(js, doc)
    uri = None
    for node in js["nodes"]:
        place = (node.get("extras") or {}).get("lightmap") if isinstance(node.get("extras"), dict) else None
        if place and place["page"] == a.page:
            uri = place["uri"]
    if uri is None:
        raise SystemExit("no node on page %d" % a.page)
    size = common.exr_size(os.path.join(os.path.dirname(os.path.abspath(a.baked)), uri))
    side = max(size)
    to_square = np.array(size, float) / side

    def accessor(values, indices=False):
        while len(bin_) % 4:
            bin_.append(0)
        data = np.ascontiguousarray(values, np.uint32 if indices else np.float32)
        js["bufferViews"].append(dict(buffer=0, byteOffset=len(bin_), byteLength=data.nbytes, target=34963 if indices else 34962))
        bin_.extend(data.tobytes())
        js["accessors"].append(dict(bufferView=len(js["bufferViews"]) - 1, componentType=5125 if indices else 5126, count=len(data), type="SCALAR" if indices else "VEC2"))
        return len(js["accessors"]) - 1

    meshes, receivers, count, left_out = [], 0, 0, 0
    for node in js["nodes"]:
        if "mesh" not in node:
            continue
        count += 1
        place = (node.get("extras") or {}).get("lightmap")
        mesh = copy.deepcopy(js["meshes"][node["mesh"]])
        here = bool(place) and place["page"] == a.page
        receivers += here
        for p in mesh["primitives"]:
            at = p["attributes"]
            if here and "TEXCOORD_%d" % place["texCoord"] in at:
                uv = doc.accessor(at["TEXCOORD_%d" % place["texCoord"]]).astype(np.float64)
                uv = (uv * place["scale"] + place["offset"]) * to_square
                at["TEXCOORD_1"] = accessor(uv)
                if "TEXCOORD_0" not in at:
                    at["TEXCOORD_0"] = at["TEXCOORD_1"]
                if p.get("mode", 4) == 4 and "indices" in p:
                    index = doc.accessor(p["indices"])[:, 0].astype(np.int64)
                    index = index[:len(index) // 3 * 3].reshape(-1, 3)
                    bad = painters(doc.accessor(at["POSITION"]).astype(np.float64)[index], uv[index], side)
                    if bad.any():
                        left_out += int(bad.sum())
                        p["indices"] = accessor(index[~bad].ravel(), True)
            else:
                for k in [k for k in at if k.startswith("TEXCOORD_") and k != "TEXCOORD_0"]:
                    del at[k]
        meshes.append(mesh)
        node["mesh"] = len(meshes) - 1
    js["meshes"] = meshes
    js["buffers"][0]["byteLength"] = len(bin_) + (-len(bin_) % 4)
    common.write_glb(a.flat, js, bin_)
    print(json.dumps(dict(res=side, page=list(size), nodes=count, receivers=receivers, left_out=left_out)))


if __name__ == "__main__":
    main()
