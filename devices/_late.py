"""The output delay of a simulated device."""

from __future__ import annotations

from graspfx.compile.kernel import kernel
from graspfx.compile.records import Floats, Table


@kernel
def delayed(line: Table, slot: int, delay: int, values: Floats) -> int:
    """Put values into the line, and into their place what was put in `delay` calls ago; give the row filled next.

    The line has delay + 1 rows; `slot` is the one that is filled now.
    """
    for j in range(line.columns):
        line[slot, j] = values[j]
    slot += 1
    if slot > delay:
        slot = 0
    for j in range(line.columns):
        values[j] = line[slot, j]
    return slot


@kernel
def cleared(line: Table, delay: int, values: Floats) -> None:
    """Leave no values, and none in the line."""
    for row in range(delay + 1):
        for j in range(line.columns):
            line[row, j] = 0.0
    for j in range(line.columns):
        values[j] = 0.0
