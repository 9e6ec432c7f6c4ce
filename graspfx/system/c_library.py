"""Functions of the C library in this process."""

from __future__ import annotations

import ctypes
import os
import sys
from typing import Any


def function(name: str) -> Any:
    """Look up a function; None on other systems than Linux, and if the C library lacks the function."""
    if not sys.platform.startswith("linux"):
        return None
    return getattr(ctypes.CDLL(None, use_errno=True), name, None)


def call(name: str, *numbers: int) -> int:
    """Call a function with integer arguments and return its result; -1 if `function` does not find it."""
    called = function(name)
    return -1 if called is None else int(called(*(ctypes.c_long(number) for number in numbers)))


def flush_output() -> None:
    """Flush the output of C code."""
    library: Any = ctypes.CDLL(None) if os.name == "posix" else ctypes.CDLL("msvcrt")
    library.fflush(None)
