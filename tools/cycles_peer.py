"""Blender's Cycles as a peer: bakes the lightmap of a flattened scene (flatten_lightmap.py).

Usage : python cycles_peer.py FLAT.glb OUT --side TEXELS [--samples 64] [--sky R,G,B] [--bounces 32]
              [--threads N] [--light-tree] [--seed 0] [--denoise]
        As a module: bake() does the same; available() says whether Blender's Python module exists.
Input : what judge/scene.py reads; TEXCOORD_1 is the place on a square page of --side texels. What has
        none casts shadows and receives nothing.
Output: OUT/lightmap.exr  E/π (the pass DIFFUSE without colour), row 0 at the top; 0 off the charts,
                          and on black surfaces, because Cycles divides light by reflectance
        OUT/denoised.exr  with --denoise: the same through Open Image Denoise, without guides
        One line of JSON: bake_s (seconds of Blender's bake operator: its synchronisation, its tree,
        sampling), denoise_s, process_s, peak_rss_mb, texels_covered, version, map, denoised.
Model : one object of all triangles, so one bake, which is Cycles' best case. Materials are Lambertian,
        with textures, vertex colours, MASK, BLEND, transmission and the limit on reflectance. Units
        are Lumel's: emission is radiance; a lamp of I candela has a power of 4 π I watts, as in Cycles
        intensity is power / 4π; a sun's strength is its irradiance. Spots have glTF's soft rim. Cycles
        reflects and emits on both sides (truth.py --two-sided) and knows no `range` of lamps.
        No clamping, no adaptive sampling, no light threshold.
Check : truth_check.py --cycles.
"""
import argparse
import importlib.util
import json
import os
import resource
import sys
import tempfile
import time

import numpy as np

import common
from judge import scene as scenes

EXTENSION = {33071: "EXTEND", 33648: "MIRROR"}      # others: REPEAT
# UV layer of each texture; the materials' texture transforms are applied there.
LAYERS = {"base_texture": "base", "emissive_texture": "glow", "transmission_texture": "glass"}


def available():
    return importlib.util.find_spec("bpy") is not None


def bake(flat, out, side, samples, threads, sky="0,0,0", denoise=False, light_tree=False, bounces=32, seed=0):
    """-> the values of the JSON line"""
    r = common.tool(__file__, flat, out, "--side", side, "--samples", samples, "--threads", threads, "--sky", sky,
                    "--bounces", bounces, "--seed", seed, "--child", *(["--light-tree"] if light_tree else []))
    light = np.load(os.path.join(out, "lightmap.npy"))
    r.update(map=os.path.join(out, "lightmap.exr"), denoised=None, denoise_s=0.0)
    common.write_exr(r["map"], light)
    os.remove(os.path.join(out, "lightmap.npy"))
    if denoise:
        # Here and not in Blender's process, which has an Open Image Denoise of its own.
        import pyoidn
        start = time.perf_counter()
        clean = pyoidn.denoise(light, hdr=True)
        r.update(denoised=os.path.join(out, "denoised.exr"), denoise_s=time.perf_counter() - start)
        common.write_exr(r["denoised"], clean)
    return r


class Nodes:
    """Node trees from values that are numbers, colours or outputs of other nodes."""

    def __init__(self, owner):
        owner.use_nodes = True
        self.tree = owner.node_tree
        self.tree.nodes.clear()

    def put(self, socket, value):
        import bpy
        if isinstance(value, bpy.types.NodeSocket):
            self.tree.links.new(value, socket)
        elif np.ndim(value) == 0:
            socket.default_value = float(value)
        else:
            socket.default_value = [*map(float, value), 1.0][:len(socket.default_value)]

    def add(self, kind, *inputs, out=0, **settings):
        """a node's output; inputs in the order of its sockets"""
        node = self.tree.nodes.new("ShaderNode" + kind)
        for key, value in settings.items():
            setattr(node, key, value)
        for socket, value in zip(node.inputs, inputs):
            if value is not None:
                self.put(socket, value)
        return node.outputs[out] if len(node.outputs) else None

    def math(self, operation, *values):
        return self.add("Math", *values, operation=operation)

    def each(self, operation, a, b):
        """of vectors"""
        return self.add("VectorMath", a, b, operation=operation)

    def texture(self, picture, texture, slot):
        """-> colour, alpha"""
        node = self.tree.nodes.new("ShaderNodeTexImage")
        node.image = picture(texture.image)
        node.interpolation = "Closest" if texture.nearest else "Linear"
        node.extension = EXTENSION.get(texture.wrap[0], "REPEAT")
        self.put(node.inputs[0], self.add("UVMap", uv_map=LAYERS[slot]))
        return node.outputs


class Level:
    """A Scene as Blender's data."""

    def __init__(self, scene, folder):
        self.scene, self.folder, self.images = scene, folder, {}
        self.coloured = not np.allclose(scene.colours, 1)
        self.object = self.mesh()
        for lamp in scene.lamps:
            self.lamp(lamp)
        if scene.sky.any():
            self.sky()

    def picture(self, number):
        """Blender's image of a texture, read from the file's own bytes"""
        import bpy
        if number not in self.images:
            path = os.path.join(self.folder, str(number))
            with open(path, "wb") as f:
                f.write(self.scene.meta["document"].picture(number if number >= 0 else -1 - number))
            image = self.images[number] = bpy.data.images.load(path)
            image.colorspace_settings.name = "sRGB" if number >= 0 else "Non-Color"
            image.alpha_mode = "CHANNEL_PACKED"
        return self.images[number]

    def mesh(self):
        import bpy
        scene, n = self.scene, len(self.scene.corners)
        mesh = bpy.data.meshes.new("level")
        mesh.vertices.add(3 * n)
        mesh.vertices.foreach_set("co", scene.corners.astype(np.float32).ravel())
        mesh.loops.add(3 * n)
        mesh.loops.foreach_set("vertex_index", np.arange(3 * n, dtype=np.int32))
        mesh.polygons.add(n)
        mesh.polygons.foreach_set("loop_start", np.arange(0, 3 * n, 3, dtype=np.int32))
        used, slot = np.unique(scene.material, return_inverse=True)
        mesh.polygons.foreach_set("material_index", slot.ravel().astype(np.int32))
        mesh.update(calc_edges=True)
        # Out of the page: no texels
        self.layer(mesh, "lightmap", np.nan_to_num(scene.uv[1], nan=-1.0))
        for key, name in LAYERS.items():
            uv = np.zeros((n, 3, 2))
            for i in used:
                t = getattr(scene.materials[i], key)
                if t is not None:
                    mine = scene.material == i
                    uv[mine] = scene.uv[t.coordinates][mine] @ t.matrix[:, :2].T + t.matrix[:, 2]
            if uv.any():
                self.layer(mesh, name, uv)
        if self.coloured:
            colours = mesh.color_attributes.new("colours", "FLOAT_COLOR", "CORNER")
            colours.data.foreach_set("color", scene.colours.astype(np.float32).ravel())
        # No corner is shared: without normals of its own each face is flat.
        face = np.cross(scene.corners[:, 1] - scene.corners[:, 0], scene.corners[:, 2] - scene.corners[:, 0])
        face /= np.linalg.norm(face, axis=1, keepdims=True)
        if np.abs(scene.normals - face[:, None]).max() > 1e-4:
            mesh.normals_split_custom_set(scene.normals.reshape(-1, 3))
        for i in used:
            mesh.materials.append(self.material(scene.materials[i]))
        thing = bpy.data.objects.new("level", mesh)
        bpy.context.scene.collection.objects.link(thing)
        return thing

    @staticmethod
    def layer(mesh, name, uv):
        uv = uv.reshape(-1, 2) * [1, -1] + [0, 1]       # Blender's v points up
        mesh.uv_layers.new(name=name, do_init=False).uv.foreach_set("vector", uv.astype(np.float32).ravel())

    def material(self, m):
        import bpy
        material = bpy.data.materials.new("material")
        nodes = Nodes(material)
        colour, alpha = m.base[:3], m.base[3]
        rest = [nodes.texture(self.picture, m.base_texture, "base_texture")] if m.base_texture else []
        if self.coloured:
            node = nodes.tree.nodes.new("ShaderNodeVertexColor")
            node.layer_name = "colours"
            rest.append(node.outputs)
        for more in rest:
            colour = nodes.each("MULTIPLY", colour, more[0])
            alpha = nodes.math("MULTIPLY", alpha, more[1])
        shader = nodes.add("BsdfDiffuse", nodes.each("MINIMUM", colour, [m.limit] * 3))
        if m.transmission > 0:
            tau = m.transmission
            if m.transmission_texture:
                red = nodes.texture(self.picture, m.transmission_texture, "transmission_texture")[0]
                tau = nodes.math("MULTIPLY", tau, nodes.add("SeparateColor", red))
            shader = nodes.add("MixShader", tau, shader, nodes.add("BsdfTransparent", colour))
        if m.emissive.any():
            strength = m.emissive.max()
            glow = m.emissive / strength
            if m.emissive_texture:
                glow = nodes.each("MULTIPLY", glow, nodes.texture(self.picture, m.emissive_texture, "emissive_texture")[0])
            shader = nodes.add("AddShader", shader, nodes.add("Emission", glow, strength))
        if m.alpha_mode == "MASK":
            alpha = nodes.math("SUBTRACT", 1.0, nodes.math("LESS_THAN", alpha, m.cutoff))
        if m.alpha_mode in ("MASK", "BLEND"):
            shader = nodes.add("MixShader", alpha, nodes.add("BsdfTransparent", [1.0] * 3), shader)
        nodes.add("OutputMaterial", shader)
        self.target = nodes.tree.nodes.new("ShaderNodeTexImage")
        self.target.name = "target"
        nodes.tree.nodes.active = self.target
        return material

    def lamp(self, lamp):
        import bpy
        from mathutils import Vector
        kind = {"directional": "SUN", "point": "POINT", "spot": "SPOT"}[lamp.kind]
        light = bpy.data.lights.new("lamp", kind)
        most = max(lamp.intensity.max(), 1e-30)
        light.color = lamp.intensity / most
        light.energy = most if kind == "SUN" else 4 * np.pi * most
        if kind == "SUN":
            light.angle = np.radians(lamp.angle)
        else:
            light.shadow_soft_size, light.use_soft_falloff = lamp.radius, False
        if kind == "SPOT":
            light.spot_size, light.spot_blend = 2 * lamp.outer, 0.0
            # ((cos θ − cos outer) / (cos inner − cos outer))², where Blender's blend is a smooth step
            nodes = Nodes(light)
            inner, outer = np.cos(lamp.inner), np.cos(lamp.outer)
            along = nodes.add("VectorMath", nodes.add("NewGeometry", out="Incoming"), lamp.direction, operation="DOT_PRODUCT", out="Value")
            share = nodes.math("DIVIDE", nodes.math("SUBTRACT", along, outer), max(0.001, inner - outer))
            share = nodes.math("MAXIMUM", nodes.math("MINIMUM", share, 1.0), 0.0)
            nodes.add("OutputLight", nodes.add("Emission", [1.0] * 3, nodes.math("MULTIPLY", share, share)))
        thing = bpy.data.objects.new("lamp", light)
        thing.location = lamp.position
        thing.rotation_mode = "QUATERNION"
        thing.rotation_quaternion = Vector(lamp.direction).to_track_quat("-Z", "Y")
        bpy.context.scene.collection.objects.link(thing)

    def sky(self):
        import bpy
        world = bpy.context.scene.world = bpy.data.worlds.new("sky")
        nodes = Nodes(world)
        most = self.scene.sky.max()
        nodes.add("OutputWorld", nodes.add("Background", self.scene.sky / most, most))


def bake_here(a):
    """Runs Cycles in this process -> the map [side, side, 3], values of the JSON line"""
    import bpy
    bpy.ops.wm.read_factory_settings(use_empty=True)
    level = scenes.load(a.scene)
    level.meta["document"] = scenes.Document(a.scene)
    level.sky = scenes.colour(a.sky)
    settings = bpy.context.scene
    settings.render.engine = "CYCLES"
    settings.render.threads_mode, settings.render.threads = "FIXED", a.threads
    c = settings.cycles
    c.device, c.samples, c.seed = "CPU", a.samples, a.seed
    c.use_adaptive_sampling = c.use_denoising = c.use_fast_gi = False
    c.max_bounces = c.diffuse_bounces = a.bounces
    c.glossy_bounces = c.transmission_bounces = c.volume_bounces = 0
    c.transparent_max_bounces = 256
    c.sample_clamp_direct = c.sample_clamp_indirect = c.light_sampling_threshold = 0.0
    c.use_light_tree = a.light_tree
    with tempfile.TemporaryDirectory() as folder:
        thing = Level(level, folder).object
        image = bpy.data.images.new("lightmap", a.side, a.side, alpha=True, float_buffer=True, is_data=True)
        for m in thing.data.materials:
            m.node_tree.nodes["target"].image = image
        thing.data.uv_layers.active = thing.data.uv_layers["lightmap"]
        thing.select_set(True)
        bpy.context.view_layer.objects.active = thing
        start = time.perf_counter()
        bpy.ops.object.bake(type="DIFFUSE", pass_filter={"DIRECT", "INDIRECT"}, target="IMAGE_TEXTURES",
                            margin=0, use_clear=True, uv_layer="lightmap")
        seconds = time.perf_counter() - start
    texels = np.empty(a.side * a.side * 4, np.float32)
    image.pixels.foreach_get(texels)
    texels = texels.reshape(a.side, a.side, 4)[::-1]
    return texels[..., :3], dict(bake_s=seconds, texels_covered=int((texels[..., 3] > 0).sum()), version=bpy.app.version_string)


def main():
    ap = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ap.add_argument("scene")
    ap.add_argument("out")
    ap.add_argument("--side", type=int, required=True)
    ap.add_argument("--samples", type=int, default=64)
    ap.add_argument("--sky", default="0,0,0")
    ap.add_argument("--bounces", type=int, default=32)
    ap.add_argument("--threads", type=int, default=os.cpu_count())
    ap.add_argument("--light-tree", action="store_true")
    ap.add_argument("--seed", type=int, default=0)
    ap.add_argument("--denoise", action="store_true")
    ap.add_argument("--child", action="store_true", help=argparse.SUPPRESS)
    a = ap.parse_args()
    if not a.child:
        print(json.dumps(bake(a.scene, a.out, a.side, a.samples, a.threads, a.sky, a.denoise, a.light_tree, a.bounces, a.seed)))
        return
    start = time.perf_counter()
    os.makedirs(a.out, exist_ok=True)
    light, said = bake_here(a)
    np.save(os.path.join(a.out, "lightmap.npy"), light)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(json.dumps(dict(said, samples=a.samples, bounces=a.bounces, threads=a.threads, peak_rss_mb=peak,
                          process_s=time.perf_counter() - start)))
    sys.stdout.flush()


if __name__ == "__main__":
    main()
