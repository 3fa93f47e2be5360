"""Path-traced references of one atlas, cached on disk, and the error of a map against them.

A reference is an .npz of truth.py at lumels chosen by texels.py. Its file name under LUMEL_REF
depends on everything that determines the answer: the content of the flattened scene (triangles,
normals, lightmap coordinates, colours, materials, images, lights; see scene_digest), the page's
side, the chosen lumels and their footprint, the treatment of back faces, the sky, and the requested
precision. It does not depend on lightmap values, version or file layout, so a bake of another
quality finds the same references. It also does not depend on the time limit: an interrupted
reference stays usable, states its own noise ("own"), and can be improved later with refine().
"""
import hashlib
import json
import os
import sys

import numpy as np

import common

sys.path.insert(0, common.SHARED)
try:
    import gltf_scene   # noqa: E402
except ModuleNotFoundError:
    # only scripts that read no scene, such as speed_error.py --page-only, work without it
    gltf_scene = None

# points along a lumel's side: the position of an edge across it is known to about 0.25 % of its
# area
SUB = 32
# a lumel is lit if its reference exceeds this share of the mean; darker ones have no meaningful
# relative error
LIT = 1e-3
_KEEP = ("texel", "irradiance", "stderr")


def scene_digest(path):
    """Short hash of what a path tracer would see in a scene."""
    sc = gltf_scene.load(path)
    h = hashlib.sha256()
    for a in [sc.tri, sc.nrm, *sc.uv, sc.col, sc.mat, *[i for i in sc.images if i is not None]]:
        h.update(str(a.shape).encode() + np.ascontiguousarray(a).tobytes())
    plain = lambda x: np.asarray(x).tolist()      # noqa: E731
    h.update(json.dumps([[{k: v for k, v in m.items() if k != "name"} for m in sc.materials], sc.lights], sort_keys=True, default=plain).encode())
    return h.hexdigest()[:16]


class References:
    """The references of one flattened scene.

    flat     .glb of flatten_lightmap.py;  side: its page, texels;  name: for file names
    count    lumels drawn (texels.py, seed 0);  target: median relative standard error;  seconds: limit for each reference
    cutouts  False leaves out lumels on alpha-masked materials (a peer that writes 0 where the surface is cut away)
    made     seconds spent on new references so far"""

    def __init__(self, name, flat, side, count=2000, target=0.002, seconds=150, sky="0,0,0", cutouts=True, log=None):
        self.name, self.flat, self.side, self.count, self.target, self.seconds, self.sky = name, flat, side, count, target, seconds, sky
        self.cutouts, self.log, self.made = cutouts, log or (lambda s: None), 0.0
        self.digest, self._base = scene_digest(flat), None
        os.makedirs(common.REF, exist_ok=True)

    def path(self, footprint, backface, inset, every, region, target):
        asked = [self.digest, self.side, "all" if every else self.count, inset, footprint, backface, target or self.target, self.sky, self.cutouts, "seed 0", "jittered %d" % self.sub(every)]
        key = common.digest(" ".join(str(x) for x in (asked + [region] if region else asked)))
        return os.path.join(common.REF, "%s-%s.npz" % (self.name, key))

    def sub(self, every):
        """points along a lumel's side; texels.py allocates memory for those of the whole page, 9 GB for 32 points on 512²"""
        return 8 if every else SUB if self.side <= 640 else SUB // 2

    def truth(self, footprint=1.0, backface="twosided", inset=2, every=False, region=None, target=None, seconds=None, refine=0):
        """-> path of the reference, which is created if missing, and otherwise improved by `refine` seconds of further paths.

        footprint  share of a texel's side to average over;  inset: see texels.py;  every: all covered lumels (inset 0) instead of a random selection
        region     only lumels with row0 ≤ row < row1 and col0 ≤ col < col1"""
        path = self.path(footprint, backface, inset, every, region, target)
        lumels = path + ".texels.npz"
        if os.path.exists(path):
            if refine:
                self._refine(path, lumels, backface, refine)
            return path
        common.tool("texels.py", self.flat, lumels, "--res", self.side, "--count", self.count, "--inset", inset, "--footprint", footprint, "--sub", self.sub(every),
                    *(["--all"] if every else []))
        self._drop(lumels, region)
        jitter(lumels)
        new = self._trace(lumels, path, backface, 0, seconds or self.seconds, target or self.target)
        new["paths"], new["parts"] = np.full(len(new["texel"]), int(new["spp"])), 1
        self._keep(path, new)
        return path

    def _trace(self, lumels, path, backface, seed, seconds, target):
        # As many strata per point and batch as fit into a launch: the error falls faster than with the number of paths.
        batch = 1 << max(6, min(12, int(np.log2((1 << 20) / max(1, len(load(lumels)["texel"]))))))
        said = common.tool("truth.py", self.flat, lumels, path + ".part.npz", "--area", "--backface", backface, "--target", target,
                           "--spp", 1 << 22, "--batch", batch, "--time", seconds, "--sky", self.sky, "--seed", seed)
        self.made += said["seconds"]
        new = dict(np.load(path + ".part.npz"))
        os.remove(path + ".part.npz")
        return new

    def _keep(self, path, ref):
        np.savez_compressed(path + ".new.npz", **ref)
        os.replace(path + ".new.npz", path)
        self.log("reference %s: %d lumels, %d to %d paths each, own noise %.3f %%, %.0f s in all" % (
            os.path.basename(path), len(ref["texel"]), ref["paths"].min(), ref["paths"].max(), 100 * own(ref), float(ref["seconds"])))

    def _refine(self, path, lumels, backface, seconds):
        """Rounds of at most a minute for the lumels whose relative standard error is above half the root mean square of all, which a few
        difficult lumels dominate. Choosing lumels by the noise of their own earlier paths biases them by at most a part of their standard error."""
        while seconds > 0:
            ref, z = load(path), load(lumels)
            some = relative_noise(ref) > 0.5 * own(ref)
            np.savez(path + ".some.npz", **{k: v[some] if v.ndim and len(v) == len(some) else v for k, v in z.items()})
            new = self._trace(path + ".some.npz", path, backface, int(ref["parts"]), min(seconds, 60), 0.0)
            os.remove(path + ".some.npz")
            seconds -= 60
            self._keep(path, merge(ref, some, new))

    def reflecting(self, ref):
        """mask of a reference's lumels on materials that reflect anything: Cycles' map is light ÷ reflectance and holds 0 on black ones"""
        if self._base is None:
            sc = gltf_scene.load(self.flat, images=False)
            self._base = np.array([max(m["base"][:3]) for m in sc.materials])[sc.mat]
        return self._base[ref["triangle"]] > 0

    def _drop(self, lumels, region):
        if self.cutouts and region is None:
            return
        z = dict(np.load(lumels))
        keep = np.ones(len(z["texel"]), bool)
        if not self.cutouts:
            sc = gltf_scene.load(self.flat, images=False)
            masked = np.array([m["alpha_mode"] == "MASK" for m in sc.materials])
            keep &= ~masked[sc.mat[z["triangle"]]]
        if region is not None:
            r, c = z["texel"].T
            keep &= (r >= region[0]) & (r < region[1]) & (c >= region[2]) & (c < region[3])
        np.savez_compressed(lumels, **{k: v[keep] if v.ndim and len(v) == len(keep) else v for k, v in z.items()})


def jitter(lumels):
    """Moves the regular points that texels.py spreads over a lumel at random within their cells.

    Where a shadow's edge is parallel to the rows of a regular grid, the mean over the grid is off by up to half a row. With 32 rows that is 1.6 % of
    the step across the edge, ten times the intended noise. Lumels that are not flat keep their points."""
    z = load(lumels)
    p = z["sub_position"].astype(np.float64)
    n, sub = len(p), int(round(np.sqrt(p.shape[1])))
    row, col = np.divmod(np.arange(sub * sub), sub)
    down, right = (p[:, -sub] - p[:, 0]) / (sub - 1), (p[:, sub - 1] - p[:, 0]) / (sub - 1)
    grid = p[:, :1] + row[:, None] * down[:, None] + col[:, None] * right[:, None]
    size = np.linalg.norm(p[:, -1] - p[:, 0], axis=1)
    flat = np.abs(p - grid).max((1, 2)) < 1e-5 * size + 2.4e-7 * np.abs(p).max((1, 2))       # two roundings of an f32
    r = np.random.default_rng(1).uniform(-0.5, 0.5, (n, sub * sub, 2)) * flat[:, None, None]
    z["sub_position"] = (p + r[..., :1] * down[:, None] + r[..., 1:] * right[:, None]).astype(np.float32)
    np.savez_compressed(lumels, **z)


def merge(ref, some, new):
    """A reference with independent further paths for the lumels `some`, weighted by their numbers."""
    if (ref["texel"][some] != new["texel"]).any():
        raise ValueError("references of different lumels")
    out = {k: v.copy() for k, v in ref.items()}
    n, m = ref["paths"][some][:, None].astype(float), float(new["spp"])
    out["irradiance"][some] = (n * ref["irradiance"][some] + m * new["irradiance"]) / (n + m)
    out["stderr"][some] = np.sqrt((n * ref["stderr"][some]) ** 2 + (m * new["stderr"]) ** 2) / (n + m)
    out["paths"][some] += int(new["spp"])
    out["parts"], out["seconds"] = ref["parts"] + 1, float(ref["seconds"]) + float(new["seconds"])
    return out


def _compare():
    import compare
    return compare


def relative_noise(ref):
    """standard error of each lumel relative to (its reference + 0.01 mean), the weighting of `lumel diff`; 0 if it is not lit"""
    lum = _compare().LUM
    y, s, on = ref["irradiance"] @ lum, ref["stderr"] @ lum, lit(ref)
    return np.where(on, s / (y + 0.01 * y[on].mean()), 0.0)


def own(ref):
    """relRMSE that the reference's own noise would give over its lit lumels"""
    return float(np.sqrt(np.mean(relative_noise(ref)[lit(ref)] ** 2)))


def load(path):
    return dict(np.load(path))


def lit(ref):
    y = ref["irradiance"] @ _compare().LUM
    return y > LIT * y.mean()


def clear(ref, other):
    """Lit lumels through which no shadow or contact edge runs: those where two sampling rules agree within 10 % and 5 standard errors."""
    lum = _compare().LUM
    y, z, s = ref["irradiance"] @ lum, other["irradiance"] @ lum, np.hypot(ref["stderr"], other["stderr"]) @ lum
    return lit(ref) & (np.abs(y - z) <= 0.1 * np.maximum(y, z) + 5 * s)


def errors(ref, exr, keep=None):
    """the figures of `lumel diff` for a map (E/π) over the lumels `keep` (default: all in the reference), and relRMSE_se: the standard error of
    relRMSE from the random choice of lumels (a few bad lumels dominate a root mean square)"""
    c = _compare()
    img = c.read_exr(exr)
    keep = np.ones(len(ref["irradiance"]), bool) if keep is None else keep
    kept = {k: ref[k][keep] for k in _KEEP}
    out = c.measure(kept, img, np.pi)
    square = signed(kept, exr) ** 2
    out["relRMSE_se"] = float(square.std() / (2 * np.sqrt(len(square) * max(square.mean(), 1e-300))))
    return out


def signed(ref, exr):
    """(x − ref)/(ref + 0.01 mean ref) of every lumel of a reference, on luminance"""
    c = _compare()
    r, k = ref["texel"].T
    x, y = c.read_exr(exr)[r, k] * np.pi @ c.LUM, ref["irradiance"] @ c.LUM
    return (x - y) / (y + 0.01 * y.mean())


def flatten(baked, flat):
    """flatten_lightmap.py -> its JSON line"""
    r = common.run([sys.executable, os.path.join(common.HERE, "flatten_lightmap.py"), baked, flat])
    if r["code"] != 0:
        raise SystemExit(r["err"])
    return json.loads(r["out"])
