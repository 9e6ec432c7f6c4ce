"""Eq. (4) beside more of numpy and scipy, hand-written numba, and JAX; thousands of grasps in one call."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dposv

import graspfx as gx
from graspfx.bench import eq4
from graspfx.bench.eq4 import EXTERNAL, INTERNAL, LAW, ContactSet, GraspMatrix, Pair, exact_force, force_method
from graspfx.bench.timing import Case, Method
from tests.bench.peers import imported, jax_in_double

FloatArray = NDArray[np.float64]
Force = Callable[[FloatArray, FloatArray], FloatArray]  # points and displacements (..., n, 3) -> forces

TITLE = eq4.TITLE
LIMITS = (
    eq4.LIMITS
    + """
The closed forms use means and the rotation about the centroid instead of G, as an expert on hard fingers would; they
solve 3 equations by cofactors or by LAPACK, without a rank decision, and fail or lose digits near a line. numba and JAX
are compiled beforehand. For thousands of grasps in one call, the error is that of a few grasps.
"""
)

CHECKED = 16  # of many


def cases(quick: bool) -> Iterator[Case]:
    """Yield the package's cases with more peers, then one of thousands of grasps."""
    for contacts in eq4.contact_sets():
        methods = [*eq4.ours(contacts), *eq4.by_numpy(contacts), *peers(contacts)]
        yield Case("eq4", contacts.name, "relative", methods, eq4.WRONG)
    contacts = eq4.fixed(next(eq4.contact_sets()))
    yield Case("eq4", contacts.name, "relative", [*eq4.ours_fixed(contacts), *eq4.by_numpy_fixed(contacts)], eq4.WRONG)
    yield many(1000 if quick else 10_000)


def peers(contacts: ContactSet) -> Iterator[Method]:
    """List more ways for contacts that change."""
    matrix = GraspMatrix(contacts.points.shape[1])
    for name, project in (("numpy QR", by_qr), ("LAPACK dposv by scipy", by_posv)):
        yield force_method(name, partial(eq4.projected, project, matrix), contacts)
    for name, make in (("numpy, closed form", lambda: by_moments), ("numba, closed form in loops", by_numba),
                       ("JAX, closed form", by_jax)):  # fmt: skip
        yield force_method(name, _later(make), contacts)


def _later(make: Callable[[], Force]) -> Callable[[Pair], FloatArray]:
    made: list[Force] = []

    def force(pair: Pair) -> FloatArray:
        if not made:
            made.append(make())
        return made[0](*pair)

    return force


def by_qr(G: FloatArray, x: FloatArray) -> FloatArray:
    """Use orthonormal columns of G' in their order, all six."""
    Q = np.linalg.qr(G.T)[0]
    return np.asarray(Q @ (Q.T @ x))


def by_posv(G: FloatArray, x: FloatArray) -> FloatArray:
    """Solve the normal equations G G' v = G x by Cholesky; ValueError where G G' is not positive definite."""
    _, v, info = dposv(G @ G.T, G @ x)
    if info:
        raise ValueError("G G' is not positive definite")
    return np.asarray(G.T @ v)


def by_moments(points: FloatArray, e: FloatArray) -> FloatArray:
    """Compute forces from the mean shift and the turn about the centroid, J w = sum r x e, by cofactors, (n, 3)."""
    n = len(points)
    mean = np.full(n, 1.0 / n)
    r = points - mean @ points
    moments, squares = (r.T @ e).tolist(), (r.T @ r).tolist()
    (xx, xy, xz), (_, yy, yz), (_, _, zz) = squares
    a, b, c = yy + zz, xx + zz, xx + yy
    m0, m1, m2 = moments[1][2] - moments[2][1], moments[2][0] - moments[0][2], moments[0][1] - moments[1][0]
    c00, c11, c22 = b * c - yz * yz, a * c - xz * xz, a * b - xy * xy
    c01, c02, c12 = xz * yz + xy * c, xy * yz + xz * b, a * yz + xy * xz
    d = 1.0 / (a * c00 - xy * c01 - xz * c02)
    p, q, s = (
        d * (c00 * m0 + c01 * m1 + c02 * m2),
        d * (c01 * m0 + c11 * m1 + c12 * m2),
        d * (c02 * m0 + c12 * m1 + c22 * m2),
    )
    shared = mean @ e + r @ np.array([[0.0, s, -q], [-s, 0.0, p], [q, -p, 0.0]])
    return np.asarray(INTERNAL * e + (EXTERNAL - INTERNAL) * shared)


def by_numba() -> Force:
    """Compile loops over fingers: two sums, a solution of three equations by cofactors, the forces."""
    program: Force = imported("numba", "the peer of numba").njit(moments_in_loops)
    return program


def many_by_numba() -> Force:
    """Compile a loop over grasps around these loops."""
    program = by_numba()

    def all_grasps(points: FloatArray, e: FloatArray) -> FloatArray:
        out = np.empty_like(e)
        for k in range(len(points)):
            out[k] = program(points[k], e[k])
        return out

    compiled: Force = imported("numba", "the peer of numba").njit(all_grasps)
    return compiled


def moments_in_loops(points: FloatArray, e: FloatArray) -> FloatArray:
    """Compute what `by_moments` does, in loops of plain numbers; written for numba."""
    n = len(points)
    centre, mean, m, J, turn = np.zeros(3), np.zeros(3), np.zeros(3), np.zeros((3, 3)), np.zeros(3)
    for i in range(n):
        for a in range(3):
            centre[a] += points[i, a] / n
            mean[a] += e[i, a] / n
    r = np.empty((n, 3))
    for i in range(n):
        for a in range(3):
            r[i, a] = points[i, a] - centre[a]
        for a in range(3):
            b, c = (a + 1) % 3, (a + 2) % 3
            m[a] += r[i, b] * e[i, c] - r[i, c] * e[i, b]
            J[a, a] += r[i, b] * r[i, b] + r[i, c] * r[i, c]
            J[a, b] -= r[i, a] * r[i, b]
            J[b, a] = J[a, b]
    size = 0.0
    for a in range(3):
        b, c = (a + 1) % 3, (a + 2) % 3
        for k in range(3):
            cofactor = J[b, (k + 1) % 3] * J[c, (k + 2) % 3] - J[b, (k + 2) % 3] * J[c, (k + 1) % 3]
            turn[k] += cofactor * m[a]
            if a == 0:
                size += J[0, k] * cofactor
    out = np.empty((n, 3))
    for i in range(n):
        for a in range(3):
            b, c = (a + 1) % 3, (a + 2) % 3
            shared = mean[a] + (turn[b] * r[i, c] - turn[c] * r[i, b]) / size
            out[i, a] = INTERNAL * e[i, a] + (EXTERNAL - INTERNAL) * shared
    return out


def by_jax() -> Force:
    """Compile the closed form with JAX, for one grasp or a stack of them."""
    jax = jax_in_double()

    def force(points: Any, e: Any) -> Any:
        return stacked(points, e, jax.numpy)

    program = jax.jit(force)
    return lambda points, e: np.asarray(program(points, e))


def stacked(points: Any, e: Any, np_: Any = np) -> Any:
    """Compute forces of stacks of grasps (..., n, 3) by numpy's or JAX's stacked linear algebra."""
    r = points - points.mean(axis=-2, keepdims=True)
    S, M = np_.matmul(r.swapaxes(-1, -2), r), np_.matmul(r.swapaxes(-1, -2), e)  # sum r r', sum r e'
    J = np_.trace(S, axis1=-2, axis2=-1)[..., None, None] * np_.eye(3) - S
    m = np_.stack([M[..., 1, 2] - M[..., 2, 1], M[..., 2, 0] - M[..., 0, 2], M[..., 0, 1] - M[..., 1, 0]], axis=-1)
    w = np_.linalg.solve(J, m[..., None])[..., 0]
    shared = e.mean(axis=-2, keepdims=True) + np_.cross(w[..., None, :], r)
    return INTERNAL * e + (EXTERNAL - INTERNAL) * shared


def by_stacked_pinv(points: FloatArray, e: FloatArray) -> FloatArray:
    """Compute P with P = G^+ G (eq. 3) from the right, all grasps at once."""
    G = gx.grasp_matrix(points)
    x = e.reshape(len(e), -1, 1)
    return np.asarray(INTERNAL * e + (EXTERNAL - INTERNAL) * (np.linalg.pinv(G) @ (G @ x)).reshape(e.shape))


def many(N: int, fingers: int = 5) -> Case:
    """Compare whole calls: points and displacements of all grasps in, their forces out."""
    rng = np.random.default_rng(14)
    points, e = eq4.RADIUS * rng.normal(size=(N, fingers, 3)), eq4.REACH * rng.normal(size=(N, fingers, 3))
    exact = np.array([exact_force(points[k], e[k]) for k in range(CHECKED)])

    def ours(points: FloatArray, e: FloatArray) -> FloatArray:
        return LAW.force(gx.Grasp(points).split(), e)

    def method(name: str, make: Callable[[], Force]) -> Method:
        force = _later(make)

        def error() -> float:
            return eq4.relative_error(force((points, e))[:CHECKED].reshape(exact.shape), exact)

        return Method(name, lambda: force((points, e)), error, calls=N)

    methods = [
        method("GraspFX Grasp.split, Coupling.force", lambda: ours),
        method("numpy pinv, stacked", lambda: by_stacked_pinv),
        method("numpy, closed form, stacked", lambda: stacked),
        method("numba, closed form in loops", many_by_numba),
        method("JAX, closed form", by_jax),
    ]
    return Case("eq4", f"{N} grasps of {fingers} fingers, one call", "relative", methods, eq4.WRONG)
