"""Motion of a recording for playback: frames at up to 60 Hz, and the minimum and maximum of all rows for charts."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from math import ceil
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspfx.errors import RecordingError
from graspfx.live.frame import Frames
from graspfx.recording.record import Recording

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int8]

RATE = 60.0  # highest frame rate [Hz]
MOST = 30_000  # most frames, for 8 minutes or more; longer recordings have a lower frame rate
WHOLE = 1 << 25  # bytes of rows that are processed at once


@dataclass
class Motion:
    """F frames of a recording with n fingers at regular intervals.

    In `squeeze`, `push`, `margin` and `depth`, the last index distinguishes three numbers: the value at the frame, and
    the minimum and the maximum over the rows from this frame to the next.

    Attributes:
        rows: Number of rows per frame.
        dimensions: Number of dimensions d of the scene.
        fingertips, contacts: Positions of fingertips and of contact points (F, n, 3) [m].
        states: Contact states (F, n), as indices into `frame.STATES`.
        force, internal, external: Forces of the fingers, and their internal and external parts (F, n, 3) [N]; None if
            not recorded.
        poses: Positions (F, 3) [m] and quaternions w, x, y, z (F, 4), by object.
        squeeze: Mean squeeze (F, 3) [N], by object.
        push: Push along each axis (F, 3, 3) [N], by object.
        margin: Friction margin of the grip (F, 3) [N], by object; empty if there is no friction.
        depth: Penetration depth of each finger (F, n, 3) [mm]; None if not recorded.
    """

    rows: int
    dimensions: int
    fingertips: FloatArray
    contacts: FloatArray
    states: IntArray
    force: FloatArray | None
    internal: FloatArray | None
    external: FloatArray | None
    poses: dict[str, tuple[FloatArray, FloatArray]]
    squeeze: dict[str, FloatArray]
    push: dict[str, FloatArray]
    margin: dict[str, FloatArray]
    depth: FloatArray | None

    def __len__(self) -> int:
        return len(self.fingertips)

    def vectors(self) -> FloatArray:
        """Return the frames as rows of w numbers (F, w), in the order in which the page of a run reads them.

        The order is: fingertips, contacts, states, internal and external forces; position and quaternion of each
        object; squeeze, push and friction margin of each object; depths. The last four each consist of value, minimum
        and maximum.
        """
        count, n, d = len(self), self.fingertips.shape[1], self.dimensions
        nothing = np.full((count, 3 * n), np.nan)
        parts = [nothing if each is None else each for each in (self.internal, self.external)]
        poses = [each for pose in self.poses.values() for each in pose]
        lines: list[FloatArray] = []
        for name, squeeze in self.squeeze.items():
            lines += [squeeze, self.push[name][:, :d], *([self.margin[name]] if name in self.margin else [])]
        lines += [] if self.depth is None else [self.depth]
        columns = [self.fingertips, self.contacts, self.states, *parts, *poses, *lines]
        return np.concatenate([np.reshape(each, (count, -1)) for each in columns], axis=1, dtype=float)


@dataclass
class Envelope:
    """Value at the first row of each frame, and minimum and maximum over all rows of the frame (F, ..., 3)."""

    count: int
    values: dict[str, FloatArray] = field(default_factory=dict)

    def add(self, name: str, numbers: FloatArray, rows: NDArray[np.intp], every: int) -> None:
        """Add the values (r, ...) of the rows with the indices `rows` (r,); there are `every` rows per frame.

        Minimum and maximum ignore NaN.
        """
        whole = self.values.setdefault(name, np.full((self.count, *numbers.shape[1:], 3), np.nan))
        frames = rows // every
        starts = np.flatnonzero(np.r_[True, np.diff(frames) > 0])
        own, first = frames[starts], rows % every == 0
        whole[frames[first], ..., 0] = numbers[first]
        whole[own, ..., 1] = np.fmin(whole[own, ..., 1], np.fmin.reduceat(numbers, starts))
        whole[own, ..., 2] = np.fmax(whole[own, ..., 2], np.fmax.reduceat(numbers, starts))


def motion_of(recording: Recording, apart: float) -> Motion:
    """Compute the motion of a recording for playback.

    Args:
        recording: Recording with at least one row; a long recording is read in parts.
        apart: Lateral distance at which fingers of a one-dimensional scene are drawn [m] (`Scenery.apart`).
    """
    count, layout = len(recording), recording.layout
    rows = max(rows_per_frame(recording.row_period), ceil(count / MOST))
    has_margin = any(column.name == "grip_margin" for column in layout.derived)
    squeeze, push, margin, depth = (Envelope(-(-count // rows)) for _ in range(4))
    pieces: dict[str, list[NDArray[Any]]] = {}
    for part in _parts(recording):
        frames, numbers = Frames(part, apart), np.arange(len(part)) + (part.start - recording.start)
        for name, each in frames.modes.items():
            squeeze.add(name, each.mean_squeeze, numbers, rows)
            push.add(name, each.push, numbers, rows)
            if has_margin:
                margin.add(name, _margin(part, name), numbers, rows)
        if "gap" in layout.columns:
            depth.add("depth", 1e3 * np.maximum(0.0, -part.array("gap")), numbers, rows)
        for name, values in _arrays(frames).items():
            pieces.setdefault(name, []).append(values[numbers % rows == 0])
    arrays = {name: np.concatenate(each) for name, each in pieces.items()}
    recorded = [name for name in layout.objects if f"{name}/position" in arrays]
    return Motion(
        rows=rows, dimensions=layout.dimensions, fingertips=arrays["fingertips"],
        contacts=arrays["contacts"], states=arrays["states"], force=arrays.get("force"),
        internal=arrays.get("internal"), external=arrays.get("external"), squeeze=squeeze.values, push=push.values,
        margin=margin.values, depth=depth.values.get("depth"),
        poses={name: (arrays[f"{name}/position"], arrays[f"{name}/wxyz"]) for name in recorded},
    )  # fmt: skip


def rows_per_frame(period: float) -> int:
    """Return the smallest number of rows per frame for which the frame rate is at most `RATE`.

    Args:
        period: Time from one row to the next [s].
    """
    return max(1, ceil(1.0 / (RATE * period) - 1e-9))


def _margin(part: Recording, name: str) -> FloatArray:
    """Return the friction margin of an object's grip (N,) [N]; NaN if it cannot be computed."""
    number = part.layout.objects.index(name)
    try:
        return part.grip_margin_of([i for i, own in enumerate(part.layout.finger_objects) if own == number])
    except RecordingError:
        return np.full(len(part), np.nan)


def _arrays(frames: Frames) -> dict[str, NDArray[Any]]:
    """Return the arrays for playback that are recorded, by name."""
    arrays: dict[str, NDArray[Any]] = {
        "fingertips": frames.fingertips, "contacts": frames.contacts, "states": frames.states,
    }  # fmt: skip
    if frames.force is not None:
        arrays["force"] = frames.force
    if frames.parts is not None:
        arrays["internal"], arrays["external"] = frames.parts
    for name, (place, turn) in frames.poses.items():
        arrays[f"{name}/position"], arrays[f"{name}/wxyz"] = place, turn
    return arrays


def _parts(recording: Recording) -> Iterator[Recording]:
    """Yield the whole recording or, if it is long, its parts."""
    if 8 * recording.layout.width * len(recording) <= WHOLE:
        yield recording
    else:
        yield from recording.parts()
