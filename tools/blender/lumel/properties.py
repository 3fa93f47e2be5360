"""Bake settings, stored in the scene, and per-object settings.

The settings of an object are in its custom property `lumel`, which the glTF exporter writes as
`extras.lumel`. They therefore also work in plain exports and can be edited by hand.
"""

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, PointerProperty, StringProperty

# Blender 5 requires this flag for paths with `//`; earlier versions do not know it.
RELATIVE = {"PATH_SUPPORTS_BLEND_RELATIVE"} if bpy.app.version >= (5, 0) else set()

QUALITIES = [
    ("draft", "Draft", "Rough look: grainy corners, jagged shadows"),
    ("quick", "Quick", "Changing lights: a third of draft's error"),
    ("preview", "Preview", "Everyday work: about 1 % error"),
    ("production", "Production", "Final bake for shipping"),
]


class LumelSettings(bpy.types.PropertyGroup):
    quality: EnumProperty(
        name="Quality", items=QUALITIES, default="preview", description="How much work to spend"
    )
    density: FloatProperty(
        name="Density",
        default=0.0,
        min=0.0,
        soft_max=64.0,
        description="Lumels per metre; 0 chooses by the level's size",
    )
    output: StringProperty(
        name="Output",
        default="//lumel",
        subtype="DIR_PATH",
        options={"ANIMATABLE"} | RELATIVE,
        description="Folder for the level and its lightmaps",
    )
    options: StringProperty(
        name="Options",
        default="",
        description="Further options of `lumel bake`, as on a command line: --ktx2 bc6h",
    )


def said(o, key, default):
    lumel = o.get("lumel")
    return lumel.get(key, default) if hasattr(lumel, "get") else default


def say(o, key, value, default):
    """Sets a key of the custom property `lumel`; default values are not written."""
    lumel = o.get("lumel")
    members = lumel.to_dict() if hasattr(lumel, "to_dict") else {}
    members.pop(key, None)
    if value != default:
        members[key] = value
    if members:
        o["lumel"] = members
    elif "lumel" in o:
        del o["lumel"]


def flag(key, name, description):
    return BoolProperty(
        name=name,
        description=description,
        get=lambda o: bool(said(o, key, False)),
        set=lambda o, value: say(o, key, bool(value), False),
    )


OBJECT_PROPERTIES = {
    "lumel_density": FloatProperty(
        name="Density factor",
        description="Times the level's lumels per metre; 0 for no lightmap at all",
        min=0.0,
        max=1000.0,
        soft_max=8.0,
        get=lambda o: float(said(o, "density", 1.0)),
        set=lambda o, value: say(o, "density", value, 1.0),
    ),
    "lumel_exclude": flag(
        "exclude", "Leave out", "It and its children neither receive nor cast light"
    ),
    "lumel_occluder": flag(
        "occluder", "Shadow only", "It and its children cast shadows and have no lightmap"
    ),
    "lumel_bake": flag(
        "bake", "Bake although it moves", "Bake it as it stands although it is animated or rigged"
    ),
}


def register():
    bpy.utils.register_class(LumelSettings)
    bpy.types.Scene.lumel = PointerProperty(type=LumelSettings)
    for name, prop in OBJECT_PROPERTIES.items():
        setattr(bpy.types.Object, name, prop)
    bpy.types.WindowManager.lumel_share = FloatProperty(default=-1.0)
    bpy.types.WindowManager.lumel_text = StringProperty()


def unregister():
    del bpy.types.WindowManager.lumel_text
    del bpy.types.WindowManager.lumel_share
    for name in OBJECT_PROPERTIES:
        delattr(bpy.types.Object, name)
    del bpy.types.Scene.lumel
    bpy.utils.unregister_class(LumelSettings)
