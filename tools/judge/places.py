"""Views of a level that nobody chose: where a player could stand, looking where it is deep."""
import mitsuba as mi
import numpy as np

from . import scene as scenes
from .trace import Tracer

HEIGHT = 1.6    # of the eye above a floor, metres, or this much of the way to what is above it
OF_ROOM = 0.6
FLOOR = 0.8     # least height of a floor's unit normal
CLOSE = 0.3     # nothing is nearer to the eye, metres
BACKS = 0.02    # most rays that end on the back of a single-sided face: the eye is inside of something
ENDS = 0.3      # least rays that end on anything
LEVEL = 0.25    # most that a view looks up or down, as the height of its unit direction
CONE = 0.75     # cosine from a view's middle to what it is judged by
APART = 0.2     # of the level's diagonal, at first; halved until there are enough
RAYS = 128      # from an eye
TRIED = 4000    # floor points


def directions(count):
    """[count, 3] unit vectors, evenly spread"""
    i = np.arange(count) + 0.5
    z, turn = 1 - 2 * i / count, np.pi * (1 + 5 ** 0.5) * i
    r = np.sqrt(1 - z * z)
    return np.stack([r * np.cos(turn), z, r * np.sin(turn)], 1)


class Caster:
    """What rays meet in a level, whatever its pictures show"""

    def __init__(self, level):
        self.tracer = Tracer(level)
        a, b, c = (level.corners[:, k] for k in range(3))
        self.cross = np.cross(b - a, c - a)
        self.two_sided = np.array([m.double_sided for m in level.materials])[level.material]

    def cast(self, o, d):
        """[n] distances, infinite where there is nothing, and whether it is a black back"""
        o, d = (np.ascontiguousarray(x.T, np.float32) for x in (o - self.tracer.centre, d))
        hit = self.tracer.cast(mi.Point3f(o), mi.Vector3f(d), mi.Bool(True))
        ok, t = np.array(hit.is_valid()), np.array(hit.t)
        triangle = np.where(ok, np.array(hit.prim_index), 0)
        back = ok & ((self.cross[triangle] * d.T).sum(1) > 0) & ~self.two_sided[triangle]
        return np.where(ok, t, np.inf), back


def eyes(level, caster, random):
    """[n, 3] points above floors, drawn by area"""
    area = 0.5 * np.linalg.norm(caster.cross, axis=1)
    up = caster.cross[:, 1] / np.maximum(2 * area, 1e-30)
    # A double-sided floor may be modelled upside down.
    floor = np.where(np.where(caster.two_sided, abs(up), up) > FLOOR, area, 0)
    if not floor.any():
        raise SystemExit("no floor to stand on: choose views by --view")
    triangle = random.choice(len(floor), TRIED, p=floor / floor.sum())
    u, v = random.random((2, TRIED))
    u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
    a, b, c = (level.corners[triangle, k] for k in range(3))
    at = a + (b - a) * u[:, None] + (c - a) * v[:, None]
    above = np.broadcast_to([0.0, 1.0, 0.0], at.shape)
    # The tracer lifts single-sided faces a little.
    room, _ = caster.cast(at + 2 * caster.tracer.eps.numpy()[0] * above, above)
    return at + above * np.minimum(HEIGHT, OF_ROOM * room)[:, None]


def find(path, count, seed):
    """-> `count` views "EYE:TARGET" of a level. The same for the same seed"""
    level = scenes.load(path, images=False)
    caster, random = Caster(level), np.random.default_rng(seed)
    at, toward = eyes(level, caster, random), directions(RAYS)
    t, back = caster.cast(np.repeat(at, RAYS, 0), np.tile(toward, (len(at), 1)))
    t, back = t.reshape(-1, RAYS), back.reshape(-1, RAYS)
    ends = np.isfinite(t)
    fit = (back.mean(1) < BACKS) & (t.min(1) > CLOSE) & (ends.mean(1) > ENDS)
    corners = level.corners.reshape(-1, 3)
    diagonal = np.linalg.norm(corners.max(0) - corners.min(0))
    # First where much is above the horizon: most of a level's floor may be an empty plain.
    above = np.floor(4 * ends[:, toward[:, 1] > 0].mean(1))
    order = np.argsort(-above, kind="stable")
    chosen, apart = [], APART * diagonal
    while len(chosen) < count and apart > 1e-3 * diagonal:
        for i in order[fit[order]]:
            if len(chosen) < count and all(np.linalg.norm(at[i] - at[j]) > apart for j in chosen):
                chosen.append(i)
        apart /= 2
    if len(chosen) < count:
        raise SystemExit("%d places to stand, %d wanted: choose views by --view"
                         % (len(chosen), count))
    weights = np.maximum(toward @ toward.T - CONE, 0)
    even = np.flatnonzero(abs(toward[:, 1]) < LEVEL)
    views = []
    for i in chosen:
        depth = np.log1p(np.where(ends[i], np.minimum(t[i], 0.5 * diagonal), 0))
        best = even[np.argmax((weights @ depth / weights.sum(1))[even])]
        views.append(":".join(",".join("%.3f" % x for x in p) for p in (at[i], at[i] + toward[best])))
    return views
