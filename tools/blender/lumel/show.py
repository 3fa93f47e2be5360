"""Shows the bake in a separate scene, so that nothing in the level is changed or hidden."""

import bpy

from . import lamps, load

SUFFIX = " (baked)"
# Custom property of a baked scene that names its level.
LEVEL = "lumel_level"


def baked_scene(level):
    """The scene that shows the bake of `level`, or None."""
    return next((s for s in bpy.data.scenes if s.get(LEVEL) == level), None)


def level_of(scene):
    """The level whose bake `scene` shows, or None."""
    level = scene.get(LEVEL)
    return level if isinstance(level, bpy.types.Scene) else None


def remove(scene):
    """Removes a baked scene and everything that only it uses."""
    for o in list(scene.objects):
        # The camera belongs to the level.
        if len(o.users_scene) == 1:
            bpy.data.objects.remove(o)
    bpy.data.scenes.remove(scene)
    # Meshes, materials and images without users, including those of this bake.
    for kind in (bpy.data.meshes, bpy.data.materials, bpy.data.images, bpy.data.lights):
        for item in [i for i in kind if i.users == 0 and i.get("lumel_bake")]:
            kind.remove(item)


def show_bake(context, path):
    """Loads `path` into the baked scene of the current level and shows it. Returns the number of
    lit objects."""
    level = context.scene
    old = baked_scene(level)
    if old is not None:
        remove(old)
    before = {kind: set(getattr(bpy.data, kind)) for kind in ("meshes", "materials", "images")}
    bpy.ops.scene.new(type="EMPTY")
    scene = context.window.scene
    scene.name = level.name + SUFFIX
    scene[LEVEL] = level
    scene.world = level.world
    new, count = load.import_level(path)
    for o in new:
        # Area lights are not part of the level: their light is in the lightmap.
        if o.name.startswith(lamps.AREA_PREFIX):
            bpy.data.objects.remove(o)
    if level.camera is not None:
        scene.collection.objects.link(level.camera)
        scene.camera = level.camera
    for kind, known in before.items():
        for item in set(getattr(bpy.data, kind)) - known:
            item["lumel_bake"] = True
    return count
