"""Problems of forces in cones, with their answers to 50 digits: the gains' ratio, fingers and the law vary."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from graspfx.bench.oracles.exact import cone_force
from graspfx.bench.peers.eq4_peers import grasp_matrix
from graspfx.compile.records import Table
from graspfx.cones.friction import ASSOCIATED, COULOMB, friction_force_square
from graspfx.cones.problem import ConeContact, Unknown, problem_size, set_up

FloatArray = NDArray[np.float64]
Law = Literal["frictionless", "associated", "coulomb"]

INTERNAL = 70.0  # [N/m]
FRICTION = 0.5
DEPTH = 0.003  # of the fingers [m]


@dataclass(frozen=True)
class Problem:
    """A grasp in contact frames, the normal first, and the answer f (m,).

    Attributes:
        K: (m, m) = k_i I + (k_e - k_i) Q Q'.
        W: its inverse, I / k_i + (1 / k_e - 1 / k_i) Q Q'.
        Q: (m, r), orthonormal.
        e: (m,).
        force: f (m,).
    """

    K: FloatArray
    W: FloatArray
    Q: FloatArray
    e: FloatArray
    force: FloatArray


@dataclass(frozen=True)
class Problems:
    """Some of a kind."""

    law: Law
    fingers: int
    ratio: float
    members: tuple[Problem, ...]

    @property
    def external(self) -> float:
        return INTERNAL / self.ratio

    @property
    def friction(self) -> float:
        return 0.0 if self.law == "frictionless" else FRICTION


def problems(quick: bool) -> Iterator[Problems]:
    """Draw every kind, seeded."""
    fingers, N = ((2, 5), 4) if quick else ((2, 5, 20), 8)
    laws: tuple[tuple[Law, tuple[float, ...]], ...] = (
        ("frictionless", (3.0, 1000.0)),
        ("associated", (3.0, 1000.0)),
        ("coulomb", (3.0, 30.0)),
    )
    for law, ratios in laws:
        for n in fingers:
            for ratio in ratios:
                yield _some(np.random.default_rng([n, int(ratio)]), N, law, n, ratio)


def _some(rng: np.random.Generator, N: int, law: Law, n: int, ratio: float) -> Problems:
    problems: list[Problem] = []
    mu = 0.0 if law == "frictionless" else FRICTION
    while len(problems) < N:
        K, Q, e = _posed(rng, n, INTERNAL / ratio)
        near = _near(K, e, mu, law)
        force = None if near is None else cone_force(K, e, mu, law != "coulomb", near)
        if force is not None and force.any():
            W = np.eye(len(e)) / INTERNAL + (ratio / INTERNAL - 1.0 / INTERNAL) * Q @ Q.T
            problems.append(Problem(K, W, Q, e, force))
    return Problems(law, n, ratio, tuple(problems))


def _posed(rng: np.random.Generator, n: int, external: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Place fingers around a ball, most of them deep in it."""
    inward = rng.normal(size=(n, 3))
    frames = np.array([np.linalg.qr(np.column_stack([v, rng.normal(size=(3, 2))]))[0].T for v in inward])
    frames[:, 0] *= np.sign(np.sum(frames[:, 0] * inward, axis=1))[:, None]
    G = (grasp_matrix(-0.05 * frames[:, 0]).reshape(6, n, 1, 3) * frames).sum(axis=3).reshape(6, 3 * n)
    s, V = np.linalg.svd(G, full_matrices=False)[1:]
    Q = V[s > 1e-9 * s[0]].T
    e = DEPTH * rng.normal(size=(n, 3))
    e[:, 0] += DEPTH
    return INTERNAL * np.eye(3 * n) + (external - INTERNAL) * Q @ Q.T, Q, e.ravel()


def _near(K: FloatArray, e: FloatArray, mu: float, law: Law) -> FloatArray | None:
    """Give w = e + s to start from: any that leads to an answer does."""
    n, m = len(e) // 3, len(e)
    problem = set_up(memoryview(np.zeros(problem_size(n, m))), 0, n, m)
    problem.contacts.array(ConeContact.coefficient)[:] = mu
    problem.contacts.array(ConeContact.displacement)[:, :3] = e.reshape(n, 3)
    answer = friction_force_square(problem, 3, Table(memoryview(K.ravel()), 0, m), True, law == "coulomb", 2)
    law_number = COULOMB if law == "coulomb" else ASSOCIATED
    return problem.unknowns.array(Unknown.value).copy() if answer.law == law_number else None
