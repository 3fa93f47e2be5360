"""Panels in the sidebar of the 3D view, and the add-on's preferences."""

import bpy
from bpy.props import StringProperty

from . import show
from .operators import LUMEL_OT_bake, LUMEL_OT_cancel, LUMEL_OT_switch


class LumelPreferences(bpy.types.AddonPreferences):
    bl_idname = __package__

    program: StringProperty(
        name="Program lumel",
        subtype="FILE_PATH",
        description="Empty: searched for on the path and where cargo installs programs",
    )

    def draw(self, _context):
        self.layout.prop(self, "program")


class Sidebar:
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Lumel"


class LUMEL_PT_bake(Sidebar, bpy.types.Panel):
    bl_idname = "LUMEL_PT_bake"
    bl_label = "Lightmaps"

    def draw(self, context):
        layout, wm = self.layout, context.window_manager
        if wm.lumel_share >= 0:
            layout.progress(factor=wm.lumel_share, text=wm.lumel_text)
            layout.operator(LUMEL_OT_cancel.bl_idname, icon="CANCEL")
            return
        if show.level_of(context.scene):
            layout.operator(LUMEL_OT_switch.bl_idname, text="Back to the level", icon="LOOP_BACK")
            return
        settings = context.scene.lumel
        layout.use_property_split = True
        for name in ("quality", "density", "output", "options"):
            layout.prop(settings, name)
        layout.operator(LUMEL_OT_bake.bl_idname, icon="RENDER_STILL")
        if show.baked_scene(context.scene):
            layout.operator(LUMEL_OT_switch.bl_idname, text="Show the bake", icon="SHADING_RENDERED")


class LUMEL_PT_object(Sidebar, bpy.types.Panel):
    bl_idname = "LUMEL_PT_object"
    bl_label = "Object"
    bl_parent_id = "LUMEL_PT_bake"

    @classmethod
    def poll(cls, context):
        return context.object is not None and show.level_of(context.scene) is None

    def draw(self, context):
        layout = self.layout
        layout.use_property_split = True
        for name in ("lumel_density", "lumel_exclude", "lumel_occluder", "lumel_bake"):
            layout.prop(context.object, name)


CLASSES = (LumelPreferences, LUMEL_PT_bake, LUMEL_PT_object)
