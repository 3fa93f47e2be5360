"""What the best lightmap of that atlas would show: the part of an error that its density must have.

Texels are fitted to the view by least squares, min Σ_s |Σ_t w_st x_t − R_s|² / (R̄ + R_s)² over the
subpixels s with the bilinear weights w that the lookup has, R from the truth's pixel, by conjugate
gradients on the normal equations.  It depends on nothing but the atlas and the truth.
"""
import numpy as np

from . import score, view
from .truth import SIDE

STEPS = 24


def fit(texels, weights, value, count, pull):
    """texels [n, 4], weights [n, 4], value [n, 3], pull [n] -> x [count, 3]"""
    w = weights * pull[:, None]

    def back(r):
        out = np.empty((count, 3))
        for c in range(3):
            out[:, c] = np.bincount(texels.ravel(), (w * r[:, c:c + 1]).ravel(), count)
        return out
    forward = lambda x: (w[..., None] * x[texels]).sum(1)       # noqa: E731
    target = value * pull[:, None]
    weight = np.bincount(texels.ravel(), weights.ravel(), count)[:, None]
    x = np.empty((count, 3))
    for c in range(3):
        x[:, c] = np.bincount(texels.ravel(), (weights * value[:, c:c + 1]).ravel(), count)
    x /= np.maximum(weight, 1e-12)                  # start: the mean of what looks at the texel
    r = back(target - forward(x))
    p, rr = r.copy(), (r * r).sum(0)
    for _ in range(STEPS):
        q = forward(p)
        step = rr / np.maximum((q * q).sum(0), 1e-30)
        x, r = x + step * p, r - step * back(q)
        new = (r * r).sum(0)
        p, rr = r + new / np.maximum(rr, 1e-30) * p, new
    return np.maximum(x, 0)


def light(baked, hit, v, width):
    """as view.shown, of the fitted lightmap"""
    h = v["albedo"].shape[0]
    value = np.repeat(v["light"].reshape(h * width, 3), SIDE * SIDE, 0).astype(float)
    out = np.zeros_like(value)
    for uri, which, texels, weights in baked.lookups(hit):
        if not len(which):
            continue
        used, small = np.unique(texels, return_inverse=True)
        small = small.reshape(texels.shape)
        r = value[which]
        y = r.mean(1)
        x = fit(small, weights, r, len(used), 1 / (y + 0.05 * y.mean() + 1e-30))
        out[which] = (x[small] * weights[..., None]).sum(1)
    return view.shown(out.astype(np.float32), hit, v, width)


def measures(baked, hit, v, width):
    m = score.compare(v, light(baked, hit, v, width))[0]
    return {"best_" + k: m[k] for k in ("flip", "patch", "dark", "bright", "dark_line",
                                        "bright_line")}
