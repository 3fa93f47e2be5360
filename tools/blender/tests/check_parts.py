"""Tests the parts of the add-on that need no Cycles: object settings, export, errors, cancelling.

    LUMEL=target/release/lumel python check_parts.py

Needs the module bpy (exit code 77 without it). On exit code 1, the output says what is wrong.
"""

import json
import math
import os
import sys
import tempfile
import time

try:
    import bpy
except ImportError as e:
    print(f"no module: {e}")
    sys.exit(77)

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path[:0] = [HERE, os.path.join(HERE, "..")]
import level  # noqa: E402
import lumel  # noqa: E402
from lumel import export, glb, lamps, operators, run, show  # noqa: E402

problems = []


def expect(found, expected, what):
    if found != expected:
        problems.append(f"{what}: found {found!r}, expected {expected!r}")


def object_settings():
    level.build("lamps")
    o = bpy.data.objects["crate"]
    expect((o.lumel_density, o.lumel_exclude), (2.0, False), "what the file says")
    o.lumel_density, o.lumel_occluder = 0.5, True
    expect(o["lumel"].to_dict(), {"density": 0.5, "occluder": True}, "edited")
    # Values from other tools are kept.
    o["lumel"] = {"bake": True, "other": 1}
    o.lumel_density = 3.0
    expect(o["lumel"].to_dict(), {"bake": True, "other": 1, "density": 3.0}, "beside others")
    del o["lumel"]
    o.lumel_density = 1.0
    expect("lumel" in o, False, "a default leaves nothing behind")


def exported(folder):
    scene = level.build("spot")
    level.area(scene)
    level.sun(scene)
    lamp = bpy.data.lights["spot"]
    lamp.use_temperature, lamp.temperature = True, 3000
    before = tuple(lamp.color)
    bpy.data.objects["crate"].lumel_exclude = True
    path = os.path.join(folder, "level.glb")
    options, warnings = export.export_level(bpy.context, path)
    expect(tuple(lamp.color), before, "the lamp's colour stays as it was")
    expect((options, warnings), ([], []), "a level without a world")
    doc = glb.Glb(path).json
    nodes = {n["name"]: n for n in doc["nodes"]}
    expect(nodes["crate"]["extras"]["lumel"], {"density": 2.0, "exclude": True}, "an object")
    area = nodes[lamps.AREA_PREFIX + "panel"]
    expect(area["extras"]["lumel"], {"density": 0}, "an area light")
    lights = {l["name"]: l for l in doc["extensions"]["KHR_lights_punctual"]["lights"]}
    expect(round(lights["sun"]["extras"]["lumel"]["angle"], 4), 2.0, "the sun's angle")
    expect(lights["spot"]["extras"]["lumel"]["ies"][:5], "data:", "the spot's beam")
    # 150 W, white, over 4 pi: W/sr, not candela.
    expect(round(lights["spot"]["intensity"], 3), round(150 / (4 * math.pi), 3), "the spot")


def errors_and_cancel(folder):
    scene = level.build("emission")
    scene.lumel.output = "//lumel"
    expect(failure(), "save the .blend first, or give an absolute output folder", "unsaved")
    scene.lumel.output = folder
    scene.lumel.options = "--sky blue"
    expect("expected one number" in failure(), True, "an option that is wrong")
    scene.lumel.options = "--sky 'x"
    expect("No closing quotation" in failure(), True, "a quotation without an end")
    scene.lumel.options, scene.lumel.quality = "", "production"
    bake, _, _ = operators.start(bpy.context)
    seen = set()
    while bake.poll() is None:
        seen.add(bake.text.split(",")[0])
        if "gather" in seen:
            bake.cancel()
        time.sleep(0.05)
    expect((bake.poll(), "gather" in seen), (75, True), "cancelled while it gathers")
    expect(os.path.exists(os.path.join(folder, "level.report.json")), False, "half a result")


def failure():
    try:
        bpy.ops.lumel.bake()
    except RuntimeError as e:
        return str(e).removeprefix("Error: ").strip()
    return ""


def twice(folder):
    """A second bake replaces the first, and switching between the scenes works in both
    directions."""
    scene = level.build("emission")
    scene.lumel.output, scene.lumel.quality, scene.lumel.density = folder, "draft", 4.0
    counts = []
    for _ in range(2):
        expect(bpy.ops.lumel.bake(), {"FINISHED"}, "a bake")
        baked = bpy.context.window.scene
        expect(show.level_of(baked), scene, "the baked scene's level")
        expect(bpy.ops.lumel.bake.poll(), False, "the bake of a bake")
        bpy.ops.lumel.switch()
        expect(bpy.context.window.scene, scene, "back to the level")
        kinds = ("scenes", "objects", "meshes", "materials", "images")
        counts.append({kind: len(getattr(bpy.data, kind)) for kind in kinds})
    expect(counts[1], counts[0], "nothing of the first bake is left")
    with open(os.path.join(folder, "level.report.json")) as f:
        report = json.load(f)
    expect(report["layout"]["texels_per_unit"], 4.0, "the density")


def main():
    lumel.register()
    try:
        with tempfile.TemporaryDirectory() as folder:
            object_settings()
            exported(folder)
        for part in (errors_and_cancel, twice):
            with tempfile.TemporaryDirectory() as folder:
                part(folder)
    finally:
        lumel.unregister()
    expect(run.PROGRESS.match("progress 42.0 % gather, 12 s left").groups(),
           ("42.0", "gather", "12 s"), "a line of progress")
    for p in problems:
        print("problem:", p)
    print("parts:", f"{len(problems)} problems")
    sys.exit(1 if problems else 0)


main()
