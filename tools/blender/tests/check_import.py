"""Checks that Blender imports a bake without loss and shows it correctly.

    python check_import.py level.glb '[{"at": [x, y, z], "radiance": [r, g, b]}, ...]'

Needs the module bpy (exit code 77 without it). Points are on surfaces, in the axes of the glTF.
Cycles renders each from 2 cm in front of the surface into floats. On exit code 1, the output
says what differs.
"""

import json
import os
import struct
import sys
import tempfile

try:
    import bpy
    from mathutils import Vector
except ImportError as e:
    print(f"no module bpy: {e}")
    sys.exit(77)

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "lumel"))
from load import import_level  # noqa: E402

# A half has 11 significant bits, so the EXR is accurate to 2^-11; Cycles computes, and the image is
# written, in floats.
RELATIVE = 2.0**-11 + 1e-5
# Cycles converts image halves to floats without handling the smallest ones: a half of 0 becomes
# 2^-15 (measured: 3.0517578e-5 times the albedo, in a shadow whose lumels are 0).
ABSOLUTE = 2.0**-15 * 1.001


def read_glb(path):
    data = open(path, "rb").read()
    length = struct.unpack_from("<I", data, 12)[0]
    return json.loads(data[20 : 20 + length]), data[28 + length :]


def floats(gltf, blob, index):
    """An accessor of floats, as tuples."""
    a = gltf["accessors"][index]
    assert a["componentType"] == 5126, "the check reads floats only"
    n = {"VEC2": 2, "VEC3": 3}[a["type"]]
    v = gltf["bufferViews"][a["bufferView"]]
    stride = v.get("byteStride", 4 * n)
    start = v.get("byteOffset", 0) + a.get("byteOffset", 0)
    return [struct.unpack_from(f"<{n}f", blob, start + i * stride) for i in range(a["count"])]


def check_document(path):
    """Checks nodes, rectangles, positions and both UV sets, corner by corner."""
    gltf, blob = read_glb(path)
    problems = []
    for node in gltf["nodes"]:
        if "mesh" not in node:
            continue
        o = bpy.data.objects.get(node["name"])
        if o is None:
            problems.append(f"{node['name']} is missing")
            continue
        place = node.get("extras", {}).get("lightmap")
        found = o.get("lightmap")
        if place:
            for key in ("uri", "page", "texCoord"):
                if found[key] != place[key]:
                    problems.append(f"{node['name']}: {key} is {found[key]}, not {place[key]}")
            for key in ("offset", "scale"):
                # Blender stores custom numbers as doubles.
                if list(found[key]) != place[key]:
                    problems.append(f"{node['name']}: {key} is {list(found[key])}, not {place[key]}")
        primitives = gltf["meshes"][node["mesh"]]["primitives"]
        expected = set()
        for p in primitives:
            attributes = p["attributes"]
            position = floats(gltf, blob, attributes["POSITION"])
            uv = floats(gltf, blob, attributes["TEXCOORD_1"])
            for (x, y, z), (u, v) in zip(position, uv):
                expected.add(tuple(round(c, 5) for c in (x, -z, y, u, 1 - v)))
        layer = o.data.uv_layers[1].data
        seen = set()
        for loop in o.data.loops:
            seen.add(tuple(round(c, 5) for c in (*o.data.vertices[loop.vertex_index].co, *layer[loop.index].uv)))
        if {tuple(x + 0.0 for x in t) for t in seen} != {tuple(x + 0.0 for x in t) for t in expected}:
            problems.append(f"{node['name']}: corners differ: {sorted(seen - expected)[:3]} for {sorted(expected - seen)[:3]}")
        # Blender joins primitives of one material, e.g. the parts of a chart that was cut.
        materials = {p.get("material") for p in primitives}
        if len(o.material_slots) != len(materials):
            problems.append(f"{node['name']}: {len(o.material_slots)} slots for {len(materials)} materials")
    return problems


def normal_at(at):
    """The normal of the lit surface nearest to a point."""
    best = (1e9, None)
    for o in bpy.data.objects:
        if o.type == "MESH" and o.get("lightmap"):
            ok, near, normal, _ = o.closest_point_on_mesh(o.matrix_world.inverted() @ at)
            distance = (o.matrix_world @ near - at).length if ok else 1e9
            if distance < best[0]:
                best = (distance, (o.matrix_world.to_3x3().inverted().transposed() @ normal).normalized())
    return best[1]


def radiance(at, folder):
    """The radiance that a camera just above a surface sees."""
    scene = bpy.context.scene
    camera = scene.camera
    normal = normal_at(at)
    camera.location = at + 0.02 * normal
    camera.rotation_euler = normal.to_track_quat("Z", "Y").to_euler()
    scene.render.filepath = os.path.join(folder, "point.exr")
    bpy.ops.render.render(write_still=True)
    image = bpy.data.images.load(scene.render.filepath)
    image.colorspace_settings.name = "Non-Color"
    pixels = list(image.pixels)
    bpy.data.images.remove(image)
    middle = 4 * (4 * 2 + 2)
    return pixels[middle : middle + 3]


def set_up():
    scene = bpy.context.scene
    camera = bpy.data.cameras.new("check")
    camera.type, camera.ortho_scale, camera.clip_start, camera.clip_end = "ORTHO", 0.002, 0.001, 0.1
    scene.camera = bpy.data.objects.new("check", camera)
    scene.collection.objects.link(scene.camera)
    scene.world = None
    scene.render.engine = "CYCLES"
    scene.cycles.samples, scene.cycles.use_denoising, scene.cycles.device = 1, False, "CPU"
    scene.render.resolution_x = scene.render.resolution_y = 4
    scene.render.image_settings.file_format = "OPEN_EXR"
    scene.render.image_settings.color_depth = "32"
    scene.view_settings.view_transform = "Raw"


def main():
    path, points = sys.argv[1], json.loads(sys.argv[2])
    bpy.ops.wm.read_factory_settings(use_empty=True)
    _, count = import_level(path)
    problems = check_document(path)
    set_up()
    with tempfile.TemporaryDirectory() as folder:
        for p in points:
            x, y, z = p["at"]
            found = radiance(Vector((x, -z, y)), folder)
            print(p["at"], [round(c, 6) for c in found], "expected", [round(c, 6) for c in p["radiance"]])
            if any(abs(f - e) > RELATIVE * e + ABSOLUTE for f, e in zip(found, p["radiance"])):
                problems.append(f"at {p['at']}: {found}, expected {p['radiance']}")
    print(f"{count} objects with a lightmap, {len(points)} points, {len(problems)} problems")
    for p in problems:
        print("problem:", p)
    sys.exit(1 if problems else 0)


main()
