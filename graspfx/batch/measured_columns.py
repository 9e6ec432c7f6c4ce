"""Measured quantities of a batch: columns of rows, variables derived from rows, and statistics over rows."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from math import prod
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspfx.batch.variants import Group
from graspfx.coupling.grasp_state import FingerState, GraspState
from graspfx.coupling.two_forces import SplitRule
from graspfx.errors import UnknownNameError
from graspfx.loop.columns import Column, Layout
from graspfx.recording.recorded_split import RowSplit

FloatArray = NDArray[np.float64]

OF_OBJECT = {  # quantities of the first object, as named by `Recording`
    "object_position": "position",
    "object_velocity": "velocity",
    "object_orientation": "orientation",
    "wrench": "wrench",
}


def columns_of(layout: Layout, quantities: Sequence[str]) -> tuple[dict[str, Column], list[str]]:
    """Return the column of each quantity, and the names of the derived variables among the quantities.

    Columns of derived variables follow the columns of a row, in the order of these names.
    """
    derived = {column.name: column for column in layout.derived}
    columns: dict[str, Column] = {}
    behind: list[str] = []
    end = layout.width
    for quantity in quantities:
        name = f"objects/{layout.objects[0]}/{OF_OBJECT[quantity]}" if quantity in OF_OBJECT else quantity
        if name in layout.columns:
            columns[quantity] = layout.columns[name]
        elif name in derived:
            start, end = end, end + prod(derived[name].shape)
            columns[quantity] = replace(derived[name], where=slice(start, end))
            behind.append(name)
        else:
            raise UnknownNameError("measure", quantity, [*layout.columns, *OF_OBJECT, *derived])
    return columns, behind


def is_quantity(layout: Layout, name: str) -> bool:
    """Return whether a batch can measure a quantity in rows of a layout."""
    try:
        columns_of(layout, [name])
    except UnknownNameError:
        return False
    return True


def split_of(group: Group, arena: FloatArray) -> dict[str, dict[str, Any]]:
    """Return the split rule of each object, by name of the object, from a variant's buffers."""
    program = group.program
    return {
        part.name: SplitRule.of(GraspState(arena, program.arena.place(part.grasped.block))).table()
        for part in program.servo.objects
    }


def _friction(group: Group, arena: FloatArray) -> FloatArray:
    """Return the fingers' coefficients of friction from a variant's buffers; nan for a finger without friction."""
    program = group.program
    found = np.full(len(program.servo.layout.fingers), np.nan)
    for part in program.servo.objects:
        state = GraspState(arena, program.arena.place(part.grasped.block))
        for finger, mu in zip(part.fingers, state.fingers.array(FingerState.coefficient), strict=True):
            found[finger] = mu or np.nan
    return found


def divider(group: Group, names: Sequence[str], arena: FloatArray) -> Callable[[FloatArray], FloatArray]:
    """Make a function that computes derived variables (r, entries) from rows (r, width) of a variant in a group."""
    layout = group.program.servo.layout
    splits, friction = [(0, split_of(group, arena))], [(0, _friction(group, arena))]

    def divide(rows: FloatArray) -> FloatArray:
        parts = RowSplit(rows, layout, splits, friction=friction).derived(names)
        return np.concatenate([parts[name].reshape(len(rows), -1) for name in names], axis=1)

    return divide


# Statistics -----------------------------------------------------------------------------------------------------------

FIRST, LAST, SUM, SQUARES, LOW, HIGH, LATE_LOW, LATE_HIGH = range(8)  # LOW, HIGH: first half; LATE_: second half
MEASURES = 8
STATISTICS = ("first", "last", "mean", "rms", "min", "max", "peak", "growth")


class Statistics(dict[str, FloatArray]):
    """Statistics of a quantity, by name of the statistic; the error for an unknown name suggests the closest name."""

    def __missing__(self, name: str) -> FloatArray:
        raise UnknownNameError("statistic", str(name), self)


def empty(*shape: int) -> FloatArray:
    """Return the measures of no rows, (*shape, MEASURES)."""
    measures = np.zeros((*shape, MEASURES))
    measures[..., [LOW, LATE_LOW]] = np.inf
    measures[..., [HIGH, LATE_HIGH]] = -np.inf
    return measures


def take(rows: FloatArray, measures: FloatArray, k: int, ticks: int) -> None:
    """Update the measures (columns, MEASURES) of a run of `ticks` ticks with rows (r, columns) of ticks k, k + 1, ...

    Sums are computed row by row, so that they do not depend on the division of a run into calls.
    """
    if k == 0:
        measures[:, FIRST] = rows[0]
    measures[:, LAST] = rows[-1]
    terms = np.empty((len(rows) + 1, 2, rows.shape[1]))
    terms[0], terms[1:, 0] = measures[:, [SUM, SQUARES]].T, rows
    with np.errstate(over="ignore", invalid="ignore"):
        np.multiply(rows, rows, out=terms[1:, 1])
        measures[:, [SUM, SQUARES]] = np.add.reduce(terms, axis=0).T  # along the slower axis, so row by row
    half = max(ticks // 2 - k, 0)
    for part, low in ((rows[:half], LOW), (rows[half:], LATE_LOW)):
        measures[:, low] = np.fmin(measures[:, low], np.fmin.reduce(part, initial=np.inf))
        measures[:, low + 1] = np.fmax(measures[:, low + 1], np.fmax.reduce(part, initial=-np.inf))


def statistic(name: str, measures: FloatArray, ticks: int) -> FloatArray:
    """Compute a statistic from the measures (..., MEASURES) of a run of `ticks` ticks.

    The growth is the largest magnitude in the second half of the ticks divided by the largest magnitude in the first
    half; the first half has `ticks // 2` ticks. Minimum, maximum, peak and growth are nan without finite values.
    """
    if name in ("first", "last"):
        return measures[..., FIRST if name == "first" else LAST]
    if name == "mean":
        return measures[..., SUM] / ticks
    if name == "rms":
        return np.asarray(np.sqrt(measures[..., SQUARES] / ticks))
    low, high = measures[..., [LOW, LATE_LOW]], measures[..., [HIGH, LATE_HIGH]]
    if name == "min":
        return _number(low.min(axis=-1))
    if name == "max":
        return _number(high.max(axis=-1))
    peaks = np.maximum(-low, high)
    if name == "peak":
        return _number(peaks.max(axis=-1))
    with np.errstate(divide="ignore", invalid="ignore"):
        return _number(peaks[..., 1]) / _number(peaks[..., 0])


def _number(values: FloatArray) -> FloatArray:
    return np.where(np.isfinite(values), values, np.nan)
