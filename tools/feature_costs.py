"""The cost of lights, materials and layers: compares scenes with and without them.

Usage : python feature_costs.py [--before OLD_LUMEL] [--runs 3] [--quality draft]
                                [--work /tmp/lumel-costs]
Steps : bakes assets/cornell_box.glb and assets/demo_level.glb without features, with the binary
        LUMEL and optionally with an older one (--before); then with one feature at a time. Time is
        the minimum wall time of interleaved runs. Instructions are those of user code
        (`perf stat`), which are independent of the machine's load; -1 without perf.
Output: lab/data/feature_costs.csv and lab/tables/feature_costs.md
Needs : the lumel binary (LUMEL) built for release; perf for instructions
"""
import argparse
import json
import os
import re
import struct
import subprocess
import time

import numpy as np

import common

HERE = os.path.dirname(os.path.abspath(__file__))
ASSETS = os.path.join(HERE, "..", "assets")
CSV = os.path.join(common.LAB, "data", "feature_costs.csv")


def rewrite(source, target, change):
    """Copies a .glb with its JSON changed by `change(document)`."""
    data = open(source, "rb").read()
    length = struct.unpack_from("<I", data, 12)[0]
    document = json.loads(data[20:20 + length])
    change(document)
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    rest = data[20 + length:]
    with open(target, "wb") as f:
        f.write(struct.pack("<4sII", b"glTF", 2, 20 + len(text) + len(rest)))
        f.write(struct.pack("<II", len(text), 0x4E4F534A) + text + rest)


def lamps(document):
    return document["extensions"]["KHR_lights_punctual"]["lights"]


def with_radius(document):
    for lamp in lamps(document):
        key, value = ("angle", 0.53) if lamp["type"] == "directional" else ("radius", 0.05)
        lamp["extras"] = {"lumel": {key: value}}


def blend(document):
    for material in document["materials"]:
        if material.get("name") == "screen":
            material["alphaMode"] = "BLEND"
            material.setdefault("pbrMetallicRoughness", {})["baseColorFactor"] = [0.8, 0.8, 0.8, 0.5]


def glass(document):
    document.setdefault("extensionsUsed", []).append("KHR_materials_transmission")
    for material in document["materials"]:
        if material.get("name") == "screen":
            material["extensions"] = {"KHR_materials_transmission": {"transmissionFactor": 0.8}}


def sky_map(path):
    """A 256 x 128 gradient with a sun of one pixel, as Radiance HDR without run lengths."""
    h, w = 128, 256
    pixels = np.tile(np.linspace(0.8, 0.1, h)[:, None, None], (1, w, 3)).astype(np.float32)
    pixels[40, 60] = 4000.0
    exponent = np.ceil(np.log2(pixels.max(axis=2) + 1e-30))
    scale = 256.0 / 2.0 ** exponent
    rgbe = np.concatenate([np.clip(pixels * scale[..., None], 0, 255), (exponent + 128)[..., None]], axis=2)
    with open(path, "wb") as f:
        f.write(b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y %d +X %d\n" % (h, w))
        f.write(rgbe.astype(np.uint8).tobytes())


def cases(work):
    cornell = os.path.join(ASSETS, "cornell_box.glb")
    demo = os.path.join(ASSETS, "demo_level.glb")
    made = {}
    for name, change in (("radius", with_radius), ("blend", blend), ("glass", glass)):
        made[name] = os.path.join(work, f"demo_{name}.glb")
        rewrite(demo, made[name], change)
    sky = os.path.join(work, "sky.hdr")
    sky_map(sky)
    flat = ["--sky", "0.4"]
    # Name, baseline, scene, options.
    return [
        ("Cornell box", None, cornell, []),
        ("demo level", None, demo, []),
        ("demo level, sky of one colour", "demo level", demo, flat),
        ("sky map with a sun in it", "demo level, sky of one colour", demo, ["--sky", sky]),
        ("lamps of 5 cm, sun of 0.53°", "demo level", made["radius"], []),
        ("a screen of BLEND", "demo level", made["blend"], []),
        ("a screen of coloured glass", "demo level", made["glass"], []),
        ("`--group` lamps, sun, rest", "demo level", demo, ["--group", "lamps=pendant*,spot,store_fill", "--group", "day=sun"]),
        ("`--directional sh1`", "demo level", demo, ["--directional", "sh1"]),
        ("`--directional dominant`", "demo level", demo, ["--directional", "dominant"]),
        ("`--layers ao`", "demo level", demo, ["--layers", "ao"]),
        ("`--layers sun_mask`", "demo level", demo, ["--layers", "sun_mask"]),
        ("`--probes 2`", "demo level", demo, ["--probes", "2"]),
    ]


def bake(binary, scene, options, work, quality):
    out = os.path.join(work, "out")
    command = [binary, "bake", scene, "-o", out, "--quality", quality, "-q"] + options
    counted = ["perf", "stat", "-x,", "-e", "instructions:u", "--"] + command
    start = time.perf_counter()
    try:
        run = subprocess.run(counted, capture_output=True, text=True, check=True)
        found = re.search(r"^(\d+),,instructions", run.stderr, re.M)
        count = int(found.group(1)) if found else -1
    except FileNotFoundError:
        subprocess.run(command, check=True)
        count = -1
    return time.perf_counter() - start, count


def main():
    ap = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ap.add_argument("--before")
    ap.add_argument("--runs", type=int, default=3)
    ap.add_argument("--quality", default="draft")
    ap.add_argument("--work", default="/tmp/lumel-costs")
    a = ap.parse_args()
    os.makedirs(a.work, exist_ok=True)
    jobs = []
    for name, base, scene, options in cases(a.work):
        if a.before and not base:
            jobs.append((f"{name}, before", None, a.before, scene, options))
            jobs.append((name, f"{name}, before", common.LUMEL, scene, options))
        else:
            jobs.append((name, base, common.LUMEL, scene, options))
    if a.before:
        sky = next(j for j in jobs if "one colour" in j[0])
        jobs.insert(jobs.index(sky), (f"{sky[0]}, before", None, a.before, sky[3], sky[4]))
    seconds = {name: [] for name, *_ in jobs}
    counts = {}
    load = os.getloadavg()[0]
    for _ in range(a.runs):
        for name, _, binary, scene, options in jobs:
            wall, count = bake(binary, scene, options, a.work, a.quality)
            seconds[name].append(wall)
            counts[name] = min(count, counts.get(name, count))
            print(f"{name}: {wall:.2f} s, {count / 1e9:.2f} G instructions", flush=True)
    rows = ["name,held against,quality,runs,seconds,instructions,load"]
    lines = ["| bake | held against | seconds | ratio | instructions, 10⁹ | ratio |", "|---|---|---|---|---|---|"]
    for name, base, *_ in jobs:
        t, n = min(seconds[name]), counts[name]
        rows.append(f'"{name}","{base or ""}",{a.quality},{a.runs},{t:.3f},{n},{load:.2f}')
        ratio = (f"{t / min(seconds[base]):.3f}", f"{n / counts[base]:.3f}") if base else ("", "")
        lines.append(f"| {name} | {base or ''} | {t:.2f} | {ratio[0]} | {n / 1e9:.2f} | {ratio[1]} |")
    open(CSV, "w").write("\n".join(rows) + "\n")
    table = "\n".join(lines) + f"\n\n`{a.quality}`, least of {a.runs} runs taken in turns; load average at the start {load:.1f}."
    common.write_tables(common.LAB, "feature_costs", {"costs": table})


if __name__ == "__main__":
    main()
