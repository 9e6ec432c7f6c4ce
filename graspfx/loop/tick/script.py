"""The script of a tick: its text, with the memories and kernels that names in it stand for."""

from __future__ import annotations

import re
from bisect import bisect_right
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspfx.errors import InputError
from graspfx.loop.safety.trust import CAUSES

FloatArray = NDArray[np.float64]

NAME = re.compile(r"[A-Za-z_]\w*")  # a name in a line of a text

OF_TEXTS = (
    "begin",
    "end",
    "run",
    "k",
    "count",
    "r",
    "i",
    "rows",
    "tick",
)  # names that the text around a tick's lines has
OF_PYTHON = ("abs", "float", "int", "math", "max", "min", "range")


class Script:
    """Runs as it stands, on memoryviews; or is specialised and compiled (`graspfx.compile`).

    Attributes:
        frozen: entries of arrays that are of the scene's structure, which programs of it fold in.
        fixed: these, and entries that follow from the scene's numbers and stay through a run.
    """

    def __init__(self) -> None:
        self.arrays: dict[str, FloatArray] = {}
        self.frozen: dict[tuple[str, int], float] = {}
        self.fixed: dict[tuple[str, int], float] = {}
        self.kernels: dict[str, Callable[..., Any]] = {}
        self.variables = {*OF_TEXTS, *OF_PYTHON}
        self._addresses: list[tuple[int, str]] = []  # of the arrays' first entries, in order

    def memory(self, kind: str, array: FloatArray, structure: Iterable[int] = (), steady: Iterable[int] = ()) -> str:
        """Name an array, the same whenever it is the same memory.

        Args:
            kind: of memory, with which the name begins.
            array: flat.
            structure: entries that never change, whatever the scene's numbers are.
            steady: entries that follow from these and stay through a run.

        Raises:
            InputError: no flat float64 array, or one that shares a part of its memory with another.
        """
        if array.dtype != np.float64 or not array.flags.c_contiguous or array.ndim != 1:
            raise InputError(kind, f"an array {array.shape} of {array.dtype}", "a flat contiguous float64 array")
        name = next((name for name, each in self.arrays.items() if each is array), None) or self._new_name(kind, array)
        self.arrays[name] = array
        self.frozen |= {(name, int(k)): float(array[k]) for k in structure}
        self.fixed |= self.frozen | {(name, int(k)): float(array[k]) for k in steady}
        return name

    def _new_name(self, kind: str, array: FloatArray) -> str:
        """Name an array that is another object than all before: maybe one's memory, shown anew."""
        for name, each in self.arrays.items():
            if np.may_share_memory(each, array):
                if each.ctypes.data == array.ctypes.data and each.size == array.size:
                    return name
                raise InputError(kind, array.shape, f"a block of its own, which shares nothing with {name}")
        return f"{kind}{len(self.arrays)}"

    def place(self, array: FloatArray) -> tuple[str, int]:
        """Find the name of the memory that a flat array is a piece of, and the entry that is its first.

        Raises:
            InputError: it is a piece of none.
        """
        if len(self._addresses) != len(self.arrays):
            self._addresses = sorted((_address(each), name) for name, each in self.arrays.items())
        address = _address(array)
        k = bisect_right(self._addresses, address, key=lambda pair: pair[0]) - 1
        if k >= 0:
            start, name = self._addresses[k]
            first = (address - start) // array.itemsize
            if first + len(array) <= len(self.arrays[name]):
                return name, first
        raise InputError("array", f"one of {len(array)} entries", "a piece of a memory of the script")

    def kernel(self, function: Callable[..., Any]) -> str:
        """Name a function."""
        name = function.__name__
        while name in self.variables or self.kernels.setdefault(name, function) is not function:
            name += "_"
        return name

    def variable(self, name: str) -> str:
        """Name a number that is no memory's and no kernel's, by this name if it is free."""
        while name in self.kernels or name in self.arrays:
            name += "_"
        self.variables.add(name)
        return name


@dataclass
class Port:
    """The memory through which a device that is no kernel is read and written."""

    station: int
    position: FloatArray
    velocity: FloatArray
    command: FloatArray
    memory: FloatArray  # whether it could be read; then the three above, and the limits
    limit: FloatArray | None = None  # of a device whose largest force depends on where it stands
    misses: FloatArray | None = None  # samples in a row without a new reading, where a safety chain counts them, (1,)
    elapsed: FloatArray | None = None  # periods since the last tick, where a safety chain takes them, (1,)
    time: float | None = None  # of the last reading [s]
    cause: FloatArray | None = None  # why forces decay, where a safety chain lets them, (1,)

    def let_go(self, cause: int) -> bool:
        """Let forces decay for a cause of this device's, unless they do already; False without a safety chain."""
        if self.cause is not None and self.cause[0] == 0.0:
            self.cause[0] = cause + CAUSES * self.station
        return self.cause is not None

    def begin(self, periods: int) -> None:
        """Begin a tick so many periods after the last one: nothing is read yet."""
        self.memory[0] = 0.0
        if self.elapsed is not None:
            self.elapsed[0] = periods

    def note(self, time: float) -> None:
        """Note the time of a reading: one that is not new is a sample without a new reading."""
        if self.misses is not None:
            self.misses[0] = self.misses[0] + 1.0 if time == self.time else 0.0
            self.time = time


@dataclass
class Table:
    """The targets of a hand that is no kernel, for each tick of a call."""

    plant: int
    memory: FloatArray  # (CHUNK, width), flat: r and r' at the end of each sample, then in its middle if asked for
    middle: bool


@dataclass
class Tick:
    """The lines of a tick's script, and what is left to be done beside it."""

    script: Script
    own: FloatArray = field(default_factory=lambda: np.zeros(0))  # the servo's memory
    loop: FloatArray | None = None  # of a loop on the wall's clock, `LoopState`
    begin: list[str] = field(default_factory=list)  # read, couple, limit, display
    end: list[str] = field(default_factory=list)  # let go after a fault, record, move
    ports: list[Port] = field(default_factory=list)
    tables: list[Table] = field(default_factory=list)
    guests: list[int] = field(default_factory=list)  # movers that other software moves between two calls
    bodies: list[int] = field(default_factory=list)  # movers that are no kernels
    plants: list[int] = field(default_factory=list)  # plants that are no kernels

    @property
    def own_name(self) -> str:
        """The name of the servo's memory in the script."""
        return next(name for name, array in self.script.arrays.items() if array is self.own)


def _address(array: FloatArray) -> int:
    address: int = array.__array_interface__["data"][0]
    return address
