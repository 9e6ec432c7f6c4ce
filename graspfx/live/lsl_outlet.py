"""Lab Streaming Layer (LSL) outlets for event markers and for rows of a run."""

from __future__ import annotations

import time
import uuid
from collections.abc import Sequence
from contextlib import suppress
from typing import TYPE_CHECKING, Any

import numpy as np

from graspfx.errors import InputError, MissingPackageError
from graspfx.live.run_look import RunLook

if TYPE_CHECKING:
    from graspfx.live.live_run import LiveRun
    from graspfx.loop.columns import Layout

RATE = 100.0  # default rate of rows [Hz]
COLUMNS = ("finger_position", "finger_force", "touching")  # default columns, present in every run
MARKERS, HAPTICS = "Markers", "Haptics"  # types of the streams
SETTINGS = "[log]\nlevel = -1\n"  # log only warnings and errors
LIBRARY = "install liblsl (https://github.com/sccn/liblsl/releases), or set PYLSL_LIB to its file"


def load_lsl() -> Any:
    """Load pylsl and the library liblsl.

    Raises:
        MissingPackageError: If pylsl is not installed, or its library cannot be loaded.
    """
    try:
        import pylsl
    except ImportError as error:
        raise MissingPackageError.of_extra("pylsl", "an LSL stream", "lsl") from error
    except (RuntimeError, OSError) as error:  # pylsl has no library for this machine, such as Linux on ARM
        raise MissingPackageError("liblsl", "an LSL stream", LIBRARY) from error
    with suppress(RuntimeError):  # older libraries do not support settings
        pylsl.set_config_content(SETTINGS)
    return pylsl


class MarkerStream:
    """LSL stream of text markers at irregular times.

    Args:
        name: Name of the stream.

    Raises:
        MissingPackageError: If pylsl or its library is missing.
    """

    def __init__(self, name: str) -> None:
        lsl = load_lsl()
        self.source = f"graspfx-markers-{uuid.uuid4()}"
        info = lsl.StreamInfo(name, MARKERS, 1, lsl.IRREGULAR_RATE, lsl.cf_string, self.source)
        self._outlet: Any = lsl.StreamOutlet(info)
        self._offset = lsl.local_clock() - time.monotonic()

    def send(self, text: str, clock: float) -> None:
        """Send a text; `clock` is its time on the clock of `time.monotonic` [s]."""
        self._outlet.push_sample([text], clock + self._offset)


class RowStream(RunLook):
    """LSL stream that sends the newest row of the attached run at a fixed rate.

    Each sample has the time of its tick. A separate thread reads the rows from the ring buffer, so the servo is not
    affected. The stream is visible to other programs when the first run is attached. If a later run has other columns,
    fingers or another sampling period, a new stream replaces it.

    Args:
        name: Name of the stream.
        rate: Rate of samples [Hz]; it is reduced to one sample per tick if it is higher.
        columns: Columns of the recording whose components are the channels, followed by the positions of all objects.

    Attributes:
        rate: Actual rate of samples [Hz].
        channels: Names of the channels, as in `recording.to_csv`.
        source: Source id by which other programs find the stream.
        samples: Number of samples sent.

    Raises:
        InputError: If the rate is not positive. `attach` raises it if the run does not record one of the columns.
        MissingPackageError: If pylsl or its library is missing.
    """

    def __init__(self, name: str, *, rate: float = RATE, columns: Sequence[str] = COLUMNS) -> None:
        if not (np.isfinite(rate) and rate > 0.0):
            raise InputError("rate", rate, "a rate above zero [Hz]")
        self._lsl = load_lsl()
        self._name, self._most, self._columns = name, rate, columns
        self.rate, self.source, self.samples = rate, "", 0
        self.channels: list[str] = []
        self._form = ""
        self._outlet: Any = None
        self._places: list[slice] = []
        self._wall: slice | None = None
        self._tick, self._number, self._zero = -1, -1, float("inf")
        super().__init__("LSL", 1.0 / rate)

    def close(self) -> None:
        """End the stream."""
        super().close()
        self._outlet = None

    def _begin(self, run: LiveRun) -> None:
        form = f"{list(run.layout.columns)} {run.layout.fingers} {run.period}"
        if form != self._form:
            self._form, self._outlet, self._run = "", None, None
            self._open(run.layout, run.period)
            self._form = form
        self._tick, self._number, self._zero = -1, run.run_number, float("inf")

    def _open(self, layout: Layout, period: float) -> None:
        """Open a stream for rows of a layout."""
        self.rate = min(self._most, 1.0 / period)
        self._pause = 1.0 / self.rate
        names = [*self._columns, *(f"objects/{name}/position" for name in layout.objects)]
        self._places, self.channels = [], []
        units: list[str] = []
        for column in names:
            if column not in layout.columns:
                raise InputError("columns", column, f"columns of the recording: {', '.join(layout.columns)}")
            entry = layout.columns[column]
            self._places.append(entry.where)
            parts = [f"{column}.{at}" for at in _parts(layout, entry.shape)] if entry.shape else [column]
            self.channels += parts
            units += [entry.unit] * len(parts)
        self.source, lsl = f"graspfx-rows-{uuid.uuid4()}", self._lsl
        info = lsl.StreamInfo(self._name, HAPTICS, len(self.channels), self.rate, lsl.cf_double64, self.source)
        described = info.desc().append_child("channels")
        for channel, unit in zip(self.channels, units, strict=True):
            described.append_child("channel").append_child_value("label", channel).append_child_value("unit", unit)
        self._outlet = lsl.StreamOutlet(info)
        self._wall = layout.columns["wall"].where if "wall" in layout.columns else None

    def _look(self, run: LiveRun) -> None:
        """Send the newest row, unless it has been sent already; after a reset, the ticks start again at zero."""
        if run.run_number != self._number:
            self._number, self._tick, self._zero = run.run_number, -1, float("inf")
        tick, rows = run.rows(run.tick)
        now = float(self._lsl.local_clock())
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
