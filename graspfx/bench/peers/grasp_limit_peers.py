"""The factor of a grasp's gains at which its sampled loop loses stability, by eigenvalues and by python-control."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from graspfx.analysis.linearisation import Linearisation

GRID = np.geomspace(1.0, 100.0, 32)  # factors that are looked at, upwards
Radius = Callable[[float], float]


def by_eigenvalues(linear: Linearisation) -> float:
    """Ask numpy for all eigenvalues of the whole loop, factor by factor, then Brent's method between the last two."""
    from graspfx.analysis.stability.loop import loop_matrix

    # the loop is a line in its gains: two matrices are all that a user needs to build
    still, whole = (loop_matrix(linear.with_changes(stiffness=s * linear.stiffness)) for s in (0.0, 1.0))
    return first_loss(lambda s: float(np.abs(np.linalg.eigvals(still + s * (whole - still))).max()))


def by_control(linear: Linearisation) -> float:
    """Ask python-control for the poles of the closed loop, likewise."""
    import control

    m, _ = linear.coordinates
    ratio = linear.with_changes(damping=0.0).to_control("open")  # of the gains alone, from forces to what answers them
    return first_loss(lambda s: float(np.abs(control.feedback(s * ratio, np.eye(m)).poles()).max()))


def first_loss(radius: Radius) -> float:
    """Find the first factor above 1 at which a spectral radius is 1."""
    from scipy.optimize import brentq

    stable = 1.0
    for factor in GRID[1:].tolist():
        if radius(factor) > 1.0:
            return float(brentq(lambda s: radius(s) - 1.0, stable, factor, xtol=1e-14, rtol=1e-12))
        stable = factor
    return np.inf
