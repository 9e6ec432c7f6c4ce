"""Turns of a hand: all its targets about an axis through a point, by an angle that changes in time."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspfx.errors import InputError
from graspfx.loop.motion.motion import Course, Motion, direction, floats, lay_out, parts_of
from graspfx.loop.tick import targets

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
        if d == 2:
            if axis is not None:
                raise InputError("axis", axis, "no axis in the plane: it is z")
            u = direction(2, 3)
        else:
            if axis is None:
                raise InputError("axis", axis, "an axis (3,) in space")
            u = direction(axis, 3)
        self._course = lay_out(parts_of(angle), 1)
        length = targets.COURSE + len(self._course.entries)
        room = [0.0] * (targets.COURSE - targets.ANGLE)
        self._entries = np.concatenate([[length], c, [0.0] * (3 - d), u, room, self._course.entries])

    @property
    def laid_out(self) -> Course:
        """The turn for `targets.turn`."""
        _, structure, given = self._course
        start = targets.COURSE
        return Course(
            self._entries, np.append(start + structure, targets.LENGTH), [(start + at, angle) for at, angle in given]
        )

    def turned(self, time: float, r: FloatArray, v: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Positions (n, d) [m] and velocities (n, d) [m/s] after this turn, from those before it; the same arrays
        while there is nothing to turn."""
        o = 2 * r.size
        S = np.concatenate([r.ravel(), v.ravel(), self._entries])
        self._course.ask(S, o + targets.COURSE, time, 1)
        if not targets.turn(S.data, o, time, 0, r.size, len(r), self.dimensions):
            return r, v
        return S[: r.size].reshape(r.shape), S[r.size : o].reshape(r.shape)
