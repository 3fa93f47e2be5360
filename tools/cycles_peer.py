"""Cycles for comparison: one bake of a flattened scene, under a uniform sky if the scene has one.

As a module: bake() runs this file in a separate process; available() says whether Blender's Python
module is installed.
As a program: cycles_bake.py of the shared tools with one more option, --sky R,G,B, the radiance of
Cycles' world.
"""
import importlib.util
import os
import sys

import common


def available():
    return importlib.util.find_spec("bpy") is not None


def bake(flat, out, side, samples, threads, sky="0,0,0", denoise=False, light_tree=False, bounces=32):
    """-> cycles_bake.py's JSON line, with `map` (lightmap.exr) and `denoised` (or None): paths of maps that hold E/π"""
    r = common.tool(os.path.abspath(__file__), flat, out, "--samples", samples, "--resolution", side, "--threads", threads, "--sky", sky, "--bounces", bounces,
                    *(["--denoise", "oidn"] if denoise else []), *([] if light_tree else ["--no-light-tree"]))
    r.update(map=os.path.join(out, "lightmap.exr"), denoised=os.path.join(out, "denoised.exr") if denoise else None)
    return r


def main():
    argv, sky = sys.argv[1:], (0.0, 0.0, 0.0)
    if "--sky" in argv:
        i = argv.index("--sky")
        sky = tuple(float(x) for x in argv[i + 1].split(","))
        sys.argv[1:] = argv[:i] + argv[i + 2:]
    sys.path.insert(0, common.SHARED)
    import bpy
    import cycles_bake
    plain = cycles_bake.set_cycles

    def set_cycles(args):
        scene = plain(args)
        world = bpy.data.worlds.new("sky")
        world.use_nodes = True
        for node in world.node_tree.nodes:
            if node.bl_idname == "ShaderNodeBackground":
                node.inputs["Color"].default_value = (*sky, 1.0)
                node.inputs["Strength"].default_value = 1.0
        scene.world = world
        return scene
    if any(sky):
        cycles_bake.set_cycles = set_cycles
    cycles_bake.main()


if __name__ == "__main__":
    main()
