"""Pushing: what is left of a grasp when only some of its fingers touch."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspfx.analysis.linearisation import Linearisation, Subject, linear_of
from graspfx.errors import InputError

FloatArray = NDArray[np.float64]

DEFINITE = 1e-4  # of the largest pivot of Cholesky's factor: the least one of a matrix that is far from singular


def pushing(
    subject: Subject, fingers: ArrayLike, *, released: ArrayLike | None = None
) -> Iterator[tuple[tuple[int, ...], Linearisation]]:
    """List every set of fingers that may touch without the others, and the loop that it closes with the whole object.

    Fingers that do not touch carry no force: K becomes K_aa - K_ab K_bb^+ K_ba of the touching coordinates a, D the
    same. For two fingers on a line that is 2 kep kip/(kep + kip) (Kawai and Yoshikawa, eq. 26). The released devices,
    which nothing but their hands moves, are left out; so is the preload.

    Args:
        subject: the grasp with every finger touching: a `Linearisation`, a scene, or the name or path of one.
        fingers: (m,), which finger each coordinate belongs to.
        released: (m,), coordinates that never carry force (the tangents of frictionless contacts), a mask.

    Yields:
        (touching fingers, linearisation), the single fingers first; the grasp itself is not among them, unless
        `released` changes it.
    """
    linear = linear_of(subject)
    m, _ = linear.coordinates
    pushers = np.asarray(fingers)
    loose = np.zeros(m, dtype=bool) if released is None else np.asarray(released, dtype=bool)
    if pushers.shape != (m,) or loose.shape != (m,):
        raise InputError("fingers", fingers, f"{m} numbers of fingers, and `released` a mask as long")
    names = sorted(set(pushers.tolist()))
    for size in range(1, len(names) + bool(loose.any())):
        for touching in combinations(names, size):
            yield touching, without_freedoms(linear, np.isin(pushers, touching) & ~loose)


def without_freedoms(linear: Linearisation, a: NDArray[np.bool_]) -> Linearisation:
    """Restrict the loop to the device coordinates `a` (m,), a mask, the others without force; no preload."""
    block = np.ix_(a, a)
    G = linear.G[:, a]
    return linear.with_arrays(
        mass=linear.mass[a],
        friction=linear.friction[a],
        G=G,
        stiffness=condensed(linear.stiffness, a),
        damping=condensed(linear.damping, a),
        hand_stiffness=linear.hand_stiffness[block],
        hand_damping=linear.hand_damping[block],
        delay=linear.delay[a],
        lateness=linear.lateness[a],
        age=linear.age[a],
        preload=None,
        G_displacement=G,
        G_contact=None,
        operator=None if linear.operator is None else linear.operator.restricted(a),
    )


def condensed(K: FloatArray, without_freedoms: NDArray[np.bool_]) -> FloatArray:
    """Compute K_aa - K_ab K_bb^+ K_ba, a the remaining coordinates and b those without force."""
    a, b = without_freedoms, ~without_freedoms
    K_ab, K_ba = K[np.ix_(a, b)], K[np.ix_(b, a)]
    if not K_ab.any() or not K_ba.any():
        return K[np.ix_(a, a)]
    return np.asarray(K[np.ix_(a, a)] - K_ab @ _solution(K[np.ix_(b, b)], K_ba))


def _solution(A: FloatArray, B: FloatArray) -> FloatArray:
    """Compute A^+ B; of a positive definite A that is not near a singular one without its singular values."""
    if (A == A.T).all():
        try:
            pivots = np.diag(np.linalg.cholesky(A))
        except np.linalg.LinAlgError:
            pivots = np.zeros(1)
        if pivots.min() > DEFINITE * pivots.max():
            return np.asarray(np.linalg.solve(A, B))
    return np.asarray(np.linalg.pinv(A) @ B)
