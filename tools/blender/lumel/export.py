"""Writes the scene as the .glb that `lumel bake` reads, and adds what Blender's exporter omits."""

import contextlib
import os

import bpy

from . import lamps, world
from .glb import Glb


def export_level(context, path):
    """Exports the scene to `path`. Returns options for `lumel bake` and warnings."""
    scene = context.scene
    with plain_colors():
        bpy.ops.export_scene.gltf(
            filepath=path,
            export_format="GLB",
            use_active_scene=True,
            use_renderable=True,
            export_apply=True,
            export_lights=True,
            export_extras=True,
            export_cameras=False,
            # Exports W/sr and W/m², like emissive materials. The default mode, Standard, multiplies
            # lamps by 683.
            export_import_convert_lighting_mode="COMPAT",
            # Lumel skips moving objects and lists them.
            export_animation_mode="ACTIVE_ACTIONS",
            export_force_sampling=False,
        )
    glb = Glb(path)
    # Tells `lumel bake` that units are correct and that no lamps were left out by mistake.
    asset = glb.json["asset"]
    asset["generator"] = f"{asset.get('generator', '')}, Lumel add-on"
    warnings = lamps.complete(glb, rendered_objects(context))
    glb.write(path)
    return world.sky_options(scene, os.path.dirname(path)), warnings


@contextlib.contextmanager
def plain_colors():
    """Temporarily replaces lamp temperatures by colours: the exporter of Blender 5.0 fails on
    them."""
    warm = [
        (lamp, tuple(lamp.color))
        for lamp in bpy.data.lights
        if getattr(lamp, "use_temperature", False)
    ]
    try:
        for lamp, _ in warm:
            lamp.color = lamps.color(lamp)
            lamp.use_temperature = False
        yield
    finally:
        for lamp, before in warm:
            lamp.color = before
            lamp.use_temperature = True


def rendered_objects(context):
    """Objects of the scene that are enabled for rendering."""
    return [o for o in context.view_layer.objects if not o.hide_render]
