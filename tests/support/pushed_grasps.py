"""Grasps at random places with random forces in their cones, and numpy's view of their wrenches and cones."""

from __future__ import annotations

import numpy as np

from graspfx.coupling.grasp_state import FingerState
from graspfx.coupling.grasped import GraspedObject
from graspfx.coupling.rules import Rules
from graspfx.objects import integrators as body
from graspfx.objects.body import fill_body
from graspfx.surfaces.closed_form.shape import Box
from tests.support.grasps import law

KINDS = {  # of contacts, and in how many dimensions
    "attached": ((1, 2, 3), Rules(attached=True)),
    "frictionless": ((1, 2, 3), Rules()),
    "stick": ((2, 3), Rules(stick=True)),
    "friction": ((2, 3), Rules(friction=0.5)),
    "slippery": ((2, 3), Rules(friction=0.05, at_contact=True)),
    "soft": ((3,), Rules(friction=0.8, patch=0.008)),
}


def random_grasp(rng: np.random.Generator, n: int, d: int, rules: Rules) -> GraspedObject:
    """An object with n contacts at random places, along random normals, some of which do not touch."""

    def fill(state: np.ndarray) -> None:
        free = [True] * d + list(rng.random({1: 0, 2: 1, 3: 3}[d]) < 0.7)
        fill_body(state, dimensions=d, mass=0.1, inertia=4e-5, free=free)

    g = GraspedObject(
        n, d, 0.001, law(40.0, 160.0), rules, fill, shape=Box((0.05,) * d), limit=rng.uniform(1.5, 6.0, n)
    )
    g.array(FingerState.contact)[:, :d] = rng.uniform(-0.03, 0.03, (n, d))
    g.array(FingerState.displacement)[:, :d] = rng.uniform(-0.005, 0.005, (n, d))
    normals = rng.normal(size=(n, d))
    g.array(FingerState.normal)[:, :d] = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    g.array(FingerState.twist_axis)[:, :d] = g.array(FingerState.normal)[:, :d]
    return g


def push(rng: np.random.Generator, g: GraspedObject, rules: Rules) -> None:
    """Random forces in the cones, on their edge for one finger in three; one finger in five is free."""
    n, d = g.fingers, g.dimensions
    c = 4 if g.soft else d
    g.array(FingerState.local)[:] = 0.0
    g.touching[:] = 1.0 if rules.attached else rng.random(n) < 0.8
    for i in range(n):
        normal = g.array(FingerState.normal)[i, :d]
        f = np.zeros(4)
        f[:d] = rng.normal(size=d)
        f[3] = rng.normal() if c > 3 else 0.0
        if not rules.attached:
            f[:d] -= (f[:d] @ normal) * normal
            pushed = abs(rng.normal())
            if not rules.stick:
                mu, size = float(g.array(FingerState.coefficient)[i]), float(np.linalg.norm(f))
                f *= mu * pushed * (1.0 if rng.random() < 0.3 else rng.random()) / size if size > 0.0 else 0.0
            f[:d] += pushed * normal
        g.array(FingerState.local)[i] = 3.0 * f * g.touching[i]


def wrench_rows(g: GraspedObject, rules: Rules) -> np.ndarray:
    """G of the free freedoms on the forces' four entries, moments over 30 mm, by numpy."""
    n, e = g.fingers, g.array(FingerState.displacement)[:, :3]
    r = g.array(FingerState.contact) + (0.0 if rules.at_contact else 1.0) * e
    G = np.zeros((6, n, 4))
    for i in range(n):
        G[:3, i, :3] = np.eye(3)
        G[3:, i, :3] = np.cross(r[i], np.eye(3)).T / 0.03
        G[3:, i, 3] = g.array(FingerState.patch)[i] * g.array(FingerState.twist_axis)[i] / 0.03
    free = g.body_state[body.FREE : body.FREE + 6] != 0.0
    return G[free].reshape(int(free.sum()), -1)


def depth(g: GraspedObject, rules: Rules, f: np.ndarray) -> float:
    """The least mu f_n - |f_t| of any finger, or f_n where it sticks or has no friction."""
    normals = g.array(FingerState.normal)
    pushed = (f[:, :3] * normals).sum(axis=1)
    if rules.attached:
        return 0.0
    if rules.stick:
        return float(pushed.min())
    along = np.column_stack([f[:, :3] - pushed[:, None] * normals, f[:, 3]])
    return float(min(pushed.min(), (g.array(FingerState.coefficient) * pushed - np.linalg.norm(along, axis=1)).min()))
