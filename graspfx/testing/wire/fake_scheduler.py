"""A stand-in for the OpenHaptics library (HD) in LLVM's language: its scheduler's thread calls one callback a period.

Where this machine has a compiler, it links a shared library that any program can load, as with `fake_library`; the
state of its devices is a file that all of them share. Else the functions are machine code in this process. Each process
has a scheduler of its own.
"""

from __future__ import annotations

import ctypes
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from graspfx.compile.emission import address, emitted, loaded
from graspfx.testing.wire.c_compiler import compiler
from graspfx.testing.wire.linking import shared
from graspfx.testing.wire.scheduler_text import TEXT

DEVICES = 3
BINS = 2048  # of a microsecond, of what the callback takes
DEVICE = 64  # words of a device
CURRENT, ERRORS, RATE, TURNS, VIOLATIONS, DEPTH, STACK, STALLED, LONGEST, STARTS = 1, 2, 19, 21, 22, 23, 24, 30, 31, 29
FIRST_BIN, FIRST_DEVICE = 32, 32 + BINS  # words
POSITION, VELOCITY, FORCE, PENDING, OWNER, ENABLED, FRAME, ERROR, NAME = 0, 3, 6, 9, 12, 13, 14, 15, 24
PACED = FIRST_DEVICE + DEVICES * DEVICE  # whether turns come as they are due, and not by the machine's clock
DUE, PASSED, RUNNING = PACED + 1, PACED + 2, PACED + 3  # turns, turns that are over, and whether there is a thread
SIZE = PACED + 4  # words of the state
SIGNATURES: Mapping[str, tuple[Any, ...]] = {
    "hdInitDevice": (ctypes.c_uint, ctypes.c_char_p),
    "hdDisableDevice": (None, ctypes.c_uint),
    "hdMakeCurrentDevice": (None, ctypes.c_uint),
    "hdEnable": (None, ctypes.c_uint),
    "hdDisable": (None, ctypes.c_uint),
    "hdBeginFrame": (None, ctypes.c_uint),
    "hdEndFrame": (None, ctypes.c_uint),
    "hdGetDoublev": (None, ctypes.c_uint, ctypes.c_void_p),
    "hdSetDoublev": (None, ctypes.c_uint, ctypes.c_void_p),
    "hdScheduleAsynchronous": (ctypes.c_ulong, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_ushort),
    "hdUnschedule": (None, ctypes.c_ulong),
    "hdSetSchedulerRate": (None, ctypes.c_ulong),
    "hdStartScheduler": (None,),
    "hdStopScheduler": (None,),
}


def library(state: Path, folder: Path) -> Any:
    """Make the library: the path of a shared one where there is a compiler, else an object with its functions."""
    text = TEXT.format(
        length=len(str(state)) + 1, path=state, bytes=8 * SIZE, device=DEVICE, devices=DEVICES,
        first_device=FIRST_DEVICE, errors=ERRORS, violations=VIOLATIONS, current=CURRENT, frame=FRAME, owner=OWNER,
        name=NAME, error=ERROR, depth=DEPTH, stack=STACK, enabled=ENABLED, pending=PENDING, force=FORCE,
        velocity=VELOCITY, position=POSITION, rate=RATE, starts=STARTS, stalled=STALLED, turns=TURNS, longest=LONGEST,
        last_bin=BINS - 1, first_bin=FIRST_BIN, paced=PACED, due=DUE, passed=PASSED, running=RUNNING,
    )  # fmt: skip
    if compiler() is not None:
        return str(shared(text, folder, "libHD.so"))
    return SchedulerFunctions(text)


class SchedulerFunctions:
    """The library's functions in this process, by their names, as ctypes shows those of a shared library."""

    def __init__(self, text: str) -> None:
        self._engine = loaded([emitted(text)], ())
        for name, (result, *kinds) in SIGNATURES.items():
            setattr(self, name, ctypes.CFUNCTYPE(result, *kinds)(address(self._engine, name)))
        self.hdGetError = ctypes.CFUNCTYPE(_Error)(address(self._engine, "hdGetError"))


class _Error(ctypes.Structure):
    """HDErrorInfo."""

    _fields_ = (("code", ctypes.c_uint), ("internal", ctypes.c_int), ("handle", ctypes.c_uint))
