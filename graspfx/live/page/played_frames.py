"""Motion of a recording for playback: frames at 50 to 60 Hz, and charts with the envelope of all ticks."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from math import ceil
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspfx.live.frame import Frames
from graspfx.recording.record import Recording

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int8]

RATE = 60.0  # highest frame rate [Hz]
MOST = 30_000  # most frames, for 8 minutes or more; longer recordings have a lower frame rate
WHOLE = 1 << 25  # bytes of rows that are processed at once


@dataclass
class Motion:
    """Frames of a recording at regular intervals.

    Attributes:
        rows: Number of rows per frame.
        time: Times of the frames (F,) [s].
        fingertips, contacts: Positions (F, n, 3) [m].
        states: Contact states (F, n), indices of `frame.STATES`.
        force, internal, external: Forces (F, n, 3) [N]; None if not recorded.
        poses: Positions (F, 3) [m] and quaternions w, x, y, z (F, 4), by object.
        squeeze: Mean squeeze at a frame, with minimum and maximum until the next frame (F, 3) [N], by object.
        push: The same for the push along each axis (F, 3, 3) [N], by object.
    """

    rows: int
    time: FloatArray
    fingertips: FloatArray
    contacts: FloatArray
    states: IntArray
    force: FloatArray | None
    internal: FloatArray | None
    external: FloatArray | None
    poses: dict[str, tuple[FloatArray, FloatArray]]
    squeeze: dict[str, FloatArray]
    push: dict[str, FloatArray]

    def __len__(self) -> int:
        return len(self.time)


@dataclass
class Envelope:
    """Values at each frame's first row, with minimum and maximum over its rows (F, ..., 3)."""

    count: int
    values: dict[str, FloatArray] = field(default_factory=dict)

    def add(self, name: str, numbers: FloatArray, rows: NDArray[np.intp], every: int) -> None:
        """Add values (r, ...) of rows (r,), with `every` rows per frame; NaN is ignored."""
        whole = self.values.setdefault(name, np.full((self.count, *numbers.shape[1:], 3), np.nan))
        frames = rows // every
        starts = np.flatnonzero(np.r_[True, np.diff(frames) > 0])
        own, first = frames[starts], rows % every == 0
        whole[frames[first], ..., 0] = numbers[first]
        whole[own, ..., 1] = np.fmin(whole[own, ..., 1], np.fmin.reduceat(numbers, starts))
        whole[own, ..., 2] = np.fmax(whole[own, ..., 2], np.fmax.reduceat(numbers, starts))


def motion_of(recording: Recording, apart: float) -> Motion:
    """Read the motion for playback.

    Args:
        recording: Recording with at least one row; a long one is read in parts.
        apart: Lateral distance between fingers on a line [m], `Scenery.apart`.
    """
    count = len(recording)
    rows = max(1, ceil(1.0 / (RATE * recording.row_period) - 1e-9), ceil(count / MOST))
    squeeze, push = Envelope(-(-count // rows)), Envelope(-(-count // rows))
    pieces: dict[str, list[NDArray[Any]]] = {}
    for part in _parts(recording):
        frames, numbers = Frames(part, apart), np.arange(len(part)) + (part.start - recording.start)
        for name, each in frames.modes.items():
            squeeze.add(name, each.mean_squeeze, numbers, rows)
            push.add(name, each.push, numbers, rows)
        for name, values in _arrays(frames).items():
            pieces.setdefault(name, []).append(values[numbers % rows == 0])
    arrays = {name: np.concatenate(each) for name, each in pieces.items()}
    recorded = [name for name in recording.layout.objects if f"{name}/position" in arrays]
    return Motion(
        rows=rows, time=arrays["time"], fingertips=arrays["fingertips"], contacts=arrays["contacts"],
        states=arrays["states"], force=arrays.get("force"), internal=arrays.get("internal"),
        external=arrays.get("external"), squeeze=squeeze.values, push=push.values,
        poses={name: (arrays[f"{name}/position"], arrays[f"{name}/wxyz"]) for name in recorded},
    )  # fmt: skip


def _arrays(frames: Frames) -> dict[str, NDArray[Any]]:
    """List the recorded arrays for playback."""
    arrays: dict[str, NDArray[Any]] = {
        "time": frames.time, "fingertips": frames.fingertips, "contacts": frames.contacts, "states": frames.states,
    }  # fmt: skip
    if frames.force is not None:
        arrays["force"] = frames.force
    if frames.parts is not None:
        arrays["internal"], arrays["external"] = frames.parts
    for name, (place, turn) in frames.poses.items():
        arrays[f"{name}/position"], arrays[f"{name}/wxyz"] = place, turn
    return arrays


def _parts(recording: Recording) -> Iterator[Recording]:
    """Yield the recording, or its parts if it is long."""
    if 8 * recording.layout.width * len(recording) <= WHOLE:
        yield recording
    else:
        yield from recording.parts()
