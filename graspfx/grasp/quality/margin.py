"""Margin of a grasp: radius of the largest ball of wrenches that bounded pushing forces can exert."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspfx.errors import InputError, UnknownNameError
from graspfx.grasp.matrix import GraspMatrix
from graspfx.grasp.quality.closure import Limit, PushingWrenches, closure_of
from graspfx.numeric import number

FloatArray = NDArray[np.float64]
Bound = Literal["sum", "each"]

BATCH = 20  # facets examined in a round
DESCENTS = 3  # descents, from the nearest facets
SHRINK = 1e-6  # relative inward shift of points: qhull fails on many coplanar points in five dimensions


@dataclass(frozen=True, eq=False)
class Margin:
    """Bounds on epsilon, the radius of the largest ball of wrenches that the grasp can exert (Ferrari and Canny 1992).

    Attributes:
        guaranteed: Lower bound: radius of the largest ball in a polytope of wrenches that the contacts can exert [N].
        reached: Upper bound: the largest wrench of the contacts along `weakest`, exact for the cones [N].
        weakest: Unit direction (w,) in which the contacts' largest wrench is smallest, forces before moments divided by
            the length; zero if force closure is neither proved nor disproved.
        length: Length that divides moments [m].
    """

    guaranteed: float
    reached: float
    weakest: FloatArray
    length: float


def wrench_margin(
    grasp: GraspMatrix,
    friction: ArrayLike = 0.0,
    torsion: ArrayLike = 0.0,
    *,
    bound: Bound = "sum",
    limit: Limit = "elliptic",
    length: float | None = None,
    about: ArrayLike | None = None,
    tolerance: float = 1e-3,
    points: int = 600,
) -> Margin:
    """Compute epsilon = min over |u| = 1 of max over w in W of u.w, for the set W of wrenches of forces in the cones.

    Normal forces are bounded. If `bound` is "sum", they sum to at most 1 N, and W is the convex hull of the contacts'
    wrenches. If `bound` is "each", every normal force is at most 1 N, and W is the Minkowski sum of the contacts'
    wrenches (both: Ferrari and Canny 1992). The support function of W is known in closed form for the cones. The
    nearest facet of a polytope of points of W bounds epsilon from below (Barber, Dobkin and Huhdanpaa 1996). The
    support of W along the normal of that facet bounds epsilon from above. The point of W that attains this support is
    added to the polytope. These steps are repeated until the bounds agree. A final descent on the sphere lowers the
    upper bound to a local minimum. A linear program cannot find epsilon, because minimisation over the sphere is not
    convex. The bounds remain further apart if W is smooth and weak along a family of directions, because the polytope
    then needs many points.

    A grasp without force closure has margin 0. Unlike force closure, epsilon depends on the length that divides moments
    and on the reference point.

    Args:
        grasp, friction, torsion, limit, length, about: As for `grasp.quality.closure.force_closure`.
        bound: Bound on the normal forces, "sum" or "each".
        tolerance: Relative difference of the two bounds at which the computation ends.
        points: Largest number of points of the polytope.

    Raises:
        InputError, UnknownNameError: As for `force_closure`, or if the tolerance is outside (0, 1).
    """
    if bound not in get_args(Bound):
        raise UnknownNameError("bound on the normal forces", str(bound), get_args(Bound))
    tolerance = number("tolerance", tolerance, "a relative tolerance in (0, 1)", zero=False)
    if tolerance >= 1.0:
        raise InputError("tolerance", tolerance, "a relative tolerance in (0, 1)")
    cones = PushingWrenches(grasp, friction, torsion, limit, length, about)
    closure, generators = closure_of(cones)
    w = len(cones.maps)
    if not closure.closed or w == 0:
        separating = np.zeros(w) if closure.separating is None else closure.separating
        return Margin(0.0, 0.0, separating, cones.length)
    start = np.vstack([np.eye(w), -np.eye(w)])
    heights, wrenches = _reach(cones, start, bound)
    best = int(heights.argmin())
    reached, weakest = float(heights[best]), start[best]
    if w == 1:
        return Margin(reached, reached, weakest, cones.length)
    guaranteed = 0.0
    from scipy.spatial import ConvexHull

    rng = np.random.default_rng(0)
    if bound == "sum":
        wrenches = np.vstack([wrenches, generators])
    else:
        own = cones.wrenches(cones.reach(start)[1]).mean(axis=0)  # (n, w)
        around = rng.normal(size=(10 * w, w))
        wrenches = np.vstack([wrenches, _reach(cones, np.vstack([own, -own, around]), bound)[1]])

    def distinct(P: FloatArray) -> FloatArray:
        P = np.unique(P.round(12), axis=0)
        return P * (1.0 - SHRINK * rng.random((len(P), 1))) if w > 3 else P

    hull = ConvexHull(distinct(wrenches), incremental=True)
    while True:
        normals, distances = hull.equations[:, :-1], -hull.equations[:, -1]
        nearest = np.argsort(distances, kind="stable")[:BATCH]
        guaranteed = max(guaranteed, float(distances[nearest[0]]))
        heights, wrenches = _reach(cones, normals[nearest], bound)
        best = int(heights.argmin())
        if heights[best] < reached:
            reached, weakest = float(heights[best]), normals[nearest[best]].copy()
        beyond = heights > distances[nearest] * (1.0 + tolerance / 2)
        if reached - guaranteed <= tolerance * reached or len(hull.points) >= points or not beyond.any():
            break
        hull.add_points(distinct(wrenches[beyond]))
    hull.close()
    for u in [weakest, *normals[nearest[:DESCENTS]]]:
        lower, at = _descended(cones, u, bound)
        if lower < reached:
            reached, weakest = lower, at
    return Margin(min(guaranteed, reached), reached, weakest, cones.length)


def _reach(cones: PushingWrenches, directions: FloatArray, bound: Bound) -> tuple[FloatArray, FloatArray]:
    """Compute the support of W along each direction, (k,), and the wrench that attains it, (k, w)."""
    heights, forces = cones.reach(directions)
    each = cones.wrenches(forces)  # (k, n, w)
    if bound == "each":
        pushing = heights > 0.0
        return (heights * pushing).sum(axis=1), (each * pushing[..., None]).sum(axis=1)
    k, i = np.arange(len(directions)), heights.argmax(axis=1)
    return heights[k, i], each[k, i]


def _descended(cones: PushingWrenches, start: FloatArray, bound: Bound) -> tuple[float, FloatArray]:
    """Find a local minimum of the support of W on the unit sphere, from the direction `start`.

    The problem is to minimise sum s with s_i >= u.w_i, where s is one number for all contacts or one for each contact.
    """
    from scipy.optimize import Bounds, NonlinearConstraint, minimize

    n, w = len(cones.normals), len(start)
    owner = np.ones((n, 1)) if bound == "sum" else np.eye(n)
    slacks = owner.shape[1]
    cost = np.append(np.zeros(w), np.ones(slacks))

    def room(x: FloatArray) -> FloatArray:
        return np.asarray(owner @ x[w:] - cones.reach(x[None, :w])[0][0])

    def room_slope(x: FloatArray) -> FloatArray:
        return np.hstack([-cones.wrenches(cones.reach(x[None, :w])[1])[0], owner])

    heights = cones.reach(start[None])[0][0]
    s = heights.max(keepdims=True) if bound == "sum" else np.maximum(heights, 0.0)

    def total(x: FloatArray) -> float:
        return float(cost @ x)

    def slope(x: FloatArray) -> FloatArray:
        return cost

    def unit(x: FloatArray) -> FloatArray:
        return np.atleast_1d(x[:w] @ x[:w])

    def unit_slope(x: FloatArray) -> FloatArray:
        return np.append(2.0 * x[:w], np.zeros(slacks))[None]

    result = minimize(
        total,
        np.append(start, s),
        jac=slope,
        method="SLSQP",
        bounds=Bounds(np.append(np.full(w, -np.inf), np.zeros(slacks)), np.full(w + slacks, np.inf)),
        constraints=[
            NonlinearConstraint(room, 0.0, np.inf, jac=room_slope),
            NonlinearConstraint(unit, 1.0, 1.0, jac=unit_slope),
        ],
        options={"maxiter": 100, "ftol": 1e-12},
    )
    u = np.asarray(result.x[:w])
    length = float(np.linalg.norm(u))
    if not np.isfinite(length) or length == 0.0:
        return np.inf, start
    u = u / length
    return float(_reach(cones, u[None], bound)[0][0]), u
