"""Blotches: the error that is neither grain nor tint, on flat open surfaces.

Pixels that show one lit surface are put into a grid of lumels on their plane (planes by normal and
distance; lumels by the bake's density).  e, the signed relative error of R's luminance, is clipped
to ±1 and averaged in each cell.  Two normalised Gaussians, σ = 0.75 and 6 lumels, halve waves of 4
and of 32 lumels (σ = 0.187 λ); their difference keeps what lies between.  Cells count where at
least 0.6 of the narrow Gaussian's weight and 0.5 of the wide one's has pixels: far from edges.
The figure is the root mean square over those cells, weighed by their pixels.
"""
import numpy as np

from . import score
from .truth import SIDE

NARROW, WIDE = 0.75, 6.0
LARGEST = 1500              # cells along a side of a plane; coarser beyond


def blur(a, sigma):
    reach = int(np.ceil(3 * sigma))
    k = np.exp(-0.5 * (np.arange(-reach, reach + 1) / sigma) ** 2)
    k /= k.sum()
    for axis in (0, 1):
        a = np.apply_along_axis(np.convolve, axis, a, k, "same") if min(a.shape) > 2 * reach else \
            np.apply_along_axis(lambda x: np.convolve(x, k, "full")[reach:-reach], axis, a)
    return a


def measure(tracer, level, hit, v, light, density):
    """density: lumels a metre -> root mean square, or nan where nothing is flat and open"""
    h, w = v["seen"].shape
    e = np.clip(score.relative_error(v, light).ravel(), -1, 1)
    first = np.arange(h * w) * SIDE * SIDE
    triangle = hit["triangle"].numpy()[first]
    p = hit["p"].numpy().T[first]
    a, b, c = (level.corners[triangle][:, i] for i in range(3))
    n = np.cross(b - a, c - a)
    n /= np.maximum(np.linalg.norm(n, axis=1, keepdims=True), 1e-30)
    use = np.isfinite(e) & ~level.curved[triangle]
    offset = ((a - tracer.centre) * n).sum(1)
    key = np.round(np.concatenate([n * 50, offset[:, None] * 50], 1)).astype(np.int64)
    _, plane = np.unique(key, axis=0, return_inverse=True)
    plane = plane.ravel()
    total, weight = 0.0, 0.0
    for i in np.flatnonzero(np.bincount(plane[use]) > 200):
        mine = use & (plane == i)
        normal = n[mine][0]
        x = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
        x /= np.linalg.norm(x)
        at = np.stack([p[mine] @ x, p[mine] @ np.cross(normal, x)], 1) * density
        at -= at.min(0)
        if at.max() > LARGEST:
            continue
        cell = at.astype(int)
        size = cell.max(0) + 1
        flat = cell[:, 0] * size[1] + cell[:, 1]
        count = np.bincount(flat, minlength=size.prod()).astype(float)
        mean = np.bincount(flat, e[mine], size.prod()) / np.maximum(count, 1)
        there = (count > 0).astype(float).reshape(size)
        mean, count = mean.reshape(size), count.reshape(size)
        n1, n2 = blur(there, NARROW), blur(there, WIDE)
        band = blur(mean, NARROW) / np.maximum(n1, 1e-9) - blur(mean, WIDE) / np.maximum(n2, 1e-9)
        ok = (n1 > 0.6) & (n2 > 0.5) & (there > 0)
        total += (band[ok] ** 2 * count[ok]).sum()
        weight += count[ok].sum()
    return float(np.sqrt(total / weight)) if weight else float("nan")
