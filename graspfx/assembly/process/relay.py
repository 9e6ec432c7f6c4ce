"""Relay of rows from a servo's ring to a recorder: a row that is not fetched in time is NaN, and counted."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspfx.assembly.process.orders import LETTER
from graspfx.loop.realtime.ring import SLOTS, Ring, Word
from graspfx.recording.recorder import Recorder

FloatArray = NDArray[np.float64]

BACKLOG = 1 << 28  # bytes of rows that may wait for the disk; beyond it rows stay in the ring, the last ones


class Relay:
    """Fetches rows, faults and changes of a servo that runs in another process.

    Args:
        ring: of the servo.
        recorder: of the run.
        watch: told of each batch of rows by the tick of the first and the count of ticks, such as a viewer; it may look
            at the recorder's last row then.
        goals: gives goals of guided hands that were taken by key; None where there are none.

    Attributes:
        ticks: whose rows were fetched.
        lost: rows that came too late, which are NaN.
        faults: that the servo has noted.
        letters: values by the number of the letter that brings them to the servo.
    """

    def __init__(
        self,
        ring: Ring,
        recorder: Recorder,
        watch: Callable[[int, int], object] | None = None,
        goals: Callable[[FloatArray], Mapping[str, Any]] | None = None,
    ) -> None:
        self._ring, self._recorder, self._watch, self._name_goals = ring, recorder, watch, goals
        self.ticks = self.lost = 0
        self.faults: list[tuple[int, str]] = []
        self.letters: dict[int, Mapping[str, Any]] = {}
        self._goals = 0  # how many of them were told

    def fetch(self) -> None:
        """Hand the recorder what is new.

        Raises:
            RecordingError: the recorder cannot take it.
        """
        changes = [*self._changes(), *self._goal_changes()]
        for tick, values in sorted(changes, key=lambda change: change[0]):
            self._recorder.change(tick, values)
        if self._recorder.backlog > BACKLOG:
            return
        head, first = int(self._ring.words[Word.HEAD]), self.ticks
        while self.ticks < head:
            self._fetch_rows(head)
        if self._watch is not None and self.ticks > first:
            self._watch(first, self.ticks - first)

    def note_fault(self, tick: int, text: str) -> None:
        """Note a fault from a tick on."""
        self.faults.append((tick, text))
        self._recorder.fault(tick, text)

    def _fetch_rows(self, head: int) -> None:
        """Copy the rows of as many ticks as the recorder's block has room for."""
        rows, place, left = self._recorder.space()
        every, first = self._ring.every, self.ticks
        count = min(left, head - first)
        begin, end = -(-first // every), -(-(first + count) // every)  # numbers of the rows
        part = rows[-(-place // every) :][: end - begin]
        at = begin % SLOTS
        while len(part):
            piece = min(len(part), SLOTS - at, SLOTS)
            part[:piece] = self._ring.rows[at : at + piece]
            part, at = part[piece:], 0
        valid = -(-int(self._ring.words[Word.HEAD]) // every) + 1 - SLOTS  # the first that was not being written over
        late = min(max(valid - begin, 0), end - begin)
        if late:
            start = -(-place // every)
            rows[start : start + late] = np.nan
            self.lost += late
        self.ticks = first + count
        self._ring.words[Word.TAIL] = self.ticks
        self._recorder.take(count)
        self._recorder.drain()

    def _goal_changes(self) -> Iterator[tuple[int, Mapping[str, Any]]]:
        """List the goals that were taken since the last time; who comes 16384 of them late has lost some."""
        count = int(self._ring.words[Word.GOALS])
        for number in range(max(self._goals, count - SLOTS + 1), count):
            row = self._ring.goal_log[number % SLOTS]
            if self._name_goals is not None and (values := self._name_goals(row[1:])):
                yield int(row[0]), values
        self._goals = count

    def _changes(self) -> Iterator[tuple[int, Mapping[str, Any]]]:
        """List the changes of keys since the last time; faults that were noted meanwhile are recorded."""
        for kind, tick, content in self._ring.notes.news():
            if kind == "fault":
                self.note_fault(tick, content)
            else:
                yield tick, self.letters.pop(content[LETTER]) if LETTER in content else content
