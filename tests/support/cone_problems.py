"""One random problem of friction cones in a block of its own."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from graspfx.compile.records import Table
from graspfx.cones.friction import RESTARTS, friction_force, friction_force_square
from graspfx.cones.problem import Answer, ConeContact, Gains, ModePart, Unknown, problem_size, set_up

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
    """One problem in a block, with what an oracle needs to judge its answer."""

    def __init__(
        self, rng: np.random.Generator, n: int, d: int, ratio: float, mu: float | np.ndarray, weights: object = 1.0
    ) -> None:
        self.n, self.d, self.m = n, d, n * d
        self.external, self.internal = 100.0 / math.sqrt(ratio), 100.0 * math.sqrt(ratio)
        self.Q = rigid_motions(rng, n, d)
        self.mu = np.broadcast_to(np.asarray(mu, dtype=float), (n,))
        self.root = np.repeat(np.sqrt(np.broadcast_to(np.asarray(weights, dtype=float), (n,))), d)
        self.e = rng.normal(size=self.m) * DEEP
        self.pose()

    def pose(self) -> None:
        """Put weights, coefficients, displacements and modes into a new block."""
        self.count = self.Q.shape[1]
        self.block = np.zeros(problem_size(self.n))
        self.cones = set_up(memoryview(self.block), 0, self.n)
        self.cones.modes = self.count
        contacts = self.cones.contacts
        contacts.array(ConeContact.weight)[:] = self.root[:: self.d] ** 2
        contacts.array(ConeContact.coefficient)[:] = self.mu
        self.cones.unknowns.array(Unknown.share)[: self.count] = 1.0
        for i in range(self.n):
            for k in range(self.count):
                contacts[i].modes.array(ModePart.motion)[k, : self.d] = self.Q[i * self.d : (i + 1) * self.d, k]
        self.displacement[:] = self.e.reshape(self.n, self.d)

    @property
    def K(self) -> np.ndarray:
        P = self.Q @ self.Q.T
        return self.root[:, None] * (self.internal * np.eye(self.m) + (self.external - self.internal) * P) * self.root

    @property
    def size(self) -> float:
        return max(self.external, self.internal) * float(np.abs(self.e).max())

    def entries(self, field: Any) -> np.ndarray:
        """A view of a field of all contacts, (n, d)."""
        return self.cones.contacts.array(field)[:, : self.d]

    @property
    def displacement(self) -> np.ndarray:
        return self.entries(ConeContact.displacement)

    @property
    def base_force(self) -> np.ndarray:
        return self.entries(ConeContact.base_force)

    @property
    def force(self) -> np.ndarray:
        """A copy, (m,)."""
        return self.entries(ConeContact.force).ravel()

    @property
    def slip(self) -> np.ndarray:
        """A copy, (m,)."""
        return self.entries(ConeContact.slip).ravel()

    @property
    def status(self) -> np.ndarray:
        return self.cones.contacts.array(ConeContact.status)

    @property
    def unknowns(self) -> np.ndarray:
        return self.cones.unknowns.array(Unknown.value)[: self.count]

    def solve(self, coulomb: bool) -> Answer:
        return friction_force(self.cones, self.d, Gains(self.external, self.internal), coulomb, RESTARTS)

    def solve_square(self, coulomb: bool, K: np.ndarray | None = None) -> tuple[int, np.ndarray]:
        """Solve it with K as a square: the law of the answer and the force (m,)."""
        square = set_up(memoryview(np.zeros(problem_size(self.n, self.m))), 0, self.n, self.m)
        square.limited = self.cones.limited
        for one, other in zip(square.contacts, self.cones.contacts, strict=True):
            one.weight, one.coefficient, one.limit = 1.0, other.coefficient, other.limit
            one.displacement, one.base_force = other.displacement, other.base_force
        table = Table(memoryview((self.K if K is None else K).ravel()), 0, self.m)
        answer = friction_force_square(square, self.d, table, True, coulomb, 0)
        return answer.law, square.contacts.array(ConeContact.force)[:, : self.d].ravel()
