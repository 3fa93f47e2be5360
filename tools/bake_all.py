"""Bake all measurement scenes and check the results.

Usage : python bake_all.py OUT [--scenes DIR] [--only TEXT] [--quality preview] [--timeout 600]
                           [-- further options of `lumel bake`]
Input : the level files and features/ below LUMEL_SCENES (not bad/, original/ or reference/), each
        with default options.
Output: OUT/NAME/… the bakes, OUT/bake_all.md and .tsv (time, peak memory, texels, warnings,
        faults), OUT/contact_NN.png: contact sheets of twelve previews. Faults are: an exit code
        other than 0, NaN, infinity or a negative value in an EXR, a validator error in a written
        glTF, and a missing preview. Exits with 1 if there are any.
"""
import argparse
import csv
import json
import os
import sys

import numpy as np

import common

# Levels without lamps get a sun and a sky; otherwise they would be black.
UNLIT = {"sponza": ["--sun", "-0.3,-1,0.2,6", "--sky", "0.5,0.6,0.8"], "default": ["--sun", "-0.3,-0.9,0.4,3", "--sky", "0.4,0.5,0.7"]}


def has_light(path):
    """a lamp, or a material that emits"""
    js = common.read_glb(path)[0] if path.lower().endswith(".glb") else json.load(open(path, encoding="utf-8"))
    return bool(js.get("extensions", {}).get("KHR_lights_punctual", {}).get("lights")) or any(any(m.get("emissiveFactor", [])) for m in js.get("materials", []))


def scan_exr(path):
    """-> (texels, faults) over every channel"""
    import mitsuba as mi
    if mi.variant() is None:
        mi.set_variant("scalar_rgb")
    v = np.array(mi.Bitmap(path), np.float32)
    faults = []
    if np.isnan(v).any():
        faults.append("%d NaN" % np.isnan(v).sum())
    if np.isinf(v).any():
        faults.append("%d inf" % np.isinf(v).sum())
    if (v < 0).any():
        faults.append("%d negative" % (v < 0).sum())
    if not (v > 0).any():
        faults.append("all black")
    return v.shape[0] * v.shape[1], faults


def sheet(pictures, path, columns=3, size=(480, 270)):
    from PIL import Image, ImageDraw
    rows = (len(pictures) + columns - 1) // columns
    out = Image.new("RGB", (columns * size[0], rows * (size[1] + 16)), "black")
    for i, (label, png) in enumerate(pictures):
        x, y = i % columns * size[0], i // columns * (size[1] + 16)
        ImageDraw.Draw(out).text((x + 4, y + 2), label, fill="white")
        if png and os.path.exists(png):
            picture = Image.open(png).convert("RGB")
            picture.thumbnail(size)
            out.paste(picture, (x, y + 16))
    out.save(path)


def main():
    argv, further = sys.argv[1:], []
    if "--" in argv:
        i = argv.index("--")
        argv, further = argv[:i], argv[i + 1:]
    ap = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ap.add_argument("out")
    ap.add_argument("--scenes", default=common.SCENES)
    ap.add_argument("--only", default="")
    ap.add_argument("--quality", default="preview")
    ap.add_argument("--timeout", type=float, default=600)
    a = ap.parse_args(argv)
    files = []
    for d, dirs, fs in os.walk(a.scenes):
        dirs[:] = sorted(x for x in dirs if x not in ("bad", "original", "reference"))
        files += [os.path.join(d, f) for f in sorted(fs) if f.lower().endswith((".gltf", ".glb"))]
    files = [f for f in files if a.only in f]
    rows, pictures = [], []
    for path in files:
        rel = os.path.relpath(path, a.scenes)
        name = os.path.splitext(rel)[0].replace(os.sep, "__").replace(" ", "_")
        out = os.path.join(a.out, name)
        png = os.path.join(out, "preview.png")
        light = [] if has_light(path) else next((v for k, v in UNLIT.items() if k in rel), UNLIT["default"])
        r = common.bake(path, out, "--quality", a.quality, "--preview", png, *light, *further, timeout=a.timeout)
        faults, texels = [], 0
        if r["code"] != 0:
            faults.append("timeout" if r["timed_out"] else "exit %d: %s" % (r["code"], r["err"].strip().splitlines()[0][:200] if r["err"].strip() else ""))
        else:
            for page in r["pages"]:
                n, bad = scan_exr(page)
                texels += n
                faults += ["%s: %s" % (os.path.basename(page), x) for x in bad]
            v = common.run(["node", os.path.join(common.HERE, "validate.mjs"), "--json", out])
            for item in json.loads(v["out"] or "[]"):
                if item["errors"]:
                    faults.append("%s: %d validator errors (%s)" % (os.path.basename(item["file"]), item["errors"], item["messages"][0]["code"]))
            if not os.path.exists(png):
                faults.append("no preview")
        warnings = (r["report_json"] or {}).get("warnings", [])
        rows.append(dict(scene=rel, seconds="%.2f" % r["seconds"], peak_mb="%.0f" % r["peak_mb"], pages=len(r["pages"]), texels=texels,
                         light=" ".join(light) or "own", warnings=len(warnings), faults="; ".join(faults), first_warning=(warnings or [""])[0][:160]))
        pictures.append((rel, png))
        print("%-60s %7.2f s %6.0f MB  %s" % (rel[:60], r["seconds"], r["peak_mb"], rows[-1]["faults"]), flush=True)
    os.makedirs(a.out, exist_ok=True)
    with open(os.path.join(a.out, "bake_all.tsv"), "w", newline="") as f:
        w = csv.DictWriter(f, rows[0].keys(), delimiter="\t")
        w.writeheader()
        w.writerows(rows)
    with open(os.path.join(a.out, "bake_all.md"), "w") as f:
        f.write("| scene | s | peak MB | pages | texels | light | warnings | faults |\n|---|---|---|---|---|---|---|---|\n")
        for r in rows:
            f.write("| %(scene)s | %(seconds)s | %(peak_mb)s | %(pages)s | %(texels)s | %(light)s | %(warnings)s | %(faults)s |\n" % r)
    for i in range(0, len(pictures), 12):
        sheet(pictures[i: i + 12], os.path.join(a.out, "contact_%02d.png" % (i // 12)))
    bad = sum(bool(r["faults"]) for r in rows)
    print("%d scenes, %d with faults" % (len(rows), bad))
    sys.exit(1 if bad else 0)


if __name__ == "__main__":
    main()
