"""Rotation of all targets of a hand about a fixed axis by an angle that varies in time."""

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
    """Rotation of the target positions r and velocities r' of a hand:

        r -> c + R (r - c),   r' -> R r' + angle' u x R (r - c)

    where c is the centre and R the rotation matrix by angle(t) about the axis u.

    Args:
        angle: Angle as a one-dimensional motion [rad].
        centre: Centre c, (2,) or (3,) [m].
        axis: Axis u, a vector (3,) of any length above zero, or the number 0, 1 or 2 of an axis. It must be None in two
            dimensions, where the axis is z.
    """

    def __init__(self, angle: Motion, centre: ArrayLike, axis: int | ArrayLike | None = None) -> None:
        c = floats("centre", centre)
        if c.shape not in ((2,), (3,)) or not np.isfinite(c).all():
            raise InputError("centre", centre, "a point with finite components (2,) or (3,) [m]")
        if angle.dimensions not in (None, 1):
            raise InputError("angle", angle.dimensions, "a one-dimensional motion, the angle [rad]")
        self.dimensions = d = len(c)
        if d == 2:
            if axis is not None:
                raise InputError("axis", axis, "None, because the axis is always z in two dimensions")
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
        """Block of the rotation, with the structure of `Turning`."""
        _, structure, others = self._course
        start = start_of(Turning, "angle")
        fixed = np.append(start + structure, entries_of(Turning, "course_entries"))
        return CourseBlock(self._entries, fixed, [(start + at, angle) for at, angle in others])

    def turned(self, time: float, r: FloatArray, v: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return positions (n, d) [m] and velocities (n, d) [m/s] rotated by the angle at a time [s].

        If the angle and its rate are zero, the given arrays are returned.
        """
        block, position, velocity = self._entries.copy(), np.array(r, dtype=float), np.array(v, dtype=float)
        self._course.ask(block, start_of(Turning, "angle"), time)
        places = Floats(position.reshape(-1).data), Floats(velocity.reshape(-1).data)
        if not turn(Turning(block.data), time, *places, len(r), self.dimensions):
            return r, v
        return position, velocity
