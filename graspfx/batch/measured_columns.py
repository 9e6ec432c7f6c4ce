"""Columns of a batch's measured quantities: columns of a row, followed by variables computed from a row."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from math import prod
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspfx.batch.groups import Group
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
    """Find the columns of quantities; computed variables follow the row and are also listed."""
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
    """Return whether a batch of runs with this layout can measure a quantity."""
    try:
        columns_of(layout, [name])
    except UnknownNameError:
        return False
    return True


def split_of(group: Group, arena: FloatArray) -> dict[str, dict[str, Any]]:
    """Read the split rule of each object from a variant's buffers."""
    program = group.program
    return {
        part.name: SplitRule.of(GraspState(arena, program.arena.place(part.grasped.block))).table()
        for part in program.servo.objects
    }


def _friction(group: Group, arena: FloatArray) -> list[float]:
    """Read the fingers' coefficients of friction from a variant's buffers; 0 for none."""
    program = group.program
    found = [0.0] * len(program.servo.layout.fingers)
    for part in program.servo.objects:
        state = GraspState(arena, program.arena.place(part.grasped.block))
        for finger, mu in zip(part.fingers, state.fingers.array(FingerState.coefficient), strict=True):
            found[finger] = float(mu)
    return found


def divider(group: Group, names: Sequence[str], arenas: FloatArray) -> Callable[[FloatArray], FloatArray]:
    """Make the function that computes variables from rows of variants with these initial buffers, (v, arena).

    Returns:
        Function of their rows (r, width, v) that returns the variables, (r, numbers, v).
    """
    layout = group.program.servo.layout
    alike: list[tuple[dict[str, dict[str, Any]], list[float], list[int]]] = []  # variants that agree in both, together
    for k, arena in enumerate(arenas):
        split, friction = split_of(group, arena), _friction(group, arena)
        members = next((members for *other, members in alike if other == [split, friction]), None)
        if members is None:
            alike.append((split, friction, [k]))
        else:
            members.append(k)

    def divide(rows: FloatArray) -> FloatArray:
        count, width, _ = rows.shape
        out: FloatArray | None = None
        for split, friction, members in alike:
            mu = np.array([each or np.nan for each in friction])
            own = np.ascontiguousarray(rows[:, :, members].transpose(2, 0, 1)).reshape(-1, width)
            parts = RowSplit(own, layout, [(0, split)], friction=[(0, mu)]).derived(names)
            whole = np.concatenate([parts[name].reshape(len(own), -1) for name in names], axis=1)
            if out is None:
                out = np.empty((count, whole.shape[1], len(arenas)))
            out[:, :, members] = whole.reshape(len(members), count, -1).transpose(1, 2, 0)
        assert out is not None
        return out

    return divide
