#!/usr/bin/env python3
"""The cost of baking N copies of a level at the same density, beside N times the cost of one.

    tools/copies.py [--level GLB] [--copies 1,4,16] [--density X] [--truth] -- [bake options]

The copies stand in a square, far enough apart to hardly light each other; directional lights are kept
once. Prints a table of processor time, rays, patches, memory and the estimated error. --truth also
bakes one copy at `production` and compares each copy's lumels with it (median and root mean square
of the difference relative to R + 1 % of the mean; needs numpy and OpenEXR). Lumels can only be
compared if they are the same, so the level then gets lightmap coordinates from a first bake, and all
bakes keep them.

Figures of time waver from run to run, so repeat numbers of copies: --copies 1,4,1,4,1.

LUMEL names the program (common.py)."""
import argparse
import copy
import json
import math
import os
import resource
import tempfile

import common


def bounds(js):
    """-> the width of the level in x, from its positions, metres (upper bound)"""
    far = 0.0
    for a in js["accessors"]:
        if a.get("type") == "VEC3" and "max" in a:
            far = max([far] + [abs(v) for v in a["min"] + a["max"]])
    place = max([abs(v) for n in js["nodes"] for v in n.get("translation", [0])] + [0])
    return 2 * (far + place)


def copies(path, out, n):
    """Writes a level of n copies."""
    js, bin_ = common.read_glb(path)
    apart = 4 * bounds(js)
    roots = js["scenes"][js.get("scene", 0)]["nodes"]
    nodes, own = js["nodes"], len(js["nodes"])
    lights = js.get("extensions", {}).get("KHR_lights_punctual", {}).get("lights", [])
    all_roots = []
    for k in range(n):
        for i in range(own):
            node = copy.deepcopy(nodes[i]) if k else nodes[i]
            if k:
                node["children"] = [c + k * own for c in node.get("children", [])]
                if not node["children"]:
                    del node["children"]
                light = node.get("extensions", {}).get("KHR_lights_punctual", {}).get("light")
                if light is not None and lights[light]["type"] == "directional":
                    del node["extensions"]["KHR_lights_punctual"]
                node.pop("camera", None)
                nodes.append(node)
    side = math.ceil(math.sqrt(n))
    for k in range(n):
        place = [apart * (k % side), 0, apart * (k // side)]
        nodes.append({"name": f"copy_{k}", "translation": place, "children": [r + k * own for r in roots]})
        all_roots.append(len(nodes) - 1)
    js["scenes"][js.get("scene", 0)]["nodes"] = all_roots
    common.write_glb(out, js, bin_)
    return own


def page(path):
    import numpy
    import OpenEXR
    with OpenEXR.File(path) as f:
        c = f.channels()
        rgb = c["RGB"].pixels if "RGB" in c else c["RGBA"].pixels[..., :3] if "RGBA" in c else \
            numpy.stack([c[k].pixels for k in "RGB"], -1)
        return numpy.asarray(rgb, "f4") @ numpy.array([0.2126, 0.7152, 0.0722], "f4")


def rectangles(folder):
    """-> {node: luminance of its rectangle}"""
    files = common.outputs(folder)
    manifest = json.load(open(files["manifest"]))
    pages = [page(os.path.join(folder, p["uri"])) for p in manifest["pages"]]
    cut = lambda r: (slice(r["y"], r["y"] + r["h"]), slice(r["x"], r["x"] + r["w"]))  # noqa: E731
    return {n["node"]: pages[n["page"]][cut(n["rect"])] for n in manifest["nodes"]}


def compare(folder, truth, own):
    """-> median and root mean square of relative differences, over all copies"""
    import numpy
    true, all_ = rectangles(truth), []
    mean = numpy.concatenate([v.ravel() for v in true.values()]).mean()
    for node, values in rectangles(folder).items():
        t = true[node % own]
        if t.shape != values.shape:
            raise SystemExit(f"node {node}: found a rectangle of {values.shape}, expected {t.shape} as in the truth")
        lit = t > 1e-3 * mean
        all_.append((numpy.abs(values - t) / (t + 0.01 * mean))[lit])
    d = numpy.concatenate(all_)
    return float(numpy.median(d)), float(numpy.sqrt((d ** 2).mean()))


def main():
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    here = os.path.dirname(os.path.abspath(__file__))
    p.add_argument("--level", default=os.path.join(here, "../assets/demo_level.glb"))
    p.add_argument("--copies", default="1,4,16")
    p.add_argument("--density", type=float, default=8.0)
    p.add_argument("--truth", action="store_true")
    p.add_argument("options", nargs="*")
    a = p.parse_args()
    fixed = ["--texels-per-unit", a.density, "--no-vertex-colors", "--no-config", *a.options]
    with tempfile.TemporaryDirectory() as t:
        truth, level = os.path.join(t, "truth"), a.level
        if a.truth:
            charted, one = os.path.join(t, "charted"), os.path.join(t, "one.glb")
            level = common.bake(level, charted, *fixed)["glb"]
            fixed += ["--uv", "keep"]
            copies(level, one, 1)
            asked = [o for o in fixed if o not in ("--quality", "draft", "quick", "preview")]
            common.bake(one, truth, *asked, "--quality", "production")
        print("| copies | lumels | patches | processor s | per copy | M rays | MiB | estimated error | true error |")
        print("|---|---|---|---|---|---|---|---|---|")
        for n in map(int, a.copies.split(",")):
            scene, out = os.path.join(t, f"level{n}.glb"), os.path.join(t, f"out{n}")
            own = copies(level, scene, n)
            before = resource.getrusage(resource.RUSAGE_CHILDREN)
            r = common.bake(scene, out, *fixed)
            after = resource.getrusage(resource.RUSAGE_CHILDREN)
            if not r["report_json"]:
                raise SystemExit(f"the bake of {n} copies failed: {r}")
            report, seconds = r["report_json"], after.ru_utime - before.ru_utime
            gather, solve = report["gather"], report["solve"]
            rays = gather["lumel_rays"] + solve["link_rays"] + solve["shadow_rays"]
            error = "%.2f %%, %.1f %%" % (100 * gather["median_error"], 100 * gather["estimated_error"])
            true = "%.2f %%, %.1f %%" % tuple(100 * x for x in compare(out, truth, own)) if a.truth else ""
            print(f"| {n} | {gather['lumels']} | {solve['subdivision']['patches']} | {seconds:.1f} | {seconds / n:.2f} "
                  f"| {1e-6 * rays:.1f} | {report['measured']['peak_bytes'] >> 20} | {error} | {true} |", flush=True)


if __name__ == "__main__":
    main()
