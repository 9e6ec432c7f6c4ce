"""Ends of processes: end with the parent, signals, and descriptors that report an end."""

from __future__ import annotations

import os
import signal
from contextlib import suppress
from pathlib import Path
from subprocess import Popen

from graspfx.system import c_library

ASK = int(signal.SIGTERM)  # lets the program clean up
KILL = int(getattr(signal, "SIGKILL", signal.SIGTERM))  # ends the program at once; on Windows both signals do
DEATH = 1  # PR_SET_PDEATHSIG


def die_with_parent(number: int) -> None:
    """On Linux, let the system send signal `number` to this process when the parent's thread that started it ends."""
    c_library.call("prctl", DEATH, number, 0, 0, 0)


def watched(process: Popen[bytes]) -> int:
    """Open a descriptor that becomes readable when a process has ended; -1 if unsupported."""
    if hasattr(os, "pidfd_open"):
        with suppress(OSError):
            return os.pidfd_open(process.pid)
    return -1


def send(number: int, process: Popen[bytes] | None, descriptor: int) -> None:
    """Send a signal to a process that has not ended, by its descriptor from `watched` unless that is -1."""
    with suppress(OSError):
        if descriptor >= 0:
            signal.pidfd_send_signal(descriptor, number)
        elif process is not None and process.returncode is None:
            os.kill(process.pid, number)


def is_stopped(number: int) -> bool:
    """Tell whether a process is stopped by a signal; False except on Linux."""
    try:
        return Path(f"/proc/{number}/stat").read_bytes().rpartition(b")")[2].split()[0] in (b"T", b"t")
    except (OSError, IndexError):
        return False


def ending(code: int) -> str:
    """Describe how a process ended, from its exit code."""
    if code < 0:
        try:
            return f"was ended by {signal.Signals(-code).name}"
        except ValueError:
            return f"was ended by signal {-code}"
    return f"ended with code {code}"
