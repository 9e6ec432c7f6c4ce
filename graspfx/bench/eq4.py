"""Benchmark of eq. (4): GraspFX and NumPy, with errors relative to a computation in exact fractions."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

import graspfx as gx
from graspfx.bench.timing import Case, Method, each
from graspfx.grasp import point_sets

FloatArray = NDArray[np.float64]
Project = Callable[[FloatArray, FloatArray], FloatArray]  # G and x -> P x
Pair = tuple[FloatArray, FloatArray]  # points and displacements of a grasp, (n, 3) each

TITLE = "Eq. (4): forces of all contacts from their points and displacements"
LIMITS = """
Each operation computes the contact forces from the contact points and displacements of one grasp. In cases named
"contacts fixed", the points stay the same, and a method may compute from them in advance. The times include neither
the creation of a PointCoupling nor the compilation of kernels. The NumPy methods compute moments about the origin and
use NumPy's default tolerance for the rank of G. Contacts have equal weights, are hard and in space, and have no
damping.
"""

EXTERNAL, INTERNAL = 30.0, 70.0  # [N/m]
OUTER, INNER = gx.Impedance(EXTERNAL), gx.Impedance(INTERNAL)
LAW = gx.Coupling(OUTER, INNER)
RADIUS, REACH = 0.05, 0.003  # radius of a grasp, and size of the displacements [m]
GRASPS = 8  # grasps of each kind
WRONG = 1e-3  # relative error of a force that is not due to rounding


@dataclass(frozen=True)
class ContactSet:
    """N grasps of n contacts: points and displacements (N, n, 3) [m], and exact forces (N, n, 3) [N]."""

    name: str
    points: FloatArray
    displacements: FloatArray
    forces: FloatArray

    @property
    def pairs(self) -> list[Pair]:
        return list(zip(self.points, self.displacements, strict=True))


def cases(quick: bool) -> Iterator[Case]:
    """Yield one case for each set of contacts; the contacts change at every operation except in the last case."""
    for contacts in contact_sets():
        yield Case("eq4", contacts.name, "relative", [*ours(contacts), *by_numpy(contacts)], WRONG)
    contacts = fixed(next(contact_sets()))
    yield Case("eq4", contacts.name, "relative", [*ours_fixed(contacts), *by_numpy_fixed(contacts)], WRONG)


def contact_sets() -> Iterator[ContactSet]:
    """Draw random grasps with a fixed seed: with few, many, nearly collinear, and distant contacts."""
    rng = np.random.default_rng(4)
    yield contact_set(rng, "5 fingers", RADIUS * _directions(rng, 5))
    yield contact_set(rng, "20 fingers", RADIUS * _directions(rng, 20))
    yield contact_set(rng, "5 fingers, condition 1e9", _near_line(rng, 1e-9))
    yield contact_set(rng, "5 fingers, 1 km away", 1000.0 * _directions(rng, 1) + RADIUS * _directions(rng, 5))


def contact_set(rng: np.random.Generator, name: str, points: FloatArray) -> ContactSet:
    """Draw random displacements of points (N, n, 3) [m], and compute the exact forces."""
    displacements = REACH * rng.normal(size=points.shape)
    forces = np.array([exact_force(p, e) for p, e in zip(points, displacements, strict=True)])
    return ContactSet(name, points, displacements, forces)


def fixed(contacts: ContactSet) -> ContactSet:
    """Return grasps that all have the points of the first grasp, with the displacements of `contacts`."""
    points = np.repeat(contacts.points[:1], GRASPS, axis=0)
    forces = np.array([exact_force(points[0], e) for e in contacts.displacements])
    return ContactSet(f"{contacts.name}, contacts fixed", points, contacts.displacements, forces)


def exact_force(points: FloatArray, e: FloatArray) -> FloatArray:
    """Compute f = k_i e + (k_e - k_i) P e (n, 3) [N] in fractions, so that only the result is rounded.

    P e is the least-squares fit of a rigid motion to the displacements e. The motion consists of the mean of e and of a
    rotation w about the centroid of the points. With the positions r relative to the centroid, w solves
    J w = sum r x e, where J is the inertia matrix of points of unit mass.

    Args:
        points: Contact points, which must not be collinear, (n, 3) [m].
        e: Displacements (n, 3) [m].
    """
    n = len(points)
    x, d = ([[Fraction(v) for v in row] for row in array.tolist()] for array in (points, e))
    centre, mean = ([sum(row[a] for row in rows) / n for a in range(3)] for rows in (x, d))
    r = [[row[a] - centre[a] for a in range(3)] for row in x]
    square = sum(v * v for row in r for v in row)
    J = [[(square if a == b else 0) - sum(row[a] * row[b] for row in r) for b in range(3)] for a in range(3)]
    moment = [sum((_cross(p, v)[a] for p, v in zip(r, d, strict=True)), Fraction()) for a in range(3)]
    cofactors = [_cross(J[(a + 1) % 3], J[(a + 2) % 3]) for a in range(3)]
    size = sum(u * v for u, v in zip(J[0], cofactors[0], strict=True))
    turn = [sum(cofactors[b][a] * moment[b] for b in range(3)) / size for a in range(3)]
    ke, ki = Fraction(EXTERNAL), Fraction(INTERNAL)
    force = np.empty((n, 3))
    for i, (arm, own) in enumerate(zip(r, d, strict=True)):
        turned = _cross(turn, arm)
        force[i] = [float(ki * own[a] + (ke - ki) * (mean[a] + turned[a])) for a in range(3)]
    return force


def force_method(name: str, force: Callable[[Any], FloatArray], contacts: ContactSet, note: str = "") -> Method:
    """Return a method whose operation is `force` of the pair (points, displacements) of one grasp."""
    return _method(name, force, contacts.pairs, contacts.forces, note)


def ours(contacts: ContactSet) -> Iterator[Method]:
    """Yield GraspFX's methods for contacts that change at every operation."""

    def by_split(pair: Pair) -> FloatArray:
        return LAW.force(gx.Grasp(pair[0]).split(tolerance=1e-12), pair[1].ravel())

    point_sets.warm()
    yield force_method("GraspFX Grasp.split, Coupling.force", by_split, contacts)
    coupling = gx.PointCoupling(OUTER, INNER, contacts.points.shape[1])

    def by_coupling(pair: Pair) -> FloatArray:
        coupling.points[:], coupling.displacement[:] = pair
        coupling.compute()
        return coupling.force.copy()

    yield force_method("GraspFX PointCoupling", by_coupling, contacts, "points, displacements and forces copied")


def by_numpy(contacts: ContactSet) -> Iterator[Method]:
    """Yield NumPy's methods for contacts that change at every operation."""
    matrix = GraspMatrix(contacts.points.shape[1])
    for name, project in (("numpy pinv", by_pinv), ("numpy solve", by_solve)):
        yield force_method(name, partial(projected, project, matrix), contacts)


def ours_fixed(contacts: ContactSet) -> Iterator[Method]:
    """Yield GraspFX's methods for fixed contacts."""
    split = gx.Grasp(contacts.points[0]).split()
    flat = [e.ravel() for e in contacts.displacements]
    point_sets.warm()
    yield _method("GraspFX Coupling.force, split known", partial(LAW.force, split), flat, contacts.forces)
    coupling = gx.PointCoupling(OUTER, INNER, contacts.points.shape[1])
    coupling.points[:] = contacts.points[0]

    def by_coupling(e: FloatArray) -> FloatArray:
        coupling.displacement[:] = e
        coupling.compute()
        return coupling.force

    note = "recomputes the split; displacements copied"
    yield _method("GraspFX PointCoupling", by_coupling, list(contacts.displacements), contacts.forces, note)


def by_numpy_fixed(contacts: ContactSet) -> Iterator[Method]:
    """Yield NumPy's method for fixed contacts: the product f = K e with a stiffness matrix K computed in advance."""
    flat = [e.ravel() for e in contacts.displacements]
    G = gx.grasp_matrix(contacts.points[0])
    P = np.linalg.pinv(G) @ G
    K, f = EXTERNAL * P + INTERNAL * (np.eye(len(P)) - P), np.empty(len(P))
    yield _method("numpy, K known", lambda e: K.dot(e, f), flat, contacts.forces, "one product, in place")


def projected(project: Project, matrix: GraspMatrix, pair: Pair) -> FloatArray:
    """Compute the forces f = k_i x + (k_e - k_i) P x (3 n,) of displacements x, with P x from `project(G, x)`."""
    x = pair[1].ravel()
    return INTERNAL * x + project(matrix(pair[0]), (EXTERNAL - INTERNAL) * x)


def by_pinv(G: FloatArray, x: FloatArray) -> FloatArray:
    """Compute P x = G^+ (G x) (eq. 3), without forming P."""
    return np.asarray(np.linalg.pinv(G) @ (G @ x))


def by_solve(G: FloatArray, x: FloatArray) -> FloatArray:
    """Compute P x = G' v, where v solves the normal equations G G' v = G x; raise LinAlgError if G G' is singular."""
    return np.asarray(np.linalg.solve(G @ G.T, G @ x) @ G)


SKEW = np.zeros((9, 3))  # r -> the entries of the matrix [r x]
SKEW[[1, 2, 3, 5, 6, 7], [2, 1, 2, 0, 1, 0]] = [-1.0, 1.0, 1.0, -1.0, -1.0, 1.0]


class GraspMatrix:
    """Grasp matrix G of n points in space (6, 3 n), with moments about the origin (eq. 2).

    Every call computes the three rows of moments for new points, in one array that all calls share. The three rows of
    forces are constant.
    """

    def __init__(self, n: int) -> None:
        self._G = np.zeros((6, 3 * n))
        self._G[:3] = np.tile(np.eye(3), n)
        self._product = np.empty((n, 9))
        self._moments, self._turned = self._G[3:].reshape(3, n, 3), self._product.reshape(n, 3, 3).transpose(1, 0, 2)

    def __call__(self, points: FloatArray) -> FloatArray:
        np.matmul(points, SKEW.T, out=self._product)
        self._moments[...] = self._turned
        return self._G


def relative_error(forces: FloatArray, exact: FloatArray) -> float:
    """Return the largest error of forces (N, n, 3), each relative to the largest force component of its grasp."""
    return float((np.abs(forces - exact).max(axis=(1, 2)) / np.abs(exact).max(axis=(1, 2))).max())


def _method(
    name: str, force: Callable[[Any], FloatArray], inputs: Sequence[Any], exact: FloatArray, note: str = ""
) -> Method:
    def error() -> float:
        return relative_error(np.array([force(x).copy() for x in inputs]).reshape(exact.shape), exact)

    return Method(name, each(force, inputs), error, note, len(inputs))


def _cross(a: Sequence[Any], b: Sequence[Any]) -> list[Any]:
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def _directions(rng: np.random.Generator, n: int) -> FloatArray:
    x = rng.normal(size=(GRASPS, n, 3))
    return np.asarray(x / np.linalg.norm(x, axis=2, keepdims=True))


def _near_line(rng: np.random.Generator, h: float) -> FloatArray:
    """Draw five points (`GRASPS`, 5, 3) [m] near a line; their distances from the line are about h times `RADIUS`."""
    axes = np.linalg.qr(rng.normal(size=(GRASPS, 3, 3)))[0]
    along = np.linspace(-1.0, 1.0, 5) + 0.1 * rng.normal(size=(GRASPS, 5))
    local = np.concatenate([along[:, :, None], h * rng.normal(size=(GRASPS, 5, 2))], axis=2)
    return np.asarray(RADIUS * local @ axes.transpose(0, 2, 1))
