"""Streams of the Lab Streaming Layer: markers, and numbers of a run at a lower rate, from a thread beside it."""

from __future__ import annotations

import threading
import uuid
from collections.abc import Sequence
from contextlib import suppress
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from graspfx.errors import GraspFXError, InputError, MissingPackageError

if TYPE_CHECKING:
    from graspfx.live.live_run import LiveRun
    from graspfx.loop.recording.layout import Layout

RATE = 100.0  # rows a second
COLUMNS = ("finger_position", "finger_force", "touching")  # of every run
MARKERS, HAPTICS = "Markers", "Haptics"  # types of the streams
SETTINGS = "[log]\nlevel = -1\n"  # warnings and errors alone on the terminal
LIBRARY = "install liblsl (https://github.com/sccn/liblsl/releases), or let PYLSL_LIB name its file"


def load_lsl() -> Any:
    """Load pylsl and its library.

    Raises:
        MissingPackageError: the package is not installed, or its library cannot be loaded.
    """
    try:
        import pylsl
    except ImportError as error:
        raise MissingPackageError.of_extra("pylsl", "an LSL stream", "lsl") from error
    except (RuntimeError, OSError) as error:  # it has no library for this machine, as on Linux for ARM
        raise MissingPackageError("liblsl", "an LSL stream", LIBRARY) from error
    with suppress(RuntimeError):  # older libraries take no settings
        pylsl.set_config_content(SETTINGS)
    return pylsl


class MarkerStream:
    """A stream of texts at irregular times.

    Args:
        name: of the stream.

    Raises:
        MissingPackageError: no pylsl, or no library.
    """

    def __init__(self, name: str) -> None:
        lsl = load_lsl()
        self.source = f"graspfx-markers-{uuid.uuid4()}"
        info = lsl.StreamInfo(name, MARKERS, 1, lsl.IRREGULAR_RATE, lsl.cf_string, self.source)
        self._outlet: Any = lsl.StreamOutlet(info)
        self._offset = lsl.local_clock() - _clock()

    def send(self, text: str, clock: float) -> None:
        """Send a text with its time, of `time.monotonic` [s]."""
        self._outlet.push_sample([text], clock + self._offset)


class RowStream:
    """A stream of numbers of a run: its newest row, at a lower rate than its ticks.

    The time of a sample is that of its tick. A thread reads the ring of rows, as a page does: the servo knows nothing
    of it.

    Args:
        name: of the stream.
        layout: of the rows.
        period: T [s].
        rate: of samples, at most one a tick [Hz].
        columns: of the rows, whose components are the stream's channels.

    Attributes:
        channels: their names, as `recording.to_csv` has them.

    Raises:
        InputError: no such column; a rate that is none.
        MissingPackageError: no pylsl, or no library.
    """

    def __init__(
        self, name: str, layout: Layout, period: float, *, rate: float = RATE, columns: Sequence[str] = COLUMNS
    ) -> None:
        if not (np.isfinite(rate) and rate > 0.0):
            raise InputError("rate", rate, "a rate above zero [Hz]")
        lsl = load_lsl()
        self.rate = min(rate, 1.0 / period)
        names = [*columns, *(f"objects/{name}/position" for name in layout.objects)]
        self._places = []
        self.channels: list[str] = []
        units: list[str] = []
        for column in names:
            if column not in layout.columns:
                raise InputError("columns", column, f"columns of the recording: {', '.join(layout.columns)}")
            entry = layout.columns[column]
            self._places.append(entry.where)
            parts = [f"{column}.{at}" for at in _parts(layout, entry.shape)] if entry.shape else [column]
            self.channels += parts
            units += [entry.unit] * len(parts)
        self.source = f"graspfx-rows-{uuid.uuid4()}"
        info = lsl.StreamInfo(name, HAPTICS, len(self.channels), self.rate, lsl.cf_double64, self.source)
        described = info.desc().append_child("channels")
        for channel, unit in zip(self.channels, units, strict=True):
            described.append_child("channel").append_child_value("label", channel).append_child_value("unit", unit)
        self._outlet: Any = lsl.StreamOutlet(info)
        self._clock = lsl.local_clock
        self._wall = layout.columns["wall"].where if "wall" in layout.columns else None
        self._run: LiveRun | None = None
        self._lock, self._over = threading.Lock(), threading.Event()
        self._tick, self._number, self._zero = -1, -1, float("inf")
        self.samples = 0
        self._thread = threading.Thread(target=self._follow, name="LSL", daemon=True)
        self._thread.start()

    def attach(self, run: LiveRun) -> None:
        """Stream a run from now on, whose rows have the stream's layout."""
        with self._lock:
            self._run, self._tick, self._number, self._zero = run, -1, run.run_number, float("inf")

    def detach(self) -> None:
        """Stream no run."""
        with self._lock:
            self._run = None

    def close(self) -> None:
        """End the stream."""
        self._over.set()
        self._thread.join()
        self._outlet = None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _follow(self) -> None:
        while not self._over.wait(1.0 / self.rate):
            with self._lock, suppress(GraspFXError):  # a run that ends while it is looked at
                if self._run is not None:
                    self._send(self._run)

    def _send(self, run: LiveRun) -> None:
        """Send the newest row, if it is new; a run that began anew has ticks of its own."""
        if run.run_number != self._number:
            self._number, self._tick, self._zero = run.run_number, -1, float("inf")
        tick, rows = run.rows(run.tick)
        now = float(self._clock())
        if not len(rows) or tick + len(rows) - 1 <= self._tick:
            return
        row, self._tick = rows[-1], tick + len(rows) - 1
        since = self._tick * run.period if self._wall is None else float(row[self._wall][0])
        self._zero = min(self._zero, now - since)
        sample = np.concatenate([row[place] for place in self._places])
        self._outlet.push_sample(sample.tolist(), self._zero + since)
        self.samples += 1


def _parts(layout: Layout, shape: tuple[int, ...]) -> list[str]:
    axes = ("x", "y", "z")
    if len(shape) == 1:
        return list(layout.fingers) if shape[0] == len(layout.fingers) else list(axes[: shape[0]])
    return [f"{finger}.{axis}" for finger in layout.fingers[: shape[0]] for axis in axes[: shape[1]]]


def _clock() -> float:
    import time

    return time.monotonic()
