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
    """the same among triangles of nearly one plane, in rising order"""
    n = face[triangles[0]]
    u = np.cross(n, np.eye(3)[np.argmin(np.abs(n))])
    u /= np.linalg.norm(u)
    flat = corners[triangles] @ np.stack([u, np.cross(n, u)], 1)
    low, high = flat.min(1) + least, flat.max(1) - least
    for k in range(1, len(triangles)):
        near = (np.abs(height[:k] - height[k]) <= same) \
            & (low[:k] < high[k]).all(1) & (high[:k] > low[k]).all(1)
        if any(not apart(flat[j], flat[k], least) for j in np.flatnonzero(near)):
            yield triangles[k]
