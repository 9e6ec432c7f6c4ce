"""Machine code that calls functions of other Python packages through the C API of Python."""

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
from graspfx.compile.llvm.method import DECLARED, python_function

Word = ctypes.c_int64
ALL_BITS, WITHOUT_SIGN = -1, 2**63 - 1
EXCHANGE = "graspfx_exchange"
CALLED = {
    "PyObject_Call": "ptr @PyObject_Call(ptr, ptr, ptr)",
    "PyFloat_FromDouble": "ptr @PyFloat_FromDouble(double)",
    "PyList_SetItem": "i32 @PyList_SetItem(ptr, i64, ptr)",
    "Py_DecRef": "void @Py_DecRef(ptr)",
}  # functions of Python's stable ABI, in addition to `DECLARED`
PLAN = ("calls", "call_count")  # words of a plan
CALL = (
    "function", "arguments", "keywords", "tested", "first", "second", "mask", "sends", "send_count",
    "receipts", "receipt_count",
)  # fmt: skip # words of a call
SEND = ("list", "memory", "count")  # words of an argument list
RECEIPT = ("place", "memory", "count")  # words of a result tuple


class MachineExchange:
    """Machine code that makes calls of Python functions, with the same results as `calls.in_turn`.

    The machine code is a function exchange(buffer, place). It returns 0, or 1 if a call raised an exception. The caller
    must hold the interpreter's lock.

    Args:
        calls: Calls, whose memories must not move.

    Attributes:
        address: Address of the function.
        plan: Words that the caller must store in the buffer from the index `place` on.

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
        """Make the calls once."""
        self._function(self.plan.ctypes.data, 0)


def _table(calls: Sequence[Call], memory: list[Any]) -> Any:
    """Return the table of words that describes calls to the machine code.

    Objects to which the words refer are appended to `memory`, which must exist as long as the table is used.
    """
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
    """Return the words of a call's condition: number of compared floats, their two addresses, and mask of bits."""
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
    """Store rows of words, with one word for each name, in new memory, and return its address."""
    flat = [word for row in rows for word in row]
    assert len(flat) == len(rows) * len(names)
    table = (Word * max(len(flat), 1))(*flat)
    memory.append(table)
    return ctypes.addressof(table)


def _address(view: memoryview, memory: list[Any]) -> int:
    """Return the address of a view of floats; a reference in `memory` prevents the floats from moving."""
    shared = (ctypes.c_double * len(view)).from_buffer(view)
    memory.append(shared)
    return ctypes.addressof(shared)


@cache
def _code() -> tuple[int, Any]:
    """Load or compile the machine code of exchanges; return the address of the function, and LLVM's engine."""
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


# LLVM text of an exchange: a sequence of calls of Python functions ----------------------------------------------------


def exchange_text() -> str:
    """Return the LLVM text of the function of a `MachineExchange`."""
    names = [*DECLARED.values(), *CALLED.values()]
    return "\n".join([*(f"declare {signature}" for signature in names), _CHANGED, _SENT, _RECEIVED, _ALL, _EXCHANGE])


def _fields(base: str, words: tuple[str, ...], pointers: tuple[str, ...]) -> str:
    """Return instructions that load words, from an address in `base`, into registers with the names of the words."""
    lines = []
    for k, name in enumerate(words):
        lines += [
            f"  %{name}.at = getelementptr i64, ptr %{base}, i64 {k}",
            f"  %{name} = load {'ptr' if name in pointers else 'i64'}, ptr %{name}.at",
        ]
    return "\n".join(lines)


# Whether a float at `first` differs from that at `second` in the bits of the mask; true if no floats are compared.
_CHANGED = """
define internal i1 @changed(i64 %count, ptr %first, ptr %second, i64 %mask) nounwind {
start:
  %always = icmp eq i64 %count, 0
  br i1 %always, label %end, label %turn
turn:
  %j = phi i64 [ 0, %start ], [ %next, %turn ]
  %bits = phi i64 [ 0, %start ], [ %now, %turn ]
  %one.at = getelementptr i64, ptr %first, i64 %j
  %other.at = getelementptr i64, ptr %second, i64 %j
  %one = load i64, ptr %one.at
  %other = load i64, ptr %other.at
  %difference = xor i64 %one, %other
  %masked = and i64 %difference, %mask
  %now = or i64 %bits, %masked
  %next = add i64 %j, 1
  %more = icmp slt i64 %next, %count
  br i1 %more, label %turn, label %told
told:
  %differs = icmp ne i64 %now, 0
  br label %end
end:
  %result = phi i1 [ true, %start ], [ %differs, %told ]
  ret i1 %result
}"""

# Fills lists with floats; false if Python raised an exception. PyList_SetItem steals the reference even if it fails.
_SENT = f"""
define internal i1 @sent(ptr %sends, i64 %send_count) nounwind {{
start:
  br label %each
each:
  %s = phi i64 [ 0, %start ], [ %s.next, %full ]
  %any = icmp slt i64 %s, %send_count
  br i1 %any, label %fill, label %good
fill:
  %send = getelementptr [{len(SEND)} x i64], ptr %sends, i64 %s
{_fields("send", SEND, ("list", "memory"))}
  br label %turn
turn:
  %j = phi i64 [ 0, %fill ], [ %next, %set ]
  %more = icmp slt i64 %j, %count
  br i1 %more, label %new, label %full
new:
  %number.at = getelementptr double, ptr %memory, i64 %j
  %number = load double, ptr %number.at
  %float = call ptr @PyFloat_FromDouble(double %number)
  %none = icmp eq ptr %float, null
  br i1 %none, label %bad, label %put
put:
  %code = call i32 @PyList_SetItem(ptr %list, i64 %j, ptr %float)
  %wrong = icmp ne i32 %code, 0
  br i1 %wrong, label %bad, label %set
set:
  %next = add i64 %j, 1
  br label %turn
full:
  %s.next = add i64 %s, 1
  br label %each
good:
  ret i1 true
bad:
  ret i1 false
}}"""

# Reads floats from a result's tuples by borrowed references; false if Python raised an exception.
_RECEIVED = f"""
define internal i1 @received(ptr %result, ptr %receipts, i64 %receipt_count) nounwind {{
start:
  br label %each
each:
  %s = phi i64 [ 0, %start ], [ %s.next, %full ]
  %any = icmp slt i64 %s, %receipt_count
  br i1 %any, label %open, label %good
open:
  %receipt = getelementptr [{len(RECEIPT)} x i64], ptr %receipts, i64 %s
{_fields("receipt", RECEIPT, ("memory",))}
  %tuple = call ptr @PyTuple_GetItem(ptr %result, i64 %place)
  %missing = icmp eq ptr %tuple, null
  br i1 %missing, label %bad, label %turn
turn:
  %j = phi i64 [ 0, %open ], [ %next, %read ]
  %more = icmp slt i64 %j, %count
  br i1 %more, label %item, label %full
item:
  %float = call ptr @PyTuple_GetItem(ptr %tuple, i64 %j)
  %none = icmp eq ptr %float, null
  br i1 %none, label %bad, label %read
read:
  %number = call double @PyFloat_AsDouble(ptr %float)
  %number.at = getelementptr double, ptr %memory, i64 %j
  store double %number, ptr %number.at
  %next = add i64 %j, 1
  br label %turn
full:
  %error = call ptr @PyErr_Occurred()
  %fine = icmp eq ptr %error, null
  %s.next = add i64 %s, 1
  br i1 %fine, label %each, label %bad
good:
  ret i1 true
bad:
  ret i1 false
}}"""

_ALL = f"""
define internal i1 @all(ptr %list_of_calls, i64 %call_count) nounwind {{
start:
  br label %each
each:
  %c = phi i64 [ 0, %start ], [ %c.next, %done ]
  %any = icmp slt i64 %c, %call_count
  br i1 %any, label %test, label %good
test:
  %call = getelementptr [{len(CALL)} x i64], ptr %list_of_calls, i64 %c
{_fields("call", CALL, ("function", "arguments", "keywords", "first", "second", "sends", "receipts"))}
  %needed = call i1 @changed(i64 %tested, ptr %first, ptr %second, i64 %mask)
  br i1 %needed, label %send, label %done
send:
  %full = call i1 @sent(ptr %sends, i64 %send_count)
  br i1 %full, label %run, label %bad
run:
  %result = call ptr @PyObject_Call(ptr %function, ptr %arguments, ptr %keywords)
  %raised = icmp eq ptr %result, null
  br i1 %raised, label %bad, label %receive
receive:
  %whole = call i1 @received(ptr %result, ptr %receipts, i64 %receipt_count)
  call void @Py_DecRef(ptr %result)
  br i1 %whole, label %done, label %bad
done:
  %c.next = add i64 %c, 1
  br label %each
good:
  ret i1 true
bad:
  ret i1 false
}}"""


_EXCHANGE = f"""
define i64 @{EXCHANGE}(ptr %buffer, i64 %place) nounwind {{
  %plan = getelementptr i64, ptr %buffer, i64 %place
{_fields("plan", PLAN, ("calls",))}
  %good = call i1 @all(ptr %calls, i64 %call_count)
  %failed = xor i1 %good, true
  %code = zext i1 %failed to i64
  ret i64 %code
}}"""
