"""The scenes of speed_error.py: what is baked, at which density and why, with which sky, sun, references and settings.

Every scene is one page with the same lumels for lumel, Cycles and the reference.  The densities are fixed here, so that the atlas (and
with it the cached references) is the same in every run."""
import json
import os
import shutil

import numpy as np

import common

ASSETS = os.path.join(common.HERE, "..", "assets")

# Settings that cast at least as many rays as production.
FINE = ("preview, error 0.02", "production, error 0.005")

# Lumel's default of --max-reflectance.  With a reflectance of 1 or more, light would never be absorbed.
LIMIT = 0.98

# title     for the plots
# file      path, or maker of it
# density   lumels per metre, and why; max_page: larger than the page, so that nothing is split
# plain     changes to the document so that every program sees the same scene (plain_document): largest reflectance, or None for no change
# fair      no lit backs are visible, so two-sided and one-sided references are equal
# count     lumels compared;  target: median relative standard error of the reference (under open sky half the lumels have none, so time must rule);
#           seconds: limit for (whole texel, middle half, chart edges too)
# cycles    samples;  slow_cycles, slow_lumel: only with --full;  light_tree: the setting of Cycles that was better at equal time;  bounces: of Cycles, 32
CHOSEN = "what `lumel bake` chooses by itself, but for 2 %%: %s"
SCENES = {
    "cornell": dict(
        title="Cornell box", file=os.path.join(ASSETS, "cornell_box.glb"), density=13.53, sky="0,0,0", fair=True,
        why="36,000 lumels, 7.4 cm each; `lumel bake` would choose 31.5 and 193,000",
        count=1000, target=0.0008, seconds=(120, 60, 40), cycles=(16, 64, 256, 1024), slow_cycles=()),
    "demo": dict(
        title="Demo level", file=os.path.join(ASSETS, "demo_level.glb"), density=7.84, sky="0.25,0.35,0.5", fair=False,
        why=CHOSEN % "220,000 lumels, 12.8 cm each",
        count=600, target=0.001, seconds=(240, 90, 40), cycles=(16, 64, 256), slow_cycles=(1024,), slow_lumel=FINE + ("production",),
        light_tree=True),   # 16 samples: 50 % in 10.1 s of processor time against 74 % in 5.9 s; median 6 against 29 %
    "garage": dict(
        title="webxr_garage", file=os.path.join(common.SCENES, "webxr_garage", "garage.gltf"), density=28.0, sky="0,0,0", plain=LIMIT, fair=False,
        why=CHOSEN % "222,000 lumels, 3.6 cm each",
        count=1000, target=0.0015, seconds=(90, 60, 30), cycles=(16, 64, 256), slow_cycles=(1024,), slow_lumel=FINE + ("quick, error 0.1", "production")),
    "godot": dict(
        title="godot_gi_demo", file=os.path.join(common.SCENES, "godot_gi_demo", "godot_gi_demo.glb"), density=2.5, sky="0,0,0", plain=LIMIT, fair=False,
        why=CHOSEN % "237,000 lumels, 40 cm each",
        count=1000, target=0.0015, seconds=(90, 60, 30), cycles=(16, 64, 256), slow_cycles=(1024,), slow_lumel=FINE + ("quick, error 0.1", "production"),
        bounces=512),       # The walls are white: 32 bounces lose 11 to 13 % of the light, 512 lose less than 64 samples show, in a third more time.
    "sponza": dict(
        title="Sponza", file=os.path.join(common.SCENES, "sponza", "sponza.glb"), density=4.97, sky="0.5,0.6,0.8", sun=((-0.3, -1, 0.2), 6.0), fair=False,
        why=CHOSEN % "247,000 lumels, 20 cm each",
        count=1000, target=0.0001, seconds=(60, 40, 40), cycles=(16, 64, 256), slow_cycles=(1024,), slow_lumel=FINE + ("quick, error 0.1", "production")),
    "room": dict(
        title="Classic room", file=os.path.join(ASSETS, "classic_room_1014.glb"), density=18.0, sky="0,0,0", fair=True,
        why="the finest that fits 256², 5.6 cm a lumel",
        count=1000, target=0.0015, seconds=(40, 30, 30), cycles=(16, 64, 256, 1024), slow_cycles=()),
    "dense": dict(
        title="Dense mesh", file="dense", density=36.5, sky="0,0,0", fair=True,
        why="the finest that fits 512² (424 × 496), 2.7 cm a lumel, which covers some seven triangles of the balls",
        count=1000, target=0.0015, seconds=(50, 30, 30), cycles=(16, 64, 256), slow_cycles=(1024,), slow_lumel=FINE),
}


# The scenes of the page; others are run by name.
FIVE = ("cornell", "demo", "garage", "godot", "sponza")

# The same with four times the lumels, as games ship. 1024 samples would take Cycles an hour a scene.
FINER = tuple(name + "_4x" for name in FIVE)
for name in FIVE:
    SCENES[name + "_4x"] = dict(
        SCENES[name], title=SCENES[name]["title"] + ", 4 × lumels", density=2 * SCENES[name]["density"],
        why="four times as many", cycles=(64,), slow_cycles=(256,), slow_lumel=FINE + ("quick, error 0.1", "production"))


def make_dense(path):
    """The project's own dense scene, written by make-assets (needs cargo)."""
    if shutil.which("cargo") is None:
        return "no cargo to make it with"
    r = common.run(["cargo", "run", "-q", "--release", "-p", "lumel-tests", "--bin", "make-assets", "--", "--dense", os.path.dirname(path)],
                   cwd=os.path.join(common.HERE, ".."))
    return None if r["code"] == 0 and os.path.exists(path) else r["err"][-500:]


def with_sun(scene, direction, lux, path):
    """A copy of a .glb with a directional light, so that every tool reads the same sun."""
    js, bin_ = common.read_glb(scene)
    lights = js.setdefault("extensions", {}).setdefault("KHR_lights_punctual", {}).setdefault("lights", [])
    lights.append(dict(name="sun", type="directional", color=[1.0, 1.0, 1.0], intensity=lux))
    js["extensionsUsed"] = sorted(set(js.get("extensionsUsed", [])) | {"KHR_lights_punctual"})
    # The shortest rotation of a light's default direction, −Z, into `direction`.
    d = np.array(direction, float) / np.linalg.norm(direction)
    q = np.array([*np.cross([0.0, 0.0, -1.0], d), 1.0 - d[2]])
    if q[3] < 1e-9:
        q = np.array([0.0, 1.0, 0.0, 0.0])
    js["nodes"].append(dict(name="sun", rotation=[float(x) for x in q / np.linalg.norm(q)], extensions={"KHR_lights_punctual": {"light": len(lights) - 1}}))
    js["scenes"][js.get("scene", 0)].setdefault("nodes", []).append(len(js["nodes"]) - 1)
    common.write_glb(path, js, bin_)


def read_document(path):
    """-> (json, bin) of a .glb, or of a .gltf with one buffer in a file beside it and no pictures"""
    if path.endswith(".glb"):
        return common.read_glb(path)
    with open(path) as f:
        js = json.load(f)
    if len(js.get("buffers", [])) != 1 or js.get("images"):
        raise SystemExit("%s: expected one buffer and no pictures" % path)
    with open(os.path.join(os.path.dirname(path), js["buffers"][0].pop("uri")), "rb") as f:
        return js, f.read()


def plain_document(scene, limit, path):
    """A .glb of the scene without features that programs interpret differently: reflectances are limited to `limit` (including the default material's 1),
    lamps lose their range (a window that Cycles does not have) and spots the soft rim of their cones (squared in glTF, a smooth step in Blender)."""
    js, bin_ = read_document(scene)
    for mesh in js["meshes"]:
        for p in mesh["primitives"]:
            if "material" not in p:
                if "default" not in (m.get("name") for m in js.setdefault("materials", [])):
                    js["materials"].append(dict(name="default"))
                p["material"] = next(i for i, m in enumerate(js["materials"]) if m.get("name") == "default")
    for m in js["materials"]:
        factor = m.setdefault("pbrMetallicRoughness", {}).setdefault("baseColorFactor", [1.0, 1.0, 1.0, 1.0])
        factor[:3] = [min(x, limit) for x in factor[:3]]
    for light in js.get("extensions", {}).get("KHR_lights_punctual", {}).get("lights", []):
        light.pop("range", None)
        if light["type"] == "spot":
            spot = light.setdefault("spot", {})
            spot["outerConeAngle"] = spot.get("outerConeAngle", np.pi / 4)
            # lumel keeps the two at least 1e-4 apart
            spot["innerConeAngle"] = spot["outerConeAngle"] - 2e-4
    common.write_glb(path, js, bin_)


def prepare(name, work):
    """-> (the .glb to bake, None) or (None, why it is missing)"""
    s = SCENES[name]
    path = s["file"]
    if path == "dense":
        path = os.path.join(work, "dense_room.glb")
        trouble = None if os.path.exists(path) else make_dense(path)
        if trouble:
            return None, trouble
    if not os.path.exists(path):
        return None, "no file " + path
    if "plain" in s:
        plain = os.path.join(work, name + ".glb")
        plain_document(path, s["plain"], plain)
        path = plain
    if "sun" in s:
        sunny = os.path.join(work, name + ".glb")
        with_sun(path, *s["sun"], sunny)
        path = sunny
    return path, None


def sky_options(name):
    sky = SCENES[name]["sky"]
    return [] if sky == "0,0,0" else ["--sky", sky]


def flat_atlas(name, scene, work, threads):
    """Draft bake and its flattened atlas -> (flat .glb, side of the page, the bake's files as common.bake has them)"""
    import reference
    s = SCENES[name]
    options = [*common.COMPARABLE, "--quality", "draft", "--texels-per-unit", s["density"], "--max-page", 2048, "--threads", threads] + sky_options(name)
    r = common.bake(scene, os.path.join(work, name + ".flat"), *options)
    if r["code"] != 0:
        raise SystemExit("lumel failed (%d): %s" % (r["code"], r["err"]))
    if len(r["pages"]) != 1:
        raise SystemExit("%s: %d pages, expected one" % (name, len(r["pages"])))
    flat = os.path.join(work, name + ".flat.glb")
    return flat, reference.flatten(r["glb"], flat)["res"], r


def references(name, flat, side, seconds=1.0, log=None):
    """The scene's References; `seconds` scales the limits of the table."""
    import reference
    s = SCENES[name]
    return reference.References(name, flat, side, s["count"], s["target"], 150, s["sky"], cutouts=False, log=log)


def three_truths(refs, name, scale=1.0, refine=0):
    """-> paths of the references: whole texel with black backs (lumel's definition), middle half with two-sided surfaces (that of Cycles), and the first again
    over lumels from the whole page, including chart edges.  `refine`: seconds, most of them for the first, because lumel's errors are the smallest"""
    asked = [(1.0, False, 2, 0.7), (0.5, True, 2, 0.15), (1.0, False, 0, 0.15)]
    return [refs.truth(footprint, backs, inset, seconds=limit * scale, refine=refine * share)
            for (footprint, backs, inset, share), limit in zip(asked, SCENES[name]["seconds"])]
