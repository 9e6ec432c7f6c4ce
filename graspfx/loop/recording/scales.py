"""Scales of a recording's dimensions: the names of fingers, axes, components; and columns that hold no real numbers."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import DTypeLike

from graspfx.loop.recording.layout import WRENCH, Layout

WHOLE = ("touching", "saturated", "status", "law")  # columns of whole numbers
LOGICAL = ("touching", "saturated")  # of these, true or false
SCALES = {
    "axis": ("x", "y", "z"),
    "turn": ("x", "y", "z"),
    "quaternion": ("x", "y", "z", "w"),
    "mode": ("internal", "translation", "rotation"),
    "share": ("soft", "trust", "squeeze", "outer"),
}


def scales_of(layout: Layout) -> Mapping[str, tuple[str, ...]]:
    """Name the entries along each dimension that a layout has, time apart."""
    d = layout.dimensions
    names = {"finger": layout.fingers, **SCALES, "axis": SCALES["axis"][:d], "component": WRENCH[d]}
    used = {name for column in layout.columns.values() for name in column.dimensions}
    return {name: entries for name, entries in names.items() if name in used}


def stored_type(column: str) -> DTypeLike:
    """Say as what type a column is stored: whole numbers in a byte."""
    return np.int8 if column.rpartition("/")[2] in WHOLE else np.float64
