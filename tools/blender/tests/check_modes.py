"""Exports a level three times with Blender's own exporter, and bakes each without the add-on.

    LUMEL=target/release/lumel python check_modes.py OUTDIR

The three lighting modes write lamps in different units. Lumel recognises them, so that all three
give the same light: within 2 % (issue 26), each with a note that names the mode. Needs the module
bpy (exit code 77 without it).
"""

import json
import os
import subprocess
import sys

try:
    import bpy
except ImportError as e:
    print(f"no module: {e}")
    sys.exit(77)

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import level  # noqa: E402

MODES = {"SPEC": "Standard", "COMPAT": "Unitless", "RAW": "Raw"}
LIMIT = 0.02


def bake(folder, mode, options):
    # Separate from the results: a bake must not overwrite its own input.
    path = os.path.join(folder, "source", f"{mode}.glb")
    bpy.ops.export_scene.gltf(
        filepath=path,
        export_apply=True,
        export_import_convert_lighting_mode=mode,
        **options,
    )
    run = subprocess.run(
        [os.environ["LUMEL"], "bake", path, "-o", folder, "--quality", "draft"],
        capture_output=True,
        text=True,
        check=True,
    )
    return run.stderr


def diff(folder, a, b):
    a, b = (os.path.join(folder, f"{mode}.lightmap.exr") for mode in (a, b))
    command = [os.environ["LUMEL"], "diff", a, b, "--json"]
    return json.loads(subprocess.run(command, capture_output=True, check=True).stdout)


def main():
    folder = os.path.abspath(sys.argv[1])
    os.makedirs(os.path.join(folder, "source"), exist_ok=True)
    problems = []
    level.build("mixed")
    for mode, name in MODES.items():
        said = bake(folder, mode, {"export_lights": True})
        if f"Lighting Mode {name}" not in said:
            problems.append(f"{mode} is not recognised: {said}")
    for mode in ("SPEC", "RAW"):
        found = diff(folder, "COMPAT", mode)
        print(f"MODE {mode} against COMPAT:", found)
        if found["relRMSE"] > LIMIT or abs(found["bias"]) > LIMIT:
            problems.append(f"{mode} differs from COMPAT by {found}")
    # With default settings, the exporter omits lamps.
    said = bake(folder, "COMPAT", {})
    if "Punctual Lights" not in said.split("ingest")[0]:
        problems.append(f"missing lamps are not told before the bake: {said}")
    for p in problems:
        print("problem:", p)
    print("modes:", "wrong" if problems else "all the same")
    sys.exit(1 if problems else 0)


main()
