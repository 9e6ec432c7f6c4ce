"""The motion of one object of a recording, and of the frame in which its scene describes it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from graspfx.card import Card, Carded
from graspfx.spatial import Quaternion, Vector, rotate

FloatArray = NDArray[np.float64]


class Columns(Protocol):
    """A recording's columns by name."""

    def array(self, column: str) -> FloatArray:
        """View a column, (N, ...)."""
        ...

    def optional(self, column: str) -> FloatArray | None:
        """View a column; None if the scene has no such quantity."""
        ...

    def whole_numbers(self, column: str) -> NDArray[np.int8] | None:
        """View a column of whole numbers; None if the scene has no such quantity."""
        ...


class ObjectMotion(Carded):
    """One object over time."""

    def __init__(self, columns: Columns, name: str) -> None:
        self._columns, self._at = columns, f"objects/{name}/"

    @property
    def position(self) -> FloatArray:
        """Positions of its centre, (N, d) [m]."""
        return self._columns.array(self._at + "position")

    @property
    def velocity(self) -> FloatArray:
        """Velocities of its centre, (N, d) [m/s]."""
        return self._columns.array(self._at + "velocity")

    @property
    def orientation(self) -> FloatArray | None:
        """Angles (N,) [rad] in a plane, quaternions x y z w (N, 4) in space, or None on a line."""
        return self._columns.optional(self._at + "orientation")

    @property
    def angular_velocity(self) -> FloatArray | None:
        """Angular velocities, (N,) or (N, 3) [rad/s], or None on a line."""
        return self._columns.optional(self._at + "angular_velocity")

    @property
    def wrench(self) -> FloatArray:
        """Wrenches of the fingers on the object about its centre, (N, w) [N, N m]."""
        return self._columns.array(self._at + "wrench")

    @cached_property
    def law(self) -> NDArray[np.int8] | None:
        """Law that the elastic force satisfies, (N,), 0 Coulomb's, 1 the associated one; None without a coefficient."""
        return self._columns.whole_numbers(self._at + "law")

    @property
    def residual(self) -> FloatArray | None:
        """Residuals of that law, (N,) [N]; None without a coefficient."""
        return self._columns.optional(self._at + "residual")

    @property
    def scale(self) -> FloatArray | None:
        """Shares of the law's forces that a safety chain left, (N, 4); None without [safety].

        By the soft start; by trust in readings and speeds; lambda, of what squeezes only; and the least of a finger's
        whole force.
        """
        return self._columns.optional(self._at + "scale")

    @property
    def tank(self) -> FloatArray | None:
        """Energy that a safety chain pays for stiffness with, (N,) [J]; None without a chain."""
        return self._columns.optional(self._at + "tank")

    def _card(self) -> Card:
        from graspfx.loop.recording.recording_card import motion_card

        return motion_card(self)


def described_pose(
    motion: ObjectMotion, frame: Mapping[str, Sequence[float]] | None
) -> tuple[FloatArray, FloatArray | None]:
    """Compute the pose of the frame that a scene describes an object's shape in: position (N, d) [m], orientation.

    Args:
        motion: of the object.
        frame: the pose of a mesh file's frame in the recorded one; None for any other shape.
    """
    if frame is None or motion.orientation is None:
        return motion.position, motion.orientation
    q: Any = Quaternion(*motion.orientation.T)  # of columns of ticks: the formulas are elementwise
    offset, turn = rotate(q, Vector(*frame["position"])), q @ Quaternion(*frame["orientation"])
    columns = np.broadcast_arrays(offset.x, offset.y, offset.z)
    return motion.position + np.stack(columns, axis=1), np.stack([turn.x, turn.y, turn.z, turn.w], axis=1)
