"""Bakes levels with the add-on, headless, and compares the result with Cycles.

    LUMEL=target/release/lumel python check_addon.py OUTDIR [CASE ...]

Needs the module bpy (exit code 77 without it). For each kind of light, the test builds the
level, presses *Bake*, renders both the level itself and the scene that shows the bake, and
compares blocks of pixels. The median ratio must be within 1 % (issue 26). On exit code 1, the
output says what differs.
"""

import os
import sys

try:
    import bpy
    import numpy as np
except ImportError as e:
    print(f"no module: {e}")
    sys.exit(77)

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path[:0] = [HERE, os.path.join(HERE, "..")]
import level  # noqa: E402
import lumel  # noqa: E402

# Paths per pixel: blocks of 64 pixels then have 16384, and the noise of a block is below 1 %.
SAMPLES = 256
BLOCK = 8
# The limit of issue 26.
MEDIAN = 0.01


def picture(scene, samples, path):
    scene.cycles.samples = samples
    scene.render.filepath = path
    bpy.ops.render.render(write_still=True, scene=scene.name)
    image = bpy.data.images.load(path)
    image.colorspace_settings.name = "Non-Color"
    w, h = image.size
    pixels = np.array(image.pixels[:], dtype=np.float64).reshape(h, w, 4)[::-1, :, :3]
    bpy.data.images.remove(image)
    return pixels


def blocks(pixels):
    h, w, _ = pixels.shape
    y = pixels @ [0.2126, 0.7152, 0.0722]
    return y.reshape(h // BLOCK, BLOCK, w // BLOCK, BLOCK).mean(axis=(1, 3))


def compare(ours, cycles):
    """Median ratio and its spread over blocks that are not lamps and not black."""
    a, b = blocks(ours), blocks(cycles)
    lit = b > 0.02 * np.median(b[b > 0])
    ratio = a[lit] / b[lit]
    return np.median(ratio), np.percentile(ratio, [5, 95]), int(lit.sum())


def check(case, folder):
    scene = level.build(case)
    lumel.register()
    try:
        scene.lumel.output = os.path.join(folder, case)
        scene.lumel.quality = "preview"
        assert bpy.ops.lumel.bake() == {"FINISHED"}, "the bake failed"
        baked = bpy.context.window.scene
        assert baked.name == "level (baked)" and baked != scene
        cycles = picture(scene, SAMPLES, os.path.join(folder, f"{case}.cycles.exr"))
        # Only emission: one sample has no noise except at edges.
        ours = picture(baked, 16, os.path.join(folder, f"{case}.lumel.exr"))
    finally:
        lumel.unregister()
    np.savez_compressed(os.path.join(folder, f"{case}.npz"), cycles=cycles, ours=ours)
    median, (low, high), count = compare(ours, cycles)
    print(f"RATIO {case:9} median {median:.4f}, 5 to 95 %: {low:.3f} to {high:.3f}, {count} blocks")
    return abs(median - 1) <= MEDIAN


def main():
    folder = os.path.abspath(sys.argv[1])
    os.makedirs(folder, exist_ok=True)
    wrong = [case for case in sys.argv[2:] or level.CASES if not check(case, folder)]
    for case in wrong:
        print(f"problem: {case}: the median differs by more than {MEDIAN:.0%}")
    sys.exit(1 if wrong else 0)


main()
