"""Matrices of a grip: the wrenches of forces at its fingers, and its body's inertia."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from graspfx.analysis.preload import ROWS, cross
from graspfx.certificate.rest.resting import Grip
from graspfx.objects import integrators as body

FloatArray = NDArray[np.float64]


def wrenches(arms: FloatArray, grip: Grip) -> FloatArray:
    """Form G (r, m) of forces at arms (n, d) from the object's centre, on its free freedoms."""
    d = grip.d
    wide = np.zeros((grip.n, 3))
    wide[:, :d] = arms
    full = np.hstack([np.vstack([np.eye(3), cross(arm)])[:, :d] for arm in wide])
    return np.asarray(full[np.array(ROWS[d])[grip.free]])


def inertia_of(state: FloatArray, R: FloatArray, grip: Grip) -> FloatArray:
    """Form the inertia of a body, turned by R, on its free freedoms (r, r)."""
    full = np.zeros((6, 6))
    full[:3, :3] = state[body.MASS] * np.eye(3)
    full[3:, 3:] = R @ np.diag(state[body.INERTIA : body.INERTIA + 3]) @ R.T
    return np.asarray(full[np.ix_(grip.axes, grip.axes)])
