"""Answers about stability as plain data for JSON, with units in the names of keys."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

UNITS = {  # keys that have one
    "gain": "gain_N_per_m",
    "limit": "limit_N_per_m",
    "internal": "internal_N_per_m",
    "external": "external_N_per_m",
    "frequency": "frequency_Hz",
    "fade": "fade_m",
}


def plain(value: Any) -> Any:
    """Write dataclasses, tuples, arrays and numbers as JSON has them; what is infinite, or no number, is None."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        fields = {field.name: getattr(value, field.name) for field in dataclasses.fields(value)}
        return {UNITS.get(name, name): plain(each) for name, each in fields.items()}
    if isinstance(value, Mapping):
        return {str(key): plain(each) for key, each in value.items()}
    if isinstance(value, Sequence) and not isinstance(value, str):
        return [plain(each) for each in value]
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value
