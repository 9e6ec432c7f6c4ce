"""Motion of a recording as a page plays it: frames at 50 to 60 Hz, and charts with the envelope of all ticks."""

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

RATE = 60.0  # frames in a second, at most
MOST = 30_000  # frames of a recording: 8 minutes and more; of a longer one there are fewer in a second
WHOLE = 1 << 25  # bytes of rows that are looked at in one piece


@dataclass
class Motion:
    """Every so many rows of a recording.

    Attributes:
        rows: from a frame to the next.
        time: (F,) [s].
        fingertips, contacts: (F, n, 3) [m].
        states: (F, n), places in `frame.STATES`.
        force, internal, external: (F, n, 3) [N]; None where the recording does not say them.
        poses: by object, positions (F, 3) [m] and quaternions w, x, y, z (F, 4).
        squeeze: by object, the mean squeeze of a frame, and the least and the greatest up to the next (F, 3) [N].
        push: by object, those of the push along each axis (F, 3, 3) [N].
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
    """A number of each frame's first row, and the least and the greatest of all its rows, (F, ..., 3)."""

    count: int
    values: dict[str, FloatArray] = field(default_factory=dict)

    def add(self, name: str, numbers: FloatArray, rows: NDArray[np.intp], every: int) -> None:
        """Take values (r, ...) of rows (r,) into account, `every` of which are a frame; NaN is no value."""
        whole = self.values.setdefault(name, np.full((self.count, *numbers.shape[1:], 3), np.nan))
        frames = rows // every
        starts = np.flatnonzero(np.r_[True, np.diff(frames) > 0])
        own, first = frames[starts], rows % every == 0
        whole[frames[first], ..., 0] = numbers[first]
        whole[own, ..., 1] = np.fmin(whole[own, ..., 1], np.fmin.reduceat(numbers, starts))
        whole[own, ..., 2] = np.fmax(whole[own, ..., 2], np.fmax.reduceat(numbers, starts))


def motion_of(recording: Recording, apart: float) -> Motion:
    """Read what a page plays.

    Args:
        recording: with at least one row; read in parts where it is long.
        apart: by how much fingers on a line are set apart [m], `Scenery.apart`.
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
    """List what is played, as far as it is recorded."""
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
    """Give the recording as it is, or a long one in parts."""
    if 8 * recording.layout.width * len(recording) <= WHOLE:
        yield recording
    else:
        yield from recording.parts()
