"""Path-traced references of one atlas, cached on disk, and the error of a map against them.

A reference is an .npz of truth.py at lumels drawn by lumels.py. Its file name under LUMEL_REF
depends on everything that determines the answer: the content of the flattened scene (triangles,
normals, lightmap coordinates, colours, materials, images, lamps; see scene_digest), the page's
side, the chosen lumels and their footprint, the treatment of back faces, the sky, and the requested
precision. It does not depend on lightmap values, version or file layout, so a bake of another
quality finds the same references. It also does not depend on the time limit: an interrupted
reference stays usable, states its own noise ("own"), and can be improved later (refine).
"""
import hashlib
import os

import numpy as np

import common
import lumels
import truth
from judge import scene as scenes

LUMINANCE = truth.LUMINANCE
MODEL = "lumels 1, " + truth.MODEL      # increase when lumels.py draws others
# points along a lumel's side: the position of an edge across it is known to about 0.25 % of its
# area. Where all lumels are chosen, memory allows fewer.
SUB, SUB_OF_ALL = 32, 8
# a lumel is lit if its reference exceeds this share of the mean; darker ones have no meaningful
# relative error
LIT = 1e-3


def scene_digest(path):
    """Short hash of what a path tracer would see in a scene."""
    s = scenes.load(path)
    h = hashlib.sha256()
    for a in [s.corners, s.normals, *s.uv, s.colours, s.material, *(s.images[i] for i in sorted(s.images))]:
        h.update(str(a.shape).encode() + np.ascontiguousarray(a).tobytes())
    h.update(repr([[sorted((k, str(v)) for k, v in vars(x).items()) for x in s.materials + s.lamps]]).encode())
    return h.hexdigest()[:16]


class References:
    """The references of one flattened scene.

    flat     .glb of flatten_lightmap.py;  side: its page, texels;  name: for file names
    count    lumels drawn;  target: median relative standard error;  seconds: limit for each reference
    cutouts  False leaves out lumels on alpha-masked materials (a peer that writes 0 where the surface is cut away)
    lift     see truth.py"""

    def __init__(self, name, flat, side, count=2000, target=0.002, seconds=150, sky="0,0,0", cutouts=True, lift=5e-6, log=None):
        self.name, self.flat, self.side, self.count, self.target, self.seconds, self.sky = name, flat, side, count, target, seconds, sky
        self.cutouts, self.lift, self.log = cutouts, lift, log or (lambda s: None)
        self.digest, self._scene = scene_digest(flat), None
        os.makedirs(common.REF, exist_ok=True)

    @property
    def scene(self):
        if self._scene is None:
            self._scene = scenes.load(self.flat, images=False)
        return self._scene

    def truth(self, footprint=1.0, two_sided=True, inset=2, every=False, region=None, target=None, seconds=None, refine=0):
        """-> path of the reference, which is created if missing, and otherwise improved by `refine` seconds of further paths.

        footprint  share of a texel's side to average over;  inset: see lumels.py;  every: all covered lumels instead of a random selection
        region     only lumels with row0 ≤ row < row1 and col0 ≤ col < col1"""
        target = target or self.target
        asked = (MODEL, self.digest, self.side, "all" if every else self.count, 0 if every else inset, footprint, two_sided, target, self.sky, self.cutouts, self.lift, region)
        path = os.path.join(common.REF, "%s-%s.npz" % (self.name, common.digest(" ".join(map(str, asked)))))
        points = path + ".lumels.npz"
        if not os.path.exists(path):
            masked = np.array([m.alpha_mode == "MASK" for m in self.scene.materials])[self.scene.material]

            def keep(texel, triangle):
                low, high = (0, 0), (self.side, self.side)
                if region:
                    low, high = region[0::2], region[1::2]
                return ((texel >= low) & (texel < high)).all(1) & (self.cutouts | ~masked[triangle])
            drawn = lumels.draw(self.scene, self.side, 0 if every else self.count, 0 if every else inset, footprint, SUB_OF_ALL if every else SUB, keep)
            if not len(drawn["texel"]):
                raise SystemExit("%s: no lumel to compare" % self.name)
            np.savez(points, **drawn)
            new = self._trace(points, path, two_sided, 0, seconds or self.seconds, target)
            new["paths"], new["parts"] = np.full(len(new["texel"]), int(new["paths"])), 1
            self._keep(path, new)
        else:
            while refine > 0:
                self._refine(path, points, two_sided, min(refine, 60))
                refine -= 60
        return path

    def _trace(self, points, path, two_sided, seed, seconds, target):
        common.tool("truth.py", self.flat, points, path + ".part.npz", *(["--two-sided"] if two_sided else []), "--target", target,
                    "--paths", 1 << 24, "--time", seconds, "--sky", self.sky, "--seed", seed, "--lift", self.lift)
        new = load(path + ".part.npz")
        os.remove(path + ".part.npz")
        return new

    def _keep(self, path, ref):
        np.savez_compressed(path + ".new.npz", **ref)
        os.replace(path + ".new.npz", path)
        self.log("reference %s: %d lumels, %d to %d paths each, own noise %.3f %%, median %.3f %%, %.0f s in all" % (
            os.path.basename(path), len(ref["texel"]), ref["paths"].min(), ref["paths"].max(), 100 * own(ref),
            100 * np.median(relative_noise(ref)[lit(ref)]), float(ref["seconds"])))

    def _refine(self, path, points, two_sided, seconds):
        """Further paths for the lumels whose relative standard error is above half the root mean square of all, which a few
        difficult lumels dominate. Choosing lumels by the noise of their own earlier paths biases them by at most a part of their standard error."""
        ref, z = load(path), load(points)
        some = relative_noise(ref) > 0.5 * own(ref)
        np.savez(path + ".some.npz", **{k: v[some] if v.ndim and len(v) == len(some) else v for k, v in z.items()})
        new = self._trace(path + ".some.npz", path, two_sided, int(ref["parts"]), seconds, 0.0)
        os.remove(path + ".some.npz")
        self._keep(path, merge(ref, some, new))

    def reflecting(self, ref):
        """mask of a reference's lumels on materials that reflect anything: Cycles' map is light ÷ reflectance and holds 0 on black ones"""
        return np.array([m.base[:3].max() > 0 for m in self.scene.materials])[self.scene.material][ref["triangle"]]


def merge(ref, some, new):
    """A reference with independent further paths for the lumels `some`, weighted by their numbers."""
    if (ref["texel"][some] != new["texel"]).any():
        raise ValueError("references of different lumels")
    out = {k: v.copy() for k, v in ref.items()}
    m = float(new["paths"])
    for k, square in (("irradiance", False), ("stderr", True), ("stderr_y", True)):
        n = ref["paths"][some].astype(float).reshape(-1, *[1] * (ref[k].ndim - 1))
        a, b = n * ref[k][some], m * new[k]
        out[k][some] = (np.hypot(a, b) if square else a + b) / (n + m)
    out["paths"][some] += int(new["paths"])
    for k in ("seconds", "lost"):
        out[k] = ref[k] + new[k]
    out["parts"] = ref["parts"] + 1
    return out


def load(path):
    return dict(np.load(path))


def lit(ref):
    y = ref["irradiance"] @ LUMINANCE
    return y > LIT * y.mean()


def relative_noise(ref):
    """standard error of each lumel relative to (its reference + 0.01 mean), the weighting of `lumel diff`; 0 if it is not lit"""
    y, on = ref["irradiance"] @ LUMINANCE, lit(ref)
    return np.where(on, ref["stderr_y"] / (y + 0.01 * y[on].mean()), 0.0)


def own(ref):
    """relRMSE that the reference's own noise would give over its lit lumels"""
    return float(np.sqrt(np.mean(relative_noise(ref)[lit(ref)] ** 2)))


def clear(ref, other):
    """Lit lumels through which no shadow or contact edge runs: those where two sampling rules agree within 10 % and 5 standard errors."""
    y, z, s = ref["irradiance"] @ LUMINANCE, other["irradiance"] @ LUMINANCE, np.hypot(ref["stderr_y"], other["stderr_y"])
    return lit(ref) & (np.abs(y - z) <= 0.1 * np.maximum(y, z) + 5 * s)


def values(ref, exr):
    """luminance of irradiance at a reference's lumels, in a map of E/π and in the reference"""
    return common.read_exr(exr)[tuple(ref["texel"].T)] @ LUMINANCE * np.pi, ref["irradiance"] @ LUMINANCE


def signed(ref, exr):
    """(x − ref)/(ref + 0.01 mean ref) of every lumel of a reference, on luminance"""
    x, y = values(ref, exr)
    return (x - y) / (y + 0.01 * y.mean())


def errors(ref, exr, keep=None):
    """the figures of `lumel diff` for a map (E/π) over the lumels `keep` (default: all in the reference): relRMSE; p50, p95, p99 and max of the
    absolute relative error; bias of the mean; own, the relRMSE that the reference's noise would give; and relRMSE_se: the standard error of
    relRMSE from the random choice of lumels (a few bad lumels dominate a root mean square)"""
    keep = np.ones(len(ref["irradiance"]), bool) if keep is None else keep
    kept = {k: ref[k][keep] for k in ("texel", "irradiance", "stderr_y")}
    (x, y), error = values(kept, exr), np.abs(signed(kept, exr))
    square = error ** 2
    rms = float(np.sqrt(square.mean()))
    p50, p95, p99 = np.percentile(error, [50, 95, 99])
    return dict(relRMSE=rms, relRMSE_se=float(square.std() / (2 * np.sqrt(len(square)) * max(rms, 1e-150))), p50=float(p50), p95=float(p95), p99=float(p99),
                max=float(error.max()), bias=float(x.mean() / y.mean() - 1), own=float(np.sqrt(np.mean((kept["stderr_y"] / (y + 0.01 * y.mean())) ** 2))), n=len(y))


def flatten(baked, flat):
    """flatten_lightmap.py -> its JSON line"""
    return common.tool("flatten_lightmap.py", baked, flat)
