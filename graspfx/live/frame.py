"""Rows of a recording, or of a running servo, as what is drawn: poses, fingertips, contacts and forces in space.

What happens on a line or in the plane is put into space: on its x axis, or on its plane of x and y.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from graspfx.errors import RecordingError
from graspfx.loop.columns import Layout
from graspfx.recording.header import Header, KeyChange, Outcome
from graspfx.recording.record import Recording
from graspfx.show.modes import Modes, directions, modes
from graspfx.show.picture.instant import apart_on_a_line, lifted
from graspfx.show.style import CONTACTS

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int8]
T = TypeVar("T")

STATES = tuple(CONTACTS)  # of a contact; "touch" where no friction tells which


class Pose(NamedTuple):
    """The frame in which a scene describes an object's shape: where it is [m], and its turn as a quaternion w, x, y, z.

    Of a mesh it is the frame of its file, of any other shape that of the object.
    """

    position: FloatArray
    wxyz: FloatArray


@dataclass(frozen=True)
class Frame:
    """One row as what is drawn, all in space. What its recording does not say is missing: None, or NaN.

    Attributes:
        time: [s].
        tick: of the row.
        objects: the pose of each object whose place is recorded.
        fingertips: (n, 3) [m].
        contact_position: c, of fingers that touch; else NaN (n, 3) [m].
        touching: (n,).
        states: of each finger one of `STATES`: "limit" where its force stands at a limit, "slide" and "stick" where
            there is friction, else "touch"; "free".
        force: of the fingers on the object (n, 3) [N]; zero of a free finger.
        internal, external: its parts, which squeeze and which move the object (n, 3) [N].
        limited: whether a finger's force stands at its limit (n,).
    """

    time: float
    tick: int
    objects: Mapping[str, Pose]
    fingertips: FloatArray
    contact_position: FloatArray
    touching: BoolArray
    states: tuple[str, ...]
    force: FloatArray | None
    internal: FloatArray | None
    external: FloatArray | None
    limited: BoolArray | None


class Frames(Sequence[Frame]):
    """Frames of rows, whose arrays are computed when they are asked for, all rows of one at a time.

    Args:
        history: a recording, or a part of one; of a long one, `Recording.part` or `Recording.parts`.
        apart: by how much fingers on a line are set apart across it [m], `Scenery.apart`.
    """

    def __init__(self, history: Recording, apart: float = 0.0) -> None:
        self.history, self.layout = history, history.layout
        self._across = apart * apart_on_a_line(len(self.layout.fingers))

    def __len__(self) -> int:
        return len(self.history)

    def __getitem__(self, k: int) -> Frame:  # type: ignore[override]
        """Give the frame of a row."""
        if not -len(self) <= k < len(self):
            raise IndexError(k)
        k %= len(self)
        every, start = self.history.header.every, self.history.start
        internal, external = self.parts or (None, None)
        return Frame(
            time=float(self.time[k]),
            tick=every * (start + k),
            objects={name: Pose(place[k], turn[k]) for name, (place, turn) in self.poses.items()},
            fingertips=self.fingertips[k],
            contact_position=self.contacts[k],
            touching=self.touching[k],
            states=tuple(STATES[state] for state in self.states[k]),
            force=None if self.force is None else self.force[k],
            internal=None if internal is None else internal[k],
            external=None if external is None else external[k],
            limited=None if self.limited is None else self.limited[k],
        )

    @property
    def time(self) -> FloatArray:
        """Times of the rows (N,) [s]."""
        return self.history.time

    @cached_property
    def poses(self) -> dict[str, tuple[FloatArray, FloatArray]]:
        """Positions (N, 3) [m] and quaternions w, x, y, z (N, 4) of each object whose place is recorded."""
        poses = {}
        for name in self.layout.objects:
            pose = self._or_none(lambda name=name: self.history.described_pose(name))  # type: ignore[misc]
            if pose is not None:
                poses[name] = lifted(pose[0], 3), quaternions(pose[1], len(self))
        return poses

    @cached_property
    def fingertips(self) -> FloatArray:
        """True positions of the fingertips, or those that devices report (N, n, 3) [m]; NaN where neither is there."""
        for name in ("true_position", "finger_position"):
            tips = self._column(name)
            if tips is not None:
                return self._spread(tips)
        return self._nowhere()

    @cached_property
    def contacts(self) -> FloatArray:
        """Contacts of the fingers that touch (N, n, 3) [m]; NaN of others."""
        contacts = self._column("contact_position")
        if contacts is None:
            return self._nowhere()
        return np.where(self.touching[:, :, None], self._spread(contacts), np.nan)

    @cached_property
    def touching(self) -> BoolArray:
        """Whether a finger exerts a force (N, n); no finger does where it is not recorded."""
        touching = self._column("touching")
        return np.zeros((len(self), len(self.layout.fingers)), dtype=bool) if touching is None else touching > 0.0

    @property
    def loose(self) -> dict[str, float]:
        """Objects that none of their fingers touches in any row, with the least gap in the last one [m].

        The gap is NaN where it is not recorded; no object is loose where nothing says who touches.
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
        """States of the contacts (N, n), as places in `STATES`."""
        states = self.touching.astype(np.int8)
        status = self._column("status")
        if status is not None:  # 0 free, 1 stick, 2 slide
            states = np.where(self.touching & (status > 0.0), STATES.index("touch") + np.nan_to_num(status), states)
        if self.limited is not None:
            states = np.where(self.touching & self.limited, STATES.index("limit"), states)
        return states.astype(np.int8)

    @cached_property
    def limited(self) -> BoolArray | None:
        """Whether a finger's force stands at its limit (N, n); None where nothing says so."""
        saturated = self._column("saturated")
        return None if saturated is None else saturated > 0.0

    @cached_property
    def force(self) -> FloatArray | None:
        """Forces of the fingers on the object, zero of free ones (N, n, 3) [N]."""
        force = self._column("finger_force")
        return None if force is None else self._exerted(force)

    @cached_property
    def parts(self) -> tuple[FloatArray, FloatArray] | None:
        """Internal and external parts of the forces (N, n, 3) [N]; None where the recording does not say them."""
        external = self._or_none(lambda: self.history.external_force)
        if external is None or self.force is None:
            return None
        outer = self._exerted(external)
        return self.force - outer, outer

    @cached_property
    def modes(self) -> dict[str, Modes]:
        """Squeeze and push of each object that fingers touch, as `graspfx plot` has them; none where not recorded."""
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
        """Give a quantity, or None where the recording leaves out what it follows from."""
        try:
            return quantity()
        except RecordingError:
            return None

    def _exerted(self, force: FloatArray) -> FloatArray:
        seen = self.touching[:, :, None] & np.isfinite(force)
        return lifted(np.where(seen, force, 0.0), 3)

    def _spread(self, places: FloatArray) -> FloatArray:
        """Lift places into space, and set fingers on a line apart across it."""
        places = lifted(places, 3)
        return places + self._across[:, None] * np.array([0.0, 1.0, 0.0]) if self._across.any() else places

    def _nowhere(self) -> FloatArray:
        return np.full((len(self), len(self.layout.fingers), 3), np.nan)


def frame_of(
    row: FloatArray, layout: Layout, header: Header, *, changes: Sequence[KeyChange] = (), tick: int = 0,
    apart: float = 0.0,
) -> Frame:  # fmt: skip
    """Read one row as what is drawn.

    Args:
        row: (width,), of the recorder or of the ring.
        layout: its columns.
        header: of the run.
        changes: of the run so far, with those of its split.
        tick: of the row.
        apart: by how much fingers on a line are set apart across it [m], `Scenery.apart`.
    """
    return Frames(history_of(row[None], layout, header, changes=changes, tick=tick), apart)[0]


def history_of(
    rows: FloatArray, layout: Layout, header: Header, *, changes: Sequence[KeyChange] = (), tick: int = 0
) -> Recording:
    """Name the columns of rows (r, width), the first of which is of a tick; they are not to be written to any more."""
    return Recording(rows, layout, header, Outcome(changes=tuple(changes)), start=tick // header.every)


def quaternions(turn: FloatArray | None, count: int) -> FloatArray:
    """Write turns as quaternions w, x, y, z (N, 4).

    Args:
        turn: angles (N,) [rad] about z, quaternions x, y, z, w (N, 4), or None for no turn.
        count: N.
    """
    wxyz = np.zeros((count, 4))
    if turn is None:
        wxyz[:, 0] = 1.0
    elif turn.ndim == 1:
        wxyz[:, 0], wxyz[:, 3] = np.cos(0.5 * turn), np.sin(0.5 * turn)
    else:
        wxyz[:] = turn[:, [3, 0, 1, 2]]
    return wxyz
