"""Follower that smooths a piecewise constant input, such as mouse or touch events."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspfx import elementary
from graspfx.errors import InputError

FloatArray = NDArray[np.float64]


def follow(w: float, h: float, share: float, goal: Any, value: Any, rate: Any) -> tuple[Any, Any]:
    """Compute position r and velocity r' of a critically damped follower after a time h, as in `Follower`.

    Args:
        w: Inverse time constant 1/tau [1/s].
        h: Elapsed time [s].
        share: Decay factor exp(-w h).
        goal: Target u, constant during h; number or array.
        value, rate: Initial r and r'; numbers or arrays.
    """
    e = value - goal
    c = rate + w * e
    return goal + (e + h * c) * share, (rate - w * h * c) * share


class Follower:
    """Critically damped follower with the position r, which follows a piecewise constant target u.

        r'' = w^2 (u - r) - 2 w r',   w = 1/tau

    The solution after any time h with a constant target is exact. With the initial values e = r - u and c = r' + w e,

        e(h) = (e + c h) exp(-w h),   r'(h) = (r' - w c h) exp(-w h).

    Position and velocity are continuous. If the initial velocity is zero, the follower does not overshoot. The delay
    behind a target of constant velocity is 2 tau.

    Args:
        lag: Time constant tau, above zero [s].
        position: Initial position, of any shape [m]; the initial velocity is zero.

    Attributes:
        position, velocity: Present r [m] and r' [m/s].
    """

    def __init__(self, lag: float, position: ArrayLike) -> None:
        if not (math.isfinite(lag) and lag > 0.0):
            raise InputError("lag", lag, "a finite time above zero [s]")
        self.lag = lag
        self.position: FloatArray = np.array(position, dtype=float)
        self.velocity: FloatArray = np.zeros_like(self.position)

    def place(self, position: ArrayLike) -> None:
        """Set the position, and set the velocity to zero."""
        self.position[...], self.velocity[...] = position, 0.0

    def follow(self, target: ArrayLike, duration: float) -> None:
        """Advance by a duration [s] with a constant target."""
        w, goal = 1.0 / self.lag, np.asarray(target, dtype=float)
        share = elementary.exp(-w * duration)
        self.position[...], self.velocity[...] = follow(w, duration, share, goal, self.position, self.velocity)
