"""Steps of bodies by the integrators' definitions, in any arithmetic, and what spinning keeps."""

from __future__ import annotations

from typing import Any

import mpmath as mp
import numpy as np
from numpy.typing import NDArray

from graspfx.objects import integrators as at

FloatArray = NDArray[np.float64]


def exact_step(kind: str, x: Any, v: Any, u: Any, z: Any, T: Any) -> tuple[Any, Any]:
    """x and v after T of v' = u - (z/T) v by the integrator's definition, in the arithmetic of its arguments."""
    a = z / T
    if kind == "explicit":
        return x + T * v, v + T * (u - a * v)
    if kind == "semi-implicit":
        w = v + T * (u - a * v)
        return x + T * w, w
    if kind == "implicit":
        w = (v + T * u) / (1 + z)
        return x + T * w, w
    if z == 0:
        return x + T * v + T * T * u / 2, v + T * u
    E = mp.exp(-z)
    return x + T * v * (1 - E) / z + T * T * u * (z - 1 + E) / z**2, v * E + T * u * (1 - E) / z


def spinning(state: FloatArray) -> tuple[float, FloatArray]:
    """Energy of rotation and angular momentum in world axes."""
    R, w = state[at.ROTATION : at.ROTATION + 9].reshape(3, 3), state[at.ANGULAR_VELOCITY : at.ANGULAR_VELOCITY + 3]
    L = R @ (state[at.INERTIA : at.INERTIA + 3] * (R.T @ w))
    return 0.5 * float(w @ L), L
