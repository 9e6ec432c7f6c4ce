"""Functions of a loop without Python that only machine code has: its clock, calls by address, words of other threads.

Each is a Python function here, so that the loop's code reads and runs as it stands, and LLVM's text in a compiled loop.
A table of addresses, or of words, is an array of 64-bit numbers shown as floats: nothing computes with them.
"""

from __future__ import annotations

import ctypes
import hashlib
import time
from collections.abc import Mapping
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspfx.compile import cache as disk
from graspfx.compile.emission import emitted, loaded, platform, show
from graspfx.compile.llvm.llvm_arithmetic import LlvmFunction

FloatArray = NDArray[np.float64]

CALL, RUN = 3, 3  # words of a call, (function, context, block), and of `steps`, (function, table, place of the world)


def now(table: Any) -> float:
    """Tell the time of the clock that never runs back [s]."""
    return time.clock_gettime(time.CLOCK_MONOTONIC)


def sleep_until(table: Any, deadline: float) -> int:
    """Wait for a time of the clock."""
    while (left := deadline - now(table)) > 0.0:
        time.sleep(left)
    return 0


def call(table: Any, slot: int) -> int:
    """Call a device's function by its words in the table; without one nothing happens, which is 0."""
    function, context, block = _words(table)[slot : slot + CALL].tolist()
    return int(_CALLED(function)(context, block)) if function else 0


def run(table: Any, slot: int, k: int, row: int) -> int:
    """Run `steps` for tick k, up to its devices' writing or from there on, by its words in the table."""
    function, buffers, world = _words(table)[slot : slot + RUN].tolist()
    numbers = (ctypes.c_int64 * 4)(world, k, 1, row)
    return int(_CALLED(function)(buffers, ctypes.addressof(numbers)))


def peek(words: Any, place: int) -> int:
    """Read a word that another thread may write."""
    return int(_words(words)[place])


def publish(words: Any, place: int, number: int) -> int:
    """Write a word: who sees it sees all that was written before."""
    _words(words)[place] = number
    return 0


_CALLED = ctypes.CFUNCTYPE(ctypes.c_int64, ctypes.c_void_p, ctypes.c_void_p)


def _words(table: Any) -> NDArray[np.int64]:
    return np.asarray(table).view(np.int64)


FUNCTIONS = now, sleep_until, call, run, peek, publish
RESULTS = {"now": "double"}  # of the others whole numbers
PREFIX = "graspfx_loop_"
TEXT = """
declare i32 @clock_gettime(i32, ptr)
declare i32 @clock_nanosleep(i32, i32, ptr, ptr)

define double @graspfx_loop_now(ptr %table) nounwind {
  %time = alloca [2 x i64]
  %ignored = call i32 @clock_gettime(i32 1, ptr %time)
  %nanos = getelementptr i64, ptr %time, i64 1
  %s = load i64, ptr %time
  %n = load i64, ptr %nanos
  %whole = mul i64 %s, 1000000000
  %all = add i64 %whole, %n
  %float = sitofp i64 %all to double
  %seconds = fdiv double %float, 1.0e9
  ret double %seconds
}

define i64 @graspfx_loop_sleep_until(ptr %table, double %deadline) nounwind {
start:
  %time = alloca [2 x i64]
  %nanos = getelementptr i64, ptr %time, i64 1
  %float = fmul double %deadline, 1.0e9
  %all = fptosi double %float to i64
  %s = sdiv i64 %all, 1000000000
  %n = srem i64 %all, 1000000000
  store i64 %s, ptr %time
  store i64 %n, ptr %nanos
  br label %sleep
sleep:
  %code = call i32 @clock_nanosleep(i32 1, i32 1, ptr %time, ptr null)
  %interrupted = icmp eq i32 %code, 4
  br i1 %interrupted, label %sleep, label %end
end:
  ret i64 0
}

define i64 @graspfx_loop_call(ptr %table, i64 %slot) nounwind {
start:
  %at = getelementptr ptr, ptr %table, i64 %slot
  %function = load ptr, ptr %at
  %none = icmp eq ptr %function, null
  br i1 %none, label %end, label %go
go:
  %second = getelementptr ptr, ptr %at, i64 1
  %third = getelementptr ptr, ptr %at, i64 2
  %context = load ptr, ptr %second
  %block = load ptr, ptr %third
  %code = call i64 %function(ptr %context, ptr %block)
  ret i64 %code
end:
  ret i64 0
}

define i64 @graspfx_loop_run(ptr %table, i64 %slot, i64 %k, i64 %row) nounwind {
  %numbers = alloca [4 x i64]
  %k.at = getelementptr i64, ptr %numbers, i64 1
  %count.at = getelementptr i64, ptr %numbers, i64 2
  %row.at = getelementptr i64, ptr %numbers, i64 3
  %at = getelementptr ptr, ptr %table, i64 %slot
  %second = getelementptr ptr, ptr %at, i64 1
  %third = getelementptr i64, ptr %at, i64 2
  %function = load ptr, ptr %at
  %buffers = load ptr, ptr %second
  %world = load i64, ptr %third
  store i64 %world, ptr %numbers
  store i64 %k, ptr %k.at
  store i64 1, ptr %count.at
  store i64 %row, ptr %row.at
  %code = call i64 %function(ptr %buffers, ptr %numbers)
  ret i64 %code
}

define i64 @graspfx_loop_peek(ptr %words, i64 %place) nounwind {
  %at = getelementptr i64, ptr %words, i64 %place
  %number = load atomic i64, ptr %at acquire, align 8
  ret i64 %number
}

define i64 @graspfx_loop_publish(ptr %words, i64 %place, i64 %number) nounwind {
  %at = getelementptr i64, ptr %words, i64 %place
  store atomic i64 %number, ptr %at release, align 8
  ret i64 0
}
"""
DRIVEN = "graspfx_loop_driven"
# A vendor's thread calls unsigned f(void *table); the words are a program's, then k, a word that ends it, and one that
# says that a call goes on. It returns 1 to be called again, 0 for the last time.
DRIVEN_TEXT = """
define i32 @graspfx_loop_driven(ptr %table) nounwind {
start:
  %at = getelementptr i64, ptr %table, i64 2
  %end = getelementptr i64, ptr %table, i64 3
  %busy = getelementptr i64, ptr %table, i64 4
  store atomic i64 1, ptr %busy seq_cst, align 8
  %over = load atomic i64, ptr %end seq_cst, align 8
  %stops = icmp ne i64 %over, 0
  br i1 %stops, label %last, label %turn
turn:
  %numbers = alloca [2 x i64]
  %next = getelementptr i64, ptr %numbers, i64 1
  %k = load i64, ptr %at
  store i64 %k, ptr %numbers
  store i64 1, ptr %next
  %second = getelementptr ptr, ptr %table, i64 1
  %function = load ptr, ptr %table
  %buffers = load ptr, ptr %second
  %done = call i64 %function(ptr %buffers, ptr %numbers)
  %new = add i64 %k, %done
  store atomic i64 %new, ptr %at release, align 8
  store atomic i64 0, ptr %busy release, align 8
  ret i32 1
last:
  store atomic i64 0, ptr %busy release, align 8
  ret i32 0
}
"""


@cache
def machine_functions() -> Mapping[str, LlvmFunction]:
    """Load the functions, by their names here; machine code that is loaded later calls them by symbol."""
    engine()
    return {f.__name__: LlvmFunction(PREFIX + f.__name__, RESULTS.get(f.__name__, "i64")) for f in FUNCTIONS}


@cache
def engine() -> Any:
    """Load the machine code of all functions."""
    import llvmlite.binding as llvm

    text = TEXT + DRIVEN_TEXT
    library = ctypes.CDLL(None)
    for name in ("clock_gettime", "clock_nanosleep"):
        if llvm.address_of_symbol(name) is None:
            llvm.add_symbol(name, ctypes.cast(getattr(library, name), ctypes.c_void_p).value)
    key = hashlib.sha256("\0".join([*platform(), "loop", text]).encode()).hexdigest()
    machine = disk.load(key)
    if machine is None:
        machine = emitted(text)
        disk.store(key, machine)
    loop = loaded([machine], ())
    show(loop, [PREFIX + f.__name__ for f in FUNCTIONS])
    return loop
