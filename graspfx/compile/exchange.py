"""Exchanges with other software by machine code, which calls the software's functions without the interpreter."""

from __future__ import annotations

import ctypes
import hashlib
from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspfx.compile import cache as disk
from graspfx.compile.calls import Call
from graspfx.compile.emission import address, emitted, loaded, platform
from graspfx.compile.llvm.exchange_text import CALL, CALLED, EXCHANGE, RECEIPT, SEND, exchange_text
from graspfx.compile.llvm.method import python_function

Word = ctypes.c_int64
ALL_BITS, WITHOUT_SIGN = -1, 2**63 - 1


class MachineExchange:
    """Machine code exchange(buffer, place) that calls other software; it returns 0, or 1 if a call raised an exception.

    The calls are made in order, bit-identical to `calls.in_turn`. The caller must hold the interpreter's lock.

    Args:
        calls: Calls whose memories have fixed addresses.

    Attributes:
        address: Address of the function.
        plan: Words that the buffer must contain at `place`.

    Raises:
        ImportError: If LLVM is not installed.
        LookupError: If this Python lacks a required C function.
    """

    def __init__(self, calls: Sequence[Call]) -> None:
        self.address, engine = _code()
        memory: list[Any] = [*calls, engine]
        table = _table(calls, memory)
        self.plan: NDArray[np.int64] = np.array([ctypes.addressof(table), len(calls)], dtype=np.int64)
        self._keep = [*memory, table]
        self._function = ctypes.PYFUNCTYPE(ctypes.c_int64, ctypes.c_void_p, ctypes.c_int64)(self.address)

    def __call__(self) -> None:
        """Make the calls by machine code."""
        self._function(self.plan.ctypes.data, 0)


def _table(calls: Sequence[Call], memory: list[Any]) -> Any:
    """Encode calls as words; referenced objects are added to `memory`, which must stay alive."""
    words: list[int] = []
    for call in calls:
        tested, first, second, mask = _test(call, memory)
        sends = [[id(numbers), _address(view, memory), len(view)] for numbers, view in call.sends]
        receipts = [[place, _address(view, memory), len(view)] for place, view in call.receipts]
        words += [
            id(call.function), id(call.arguments), id(call.keywords) if call.keywords else 0,
            tested, first, second, mask,
            _words(sends, SEND, memory), len(sends), _words(receipts, RECEIPT, memory), len(receipts),
        ]  # fmt: skip
    assert len(words) == len(calls) * len(CALL)
    return (Word * max(len(words), 1))(*words)


def _test(call: Call, memory: list[Any]) -> tuple[int, int, int, int]:
    """Encode the condition of a call: number of compared floats, their addresses, and compared bits."""
    if call.nonzero is not None:
        zeros = (ctypes.c_double * len(call.nonzero))()
        memory.append(zeros)
        return len(call.nonzero), _address(call.nonzero, memory), ctypes.addressof(zeros), WITHOUT_SIGN
    if call.changed is not None:
        new, old = call.changed
        assert len(new) == len(old)
        return len(new), _address(new, memory), _address(old, memory), ALL_BITS
    return 0, 0, 0, 0


def _words(rows: Sequence[Sequence[int]], names: tuple[str, ...], memory: list[Any]) -> int:
    """Write rows of words and return their address."""
    flat = [word for row in rows for word in row]
    assert len(flat) == len(rows) * len(names)
    table = (Word * max(len(flat), 1))(*flat)
    memory.append(table)
    return ctypes.addressof(table)


def _address(view: memoryview, memory: list[Any]) -> int:
    """Return the address of floats, which is fixed as long as `memory` refers to them."""
    shared = (ctypes.c_double * len(view)).from_buffer(view)
    memory.append(shared)
    return ctypes.addressof(shared)


@cache
def _code() -> tuple[int, Any]:
    """Load the machine code of exchanges; return its address and the engine that owns it."""
    import llvmlite.binding as llvm

    for name in CALLED:
        if llvm.address_of_symbol(name) is None:
            try:
                llvm.add_symbol(name, python_function(name))
            except AttributeError as error:
                raise LookupError(f"this Python has no {name}") from error
    text = exchange_text()
    key = hashlib.sha256("\0".join([*platform(), "exchange", text]).encode()).hexdigest()
    machine = disk.load(key)
    if machine is None:
        machine = emitted(text)
        disk.store(key, machine)
    engine = loaded([machine], ())
    return address(engine, EXCHANGE), engine
