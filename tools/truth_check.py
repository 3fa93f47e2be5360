"""Known answers for truth.py, and with --cycles for cycles_peer.py.

Usage : python truth_check.py [--cycles]
Scenes: written as .glb: a floor whose middle is asked, under lamps, panes and glowing sheets; and the
        project's furnaces, closed rooms whose irradiance is π × emission / (1 − reflectance).
Output: a line for each: what is expected, what was found, its standard error; the exit code is 1 if a
        difference is above 4 standard errors and the known deviation. Cycles gives no standard error:
        the mean over the floor's middle is held to 1 %.
"""
import argparse
import os
import sys
import tempfile

import numpy as np

import common
import truth
from judge import scene as scenes

RED = np.array([0.8, 0.4, 0.1])
DOWN = [-np.sqrt(0.5), 0, 0, np.sqrt(0.5)]      # turns −Z into −Y
ABOVE = 2.0                                     # height of lamps, metres
CLOSED = 10 / ABOVE ** 2                        # lux of one of 10 candela, I / d²
# A sheet of 600 m at a height of 1 m leaves out what comes from below 0.19° above the horizon.
WIDE, ROUNDING = 300.0, 1.2e-5


def material(base=(0, 0, 0), alpha=1.0, mode="OPAQUE", transmission=0.0, glow=0.0, limit=1.0):
    return dict(doubleSided=True, alphaMode=mode, pbrMetallicRoughness=dict(baseColorFactor=[*map(float, base), alpha]),
                extras=dict(lumel=dict(maxReflectance=limit)), emissiveFactor=[1.0 * (glow > 0)] * 3,
                extensions=dict(KHR_materials_emissive_strength=dict(emissiveStrength=glow),
                                KHR_materials_transmission=dict(transmissionFactor=transmission)))


def lamp(kind="point", intensity=10.0, spot=None, **hints):
    more = {k: hints.pop(k) for k in ("range",) if k in hints}
    return dict(type=kind, intensity=intensity, **more, **(dict(spot=spot) if spot else {}), extras=dict(lumel=hints))


def write(path, sheets, lamps=()):
    """sheets: (height, half its side, material); the first is the floor, and has TEXCOORD_1"""
    data, js = b"", dict(asset=dict(version="2.0"), scene=0, meshes=[], nodes=[], materials=[], accessors=[], bufferViews=[])

    def accessor(a):
        nonlocal data
        js["bufferViews"].append(dict(buffer=0, byteOffset=len(data), byteLength=4 * a.size))
        js["accessors"].append(dict(bufferView=len(js["bufferViews"]) - 1, componentType=5126, count=len(a),
                                    type="VEC%d" % a.shape[1], min=a.min(0).tolist(), max=a.max(0).tolist()))
        data += a.astype("<f4").tobytes()
        return len(js["accessors"]) - 1
    for i, (height, half, m) in enumerate(sheets):
        uv = np.array([[0, 0], [0, 1], [1, 1], [0, 0], [1, 1], [1, 0]], float)
        corners = np.stack([(2 * uv[:, 0] - 1) * half, np.full(6, height), (2 * uv[:, 1] - 1) * half], 1)
        at = dict(POSITION=accessor(corners), **(dict(TEXCOORD_1=accessor(uv)) if i == 0 else {}))
        js["meshes"].append(dict(primitives=[dict(attributes=at, material=i)]))
        js["nodes"].append(dict(mesh=i))
        js["materials"].append(m)
    for i, _ in enumerate(lamps):
        js["nodes"].append(dict(translation=[0, ABOVE, 0], rotation=DOWN, extensions=dict(KHR_lights_punctual=dict(light=i))))
    if lamps:
        js["extensions"] = dict(KHR_lights_punctual=dict(lights=list(lamps)))
    js["scenes"], js["buffers"] = [dict(nodes=list(range(len(js["nodes"]))))], [dict(byteLength=len(data))]
    common.write_glb(path, js, data)


def cases():
    """(name, sheets, lamps, sky, expected, whether Cycles has it)"""
    # Cycles' map is light ÷ reflectance: it needs a floor that reflects. Nothing returns its light.
    floor, wide, point = (0, 5, material(RED)), (0, WIDE, material(RED)), [lamp()]
    pane = lambda m, half=5.0: (1.0, half, m)      # noqa: E731
    quarter = material(alpha=0.25, mode="BLEND")
    glass = material(RED, 0.5, "BLEND", 0.7, limit=0.0)
    soft = dict(innerConeAngle=0.0, outerConeAngle=np.pi / 3)
    one = np.ones(3)
    return [
        ("point lamp", [floor], point, 0, CLOSED * one, True),
        ("spot, its axis", [floor], [lamp("spot", spot=soft)], 0, CLOSED * one, True),
        ("pane of alpha 0.25", [floor, pane(quarter)], point, 0, 0.75 * CLOSED * one, True),
        ("two panes of alpha 0.25", [floor, pane(quarter), (1.5, 5, quarter)], point, 0, 0.75 ** 2 * CLOSED * one, True),
        ("glass τ = 0.7, coloured", [floor, pane(material(RED, transmission=0.7, limit=0.0))], point, 0, 0.7 * RED * CLOSED, True),
        ("BLEND glass α = 0.5, τ = 0.7", [floor, pane(glass)], point, 0, (0.5 + 0.35 * RED) * CLOSED, True),
        ("mask below its cutoff", [floor, pane(material(alpha=0.4, mode="MASK"))], point, 0, CLOSED * one, True),
        ("sphere lamp r = 0.5", [floor], [lamp(radius=0.5)], 0, CLOSED * one, True),
        ("sphere lamp r = 1.9", [floor], [lamp(radius=1.9)], 0, CLOSED * one, False),
        ("sun of 20°", [floor], [lamp("directional", 3.0, angle=20.0)], 0, 3 * one, True),
        ("range of 3", [floor], [lamp(range=3.0)], 0, (1 - (ABOVE / 3) ** 4) * CLOSED * one, False),
        ("sky", [floor], [], 2, 2 * np.pi * one, True),
        ("sky through BLEND glass", [wide, pane(glass, WIDE)], [], 1, (0.5 + 0.35 * RED) * np.pi, True),
        ("glowing glass τ = 1, α = 0.5", [wide, pane(material(RED, 0.5, "BLEND", 1.0, 2.0, 0.0), WIDE)], [], 0, np.pi * one, True),
        ("furnace, ρ = 0.99 held to 0.5", [(h, WIDE, material(0.99 * one, glow=1, limit=0.5)) for h in (0, 1)], [], 0, 2 * np.pi * one, True),
    ]


def main():
    ap = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ap.add_argument("--cycles", action="store_true")
    a = ap.parse_args()
    fine = True

    def say(name, want, found, error, good):
        nonlocal fine
        fine &= bool(good)
        print("%-32s want %s  found %s  ± %s  %s" % (name, np.round(want, 5), np.round(found, 5), np.round(error, 6), "ok" if good else "WRONG"), flush=True)

    with tempfile.TemporaryDirectory() as folder:
        path = os.path.join(folder, "case.glb")
        for name, sheets, lamps, sky, want, in_cycles in cases():
            write(path, sheets, lamps)
            if a.cycles:
                import cycles_peer
                if in_cycles:
                    found = np.pi * cycles_middle(cycles_peer, path, folder, sheets[0][1], sky)
                    say(name, want, found, 0 * want, np.abs(found - want).max() < 0.01 * want.max())
                continue
            level = scenes.load(path)
            level.sky = np.full(3, float(sky))
            tracer = truth.tracer_of(level)
            e = truth.light(tracer, np.zeros((1, 3)), np.array([[0.0, 1, 0]]), paths=1 << 17)
            # The receiver is `eps` off the floor, nearer to the lamp: by that share I / d² grows, d = 2,
            # and 1.5 times as much with the window of the range.
            near = 1.5 * float(tracer.eps[0]) * (sky == 0) + ROUNDING
            say(name, want, e["irradiance"][0], e["stderr"][0], (np.abs(e["irradiance"][0] - want) <= 4 * e["stderr"][0] + near * want).all())
    import lumels
    for name, rho in (("furnace_cube_50", 0.5), ("furnace_cube_90", 0.9), ("furnace_nonconvex_90", 0.9)) if not a.cycles else ():
        level = scenes.load(os.path.join(common.HERE, "..", "assets", name + ".glb"))
        p = lumels.points(level, 50)
        e = truth.light(truth.tracer_of(level), p["position"], p["normal"], paths=1 << 14)
        want = np.pi * max((m.emissive for m in level.materials), key=sum) / (1 - rho)
        error = np.sqrt((e["stderr"] ** 2).mean(0) / len(e["stderr"]))
        found = e["irradiance"].mean(0)
        say(name, want, found, error, (np.abs(found - want) <= 4 * error + 2e-4 * want).all())
    sys.exit(0 if fine else 1)


def cycles_middle(peer, path, folder, half, sky):
    """mean of Cycles' map over the floor's middle: 16 lumels of 3 cm if it is 10 m wide, each of which would see a lamp I / d² to 1e-4"""
    side = 332 if half == 5 else 64
    r = peer.bake(path, folder, side, 1024 if side == 64 else 256, os.cpu_count(), "%g,%g,%g" % (sky, sky, sky))
    k = side // 2 - 2
    return common.read_exr(r["map"])[k:k + 4, k:k + 4].mean((0, 1))


if __name__ == "__main__":
    main()
