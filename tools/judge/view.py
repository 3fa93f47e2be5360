"""A bake as an engine shows it: albedo · R + emission, R looked up in the pages as a GPU does.

The baked .glb is read anew and hit by the same rays as the level; what it is lit by are its nodes'
extras.lightmap and the EXR pages.  Backs of single-sided faces are black, and so is what has no
lightmap.  Albedo and emission are the truth's, so that only light can differ.
"""
import os

import numpy as np

from . import scene as scenes
from .trace import Tracer, mi
from .truth import SIDE, primary, size_of


def read_exr(path):
    """[h, w, 3] float32, row 0 at the top"""
    for name, bitmap in mi.Bitmap(path).split():
        if name in ("<root>", ""):
            break
    else:
        bitmap = mi.Bitmap(path)
    a = np.array(bitmap, np.float32)
    return np.repeat(a[..., None], 3, 2) if a.ndim == 2 else np.ascontiguousarray(a[..., :3])


def taps(shape, uv):
    """the four texels of a bilinear lookup, clamped at the border -> indices, weights [n, 4]"""
    h, w = shape[:2]
    x, y = uv[:, 0] * w - 0.5, uv[:, 1] * h - 0.5
    x0, y0 = np.floor(x), np.floor(y)
    fx, fy = x - x0, y - y0
    column = [np.clip(x0 + i, 0, w - 1).astype(np.int64) for i in (0, 1)]
    row = [np.clip(y0 + i, 0, h - 1).astype(np.int64) for i in (0, 1)]
    index = np.stack([row[j] * w + column[i] for j in (0, 1) for i in (0, 1)], 1)
    weight = np.stack([b * a for b in (1 - fy, fy) for a in (1 - fx, fx)], 1)
    return index, weight


class Baked:
    """a finished bake in a folder"""

    def __init__(self, glb):
        self.scene = scenes.load(glb, images=True)
        self.tracer = Tracer(self.scene)
        self.places, self.pages = {}, {}
        folder = os.path.dirname(glb)
        for number, extras in enumerate(self.scene.extras):
            said = extras.get("lightmap")
            for copy, place in enumerate(said if isinstance(said, list) else [said]):
                if place:
                    self.places[number, copy] = place
                    if place["uri"] not in self.pages:
                        self.pages[place["uri"]] = read_exr(os.path.join(folder, place["uri"]))

    def lookups(self, hit):
        """where each subpixel looks: list of (page, subpixels, texels [n, 4], weights [n, 4])"""
        shows = np.flatnonzero(hit["shows"].numpy())
        triangle = hit["triangle"].numpy()[shows]
        b = hit["uv"].numpy().T[shows]
        b = np.stack([1 - b[:, 0] - b[:, 1], b[:, 0], b[:, 1]], 1)
        # A place of each node, page by page
        owner = np.stack([self.scene.node, self.scene.instance], 1)
        whose, at = np.unique(owner, axis=0, return_inverse=True)
        at = at.ravel()[triangle]
        rows = [self.places.get(tuple(int(x) for x in o)) for o in whose]
        page = np.array([r["uri"] if r else "" for r in rows])
        offset = np.array([r.get("offset", [0, 0]) if r else [0, 0] for r in rows], float)
        scale = np.array([r.get("scale", [1, 1]) if r else [1, 1] for r in rows], float)
        corner = self.scene.uv[1][triangle]
        uv = (corner * b[..., None]).sum(1) * scale[at] + offset[at]
        out = []
        for uri, image in self.pages.items():
            mine = (page[at] == uri) & np.isfinite(uv).all(1)
            out.append((uri, shows[mine], *taps(image.shape, uv[mine])))
        return out

    def light(self, hit, pages=None):
        """R [n, 3] of each subpixel, 0 where there is no lightmap"""
        out = np.zeros((len(hit["shows"].numpy()), 3), np.float32)
        for uri, which, texels, weights in self.lookups(hit):
            flat = (pages or self.pages)[uri].reshape(-1, 3)
            out[which] = (flat[texels] * weights[..., None]).sum(1)
        return out

    def hits(self, camera, width):
        return primary(self.tracer, camera, *size_of(camera, width))


def shown(light, hit, reference, width):
    """Σ albedo R / Σ albedo of each pixel, as the truth's `light`"""
    h = reference["albedo"].shape[0]
    albedo = hit["albedo"].numpy().T
    total = (albedo * light).reshape(h, width, SIDE * SIDE, 3).sum(2)
    under = albedo.reshape(h, width, SIDE * SIDE, 3).sum(2)
    return np.where(under > 1e-6, total / np.maximum(under, 1e-6), 0).astype(np.float32)


def backs(hit, v, width):
    """pixels some of whose subpixels show the back of a double-sided face"""
    mask = hit["shows"].numpy() & hit["back"].numpy()
    return mask.reshape(v["seen"].shape[0], width, SIDE * SIDE).any(2)
