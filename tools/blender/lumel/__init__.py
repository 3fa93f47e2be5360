"""Lumel for Blender: bakes the lightmaps of a level with one button."""

import bpy

from . import operators, panels, properties


def register():
    properties.register()
    for c in operators.CLASSES + panels.CLASSES:
        bpy.utils.register_class(c)


def unregister():
    for c in reversed(operators.CLASSES + panels.CLASSES):
        bpy.utils.unregister_class(c)
    properties.unregister()
