"""Writes the scene as the .glb that `lumel bake` reads, with all that the exporter leaves out."""

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
            # W/sr and W/m², as glowing materials are. The default, Standard, takes lamps times 683.
            export_import_convert_lighting_mode="COMPAT",
            # Lumel leaves out what moves, and says so.
            export_animation_mode="ACTIVE_ACTIONS",
            export_force_sampling=False,
        )
    glb = Glb(path)
    # So that `lumel bake` knows that units are right and no lamps were left out by mistake.
    asset = glb.json["asset"]
    asset["generator"] = f"{asset.get('generator', '')}, Lumel add-on"
    warnings = lamps.complete(glb, rendered_objects(context))
    glb.write(path)
    return world.sky_options(scene, os.path.dirname(path)), warnings


@contextlib.contextmanager
def plain_colors():
    """Lamps' temperatures as colours for a while: the exporter of Blender 5.0 fails on them."""
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
    """Objects of the scene that are not switched off for renders."""
    return [o for o in context.view_layer.objects if not o.hide_render]
