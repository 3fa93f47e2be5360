"""Faces that lie on each other."""
import numpy as np

# Faces are compared with those in their cell: of so much of a unit normal, and of such a share of
# the scene's size along it. They overlap if by more than this share.
DIRECTION, CELL, OVERLAP = 1e-3, 1e-5, 1e-5


def apart(a, b, least):
    """whether convex polygons [n, 2], counter-clockwise, overlap by less than `least`"""
    for p, q in ((a, b), (b, a)):
        edge = np.roll(p, -1, 0) - p
        inward = np.stack([-edge[:, 1], edge[:, 0]], 1)
        inward /= np.maximum(np.linalg.norm(edge, axis=1), 1e-30)[:, None]
        deep = inward @ q.T - (inward * p).sum(1)[:, None]
        if (deep.max(1) < least).any():
            return True
    return False


def later(corners, face, same):
    """numbers of triangles that an earlier one in the same place, facing the same way, covers at
    least in part; `same`: distance of planes, metres"""
    size = max(np.abs(corners).max(), 1e-9)
    real = np.flatnonzero(np.linalg.norm(face, axis=1) > 0.5)
    height = (face[real] * corners[real, 0]).sum(1)
    found = set()
    # Cells shifted by a half, so that what rounding parts in one is together in the other.
    for shift in (0.0, 0.5):
        key = np.column_stack([face[real] / DIRECTION, height / (CELL * size)])
        key = np.floor(key + shift)
        _, cell, count = np.unique(key, axis=0, return_inverse=True, return_counts=True)
        cell = cell.ravel()
        order = np.argsort(cell, kind="stable")
        for rows in np.split(order, np.cumsum(count)[:-1]):
            if len(rows) > 1:
                found.update(within(real[rows], corners, face, height[rows], same, OVERLAP * size))
    return np.array(sorted(found), int)


def within(triangles, corners, face, height, same, least):
    """the same among triangles of nearly one plane"""
    n = face[triangles[0]]
    u = np.cross(n, np.eye(3)[np.argmin(np.abs(n))])
    u /= np.linalg.norm(u)
    flat = corners[triangles] @ np.stack([u, np.cross(n, u)], 1)
    low, high = flat.min(1) + least, flat.max(1) - least
    # Sweep along the first axis: those that begin before k and may still reach it.
    order = np.argsort(low[:, 0], kind="stable")
    triangles, flat, height, low, high = (
        x[order] for x in (triangles, flat, height, low, high))
    begin = np.searchsorted(np.maximum.accumulate(high[:, 0]), low[:, 0], side="right")
    for k in range(1, len(triangles)):
        b = slice(begin[k], k)
        near = (np.abs(height[b] - height[k]) <= same) & (high[b, 0] > low[k, 0]) \
            & (low[b, 1] < high[k, 1]) & (high[b, 1] > low[k, 1])
        for j in begin[k] + np.flatnonzero(near):
            if not apart(flat[j], flat[k], least):
                yield max(triangles[j], triangles[k])
