"""Loads a bake of Lumel into Blender, lit by its lightmap.

    blender --python load.py -- out/level.glb
    python load.py out/level.glb [level.blend]        (with the module bpy)

Each surface becomes an emission of base colour x lightmap (R = E/pi, the radiance of a white
surface) plus what it emits itself. So Eevee and Cycles show what was baked, without another light.
Lamps of the file are hidden: their light is in the lightmap.
"""

import math
import os
import sys

import bpy


def import_level(path):
    """Imports the .glb into the current scene, lit; returns the new objects and how many are lit."""
    before = set(bpy.data.objects)
    bpy.ops.import_scene.gltf(filepath=path)
    new = [o for o in bpy.data.objects if o not in before]
    folder = os.path.dirname(os.path.abspath(path))
    pages, materials, count = {}, {}, 0
    for o in new:
        if o.type == "LIGHT":
            o.hide_render = True
            o.hide_set(True)
        # Extras of nodes become custom properties of objects.
        place = o.get("lightmap")
        if o.type != "MESH" or place is None or len(o.data.uv_layers) < 2:
            continue
        uri, offset, scale = place["uri"], list(place["offset"]), list(place["scale"])
        if uri not in pages:
            pages[uri] = load_page(os.path.join(folder, uri))
        uv = o.data.uv_layers[int(place["texCoord"])].name
        for slot in o.material_slots:
            key = (slot.material.name if slot.material else None, uri, uv, *offset, *scale)
            if key not in materials:
                materials[key] = lit_material(slot.material, pages[uri], uv, offset, scale)
            # Instances share mesh and material, but the lightmap rectangle belongs to the object,
            # so the material must too.
            slot.link = "OBJECT"
            slot.material = materials[key]
        count += 1
    return new, count


def load_page(path):
    image = bpy.data.images.load(path, check_existing=True)
    # A page with this name may already be loaded from an earlier bake.
    image.reload()
    # Linear Rec.709 is Blender's own working space, so nothing is converted.
    image.colorspace_settings.name = "Linear Rec.709"
    return image


def lit_material(material, image, uv, offset, scale):
    """A copy of `material` that shows base colour x page + emission."""
    m = material.copy() if material else bpy.data.materials.new("lightmap")
    m.use_nodes = True
    tree = m.node_tree
    node, link = tree.nodes.new, tree.links.new
    surface = next((n for n in tree.nodes if n.type == "BSDF_PRINCIPLED"), None)
    output = next(n for n in tree.nodes if n.type == "OUTPUT_MATERIAL")

    coordinates = node("ShaderNodeUVMap")
    coordinates.uv_map = uv
    mapping = node("ShaderNodeMapping")
    # The importer flips v (v' = 1 - v), and images have v' = 1 at the top: 1 - (offset + scale (1 -
    # v')) = (1 - offset - scale) + scale v'.
    mapping.inputs["Location"].default_value = (offset[0], 1 - offset[1] - scale[1], 0)
    mapping.inputs["Scale"].default_value = (scale[0], scale[1], 1)
    page = node("ShaderNodeTexImage")
    page.image, page.extension = image, "EXTEND"
    times = node("ShaderNodeVectorMath")
    times.operation = "MULTIPLY"
    link(coordinates.outputs["UV"], mapping.inputs["Vector"])
    link(mapping.outputs["Vector"], page.inputs["Vector"])
    link(page.outputs["Color"], times.inputs[0])
    times.inputs[1].default_value = (1, 1, 1)
    lit = node("ShaderNodeEmission")
    shown = lit
    if surface:
        connect(tree, surface.inputs["Base Color"], times.inputs[1])
        glow = node("ShaderNodeEmission")
        connect(tree, surface.inputs["Emission Color"], glow.inputs["Color"])
        connect(tree, surface.inputs["Emission Strength"], glow.inputs["Strength"])
        shown = node("ShaderNodeAddShader")
        link(lit.outputs[0], shown.inputs[0])
        link(glow.outputs[0], shown.inputs[1])
        alpha = surface.inputs["Alpha"]
        if alpha.is_linked or alpha.default_value < 1:
            clear, mix = node("ShaderNodeBsdfTransparent"), node("ShaderNodeMixShader")
            connect(tree, alpha, mix.inputs["Fac"])
            link(clear.outputs[0], mix.inputs[1])
            link(shown.outputs[0], mix.inputs[2])
            shown = mix
    link(times.outputs["Vector"], lit.inputs["Color"])
    link(shown.outputs[0], output.inputs["Surface"])
    return m


def connect(tree, source, target):
    """Connects `target` to what `source` has: its link or its value."""
    if source.is_linked:
        tree.links.new(source.links[0].from_socket, target)
    else:
        value = source.default_value
        try:
            target.default_value = value
        except (TypeError, ValueError):
            # A colour becomes a vector without alpha.
            target.default_value = tuple(value)[:3]


if __name__ == "__main__":
    arguments = sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else sys.argv[1:]
    if not arguments:
        sys.exit("usage: load.py LEVEL.glb [OUT.blend]")
    if "bpy" in sys.modules and not bpy.app.binary_path:
        bpy.ops.wm.read_factory_settings(use_empty=True)
    objects, count = import_level(arguments[0])
    places = [o["lightmap"] for o in objects if o.type == "MESH" and "lightmap" in o]
    exposure = places[0].get("exposure", 1) if places else 1
    bpy.context.scene.view_settings.exposure = math.log2(exposure)
    print(f"{count} objects with a lightmap")
    if len(arguments) > 1:
        bpy.ops.wm.save_as_mainfile(filepath=os.path.abspath(arguments[1]))
