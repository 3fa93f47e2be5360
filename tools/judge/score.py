"""Measures of a bake's view against the truth's.

Exposure: the same for both.  The logarithmic mean of the truth's luminance, over pixels between its
10th and 90th percentile among those that have light at all, is shown as a linear 0.18; as a camera
that meters the middle of the histogram.  Tone map: Narkowicz' fit of ACES, then sRGB: what game
engines offer, and bright parts keep their differences instead of clipping.
Perceived difference: LDR-FLIP at its default 67 pixels a degree; `flip` mean, `patch` the 99th
percentile of means over 5 × 5 pixels, `patch_max` the largest.
Dark, bright: share of pixels whose luminance is less than half, or more than twice, of the truth's,
where the brighter of both is shown as 2 % of white or more (linear): below that the screen's own
reflection in a lit room, about 1 %, hides a factor of two.  `dark_line`, `bright_line`: the share
of those that form lines: in a straight run of 13 pixels in one of 16 directions, where one pixel in
four may be missing, and not in any square of 5 × 5 of them.
Backs of double-sided faces count apart, as `dark_back` and `bright_back`: both sides share lumels,
and no lightmap of one coordinate a vertex can hold the light of both.
Points: |bake − truth| / (truth + 1 % of the mean truth) of R's luminance over pixels that show one
lit surface: median, 95th percentile, root mean square.
"""
import numpy as np

from .trace import LUMINANCE

KEY, FAINT = 0.18, 0.02


def exposure(radiance):
    y = radiance.reshape(-1, 3) @ LUMINANCE
    y = y[y > 1e-6 * max(y.max(), 1e-30)]
    if not len(y):
        return 1.0
    low, high = np.percentile(y, [10, 90])
    y = np.maximum(y[(y >= low) & (y <= high)], 1e-4 * high)
    return float(KEY / np.exp(np.log(y).mean()))


def tone(x):
    """linear display value 0..1 of an exposed radiance"""
    x = np.maximum(x, 0)
    return np.clip(x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14), 0, 1)


def srgb(x):
    return np.where(x <= 0.0031308, 12.92 * x, 1.055 * np.maximum(x, 1e-9) ** (1 / 2.4) - 0.055)


def picture(radiance, exposed):
    return srgb(tone(radiance * exposed)).astype(np.float32)


def flip(truth, bake):
    """FLIP's map of two pictures"""
    import flip_evaluator
    full, mean, _ = flip_evaluator.evaluate(truth, bake, "LDR", applyMagma=False)
    full = np.asarray(full)
    return full[..., 0] if full.ndim == 3 else full


def box(a, size):
    """mean over size × size, valid part"""
    s = np.pad(np.cumsum(np.cumsum(a, 0, dtype=float), 1), ((1, 0), (1, 0)))
    return (s[size:, size:] - s[:-size, size:] - s[size:, :-size] + s[:-size, :-size]) / size ** 2


def moved(a, dx, dy):
    out = np.zeros_like(a)
    h, w = a.shape
    out[max(dy, 0):h + min(dy, 0), max(dx, 0):w + min(dx, 0)] = \
        a[max(-dy, 0):h + min(-dy, 0), max(-dx, 0):w + min(-dx, 0)]
    return out


def lines(mask, length=13, missing=3):
    """pixels of a mask that form lines (see the head)"""
    out = np.zeros_like(mask)
    if not mask.any():
        return out
    half = length // 2
    for k in range(16):
        angle = np.pi * k / 16
        c, s = np.cos(angle), np.sin(angle)
        run = [(round(t * c), round(t * s)) for t in range(-half, half + 1)]
        full = sum(moved(mask, x, y).astype(int) for x, y in run) >= length - missing
        out |= mask & np.logical_or.reduce([moved(full, -x, -y) for x, y in run])
    block = [(x, y) for x in range(-2, 3) for y in range(-2, 3)]
    solid = np.logical_and.reduce([moved(mask, x, y) for x, y in block])
    return out & ~np.logical_or.reduce([moved(solid, x, y) for x, y in block])


def radiance(v, light):
    return v["albedo"] * light + v["glow"]


def extremes(truth, bake, exposed):
    """-> dark, bright: masks"""
    t, b = truth @ LUMINANCE, bake @ LUMINANCE
    visible = tone(np.maximum(t, b) * exposed) >= FAINT
    return visible & (b < 0.5 * t), visible & (b > 2 * t)


def relative_error(v, light):
    """signed, of R's luminance; NaN where no surface fills the pixel or there is no light"""
    t, b = v["light"] @ LUMINANCE, light @ LUMINANCE
    full = v["seen"] > 0.999
    mean = t[full].mean() if full.any() else 0
    lit = full & (t > 1e-3 * mean) & (v["albedo"].max(2) > 1e-3)
    return np.where(lit, (b - t) / (t + 0.01 * mean + 1e-30), np.nan)


def compare(v, light, backs=None):
    """-> measures, pictures (truth, bake, FLIP's map); backs: mask of pixels, see the head"""
    t, b = radiance(v, v["light"]), radiance(v, light)
    e = exposure(t)
    shown = picture(t, e), picture(b, e)
    m = flip(*shown)
    patches = box(m, 5)
    dark, bright = extremes(t, b, e)
    backs = np.zeros_like(dark) if backs is None else backs
    dark_back, bright_back = dark & backs, bright & backs
    dark, bright = dark & ~backs, bright & ~backs
    error = np.abs(relative_error(v, light))
    error = error[np.isfinite(error)]
    median, high = np.percentile(error, [50, 95]) if len(error) else (0, 0)
    out = dict(flip=m.mean(), patch=np.percentile(patches, 99), patch_max=patches.max(),
               dark=dark.mean(), bright=bright.mean(), dark_back=dark_back.mean(),
               bright_back=bright_back.mean(), dark_line=lines(dark).mean(),
               bright_line=lines(bright).mean(), error_median=median, error_p95=high,
               error_rms=np.sqrt((error ** 2).mean()) if len(error) else 0)
    return {k: float(x) for k, x in out.items()}, (*shown, m)


def own_noise(v):
    """the same of one half of the truth's paths against the other: twice what the whole's noise
    adds, or more (each half has √2 of its noise)"""
    half = dict(v, light=v["half0"])
    return compare(half, v["half1"])[0]
