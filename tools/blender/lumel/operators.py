"""Operators that bake, cancel, and switch between the level and its bake."""

import os
import shlex

import bpy

from . import show
from .export import export_level
from .run import Bake, find_program

# Seconds between checks of a running bake.
INTERVAL = 0.1
# The running bake, if any.
running = None


def preferences(context):
    addon = context.preferences.addons.get(__package__)
    return addon.preferences if addon else None


class LumelError(Exception):
    """An error that the user can fix."""


def output_folder(scene):
    path = scene.lumel.output
    if path.startswith("//") and not bpy.data.filepath:
        raise LumelError("save the .blend first, or give an absolute output folder")
    folder = bpy.path.abspath(path)
    os.makedirs(folder, exist_ok=True)
    return folder


def start(context):
    """Exports the level and starts the bake. Returns the bake, its .glb, and warnings."""
    chosen = preferences(context)
    program = find_program(chosen.program if chosen else "")
    if program is None:
        raise LumelError("the program lumel is not found: give its path in the preferences")
    scene = context.scene
    folder = output_folder(scene)
    # A subfolder, because a bake must not overwrite its own input.
    source = os.path.join(folder, "source")
    os.makedirs(source, exist_ok=True)
    name = bpy.path.clean_name(scene.name)
    level = os.path.join(source, name + ".glb")
    options, warnings = export_level(context, level)
    arguments = [level, "-o", folder, "--quality", scene.lumel.quality, *options]
    if scene.lumel.density > 0:
        arguments += ["--texels-per-unit", f"{scene.lumel.density:g}"]
    try:
        arguments += shlex.split(scene.lumel.options)
    except ValueError as e:
        raise LumelError(f"options {scene.lumel.options!r}: {e}") from e
    return Bake(program, arguments), os.path.join(folder, name + ".glb"), warnings


class LUMEL_OT_bake(bpy.types.Operator):
    """Export the level, bake its lightmaps and show the result in a separate scene"""

    bl_idname = "lumel.bake"
    bl_label = "Bake"

    @classmethod
    def poll(cls, context):
        return running is None and show.level_of(context.scene) is None

    def execute(self, context):
        """Without a window, waits for the bake."""
        if not self.begin(context):
            return {"CANCELLED"}
        return self.end(context, running.wait())

    def invoke(self, context, _event):
        if not self.begin(context):
            return {"CANCELLED"}
        wm = context.window_manager
        self.timer = wm.event_timer_add(INTERVAL, window=context.window)
        wm.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context, event):
        if event.type != "TIMER":
            return {"PASS_THROUGH"}
        code = running.poll()
        wm = context.window_manager
        wm.lumel_share, wm.lumel_text = running.share, running.text
        redraw(context)
        if code is None:
            return {"PASS_THROUGH"}
        wm.event_timer_remove(self.timer)
        # The user may have switched to another scene meanwhile.
        context.window.scene = self.level
        return self.end(context, code)

    def begin(self, context):
        global running
        self.level = context.scene
        try:
            running, self.result, self.warnings = start(context)
        except (LumelError, OSError, RuntimeError, ValueError) as e:
            self.report({"ERROR"}, str(e))
            return False
        context.window_manager.lumel_share = 0.0
        return True

    def end(self, context, code):
        global running
        bake, running = running, None
        context.window_manager.lumel_share = -1.0
        for warning in self.warnings + bake.warnings():
            self.report({"WARNING"}, warning)
        if code != 0:
            if code == 75 or code < 0:
                self.report({"INFO"}, "Bake cancelled: the last results are as they were")
            else:
                self.report({"ERROR"}, bake.error())
            return {"CANCELLED"}
        count = show.show_bake(context, self.result)
        self.report({"INFO"}, f"{bake.summary()}; {count} objects lit")
        return {"FINISHED"}


class LUMEL_OT_cancel(bpy.types.Operator):
    """Stop the bake and keep the previous results"""

    bl_idname = "lumel.cancel"
    bl_label = "Cancel"

    @classmethod
    def poll(cls, _context):
        return running is not None

    def execute(self, _context):
        running.cancel()
        return {"FINISHED"}


class LUMEL_OT_switch(bpy.types.Operator):
    """Switch between the level and its bake"""

    bl_idname = "lumel.switch"
    bl_label = "Switch"

    @classmethod
    def poll(cls, context):
        return cls.other(context.scene) is not None

    @staticmethod
    def other(scene):
        return show.level_of(scene) or show.baked_scene(scene)

    def execute(self, context):
        context.window.scene = self.other(context.scene)
        return {"FINISHED"}


def redraw(context):
    for window in context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                area.tag_redraw()


CLASSES = (LUMEL_OT_bake, LUMEL_OT_cancel, LUMEL_OT_switch)
