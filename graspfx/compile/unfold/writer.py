"""The lines of a program while it is unfolded."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from graspfx.compile.records import Floats, Record
from graspfx.compile.unfold.expression import NotUnfoldable, number

FloatArray = NDArray[np.float64]


class Origin(NamedTuple):
    """The stage that a line comes from, of those that the whole program's calls, and the line in it."""

    stage: str
    file: str
    line: int


class Line(NamedTuple):
    """A line of a program."""

    text: str
    origin: Origin


class Names(Protocol):
    """The names of a program."""

    def place(self, array: FloatArray) -> tuple[str, int]:
        """Give the name of the memory that an array is a piece of, and which entry of it is the array's first."""
        ...

    def kernel(self, function: Callable[..., Any]) -> str:
        """Name a kernel."""
        ...

    def variable(self, name: str) -> str:
        """Name a variable: no memory and no kernel has that name; it is this one if it can be."""
        ...


class Writer:
    """Lines so far, indented as the next one will be."""

    def __init__(self, names: Names) -> None:
        self.names = names
        self.lines: list[Line] = []
        self.indent = ""
        self._places: dict[int, tuple[FloatArray, str, int]] = {}  # by id; the array itself, so that it keeps its id

    def write(self, text: str, origin: Origin) -> None:
        self.lines.append(Line(self.indent + text, origin))

    def place(self, array: FloatArray) -> tuple[str, int]:
        """Give the name of an array's memory, and the entry of it that is the array's first."""
        place = self._places.get(id(array))
        if place is None:
            if array.ndim != 1 or not array.flags.c_contiguous:
                raise NotUnfoldable(f"an array {array.shape}", "a flat contiguous array")
            place = self._places[id(array)] = (array, *self.names.place(array))
        return place[1], place[2]

    def argument(self, value: Any) -> str:
        """Write an argument of a kernel: a whole memory, a record as memory and entry, or a number."""
        if isinstance(value, Record | Floats):
            name, first = self.place(np.asarray(value.buffer))
            return f"{name}, {first + value.offset}"
        if is_memory(value):
            name, first = self.place(value)
            if first:
                raise NotUnfoldable(f"{name} from entry {first} on", "a whole memory, and the entry beside it")
            return name
        return number(value).text


def is_memory(value: object) -> bool:
    """Tell whether a value is an array whose entries are numbers of the program."""
    return isinstance(value, np.ndarray) and value.dtype == np.float64
