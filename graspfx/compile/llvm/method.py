"""Programs as built-in functions of Python. A call takes 20 ns, whereas a call by ctypes takes almost 1 us."""

from __future__ import annotations

import ctypes
import struct
from collections.abc import Callable, Sequence
from functools import cache
from typing import Any

from graspfx.compile.llvm.llvm_arithmetic import FLOAT

ENTRY, METHOD, CALLBACK = "graspfx_entry", "graspfx_method", "graspfx_callback"
FASTCALL = 0x80  # METH_FASTCALL: f(self, array of arguments, how many)
READ = {False: ("i64", "PyLong_AsLongLong"), True: ("double", "PyFloat_AsDouble")}
DECLARED = {
    "PyTuple_GetItem": "ptr @PyTuple_GetItem(ptr, i64)",
    "PyBytes_AsString": "ptr @PyBytes_AsString(ptr)",
    "PyLong_AsLongLong": "i64 @PyLong_AsLongLong(ptr)",
    "PyFloat_AsDouble": "double @PyFloat_AsDouble(ptr)",
    "PyLong_FromLongLong": "ptr @PyLong_FromLongLong(i64)",
    "PyErr_Occurred": "ptr @PyErr_Occurred()",
    "PyErr_BadArgument": "i32 @PyErr_BadArgument()",
}  # Python's stable interface


class _Definition(ctypes.Structure):
    """The struct PyMethodDef of Python's C API."""

    _fields_ = (
        ("name", ctypes.c_char_p),
        ("function", ctypes.c_void_p),
        ("flags", ctypes.c_int),
        ("doc", ctypes.c_char_p),
    )


def method_text(entry: str, arrays: int, numbers: Sequence[str]) -> str:
    """Return the LLVM text of two functions that read arguments from memory and call the entry of a program.

    Python calls the function `graspfx_method`. The first item of its argument `self`, a tuple, is a bytes object with
    the addresses of the buffers. Other machine code calls the function `graspfx_callback`. Its argument is the address
    of a table, with eight bytes for the address of each buffer and then for each number.

    Args:
        entry: Name of the program's entry.
        arrays: Number of buffers.
        numbers: LLVM types of the numbers.
    """
    n = len(numbers)
    reading, operands = [], [f"ptr %p{k}" for k in range(arrays)]
    unpacking = []
    for k, type_ in enumerate(numbers):
        kind, reader = READ[type_ == FLOAT]
        reading += [
            f"  %at{k} = getelementptr ptr, ptr %arguments, i64 {k}",
            f"  %object{k} = load ptr, ptr %at{k}",
            f"  %n{k} = call {kind} @{reader}(ptr %object{k})",
        ]
        operands.append(f"{kind} %n{k}")
        unpacking += [f"  %at{k} = getelementptr i64, ptr %table, i64 {arrays + k}"]
        unpacking += [f"  %n{k} = load {kind}, ptr %at{k}"]
    loading = []
    for k in range(arrays):
        loading += [f"  %slot{k} = getelementptr ptr, ptr %table, i64 {k}", f"  %p{k} = load ptr, ptr %slot{k}"]
    lines = [
        *(f"declare {signature}" for signature in DECLARED.values()),
        f"define ptr @{METHOD}(ptr %self, ptr %arguments, i64 %count) nounwind {{",
        f"  %right = icmp eq i64 %count, {n}",
        "  br i1 %right, label %read, label %wrong",
        "read:",
        *reading,
        "  %error = call ptr @PyErr_Occurred()",
        "  %fine = icmp eq ptr %error, null",
        "  br i1 %fine, label %run, label %fail",
        "run:",
        "  %bytes = call ptr @PyTuple_GetItem(ptr %self, i64 0)",
        "  %table = call ptr @PyBytes_AsString(ptr %bytes)",
        *loading,
        f"  %result = call i64 @{entry}({', '.join(operands)})",
        "  %raised = call ptr @PyErr_Occurred()",  # exception of a Python function that the entry has called
        "  %whole = icmp eq ptr %raised, null",
        "  br i1 %whole, label %tell, label %fail",
        "tell:",
        "  %told = call ptr @PyLong_FromLongLong(i64 %result)",
        "  ret ptr %told",
        "wrong:",
        "  %ignored = call i32 @PyErr_BadArgument()",
        "  br label %fail",
        "fail:",
        "  ret ptr null",
        "}",
        f"define i64 @{CALLBACK}(ptr %table) nounwind {{",
        *loading,
        *unpacking,
        f"  %result = call i64 @{entry}({', '.join(operands)})",
        "  ret i64 %result",
        "}",
    ]
    return "\n".join(lines)


def method(address: int, pointers: Sequence[ctypes.c_void_p], owner: Any) -> Callable[..., int]:
    """Create a built-in function of Python that calls a program with fixed buffers.

    The function keeps references to the pointers and to the owner of the machine code.

    Args:
        address: Address of the machine code of `method_text`.
        pointers: Pointers to the buffers, in the order of the entry's parameters.
        owner: Engine that owns the machine code.
    """
    definition = _Definition(b"run", address, FASTCALL, None)
    table = struct.pack(f"{len(pointers)}P", *(pointer.value for pointer in pointers))
    function: Callable[..., int] = _new_function()(
        ctypes.addressof(definition), (table, definition, owner, *pointers), None
    )
    return function


@cache
def _new_function() -> Any:
    """Return the function PyCFunction_NewEx(definition, self, module) of Python's C API."""
    kind = ctypes.PYFUNCTYPE(ctypes.py_object, ctypes.c_void_p, ctypes.py_object, ctypes.c_void_p)
    return kind(("PyCFunction_NewEx", ctypes.pythonapi))


def python_function(name: str) -> int | None:
    """Return the address of a function of Python's C API."""
    return ctypes.cast(getattr(ctypes.pythonapi, name), ctypes.c_void_p).value
