"""Calls of functions of the C library."""

from __future__ import annotations

import ctypes
import os
import sys
from typing import Any


def function(name: str) -> Any:
    """Return a function of the C library by its name; None if it does not exist, or if the system is not Linux."""
    if not sys.platform.startswith("linux"):
        return None
    return getattr(ctypes.CDLL(None, use_errno=True), name, None)


def call(name: str, *numbers: int) -> int:
    """Call a function of the C library with integers, and return its result; -1 if `function` does not find it."""
    called = function(name)
    return -1 if called is None else int(called(*(ctypes.c_long(number) for number in numbers)))


def flush_output() -> None:
    """Flush the output streams of the C library."""
    library: Any = ctypes.CDLL(None) if os.name == "posix" else ctypes.CDLL("msvcrt")
    library.fflush(None)
