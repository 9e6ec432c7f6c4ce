"""Turns of a hand: all its targets about an axis through a point, by an angle that changes in time."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspfx.errors import InputError
from graspfx.loop.motion import Motion, direction, floats

FloatArray = NDArray[np.float64]


class Turn:
    """r -> c + R (r - c) and r' -> R r' + angle' u x R (r - c), R the rotation by angle(t) about u.

    Args:
        angle: in time, of one dimension [rad].
        centre: c, (2,) or (3,) [m].
        axis: u, (3,) of any length above zero, or 0, 1, 2 for an axis; None in the plane, where it is z.
    """

    def __init__(self, angle: Motion, centre: ArrayLike, axis: int | ArrayLike | None = None) -> None:
        c = floats("centre", centre)
        if c.shape not in ((2,), (3,)) or not np.isfinite(c).all():
            raise InputError("centre", centre, "finite components (2,) or (3,) of a point [m]")
        if angle.dimensions not in (None, 1):
            raise InputError("angle", angle.dimensions, "a motion of one dimension, an angle [rad]")
        self.dimensions = d = len(c)
        self._angle, self._centre = angle, c
        if d == 2:
            if axis is not None:
                raise InputError("axis", axis, "no axis in the plane: it is z")
            self._along = np.zeros((2, 2))
            self._cross = np.array([[0.0, -1.0], [1.0, 0.0]])  # [u]x: its product with v is u x v
        else:
            if axis is None:
                raise InputError("axis", axis, "an axis (3,) in space")
            u = direction(axis, 3)
            self._along = np.outer(u, u)
            self._cross = np.array([[0.0, -u[2], u[1]], [u[2], 0.0, -u[0]], [-u[1], u[0], 0.0]])
        self._across = np.eye(d) - self._along

    def turned(self, time: float, r: FloatArray, v: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Positions (n, d) [m] and velocities (n, d) [m/s] after this turn, from those before it; the same arrays
        while there is nothing to turn."""
        angle, rate = (float(value[0]) for value in self._angle.at(time))
        if angle == 0.0 and rate == 0.0:
            return r, v
        R = self._along + math.cos(angle) * self._across + math.sin(angle) * self._cross
        arms = (r - self._centre) @ R.T
        return self._centre + arms, v @ R.T + rate * (arms @ self._cross.T)
