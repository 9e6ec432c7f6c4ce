"""Scales of a recording's dimensions: the names of fingers, axes, components; and columns that hold no real numbers."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import DTypeLike

from graspfx.loop.recording.layout import WRENCH, Layout

WHOLE = ("touching", "saturated", "status", "law", "fresh")  # columns of small whole numbers,
LARGE = ("skipped", "switches")  # and of large ones
LOGICAL = ("touching", "saturated", "fresh")  # of the small ones, true or false
SCALES = {
    "axis": ("x", "y", "z"),
    "turn": ("x", "y", "z"),
    "quaternion": ("x", "y", "z", "w"),
    "mode": ("internal", "translation", "rotation"),
    "call": ("read", "write"),
    "share": ("soft", "trust", "squeeze", "outer"),
}


def scales_of(layout: Layout) -> Mapping[str, tuple[str, ...]]:
    """Name the entries along each dimension that a layout has, time apart."""
    d = layout.dimensions
    raw = {f"{name}_raw": tuple(map(str, range(count))) for name, count, _ in layout.raw}
    names = {
        "finger": layout.fingers,
        "device": layout.devices,
        **raw,
        **SCALES,
        "axis": SCALES["axis"][:d],
        "component": WRENCH[d],
    }
    used = {name for column in layout.columns.values() for name in column.dimensions}
    return {name: entries for name, entries in names.items() if name in used}


def stored_type(column: str, layout: Layout) -> DTypeLike:
    """Say as what type a column is stored: small whole numbers in a byte, raw ones as the device has them."""
    folder, _, name = column.rpartition("/")
    if folder == "raw":
        return np.dtype(next(kind for device, _, kind in layout.raw if device == name))
    return np.int8 if name in WHOLE else np.int64 if name in LARGE else np.float64
