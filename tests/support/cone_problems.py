"""One random problem of friction cones in a buffer of its own."""

from __future__ import annotations

import math

import numpy as np

from graspfx.cones.cone import modes_offset
from graspfx.cones.friction import RESTARTS, friction_force, problem_size

DEEP = 0.01  # size of random displacements [m]


def rigid_motions(rng: np.random.Generator, n: int, d: int) -> np.ndarray:
    """Orthonormal rigid displacements of n random points, every point's in random axes of its own, (m, k)."""
    r = rng.normal(size=(n, d))
    columns = [np.tile(np.eye(d)[a], n) for a in range(d)]
    if d == 2:
        columns.append(np.stack([-r[:, 1], r[:, 0]], axis=1).ravel())
    if d == 3:
        columns += [np.cross(np.eye(3)[a], r).ravel() for a in range(3)]
    U, values, _ = np.linalg.svd(np.array(columns).T, full_matrices=False)
    U = U[:, values > 1e-9 * values[0]]
    for i in range(n):
        U[i * d : i * d + d] = np.linalg.qr(rng.normal(size=(d, d)))[0] @ U[i * d : i * d + d]
    return U


class Problem:
    """One problem in a buffer, with what an oracle needs to judge its answer."""

    def __init__(
        self, rng: np.random.Generator, n: int, d: int, ratio: float, mu: float | np.ndarray, weights: object = 1.0
    ) -> None:
        self.n, self.d, self.m = n, d, n * d
        self.external, self.internal = 100.0 / math.sqrt(ratio), 100.0 * math.sqrt(ratio)
        self.Q = rigid_motions(rng, n, d)
        self.mu = np.broadcast_to(np.asarray(mu, dtype=float), (n,))
        self.root = np.repeat(np.sqrt(np.broadcast_to(np.asarray(weights, dtype=float), (n,))), d)
        self.e = rng.normal(size=self.m) * DEEP
        self.count = self.Q.shape[1]
        self.S = np.zeros(problem_size(n, d, self.count, False))
        self.S[:n] = self.root[::d] ** 2
        self.S[n : 2 * n] = self.mu
        self.S[3 * n : 3 * n + self.m] = self.e
        self.S[modes_offset(0, n, d, self.count) :] = np.column_stack([np.ones(self.count), self.Q.T]).ravel()

    @property
    def K(self) -> np.ndarray:
        P = self.Q @ self.Q.T
        return self.root[:, None] * (self.internal * np.eye(self.m) + (self.external - self.internal) * P) * self.root

    @property
    def size(self) -> float:
        return max(self.external, self.internal) * float(np.abs(self.e).max())

    def vector(self, k: int) -> np.ndarray:
        return self.S[3 * self.n + k * self.m : 3 * self.n + (k + 1) * self.m]

    @property
    def force(self) -> np.ndarray:
        return self.vector(2)

    @property
    def slip(self) -> np.ndarray:
        return self.vector(3)

    @property
    def unknowns(self) -> np.ndarray:
        return self.S[3 * self.n + 5 * self.m : 3 * self.n + 5 * self.m + self.count]

    def solve(self, coulomb: bool) -> tuple[int, float, int]:
        S = memoryview(self.S)
        return friction_force(S, 0, self.n, self.d, self.count, self.external, self.internal, coulomb, RESTARTS)
