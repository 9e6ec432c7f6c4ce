"""The output delay of a simulated device, on a flat block."""

from __future__ import annotations

from typing import Any


def delayed(S: Any, slot: int, line: int, delay: int, at: int, width: int) -> None:
    """Put the `width` entries at `at` into the line and take there what was put in `delay` calls ago.

    The line has delay + 1 rows; S[slot] is the row to be filled next.
    """
    if delay == 0:
        return
    row = int(S[slot])
    into = line + row * width
    for j in range(width):
        S[into + j] = S[at + j]
    row += 1
    if row > delay:
        row = 0
    S[slot] = row
    out = line + row * width
    for j in range(width):
        S[at + j] = S[out + j]


def cleared(S: Any, line: int, delay: int, at: int, width: int) -> None:
    """Nothing held, and nothing left in the line."""
    for j in range((delay + 1) * width):
        S[line + j] = 0.0
    for j in range(width):
        S[at + j] = 0.0
