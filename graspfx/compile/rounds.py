"""Rounds: a program and calls of other packages' functions in turn, any number of rounds by one call of Python."""

from __future__ import annotations

import ctypes
import hashlib
from collections.abc import Callable, Sequence
from functools import cache
from typing import Any

from graspfx.compile import cache as disk
from graspfx.compile.calls import Call, in_turn
from graspfx.compile.emission import address, emitted, loaded, platform
from graspfx.compile.llvm.method import method, python_function
from graspfx.compile.llvm.rounds_text import CALL, CALLED, PLAN, RECEIPT, ROUNDS, SEND, rounds_text
from graspfx.compile.native import Spread

Word = ctypes.c_int64
ALL_BITS, WITHOUT_SIGN = -1, 2**63 - 1


class Rounds:
    """Rounds in machine code, each a program's entry with (k, 1, row) and calls after it.

    `run(k, count, row)` does rounds with k and row growing by one, until the flag is not zero after the program: that
    round's calls are not made. It gives the number of rounds with calls; if a call raises, `done` has it. Calls are
    made in their order, as `calls.in_turn` makes them, with the same bits.

    Whoever calls `run` holds the rounds meanwhile.

    Args:
        calls: whose memories stay where they are.
        flag: a float that the program writes; of no use without one.

    Raises:
        ImportError: no LLVM.
        LookupError: this Python lacks what they take.
    """

    def __init__(self, calls: Sequence[Call], flag: memoryview | None = None) -> None:
        code, engine = _code()
        memory: list[Any] = [*calls, engine]
        table = _table(calls, memory)
        plan = self._plan = (Word * len(PLAN))()
        self._program: Spread | None = None
        if flag is not None:
            plan[PLAN.index("flag")] = _address(flag, memory)
        plan[PLAN.index("calls")], plan[PLAN.index("call_count")] = ctypes.addressof(table), len(calls)
        self.run: Callable[[int, int, int], int] = method(
            code, [ctypes.c_void_p(ctypes.addressof(plan))], (*memory, plan, table)
        )

    @property
    def program(self) -> Spread | None:
        """Program of the rounds, bound to its buffers, with three whole numbers; None for rounds of calls alone."""
        return self._program

    @program.setter
    def program(self, program: Spread | None) -> None:
        if program is not self._program:
            self._plan[0], self._plan[1] = (program.address, ctypes.addressof(program.table)) if program else (0, 0)
            self._program = program

    @property
    def done(self) -> int:
        """Number of rounds of the last run."""
        return int(self._plan[-1])


def at_once(calls: Sequence[Call]) -> Callable[[], object]:
    """Make the function that makes these calls, in machine code where there is LLVM, else in Python."""
    try:
        run = Rounds(calls).run
    except (ImportError, LookupError):
        return in_turn(calls)
    return lambda: run(0, 1, 0)


def _table(calls: Sequence[Call], memory: list[Any]) -> Any:
    """Write calls as words; what they point to is added to the memory, which has to live as long."""
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
    """Write when a call is made: how many floats are compared, where they are, and in which bits."""
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
    """Write rows of words and give their address."""
    flat = [word for row in rows for word in row]
    assert len(flat) == len(rows) * len(names)
    table = (Word * max(len(flat), 1))(*flat)
    memory.append(table)
    return ctypes.addressof(table)


def _address(view: memoryview, memory: list[Any]) -> int:
    """Give the address of floats, which stay where they are as long as the memory has them."""
    shared = (ctypes.c_double * len(view)).from_buffer(view)
    memory.append(shared)
    return ctypes.addressof(shared)


@cache
def _code() -> tuple[int, Any]:
    """Load the machine code of rounds: its address, and the engine that holds it."""
    import llvmlite.binding as llvm

    for name in CALLED:
        if llvm.address_of_symbol(name) is None:
            try:
                llvm.add_symbol(name, python_function(name))
            except AttributeError as error:
                raise LookupError(f"this Python has no {name}") from error
    text = rounds_text()
    key = hashlib.sha256("\0".join([*platform(), "rounds", text]).encode()).hexdigest()
    machine = disk.load(key)
    if machine is None:
        machine = emitted(text)
        disk.store(key, machine)
    engine = loaded([machine], ())
    return address(engine, ROUNDS), engine
