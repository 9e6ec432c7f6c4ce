"""Lateness of forces as it is measured: of its ends, but for one sample in a hundred, the one that is less stable."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from graspfx.analysis.linearisation import Linearisation
from graspfx.analysis.stability.fullloop import radius_of
from graspfx.build.mechanics import Mechanics
from graspfx.loop.recording.record import Recording

FloatArray = NDArray[np.float64]

ENDS = (1.0, 99.0)  # per cent of the samples
COLUMNS = ("late", "io")  # of a run on the wall's clock


def exchange_times(recording: Recording) -> tuple[float, float] | None:
    """Give how long after its deadline a tick had written to its devices, the ends of 98 % of them [s].

    That is the tick's own lateness, its reading and its writing; what it computes between the two is in no column. Of a
    recording without these columns it is the round trip of its header, twice; None for a run without hardware.
    """
    if all(name in recording.layout.columns for name in COLUMNS) and recording.header.settled:
        late, calls = (recording.array(name) for name in COLUMNS)
        low, high = np.percentile(late + calls.sum(axis=1), ENDS)
        return max(float(low), 0.0), max(float(high), 0.0)
    trip = recording.header.round_trip
    return (trip, trip) if trip > 0.0 else None


def lateness_ends(mechanics: Mechanics, recording: Recording | None) -> FloatArray:
    """Give the least and the largest lateness of each finger, (2, n) [s].

    With a recording the time of its reading and writing takes the place of the round trip in the measures of hardware.
    """
    times = None if recording is None else exchange_times(recording)
    if times is None:
        return mechanics.jitter
    own = np.maximum(mechanics.lateness - mechanics.round_trip, 0.0)
    ends = own + np.array(times)[:, None]
    return np.where(mechanics.hardware, ends, mechanics.jitter)


def less_stable(linear: Linearisation, ends: FloatArray) -> tuple[Linearisation, list[str]]:
    """Give a loop the lateness of one end, (m,), the one with the larger spectral radius; and say so.

    Args:
        linear: the loop.
        ends: least and largest lateness, (2, m) [s].
    """
    loops = [linear.with_arrays(lateness=each) for each in ends]
    if (ends[0] == ends[1]).all():
        return loops[1], []
    worse = int(radius_of(loops[1]) >= radius_of(loops[0]))
    low, high = (1e3 * float(each.max()) for each in ends)
    text = f"forces {low:.3g} to {high:.3g} ms late in 98 % of the samples: the worse end, {(low, high)[worse]:.3g} ms"
    return loops[worse], [text]
