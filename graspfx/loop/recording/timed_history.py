"""The history of a run on the wall's clock: when its ticks were, what its devices told besides, and what happened."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from graspfx.loop.recording.by_name import by_name
from graspfx.loop.recording.header import MARK, REST
from graspfx.loop.recording.history import History

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]


class Event(NamedTuple):
    """An event of a run: its tick, "fault", "change" of a key or "rest", and its text."""

    tick: int
    kind: str
    text: str

    def __str__(self) -> str:
        return f"tick {self.tick}: {self.kind}, {self.text}"


class TimedHistory(History):
    """A history with the columns of a run on the wall's clock; they are None for any other run."""

    @property
    def wall(self) -> FloatArray | None:
        """Times of the ticks on the wall's clock since that of the first, (N,) [s]."""
        return self.optional("wall")

    @property
    def late(self) -> FloatArray | None:
        """Times by which the ticks began after their deadlines, (N,) [s]."""
        return self.optional("late")

    @property
    def io(self) -> FloatArray | None:
        """Times that the devices took to be asked and read, and to be written, (N, 2) [s]."""
        return self.optional("io")

    @property
    def skipped(self) -> IntArray | None:
        """Periods that were left out before each tick, (N,)."""
        return self._integers("skipped")

    @cached_property
    def fresh(self) -> BoolArray | None:
        """Whether each finger's reading brought a new sample, (N, n)."""
        values = self.optional("fresh")
        return None if values is None else np.not_equal(values, 0.0)

    @property
    def largest_force(self) -> FloatArray | None:
        """Largest forces that devices told they could display where they were read, (N, n) [N]; infinite without.

        None also where no device's limit depends on where it stands.
        """
        return self.optional("largest_force")

    @property
    def switches(self) -> IntArray | None:
        """Switches of each device as bits, (N, devices), in the order of `layout.devices`; None where none has any."""
        return self._integers("switches")

    @cached_property
    def raw(self) -> Mapping[str, IntArray | FloatArray]:
        """Raw numbers that came over the wire, by the device's first finger, (N, m); of devices that show them."""
        kinds = {name: kind for name, _, kind in self.layout.raw if f"raw/{name}" not in self.layout.omitted}
        return by_name(
            "device with raw numbers", {name: self.array(f"raw/{name}").astype(kind) for name, kind in kinds.items()}
        )

    @property
    def rest(self) -> int | None:
        """The tick from which forces decay as the run ends; None where they end at once."""
        return next((change.tick for change in self.outcome.changes if change.key == REST), None)

    @property
    def events(self) -> tuple[Event, ...]:
        """Faults, changes of keys, marks and the rest in the order of their ticks."""
        events = [Event(fault.tick, "fault", fault.message) for fault in self.faults]
        events += [Event(change.tick, "change", f"{change.key} = {change.value}") for change in self.changes]
        ends = [change for change in self.outcome.changes if change.key == REST]
        events += [Event(change.tick, "rest", str(change.value)) for change in ends]
        marks = [change for change in self.outcome.changes if change.key == MARK]
        events += [Event(change.tick, "mark", str(change.value)) for change in marks]
        return tuple(sorted(events, key=lambda event: event.tick))

    def _integers(self, column: str) -> IntArray | None:
        values = self.optional(column)
        return None if values is None else values.astype(np.int64)
