"""A text of kernel calls, with the memory and the functions that its names stand for."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspfx.errors import InputError

FloatArray = NDArray[np.float64]


class Script:
    """Runs as it stands, on memoryviews; or is specialised and compiled (`graspfx.compile`)."""

    def __init__(self) -> None:
        self.arrays: dict[str, FloatArray] = {}
        self.frozen: dict[tuple[str, int], float] = {}
        self.kernels: dict[str, Callable[..., Any]] = {}

    def memory(self, kind: str, array: FloatArray, structure: Iterable[int] = ()) -> str:
        """The name of an array, the same whenever it is the same memory; entries in `structure` never change."""
        if array.dtype != np.float64 or not array.flags.c_contiguous or array.ndim != 1:
            raise InputError(kind, f"an array {array.shape} of {array.dtype}", "a flat contiguous float64 array")
        name = next((name for name, known in self.arrays.items() if known is array), f"{kind}{len(self.arrays)}")
        self.arrays[name] = array
        self.frozen |= {(name, int(k)): float(array[k]) for k in structure}
        return name

    def kernel(self, function: Callable[..., Any]) -> str:
        """The name of a function."""
        name = function.__name__
        while self.kernels.setdefault(name, function) is not function:
            name += "_"
        return name


def copied(to: str, entries: Iterable[int], source: str, others: Iterable[int], sign: str = "") -> list[str]:
    """Lines that copy entries one by one."""
    return [f"{to}[{int(a)}] = {sign}{source}[{int(b)}]" for a, b in zip(entries, others, strict=True)]


def under(condition: str, lines: Iterable[str], otherwise: Iterable[str] = ()) -> list[str]:
    """Lines that run if a condition holds, and others that run if not; nothing if there are none."""
    body, rest = [f"    {line}" for line in lines], [f"    {line}" for line in otherwise]
    if not body:
        return [f"if not ({condition}):", *rest] if rest else []
    return [f"if {condition}:", *body, *(["else:", *rest] if rest else [])]
