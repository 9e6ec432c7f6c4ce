"""A text of kernel calls, with the memory and the functions that its names stand for."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspfx.errors import InputError

FloatArray = NDArray[np.float64]

OWN = ("begin", "end", "run", "k", "count", "r", "i", "row", "rows", "code", "ahead", "int", "range")  # of the text


class Script:
    """Runs as it stands, on memoryviews; or is specialised and compiled (`graspfx.compile`)."""

    def __init__(self) -> None:
        self.arrays: dict[str, FloatArray] = {}
        self.frozen: dict[tuple[str, int], float] = {}
        self.kernels: dict[str, Callable[..., Any]] = {}

    def memory(self, kind: str, array: FloatArray, structure: Iterable[int] = ()) -> str:
        """The name of an array, the same whenever it is the same memory; entries in `structure` never change.

        Raises:
            InputError: no flat float64 array, or one that shares a part of its memory with another.
        """
        if array.dtype != np.float64 or not array.flags.c_contiguous or array.ndim != 1:
            raise InputError(kind, f"an array {array.shape} of {array.dtype}", "a flat contiguous float64 array")
        name = next((name for name, known in self.arrays.items() if known is array), None) or self._named(kind, array)
        self.arrays[name] = array
        self.frozen |= {(name, int(k)): float(array[k]) for k in structure}
        return name

    def _named(self, kind: str, array: FloatArray) -> str:
        """A name for an array that is another object than all before: maybe one's memory, shown anew."""
        for name, known in self.arrays.items():
            if np.may_share_memory(known, array):
                if known.ctypes.data == array.ctypes.data and known.size == array.size:
                    return name
                raise InputError(kind, array.shape, f"a block of its own, which shares nothing with {name}")
        return f"{kind}{len(self.arrays)}"

    def kernel(self, function: Callable[..., Any]) -> str:
        """The name of a function."""
        name = f"{function.__name__}_" if function.__name__ in OWN else function.__name__
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
