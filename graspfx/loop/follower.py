"""A follower: smooth motion behind an input that comes in steps, such as the events of a mouse or a screen."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspfx import elementary
from graspfx.errors import InputError

FloatArray = NDArray[np.float64]


def follow(w: float, h: float, share: float, goal: Any, value: Any, rate: Any) -> tuple[Any, Any]:
    """Compute value and rate of a critically damped follower a time h later: numbers, or arrays of them.

    Args:
        w: 1/tau [1/s].
        h: the time [s].
        share: exp(-w h).
        goal: u, the same all along.
        value, rate: at the beginning, r and r'.
    """
    e = value - goal
    c = rate + w * e
    return goal + (e + h * c) * share, (rate - w * h * c) * share


class Follower:
    """A critically damped follower of a target u that holds between its events.

        r'' = w^2 (u - r) - 2 w r',   w = 1/tau

    solved exactly over each step, whatever its length: with e = r - u and c = r' + w e at its beginning

        e(h) = (e + c h) exp(-w h),   r'(h) = (r' - w c h) exp(-w h).

    It never overshoots from rest, is continuous with its velocity, and is 2 tau behind a target that moves steadily.

    Args:
        lag: tau, above zero [s].
        position: where it is at first, at rest.

    Attributes:
        position, velocity: of the follower, in arrays of its own [m, m/s].
    """

    def __init__(self, lag: float, position: ArrayLike) -> None:
        if not (math.isfinite(lag) and lag > 0.0):
            raise InputError("lag", lag, "a finite time above zero [s]")
        self.lag = lag
        self.position: FloatArray = np.array(position, dtype=float)
        self.velocity: FloatArray = np.zeros_like(self.position)

    def place(self, position: ArrayLike) -> None:
        """Put it at a position, at rest."""
        self.position[...], self.velocity[...] = position, 0.0

    def follow(self, target: ArrayLike, duration: float) -> None:
        """Follow a target that has stood for a time [s], which was the same all along."""
        w, goal = 1.0 / self.lag, np.asarray(target, dtype=float)
        share = elementary.exp(-w * duration)
        self.position[...], self.velocity[...] = follow(w, duration, share, goal, self.position, self.velocity)
