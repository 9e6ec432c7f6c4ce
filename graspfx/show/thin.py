"""A long recording thinned for a figure: of each short while, the rows in which something is least or greatest."""

from __future__ import annotations

from contextlib import suppress
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from graspfx.errors import RecordingError
from graspfx.recording.record import Recording

FloatArray = NDArray[np.float64]

MOST = 1 << 25  # bytes of rows that are drawn as they are
SPANS = 1500  # short whiles into which a longer recording is divided


class Thinned(Recording):
    """Rows of a recording that are not equally far apart.

    Args:
        whole: the recording.
        rows: some of its rows.
        numbers: of these rows in it.
    """

    def __init__(self, whole: Recording, rows: FloatArray, numbers: NDArray[np.intp]) -> None:
        super().__init__(rows, whole.layout, whole.header, whole.outcome)
        self._numbers, self._end = numbers, whole.end

    def part(self, first: int, stop: int) -> Thinned:
        """Give the rows from one up to another."""
        return Thinned(self, self.rows[first:stop], self._numbers[first:stop])

    @cached_property
    def time(self) -> FloatArray:
        """Times of the rows, (N,) [s]."""
        return self.header.every * self._numbers.astype(float) * self.header.period

    @property
    def end(self) -> float:
        """Time at which the run ended [s]."""
        return self._end


def thinned(recording: Recording) -> Recording:
    """Thin a recording on a disk that is too long to be drawn from memory; others are returned as they are.

    Of each of `SPANS` equal whiles it has the first row, and those in which a number of a drawn quantity (positions,
    forces and their parts) is least or greatest, so that lines keep their envelopes.
    """
    size = 8 * recording.layout.width * len(recording)
    if not recording.is_stored or size <= MOST or recording.changes:
        return recording
    step = -(-len(recording) // SPANS)
    rows, numbers = [], []
    for first in range(0, len(recording), step):
        part = recording.part(first, min(first + step, len(recording)))
        rows_drawn = _ends(part)
        rows.append(part.rows[rows_drawn])
        numbers.append(first + rows_drawn)
    return Thinned(recording, np.concatenate(rows), np.concatenate(numbers))


def _ends(part: Recording) -> NDArray[np.intp]:
    """Find the rows in which a drawn number is least or greatest, and the first."""
    names = ["finger_position", "finger_force", "gap"]
    names += [f"objects/{name}/{place}" for name in part.layout.objects for place in ("position", "orientation")]
    drawn = [part.array(name) for name in names if name in part.layout.columns]
    with suppress(RecordingError):  # of one that does not say how forces divide
        drawn += [part.external_force, part.internal_displacement]
    numbers = np.concatenate([np.nan_to_num(each.reshape(len(part), -1)) for each in drawn], axis=1)
    return np.unique(np.concatenate([[0], numbers.argmin(axis=0), numbers.argmax(axis=0)]))
