"""Functions of the C library that this process has loaded already."""

from __future__ import annotations

import ctypes
import os
import sys
from typing import Any


def function(name: str) -> Any:
    """Look up a function that only Linux has; None elsewhere."""
    if not sys.platform.startswith("linux"):
        return None
    return getattr(ctypes.CDLL(None, use_errno=True), name, None)


def call(name: str, *numbers: int) -> int:
    """Call a function of whole numbers that only Linux has; -1 elsewhere."""
    called = function(name)
    return -1 if called is None else int(called(*(ctypes.c_long(number) for number in numbers)))


def flush_output() -> None:
    """Write out what C code has printed."""
    library: Any = ctypes.CDLL(None) if os.name == "posix" else ctypes.CDLL("msvcrt")
    library.fflush(None)
