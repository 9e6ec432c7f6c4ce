"""Measures of a recording's rows, by the same code as for running variants."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from graspfx.batch.group_runs import Measures
from graspfx.batch.measured_columns import columns_of
from graspfx.batch.statistics import FIRST, LATE_LOW, LOW, empty, statistic, take
from graspfx.batch.variant_runs import taking
from graspfx.errors import MissingPackageError
from graspfx.recording.record import Recording

FloatArray = NDArray[np.float64]


def measures_of_recording(recording: Recording, measure: Sequence[str], statistics: Sequence[str]) -> Measures:
    """Measure a recording of all columns and ticks, by quantity and statistic, (1, *quantity)."""
    columns, _ = columns_of(recording.layout, measure)
    out: Measures = {}
    for quantity, column in columns.items():
        values = recording.array(column.name)
        raw = row_measures(values.reshape(len(values), -1))
        out[quantity] = {
            name: np.asarray(statistic(name, raw, len(values))).reshape(1, *column.shape) for name in statistics
        }
    return out


def row_measures(rows: FloatArray) -> FloatArray:
    """Compute measures (width, MEASURES) of rows (N, width)."""
    width, half = rows.shape[1], len(rows) // 2
    sums, columns = empty(width), np.arange(width, dtype=float)
    for part, low in ((rows[:half], LOW), (rows[half:], LATE_LOW)):
        values = np.ascontiguousarray(part).reshape(-1)
        buffers = {"rows": values, "columns": columns, "found": sums.reshape(-1)}
        if not len(part):
            continue
        try:
            program = taking()
        except MissingPackageError:  # without LLVM the same lines run as Python
            take(values, columns, buffers["found"], len(part), width, width, low)
        else:
            program.bind(*(buffers[name] for name in program.arrays)).long(len(part), width, width, low)
    sums[:, FIRST] = rows[0]
    return sums
