"""Converts the world into options for `lumel bake`: a colour, or a map rendered by Cycles."""

import os

import bpy

# Rows of the map: 0.18 degrees each. The sun keeps its total light, spread over a few pixels.
HEIGHT = 1024
# Enough for filtering and clouds: the image contains only the world.
SAMPLES = 16


def sky_options(scene, folder):
    """Options for the scene's world; writes `world.exr` into `folder` if a map is needed."""
    world = scene.world
    if world is None:
        return []
    color = constant(world)
    if color is None:
        path = os.path.join(folder, "world.exr")
        render(scene, path)
        return ["--sky", path]
    if max(color) <= 0:
        return []
    return ["--sky", ",".join(f"{c:.9g}" for c in color)]


def constant(world):
    """The world's radiance if it is the same in all directions, otherwise None."""
    # Blender 5 always uses nodes, and the switch is deprecated.
    if bpy.app.version < (5, 0) and not world.use_nodes:
        return tuple(world.color)
    if world.node_tree is None:
        return tuple(world.color)
    outputs = [n for n in world.node_tree.nodes if n.type == "OUTPUT_WORLD" and n.is_active_output]
    if not outputs or not outputs[0].inputs["Surface"].is_linked:
        return (0.0, 0.0, 0.0)
    background = outputs[0].inputs["Surface"].links[0].from_node
    if background.type != "BACKGROUND":
        return None
    color, strength = background.inputs["Color"], background.inputs["Strength"]
    if color.is_linked or strength.is_linked:
        return None
    return tuple(c * strength.default_value for c in color.default_value[:3])


def render(scene, path):
    """Renders the world as a latitude-longitude map with +X in the centre, as Lumel reads it."""
    temporary = bpy.data.scenes.new("lumel world")
    data = bpy.data.cameras.new("lumel world")
    camera = bpy.data.objects.new("lumel world", data)
    try:
        temporary.world = scene.world
        temporary.collection.objects.link(camera)
        temporary.camera = camera
        data.type = "PANO"
        # Blender 5 moved the setting from Cycles to the camera.
        settings = data if hasattr(data, "panorama_type") else data.cycles
        settings.panorama_type = "EQUIRECTANGULAR"
        camera.rotation_euler = (1.5707963, 0, -1.5707963)
        r = temporary.render
        r.engine = "CYCLES"
        r.resolution_x, r.resolution_y, r.resolution_percentage = 2 * HEIGHT, HEIGHT, 100
        r.film_transparent = False
        r.image_settings.file_format = "OPEN_EXR"
        r.image_settings.color_mode = "RGB"
        r.image_settings.color_depth = "32"
        r.filepath = path
        c = temporary.cycles
        c.samples, c.use_adaptive_sampling, c.use_denoising = SAMPLES, False, False
        c.pixel_filter_type = "BOX"
        bpy.ops.render.render(write_still=True, scene=temporary.name)
    finally:
        bpy.data.objects.remove(camera)
        bpy.data.cameras.remove(data)
        bpy.data.scenes.remove(temporary)
