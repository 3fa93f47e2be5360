"""The lumels of a flattened scene (flatten_lightmap.py) and where they are in space.

draw(scene, side, ...) -> the arrays that truth.py reads and keeps:
    position, normal, face  [n, S, 3]  S points spread over a lumel's part of the surface, the
                            interpolated normals there, and those of the faces
    texel [n, 2]            row and column, row 0 at the top of the page
    triangle [n]            that at the texel's centre;  centre [n, 3]: the point there
    bend [n]                least cosine between a lumel's normals and its faces'
    holes [n]               share of the lumel that is off the surface
    covered                 lumels of the whole page, those whose centre is on a triangle
"""
import numpy as np

ON_EDGE = -1e-9         # least weight: a place on an edge of two triangles is on one of them
AT_ONCE = 1 << 21       # points whose place in a triangle is computed at a time


def slivers(corners):
    """mask of triangles with practically no area.  Lumel drops them and makes no chart for them. They
    stay in the document, where their corners may be in charts at opposite ends of the page."""
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(1)
    area = np.linalg.norm(face_normals(corners), axis=1)
    return area < 1e-6 * longest ** 2


def face_normals(corners):
    """not of unit length: twice the triangles' areas"""
    return np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])


def unit(v):
    return v / np.maximum(np.linalg.norm(v, axis=-1, keepdims=True), 1e-300)


def weights(page, triangle, at):
    """barycentric weights [..., 3] of places `at` [..., 2] in triangles of the page"""
    a, b, c = (page[triangle, k] for k in range(3))
    e, f, d = b - a, c - a, at - a
    area = e[..., 0] * f[..., 1] - e[..., 1] * f[..., 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        v = (d[..., 0] * f[..., 1] - d[..., 1] * f[..., 0]) / area
        w = (d[..., 1] * e[..., 0] - d[..., 0] * e[..., 1]) / area
    return np.stack([1 - v - w, v, w], -1)


def cells(low, high, side):
    """every triangle with every row and column in [low, high] -> triangle, row, column"""
    low, high = np.maximum(low, 0), np.minimum(high, side - 1)
    size = np.where(np.isfinite(low + high), np.maximum(high - low + 1, 0), 0).astype(np.int64)
    count = size.prod(1)
    triangle = np.repeat(np.arange(len(low)), count)
    k = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
    first = np.nan_to_num(low).astype(np.int64)[triangle]
    return triangle, first[:, 1] + k // size[triangle, 0], first[:, 0] + k % size[triangle, 0]


def owners(page, side):
    """the triangle at each texel's centre, -1 without one; the last of several"""
    t, row, column = cells(np.ceil(page.min(1) - 0.5), np.floor(page.max(1) - 0.5), side)
    inside = (weights(page, t, np.stack([column, row], 1) + 0.5) >= ON_EDGE).all(1)
    out = np.full((side, side), -1)
    out[row[inside], column[inside]] = t[inside]
    return out


def charts(scene, page):
    """the chart of each triangle: triangles that share a corner, in space and on the page"""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components
    n = len(page)
    corner = np.concatenate([np.nan_to_num(page), scene.corners], 2).reshape(-1, 5).astype(np.float32)
    _, corner = np.unique(corner, axis=0, return_inverse=True)
    corner = corner.ravel() + n
    links = coo_matrix((np.ones(3 * n), (np.repeat(np.arange(n), 3), corner)), (corner.max() + 1,) * 2)
    return connected_components(links, False)[1][:n]


def inner(owner, chart, inset):
    """mask of the texels whose neighbours up to `inset` away are all on the same chart"""
    side, at = len(owner), np.where(owner >= 0, chart[owner], -1)
    around, steps = np.pad(at, inset, constant_values=-1), range(2 * inset + 1)
    return (at >= 0) & np.logical_and.reduce([around[i:i + side, j:j + side] == at for i in steps for j in steps])


def spread(page, owner, texel, places):
    """triangle [n, S] (-1 off the surface) and weights [n, S, 3] at `places` [n, S, 2], each within
    half a texel of its lumel's centre"""
    n, s = places.shape[:2]
    number = np.full(owner.shape, -1)
    number[tuple(texel.T)] = np.arange(n)
    t, row, column = cells(np.floor(page.min(1)), np.floor(page.max(1)), len(owner))
    lumel = number[row, column]
    t, lumel = t[lumel >= 0], lumel[lumel >= 0]
    triangle, weight = np.full((n, s), -1), np.zeros((n, s, 3))
    for k in range(0, len(t), max(1, AT_ONCE // s)):
        tk, lk = t[k:k + AT_ONCE // s, None], lumel[k:k + AT_ONCE // s]
        w = weights(page, tk, places[lk])
        i, j = np.nonzero((w >= ON_EDGE).all(2))
        triangle[lk[i], j], weight[lk[i], j] = tk[i, 0], w[i, j]
    return triangle, weight


def draw(scene, side, count=0, inset=0, footprint=1.0, sub=32, keep=None, seed=0):
    """`count` random lumels (0: all) that are at least `inset` texels from chart edges and for which
    keep(texel, triangle) is true.

    footprint  side of the square about the centre that the points are spread over, texels
    sub        points along that side; each is random within its cell, since a regular grid is off
               by up to half a row where a shadow's edge is parallel to its rows"""
    page = np.where(slivers(scene.corners)[:, None, None], np.nan, scene.uv[1] * side)
    owner = owners(page, side)
    texel = np.argwhere(inner(owner, charts(scene, page), inset))
    if count and count < len(texel):
        texel = texel[np.sort(np.random.default_rng(seed).permutation(len(texel))[:count])]
    if keep is not None:
        texel = texel[keep(texel, owner[tuple(texel.T)])]
    n, middle = len(texel), owner[tuple(texel.T)]
    rng = np.random.default_rng(seed + 1)
    cell = np.stack(np.meshgrid(np.arange(sub), np.arange(sub)), -1).reshape(-1, 2)
    # In random order, so that no part of a lumel is paired with some directions only.
    cell = cell[rng.permutation(sub * sub)]
    places = (cell + rng.random((n, sub * sub, 2))) / sub - 0.5
    places = texel[:, None, ::-1] + 0.5 + footprint * places
    triangle, weight = spread(page, owner, texel, places)
    off = triangle < 0
    for i in np.flatnonzero(off.any(1)):
        on = np.flatnonzero(~off[i])
        if len(on):
            other = rng.choice(on, off[i].sum())
            triangle[i, off[i]], weight[i, off[i]] = triangle[i, other], weight[i, other]
        else:       # less than a cell of surface: its centre
            triangle[i] = middle[i]
            weight[i] = weights(page, middle[i:i + 1], texel[i:i + 1, ::-1] + 0.5)
    between = lambda a, t, w: np.einsum("...k,...kc->...c", w, a[t])      # noqa: E731
    normal = unit(between(scene.normals, triangle, weight))
    face = unit(face_normals(scene.corners))[triangle]
    centre = between(scene.corners, middle, weights(page, middle, texel[:, ::-1] + 0.5))
    small = lambda a: a.astype(np.float32)      # noqa: E731
    return dict(position=small(between(scene.corners, triangle, weight)), normal=small(normal),
                face=small(face), texel=texel, triangle=middle, centre=centre,
                bend=(normal * face).sum(2).min(1), holes=off.mean(1), covered=int((owner >= 0).sum()))


def points(scene, count, seed=1, margin=0.0):
    """dict(position, normal, triangle) of points drawn by area from faces that emit nothing, at least
    `margin` metres from the edges of their triangles; normals are the faces'"""
    doubled = face_normals(scene.corners)
    area = np.linalg.norm(doubled, axis=1) / 2
    dark = np.array([not m.emissive.any() for m in scene.materials])[scene.material]
    share = area * (dark if dark.any() else 1)
    rng = np.random.default_rng(seed)
    triangle = rng.choice(len(area), count * (8 if margin else 1), p=share / share.sum())
    weight = rng.dirichlet([1, 1, 1], len(triangle))
    corners = scene.corners[triangle]
    opposite = np.linalg.norm(corners[:, [2, 0, 1]] - corners[:, [1, 2, 0]], axis=2)
    inside = (weight * 2 * area[triangle, None] / np.maximum(opposite, 1e-300)).min(1) >= margin
    triangle, weight, corners = [a[inside][:count] for a in (triangle, weight, corners)]
    return dict(position=np.einsum("nk,nkc->nc", weight, corners), normal=unit(doubled)[triangle], triangle=triangle)
