"""Poses, fingertips, contacts and forces in 3-D, for drawing rows of a recording or of a running servo.

One-dimensional scenes lie on the x axis; two-dimensional scenes lie in the x-y plane.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from graspfx.errors import RecordingError
from graspfx.loop.columns import Layout
from graspfx.recording.header import Header, KeyChange, Outcome
from graspfx.recording.record import Recording
from graspfx.show.picture.instant import apart_on_a_line, lifted
from graspfx.show.squeeze_and_push import Modes, directions, modes
from graspfx.show.style import CONTACTS

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int8]
T = TypeVar("T")

STATES = tuple(CONTACTS)  # states of a contact; a touching contact without friction is in the state "touch"


class Frames:
    """Arrays in 3-D for drawing N rows with n fingers; each array is computed on first use, for all rows together.

    Args:
        history: Recording or part of a recording; for long recordings, use `Recording.part` or `Recording.parts`.
        apart: Lateral distance at which fingers of a one-dimensional scene are drawn [m] (`Scenery.apart`).
    """

    def __init__(self, history: Recording, apart: float = 0.0) -> None:
        self.history, self.layout = history, history.layout
        self._across = apart * apart_on_a_line(len(self.layout.fingers))

    def __len__(self) -> int:
        return len(self.history)

    @property
    def time(self) -> FloatArray:
        """Times of the rows (N,) [s]."""
        return self.history.time

    @cached_property
    def poses(self) -> dict[str, tuple[FloatArray, FloatArray]]:
        """Positions (N, 3) [m] and quaternions w, x, y, z (N, 4) of each object with a recorded position.

        For a mesh, the pose is that of the frame of the mesh file; for any other shape, that of the object's frame.
        """
        poses = {}
        for name in self.layout.objects:
            pose = self._or_none(lambda name=name: self.history.described_pose(name))  # type: ignore[misc]
            if pose is not None:
                poses[name] = lifted(pose[0], 3), quaternions(pose[1], len(self))
        return poses

    @cached_property
    def fingertips(self) -> FloatArray:
        """Positions of the fingertips (N, n, 3) [m].

        They are the true positions or, if these are not recorded, the positions reported by the devices. They are NaN
        if neither is recorded.
        """
        for name in ("true_position", "finger_position"):
            tips = self._column(name)
            if tips is not None:
                return self._spread(tips)
        return self._nowhere()

    @cached_property
    def contacts(self) -> FloatArray:
        """Contact points of touching fingers (N, n, 3) [m]; NaN for free fingers, or if not recorded."""
        contacts = self._column("contact_position")
        if contacts is None:
            return self._nowhere()
        return np.where(self.touching[:, :, None], self._spread(contacts), np.nan)

    @cached_property
    def touching(self) -> BoolArray:
        """Whether each finger exerts a force on the object (N, n); False if not recorded."""
        touching = self._column("touching")
        return np.zeros((len(self), len(self.layout.fingers)), dtype=bool) if touching is None else touching > 0.0

    @property
    def loose(self) -> dict[str, float]:
        """Smallest gap to a finger in the last row [m], for each object that no finger touches in any row.

        The gap is NaN if it was not recorded. The dictionary is empty if the column `touching` was not recorded.
        """
        if "touching" not in self.layout.columns or not len(self):
            return {}
        gap, loose = self._column("gap"), {}
        for number, name in enumerate(self.layout.objects):
            fingers = [i for i, own in enumerate(self.layout.finger_objects) if own == number]
            if fingers and not self.touching[:, fingers].any():
                loose[name] = float("nan") if gap is None else float(gap[-1, fingers].min())
        return loose

    @cached_property
    def states(self) -> IntArray:
        """States of the contacts (N, n), as indices into `STATES`.

        The state is "free" without contact, "limit" if the force is saturated, "slide" or "stick" if the status of a
        frictional contact is recorded, and otherwise "touch".
        """
        states = self.touching.astype(np.int8)
        status = self._column("status")
        if status is not None:  # 0 free, 1 stick, 2 slide
            states = np.where(self.touching & (status > 0.0), STATES.index("touch") + np.nan_to_num(status), states)
        if self.limited is not None:
            states = np.where(self.touching & self.limited, STATES.index("limit"), states)
        return states.astype(np.int8)

    @cached_property
    def limited(self) -> BoolArray | None:
        """Whether each finger's force is saturated (N, n); None if not recorded."""
        saturated = self._column("saturated")
        return None if saturated is None else saturated > 0.0

    @cached_property
    def force(self) -> FloatArray | None:
        """Forces of the fingers on the object (N, n, 3) [N], zero for free fingers; None if not recorded."""
        force = self._column("finger_force")
        return None if force is None else self._exerted(force)

    @cached_property
    def parts(self) -> tuple[FloatArray, FloatArray] | None:
        """Internal and external parts of the forces, each (N, n, 3) [N]; None if not recorded."""
        external = self._or_none(lambda: self.history.external_force)
        if external is None or self.force is None:
            return None
        outer = self._exerted(external)
        return self.force - outer, outer

    @cached_property
    def modes(self) -> dict[str, Modes]:
        """Squeeze and push of each object that has fingers, as in `graspfx plot`; empty if a column is missing."""
        contacts = self._column("contact_position")
        tips = self._column("finger_position")
        if self.parts is None or contacts is None or tips is None or not len(self):
            return {}
        contacts, tips = (np.nan_to_num(lifted(each, 3)) for each in (contacts, tips))
        squeezes: dict[str, Modes] = {}
        for number, name in enumerate(self.layout.objects):
            fingers = [i for i, own in enumerate(self.layout.finger_objects) if own == number]
            if fingers:
                inward = directions(contacts[:, fingers], (tips - contacts)[:, fingers])
                internal, external = (part[:, fingers] for part in self.parts)
                squeezes[name] = modes(internal, external, inward, self.touching[:, fingers])
        return squeezes

    def _column(self, name: str) -> FloatArray | None:
        return self.history.array(name) if name in self.layout.columns else None

    def _or_none(self, quantity: Callable[[], T]) -> T | None:
        """Return a quantity, or None if it cannot be computed from the recording."""
        try:
            return quantity()
        except RecordingError:
            return None

    def _exerted(self, force: FloatArray) -> FloatArray:
        seen = self.touching[:, :, None] & np.isfinite(force)
        return lifted(np.where(seen, force, 0.0), 3)

    def _spread(self, places: FloatArray) -> FloatArray:
        """Convert positions to 3-D; in a one-dimensional scene, also displace the fingers laterally."""
        places = lifted(places, 3)
        return places + self._across[:, None] * np.array([0.0, 1.0, 0.0]) if self._across.any() else places

    def _nowhere(self) -> FloatArray:
        return np.full((len(self), len(self.layout.fingers), 3), np.nan)


def history_of(
    rows: FloatArray, layout: Layout, header: Header, *, changes: Sequence[KeyChange] = (), tick: int = 0
) -> Recording:
    """Make a recording of the rows (r, width), of which the first belongs to `tick`.

    The rows are not copied and must not be modified afterwards.
    """
    return Recording(rows, layout, header, Outcome(changes=tuple(changes)), start=tick // header.every)


def quaternions(turn: FloatArray | None, count: int) -> FloatArray:
    """Convert rotations to quaternions w, x, y, z (N, 4).

    Args:
        turn: Angles about z (N,) [rad], quaternions x, y, z, w (N, 4), or None for no rotation.
        count: Number of rows N.
    """
    wxyz = np.zeros((count, 4))
    if turn is None:
        wxyz[:, 0] = 1.0
    elif turn.ndim == 1:
        wxyz[:, 0], wxyz[:, 3] = np.cos(0.5 * turn), np.sin(0.5 * turn)
    else:
        wxyz[:] = turn[:, [3, 0, 1, 2]]
    return wxyz
