"""Functions of other packages that a program calls between two steps; arguments and results are in buffers."""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True)
class Call:
    """Call that is repeated with the same argument objects, in which only numbers change.

    Attributes:
        function: Function to call.
        arguments: Positional arguments.
        keywords: Keyword arguments.
        sends: Pairs of a list of floats among the arguments and a memory of equal size. Before each call, the list is
            filled from the memory. The function must not store the list.
        receipts: Pairs of an index in the returned tuple and a memory. After each call, the tuple of floats at this
            index is written to the memory.
        nonzero: Memory of floats. If all floats are zero, the call is skipped. None for no such condition.
        changed: Two memories of equal size. If their contents are identical, the call is skipped. None for no such
            condition.
    """

    function: Callable[..., Any]
    arguments: tuple[Any, ...]
    keywords: dict[str, Any] = field(default_factory=dict)
    sends: Sequence[tuple[list[float], memoryview]] = ()
    receipts: Sequence[tuple[int, memoryview]] = ()
    nonzero: memoryview | None = None
    changed: tuple[memoryview, memoryview] | None = None


def in_turn(calls: Sequence[Call]) -> Callable[[], None]:
    """Return a Python function that makes the calls in the given order."""
    each = [_bound(call) for call in calls]

    def run() -> None:
        for call in each:
            call()

    return run


def _bound(call: Call) -> Callable[[], None]:
    function, arguments, keywords, receipts = call.function, call.arguments, call.keywords, call.receipts
    sends = [(numbers, memory.tolist) for numbers, memory in call.sends]
    writers = [(place, struct.Struct(f"{len(memory)}d").pack_into, memory) for place, memory in receipts]

    def run() -> None:
        for numbers, read in sends:
            numbers[:] = read()
        result = function(*arguments, **keywords)
        for place, write, memory in writers:
            write(memory, 0, *result[place])

    if call.nonzero is not None:
        return _if_nonzero(run, call.nonzero)
    return run if call.changed is None else _if_changed(run, *call.changed)


def _if_nonzero(run: Callable[[], None], memory: memoryview) -> Callable[[], None]:
    none, read = [0.0] * len(memory), memory.tolist

    def tested() -> None:
        if read() != none:
            run()

    return tested


def _if_changed(run: Callable[[], None], new: memoryview, old: memoryview) -> Callable[[], None]:
    def tested() -> None:
        if new.tobytes() != old.tobytes():
            run()

    return tested
