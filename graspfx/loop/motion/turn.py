"""Turns of a hand: rotations of all its targets about a fixed axis by an angle that varies in time."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspfx.compile.records import Floats, entries_of, start_of
from graspfx.errors import InputError
from graspfx.loop.motion.motion import CourseBlock, Motion, direction, floats, lay_out, parts_of
from graspfx.loop.motion.state import Turning
from graspfx.loop.motion.targets import turn

FloatArray = NDArray[np.float64]


class Turn:
    """r -> c + R (r - c) and r' -> R r' + angle' u x R (r - c), where R is the rotation by angle(t) about u.

    Args:
        angle: Angle as a one-dimensional motion [rad].
        centre: Centre c, (2,) or (3,) [m].
        axis: Direction u, (3,) of any length above zero, or the number 0, 1 or 2 of an axis; None in 2-D, where it is
            z.
    """

    def __init__(self, angle: Motion, centre: ArrayLike, axis: int | ArrayLike | None = None) -> None:
        c = floats("centre", centre)
        if c.shape not in ((2,), (3,)) or not np.isfinite(c).all():
            raise InputError("centre", centre, "finite components (2,) or (3,) of a point [m]")
        if angle.dimensions not in (None, 1):
            raise InputError("angle", angle.dimensions, "a one-dimensional motion, the angle [rad]")
        self.dimensions = d = len(c)
        if d == 2:
            if axis is not None:
                raise InputError("axis", axis, "no axis, because in 2-D it is always z")
            u = direction(2, 3)
        else:
            if axis is None:
                raise InputError("axis", axis, "an axis (3,) in space")
            u = direction(axis, 3)
        self._course = lay_out(parts_of(angle), 1)
        front = np.zeros(start_of(Turning, "angle"))
        turning = Turning(front)
        turning.course_entries = len(self._course.entries)
        turning.array(Turning.centre)[:d], turning.array(Turning.axis)[:] = c, u
        self._entries = np.concatenate([front, self._course.entries])

    @property
    def laid_out(self) -> CourseBlock:
        """The turn, laid out as a `Turning`."""
        _, structure, others = self._course
        start = start_of(Turning, "angle")
        fixed = np.append(start + structure, entries_of(Turning, "course_entries"))
        return CourseBlock(self._entries, fixed, [(start + at, angle) for at, angle in others])

    def turned(self, time: float, r: FloatArray, v: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Rotate positions (n, d) [m] and velocities (n, d) [m/s]; return the same arrays while the angle and its rate
        are zero."""
        block, position, velocity = self._entries.copy(), np.array(r, dtype=float), np.array(v, dtype=float)
        self._course.ask(block, start_of(Turning, "angle"), time)
        places = Floats(position.reshape(-1).data), Floats(velocity.reshape(-1).data)
        if not turn(Turning(block.data), time, *places, len(r), self.dimensions):
            return r, v
        return position, velocity
