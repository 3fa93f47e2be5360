"""A small scripted level with walls, a window, modifiers, and one kind of light at a time."""

import math

import bpy

# `hdri` also exists, but is not within 1 % at `preview` (docs/from_blender.md); name it to run it.
CASES = ("emission", "lamps", "spot", "area", "sun", "world")


def material(name, color, emission=0.0):
    m = bpy.data.materials.new(name)
    # Blender 5 always has nodes.
    if bpy.app.version < (5, 0):
        m.use_nodes = True
    surface = m.node_tree.nodes["Principled BSDF"]
    surface.inputs["Base Color"].default_value = (*color, 1)
    surface.inputs["Roughness"].default_value = 1
    # A lightmap has no highlights.
    surface.inputs["Specular IOR Level"].default_value = 0
    if emission:
        surface.inputs["Emission Color"].default_value = (1, 0.8, 0.6, 1)
        surface.inputs["Emission Strength"].default_value = emission
    return m


def box(name, low, high, m):
    bpy.ops.mesh.primitive_cube_add(size=1)
    o = bpy.context.object
    o.name = o.data.name = name
    o.scale = [h - l for l, h in zip(low, high)]
    o.location = [0.5 * (l + h) for l, h in zip(low, high)]
    o.data.materials.append(m)
    return o


def build(case):
    """Starts an empty file and builds the level; returns its scene."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.name = "level"
    white, red = material("white", (0.7, 0.7, 0.7)), material("red", (0.6, 0.15, 0.1))
    green = material("green", (0.2, 0.5, 0.2))
    box("floor", (-3, -2, -0.2), (3, 2, 0), white)
    box("ceiling", (-3, -2, 2.6), (3, 2, 2.8), white)
    box("left", (-3.2, -2, -0.2), (-3, 2, 2.8), red)
    box("back", (-3.2, 2, -0.2), (3.2, 2.2, 2.8), white)
    box("front", (-3.2, -2.2, -0.2), (3.2, -2, 2.8), white)
    # The right wall has a window.
    box("sill", (3, -2, -0.2), (3.2, 2, 0.8), green)
    box("lintel", (3, -2, 2.2), (3.2, 2, 2.8), green)
    box("jamb 1", (3, -2, 0.8), (3.2, -0.8, 2.2), green)
    box("jamb 2", (3, 0.8, 0.8), (3.2, 2, 2.2), green)
    # Modifiers must be applied: one column becomes three.
    column = box("column", (-1.6, 1.0, 0), (-1.3, 1.3, 2.6), white)
    array = column.modifiers.new("three", "ARRAY")
    array.count, array.use_relative_offset, array.use_constant_offset = 3, False, True
    # In the object's own space, which its scale stretches.
    array.constant_offset_displace = (1.2 / 0.3, 0, 0)
    box("crate", (0.6, -0.9, 0), (1.3, -0.2, 0.7), red).rotation_euler = (0, 0, 0.4)
    LIGHTS[case](scene)
    # An object setting for the baker, not part of any mesh.
    bpy.data.objects["crate"]["lumel"] = {"density": 2.0}
    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    camera.data.lens = 18
    camera.location, camera.rotation_euler = (2.6, -1.7, 1.9), (math.radians(74), 0, math.radians(58))
    scene.collection.objects.link(camera)
    scene.camera = camera
    render_settings(scene)
    return scene


def render_settings(scene):
    scene.render.engine = "CYCLES"
    c = scene.cycles
    c.device, c.use_adaptive_sampling, c.use_denoising = "CPU", False, False
    c.max_bounces = c.diffuse_bounces = c.transparent_max_bounces = 32
    c.sample_clamp_direct = c.sample_clamp_indirect = 0
    c.light_sampling_threshold = 0
    scene.render.resolution_x, scene.render.resolution_y = 168, 112
    scene.render.image_settings.file_format = "OPEN_EXR"
    scene.render.image_settings.color_depth = "32"


def lamp(scene, kind, name, energy, at, turn=(0, 0, 0), **values):
    data = bpy.data.lights.new(name, kind)
    data.energy = energy
    for key, value in values.items():
        setattr(data, key, value)
    o = bpy.data.objects.new(name, data)
    o.location, o.rotation_euler = at, turn
    scene.collection.objects.link(o)
    return data


def emission(_scene):
    box("strip", (-2, -0.1, 2.5), (1, 0.1, 2.58), material("strip", (0, 0, 0), 12.0))


def lamps(scene):
    lamp(scene, "POINT", "bulb", 80, (-1.0, -0.4, 1.9), shadow_soft_size=0.1, color=(1, 0.8, 0.5))
    lamp(scene, "POINT", "small", 30, (1.8, 0.9, 1.2), shadow_soft_size=0.03)


def spot(scene):
    lamp(scene, "SPOT", "spot", 150, (1.2, -1.2, 2.4), (0.7, 0.5, 0.2), spot_size=math.radians(80),
         spot_blend=0.6, shadow_soft_size=0.05)


def area(scene):
    lamp(scene, "AREA", "panel", 60, (-0.5, 0, 2.5), shape="RECTANGLE", size=1.2, size_y=0.4)
    lamp(scene, "AREA", "round", 20, (2.2, 1.2, 2.3), (0.3, 0.4, 0), shape="DISK", size=0.5)


def sun(scene):
    lamp(scene, "SUN", "sun", 5, (0, 0, 5), (0, math.radians(58), math.radians(8)),
         angle=math.radians(2))


def mixed(scene):
    """Lamps of all kinds next to emissive materials, which the exporter's lighting modes treat
    differently."""
    emission(scene)
    lamps(scene)
    sun(scene)


def new_world(scene):
    scene.world = bpy.data.worlds.new("world")
    if bpy.app.version < (5, 0):
        scene.world.use_nodes = True
    return scene.world.node_tree, scene.world.node_tree.nodes["Background"]


def world(scene):
    _, background = new_world(scene)
    background.inputs["Color"].default_value = (0.4, 0.6, 1.0, 1)
    background.inputs["Strength"].default_value = 3.0


def hdri(scene):
    """A map that is bright only towards the window, rotated by a Mapping node."""
    tree, background = new_world(scene)
    image = bpy.data.images.new("sky", 64, 32, float_buffer=True)
    pixels = [0.0] * (4 * 64 * 32)
    for row in range(32):
        for column in range(64):
            # The centre of the image is +X; 16 columns to the left is +Y.
            bright = abs(column - 16) < 5 and 16 <= row < 26
            i = 4 * (64 * row + column)
            pixels[i : i + 4] = (12, 10, 7, 1) if bright else (0.2, 0.3, 0.6, 1)
    image.pixels = pixels
    image.pack()
    environment = tree.nodes.new("ShaderNodeTexEnvironment")
    environment.image = image
    image.colorspace_settings.name = "Linear Rec.709"
    mapping = tree.nodes.new("ShaderNodeMapping")
    # Rotates +Y of the map towards the window.
    mapping.inputs["Rotation"].default_value = (0, 0, math.radians(90))
    coordinates = tree.nodes.new("ShaderNodeTexCoord")
    tree.links.new(coordinates.outputs["Generated"], mapping.inputs["Vector"])
    tree.links.new(mapping.outputs["Vector"], environment.inputs["Vector"])
    tree.links.new(environment.outputs["Color"], background.inputs["Color"])


LIGHTS = {f.__name__: f for f in (emission, lamps, spot, area, sun, world, hdri, mixed)}
