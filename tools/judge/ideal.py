"""What the best lightmap of that atlas would show: the part of an error that its density must have.

Texels are fitted to the view by least squares, min Σ_s |Σ_t w_st x_t − R_s|² / (R̄ + R_s)² over the
subpixels s with the bilinear weights w that the lookup has, R from the truth's pixel, by conjugate
gradients on the normal equations.  It depends on nothing but the atlas and the truth.
"""
import numpy as np
from scipy.sparse import csr_array

from . import score, view
from .truth import SIDE

STEPS = 24


def fit(texels, weights, value, count, pull):
    """texels [n, 4], weights [n, 4], value [n, 3], pull [n] -> x [count, 3]"""
    rows = np.repeat(np.arange(len(texels)), texels.shape[1])
    matrix = lambda w: csr_array((w.ravel(), (rows, texels.ravel())),       # noqa: E731
                                 shape=(len(texels), count))
    lookups, a = matrix(weights), matrix(weights * pull[:, None])
    back = a.T.tocsr()
    # Start: the mean of what looks at the texel.
    x = lookups.T @ value / np.maximum(lookups.sum(0), 1e-12)[:, None]
    r = back @ (value * pull[:, None] - a @ x)
    p, rr = r.copy(), (r * r).sum(0)
    for _ in range(STEPS):
        q = a @ p
        step = rr / np.maximum((q * q).sum(0), 1e-30)
        x, r = x + step * p, r - step * (back @ q)
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
