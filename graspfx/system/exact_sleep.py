"""Sleep until a time of the clock that never runs back: to an absolute one on Linux, where nothing adds up."""

from __future__ import annotations

import ctypes
import time
from collections.abc import Callable

from graspfx.system import c_library

MONOTONIC, ABSOLUTE = 1, 1  # of clock_nanosleep


class Timespec(ctypes.Structure):
    """A time of the C library's."""

    _fields_ = [("seconds", ctypes.c_long), ("nanoseconds", ctypes.c_long)]


def sleeper() -> Callable[[int], None]:
    """Give a function that sleeps until a time of the monotonic clock [ns]."""
    function = c_library.function("clock_nanosleep")
    if function is None:
        return lambda deadline: time.sleep(max(0.0, 1e-9 * (deadline - time.monotonic_ns())))
    function.argtypes = (ctypes.c_int, ctypes.c_int, ctypes.POINTER(Timespec), ctypes.c_void_p)

    def sleep(deadline: int) -> None:
        seconds, rest = divmod(deadline, 10**9)
        function(MONOTONIC, ABSOLUTE, ctypes.byref(Timespec(seconds, rest)), None)

    return sleep
