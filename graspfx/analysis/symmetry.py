"""Symmetries of a grasp: exchanges of fingers, with a rotation or mirror image, that leave every matrix as it is."""

from __future__ import annotations

from itertools import permutations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspfx.analysis.linearisation import Linearisation

FloatArray = NDArray[np.float64]

MOST_FINGERS = 5  # whose exchanges are all tried
SAME = 1e-10  # relative: by what the matrices of a symmetric grasp may change


def symmetries(linear: Linearisation, contacts: ArrayLike, free: ArrayLike) -> list[tuple[int, ...]]:
    """List the exchanges of fingers under which a loop without its preload is the same, the identity first.

    Finger i goes to the place of finger p[i]. With Q the orthogonal matrix that takes the contacts there, V of blocks Q
    and W = diag(Q, det(Q) Q) of the object, it is asked that V A V' = A of devices, hands and gains, W G V' = G, and
    W M W' = M of the object. Sets of fingers that an exchange takes to one another have the same limits alone.

    Args:
        linear: the coordinates are those of the fingers one after another, in world axes.
        contacts: (n, d) [m].
        free: which of the object's freedoms move, (1,), (3,) or (6,).
    """
    points = np.asarray(contacts, dtype=float)
    n, d = points.shape
    identity = tuple(range(n))
    if linear.operator is not None and not linear.operator.alike:
        return [identity]
    if n > MOST_FINGERS or linear.G.shape[1] != n * d or linear.ground is not None:
        return [identity]
    X = points - points.mean(axis=0)
    size = max(float(np.abs(X).max()), 1e-300)
    others = list(permutations(range(n)))[1:]
    Y = X[np.array(others).reshape(-1, n)]  # where each exchange puts the fingers
    if not others:
        return [identity]
    left, _, right = np.linalg.svd(np.einsum("ni,pnj->pij", X, Y))
    answers = [identity]
    for exchange, U, Vt, target in zip(others, left, right, Y, strict=True):
        for sign in (1.0, -1.0):
            flip = np.ones(d)
            flip[-1] = sign
            Q = (Vt.T * flip) @ U.T
            if np.abs(X @ Q.T - target).max() <= SAME * size and _is_symmetry(linear, Q, exchange, np.asarray(free)):
                answers.append(exchange)
                break
    return answers


def _is_symmetry(linear: Linearisation, Q: FloatArray, exchange: tuple[int, ...], free: NDArray[np.bool_]) -> bool:
    """Tell whether every matrix of the loop is the same in the exchanged coordinates."""
    d, n = len(Q), len(exchange)
    V = np.zeros((n * d, n * d))
    for i, k in enumerate(exchange):
        V[k * d : k * d + d, i * d : i * d + d] = Q
    W = _object_map(Q)
    if W[np.ix_(free, ~free)].any() and np.abs(W[np.ix_(free, ~free)]).max() > SAME:
        return False
    W = W[np.ix_(free, free)]
    delay = linear.delay * linear.period + linear.lateness
    devices = [linear.stiffness, linear.damping, linear.hand_stiffness, linear.hand_damping]
    if linear.operator is not None:
        devices += [A for A in (*linear.operator.springs, *linear.operator.ratios) if A.size]
    devices += [np.diag(each) for each in (linear.mass, linear.friction, delay, linear.age)]
    objects = [linear.inertia, linear.viscosity]
    pairs = [(V @ A @ V.T, A) for A in devices] + [(W @ A @ W.T, A) for A in objects] + [(W @ linear.G @ V.T, linear.G)]
    return all(np.abs(A - B).max(initial=0.0) <= SAME * np.abs(B).max(initial=0.0) for A, B in pairs)


def _object_map(Q: FloatArray) -> FloatArray:
    """Give W, how the object's shifts and turns go under Q: (1, 1), (3, 3) or (6, 6)."""
    d, turned = len(Q), float(np.linalg.det(Q))
    W = np.zeros(((1, 3, 6)[d - 1],) * 2)
    W[:d, :d] = Q
    if d == 2:
        W[2, 2] = turned
    elif d == 3:
        W[3:, 3:] = turned * Q
    return W


def alike_sets(sets: list[tuple[int, ...]], exchanges: list[tuple[int, ...]]) -> list[int]:
    """Give for each set of fingers, by their places, the index of the first set that an exchange takes to it."""
    first: dict[tuple[int, ...], int] = {}
    for k, each in enumerate(sets):
        for exchange in exchanges:
            first.setdefault(tuple(sorted(exchange[i] for i in each)), k)
    return [first[tuple(sorted(each))] for each in sets]
