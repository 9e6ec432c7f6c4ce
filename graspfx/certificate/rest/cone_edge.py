"""Friction cones at rest: how far each contact is from sliding, and what sliding would take from the stiffness."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from graspfx.analysis.linearisation import Linearisation
from graspfx.coupling import block as at
from graspfx.coupling.grasped import GraspedObject
from graspfx.objects import integrators as body

FloatArray = NDArray[np.float64]

EDGE = 1e-3  # of the largest friction: what a contact on the cone's edge may lack of it
ALL_SETS = 5  # contacts on the edge up to which every set of them may slide; of more, single ones and all
MOST_GRIPS = 8  # fingers whose margins stand one by one
GROWTH = 1e-9  # above 1: a spectral radius that is no rounding


def grip_margins(grasped: GraspedObject) -> FloatArray:
    """Give f_t/(mu f_n) of each finger's last elastic force, (n,); nan for one without coefficient or normal force.

    1 is the edge of the friction cone. The torsion of a soft finger counts as in its limit surface,
    sqrt(f_t^2 + (tau/rho)^2).
    """
    margins = np.full(grasped.fingers, np.nan)
    for i, (normal, tangent) in enumerate(_forces(grasped)):
        mu = grasped.rows[i, at.COEFFICIENT]
        if mu > 0.0 and normal > 0.0:
            margins[i] = float(np.hypot(np.linalg.norm(tangent), grasped.rows[i, at.LOCAL + 3])) / (mu * normal)
    return margins


def edge_directions(grasped: GraspedObject, fingers: Sequence[int]) -> tuple[FloatArray, FloatArray]:
    """Give T and V (n d, fingers), world axes: along t each contact slides, and V'f = f_t - mu f_n = 0 meanwhile."""
    n, d = grasped.fingers, grasped.dimensions
    R = grasped.body_state[body.ROTATION : body.ROTATION + 9].reshape(3, 3)
    forces = list(_forces(grasped))
    T, V = np.zeros((n * d, len(fingers))), np.zeros((n * d, len(fingers)))
    for column, i in enumerate(fingers):
        tangent = forces[i][1]
        t = tangent / max(float(np.linalg.norm(tangent)), 1e-300)
        x = slice(i * d, i * d + d)
        T[x, column] = (R @ t)[:d]
        normal = grasped.rows[i, at.NORMAL : at.NORMAL + 3]
        V[x, column] = (R @ (t - grasped.rows[i, at.COEFFICIENT] * normal))[:d]
    return T, V


def _forces(grasped: GraspedObject) -> Iterator[tuple[float, FloatArray]]:
    """Give the normal force of each finger, and its tangential force in the object's axes (3,)."""
    for row in grasped.rows:
        normal, force = row[at.NORMAL : at.NORMAL + 3], row[at.LOCAL : at.LOCAL + 3].copy()
        force[grasped.dimensions :] = 0.0
        along = float(normal @ force)
        yield along, force - along * normal


def released(K: FloatArray, T: FloatArray, V: FloatArray) -> FloatArray | None:
    """Compute K_s = K - K T (V'K T)^-1 V'K, the stiffness while contacts slide; None where det(V'K T) <= 0."""
    inner = V.T @ K @ T
    if np.linalg.det(inner / max(float(np.abs(inner).max(initial=0.0)), 1e-300)) <= 0.0:
        return None
    return np.asarray(K - K @ T @ np.linalg.solve(inner, V.T @ K))


def sliding_notes(
    linear: Linearisation, T: FloatArray, V: FloatArray, names: Sequence[str]
) -> Iterator[str]:  # fmt: skip
    """Say which contacts on their cones' edges could not slide calmly at the gains that are there.

    A note, no limit: while they slide the loop also does other things than these linear ones, and the smallest limit
    over all sets of sliding contacts would warn of grasps that stay where they are.

    Args:
        linear: the loop with sticking contacts, at rest.
        T, V: of `edge_directions` in its coordinates, (m, contacts).
        names: of their fingers.
    """
    from graspfx.analysis.stability.fullloop import radius_of

    count = len(names)
    sizes = range(1, count + 1) if count <= ALL_SETS else (1, count)
    for size in sizes:
        for sliders in combinations(range(count), size):
            some, of = list(sliders), ", ".join(names[i] for i in sliders)
            t, v = T[:, some], V[:, some]
            K = released(linear.stiffness, t, v)
            if K is None:
                yield f"if {of} slid, friction would have no answer to it (det V'K T <= 0): a jump is possible"
                continue
            D = released(linear.damping, t, v) if linear.damping.any() else linear.damping
            radius = radius_of(linear.with_changes(stiffness=K, damping=linear.damping if D is None else D))
            if radius > 1.0 + GROWTH:
                yield f"if {of} slid on, the loop would grow while it slides, spectral radius {radius:.6f}"


def said_of_grip(grip: Mapping[str, float], edge: Sequence[str]) -> str:
    """Say how near the fingers are to sliding, the nearest first."""
    ranked = sorted(grip.items(), key=lambda item: -round(item[1], 6))  # equal ones in their order
    margins = ", ".join(f"{name} {margin:.2f}" for name, margin in ranked[:MOST_GRIPS])
    more = f", {len(ranked) - MOST_GRIPS} more down to {ranked[-1][1]:.2f}" if len(ranked) > MOST_GRIPS else ""
    on = f"; on the cone's edge, and sticking: {', '.join(edge)}" if edge else ""
    return f"friction in use, f_t/(mu f_n): {margins}{more}{on}"
