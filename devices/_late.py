"""The output delay of a simulated device."""

from __future__ import annotations

from graspfx.protocols import Floats, Table, kernel


@kernel
def delay_values(line: Table, slot: int, delay: int, values: Floats) -> int:
    """Store values in the delay line, and replace them by the values of `delay` calls ago; return the next row to fill.

    The line has delay + 1 rows; `slot` is the row that this call fills.
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
def clear_line(line: Table, delay: int, values: Floats) -> None:
    """Set the values and the delay line to zero."""
    for row in range(delay + 1):
        for j in range(line.columns):
            line[row, j] = 0.0
    for j in range(line.columns):
        values[j] = 0.0
