"""Ends of processes: end with the parent process, signals, and file descriptors that report the end of a process."""

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
    """On Linux, request that this process receives signal `number` when the thread of the parent that started it ends.

    On other systems, do nothing.
    """
    c_library.call("prctl", DEATH, number, 0, 0, 0)


def watched(process: Popen[bytes]) -> int:
    """Return a file descriptor that becomes readable when a process has ended; -1 if the system has none."""
    if hasattr(os, "pidfd_open"):
        with suppress(OSError):
            return os.pidfd_open(process.pid)
    return -1


def send(number: int, process: Popen[bytes] | None, descriptor: int) -> None:
    """Send signal `number` to a process, unless the process has ended.

    Args:
        process: Process, which is used only if the descriptor is -1.
        descriptor: File descriptor of the process from `watched`.
    """
    with suppress(OSError):
        if descriptor >= 0:
            signal.pidfd_send_signal(descriptor, number)
        elif process is not None and process.returncode is None:
            os.kill(process.pid, number)


def is_stopped(number: int) -> bool:
    """Return whether a signal has stopped the process with the given number; always False except on Linux."""
    try:
        return Path(f"/proc/{number}/stat").read_bytes().rpartition(b")")[2].split()[0] in (b"T", b"t")
    except (OSError, IndexError):
        return False


def ending(code: int) -> str:
    """Return a description of how a process with the given exit code ended."""
    if code < 0:
        try:
            return f"was ended by {signal.Signals(-code).name}"
        except ValueError:
            return f"was ended by signal {-code}"
    return f"ended with code {code}"
