"""Ends of processes: one that goes with its parent, one that is ended, and a descriptor that tells of an end."""

from __future__ import annotations

import os
import signal
from contextlib import suppress
from pathlib import Path
from subprocess import Popen

from graspfx.system import c_library

ASK = int(signal.SIGTERM)  # a program may put things in order
KILL = int(getattr(signal, "SIGKILL", signal.SIGTERM))  # none may; on Windows both end it at once
DEATH = 1  # PR_SET_PDEATHSIG


def die_with_parent(number: int) -> None:
    """Let the end of the thread that began this process send it a signal, on Linux."""
    c_library.call("prctl", DEATH, number, 0, 0, 0)


def watched(process: Popen[bytes]) -> int:
    """Open a descriptor that is ready to be read when a process has ended; -1 where there is none."""
    if hasattr(os, "pidfd_open"):
        with suppress(OSError):
            return os.pidfd_open(process.pid)
    return -1


def send(number: int, process: Popen[bytes] | None, descriptor: int) -> None:
    """Send a signal to a process that has not ended, by the descriptor from `watched` if it is none of -1."""
    with suppress(OSError):
        if descriptor >= 0:
            signal.pidfd_send_signal(descriptor, number)
        elif process is not None and process.returncode is None:
            os.kill(process.pid, number)


def is_stopped(number: int) -> bool:
    """Tell whether a process is stopped by a signal, on Linux."""
    try:
        return Path(f"/proc/{number}/stat").read_bytes().rpartition(b")")[2].split()[0] in (b"T", b"t")
    except (OSError, IndexError):
        return False


def ending(code: int) -> str:
    """Say how a process ended, by its code."""
    if code < 0:
        try:
            return f"was ended by {signal.Signals(-code).name}"
        except ValueError:
            return f"was ended by signal {-code}"
    return f"ended with code {code}"
