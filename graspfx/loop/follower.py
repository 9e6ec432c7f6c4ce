"""Follower that smooths a stepwise input such as mouse or touch events."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspfx import elementary
from graspfx.errors import InputError

FloatArray = NDArray[np.float64]


def follow(w: float, h: float, share: float, goal: Any, value: Any, rate: Any) -> tuple[Any, Any]:
    """Compute the value and rate of a critically damped follower after a time h, for numbers or arrays.

    Args:
        w: Inverse time constant 1/tau [1/s].
        h: Elapsed time [s].
        share: Decay factor exp(-w h).
        goal: Target u, constant over the step.
        value, rate: Values of r and r' at the beginning of the step.
    """
    e = value - goal
    c = rate + w * e
    return goal + (e + h * c) * share, (rate - w * h * c) * share


class Follower:
    """A critically damped follower of a target u that is constant between events.

        r'' = w^2 (u - r) - 2 w r',   w = 1/tau

    The solution over a step of any length h is exact. With e = r - u and c = r' + w e at the step's beginning,

        e(h) = (e + c h) exp(-w h),   r'(h) = (r' - w c h) exp(-w h).

    From rest the follower never overshoots. Its position and velocity are continuous. The follower lags a target of
    constant velocity by the time 2 tau.

    Args:
        lag: Time constant tau, above zero [s].
        position: Initial position of any shape, at rest [m].

    Attributes:
        position, velocity: State of the follower, in its own arrays [m, m/s].
    """

    def __init__(self, lag: float, position: ArrayLike) -> None:
        if not (math.isfinite(lag) and lag > 0.0):
            raise InputError("lag", lag, "a finite time above zero [s]")
        self.lag = lag
        self.position: FloatArray = np.array(position, dtype=float)
        self.velocity: FloatArray = np.zeros_like(self.position)

    def place(self, position: ArrayLike) -> None:
        """Set the follower to a position, at rest."""
        self.position[...], self.velocity[...] = position, 0.0

    def follow(self, target: ArrayLike, duration: float) -> None:
        """Advance by a duration [s] during which the target was constant."""
        w, goal = 1.0 / self.lag, np.asarray(target, dtype=float)
        share = elementary.exp(-w * duration)
        self.position[...], self.velocity[...] = follow(w, duration, share, goal, self.position, self.velocity)
