"""Priorities, processors, timers and memory locking of threads and processes; some functions require Linux."""

from __future__ import annotations

import ctypes
import os
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Any

from graspfx.system import c_library

SLACK = 29  # PR_SET_TIMERSLACK
CURRENT, FUTURE, TOUCHED = 1, 2, 4  # flags of mlockall; TOUCHED leaves untouched pages unlocked, which saves time
MONOTONIC, ABSOLUTE = 1, 1  # arguments of clock_nanosleep
OTHER = "other"  # policy without real-time priority


def processors() -> int:
    """Return the number of processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def memory_limit() -> str:
    """Return a description of this process's memory limit; empty if there is no limit."""
    with suppress(ImportError, OSError, ValueError):
        import resource

        for name, flag in (("RLIMIT_AS", "-v"), ("RLIMIT_DATA", "-d")):
            most, _ = resource.getrlimit(getattr(resource, name))
            if most != resource.RLIM_INFINITY:
                return f"{most / 1e6:.0f} MB ({name}, `ulimit {flag}`)"
    return ""


def be_nice(number: int) -> None:
    """Increase the nice value of this process by `number`, which lowers its priority, if the system supports it."""
    if hasattr(os, "nice"):
        with suppress(OSError):
            os.nice(number)


def set_fifo(priority: int) -> str:
    """Set the policy of this thread to SCHED_FIFO with a priority.

    Threads that this thread starts do not inherit the priority.

    Returns:
        "fifo PRIORITY", or "other" if the system does not allow the policy.
    """
    fifo = getattr(os, "SCHED_FIFO", None)
    if fifo is None or not hasattr(os, "sched_setscheduler"):
        return OTHER
    return f"fifo {priority}" if set_policy(fifo | getattr(os, "SCHED_RESET_ON_FORK", 0), priority) else OTHER


def set_policy(policy: Any, priority: int) -> bool:
    """Set the scheduling policy and priority of this thread; return whether the system allows it."""
    with suppress(OSError):
        os.sched_setscheduler(0, policy, os.sched_param(priority))
        return True
    return False


def real_time_policy() -> tuple[Any, int] | None:
    """Return the scheduling policy and priority of this thread; None if the policy is not a real-time policy."""
    if not hasattr(os, "sched_getscheduler"):
        return None
    policy = os.sched_getscheduler(0) & ~getattr(os, "SCHED_RESET_ON_FORK", 0)
    if policy not in (os.SCHED_FIFO, os.SCHED_RR):
        return None
    return policy, os.sched_getparam(0).sched_priority


def set_exact_timers() -> bool:
    """Set the timer slack of this thread to its minimum of 1 ns; return whether the system allows it."""
    return c_library.call("prctl", SLACK, 1, 0, 0, 0) == 0


def most_locked() -> float | None:
    """Return the number of bytes that this process may lock in memory: infinity for no limit, None if unknown."""
    try:
        import resource

        limit, _ = resource.getrlimit(resource.RLIMIT_MEMLOCK)
        return float("inf") if limit == resource.RLIM_INFINITY or os.geteuid() == 0 else float(limit)
    except (ImportError, AttributeError, OSError, ValueError):
        return None


def lock_memory() -> str:
    """Lock the memory of this process, so that it is not swapped to disk.

    Returns:
        "locked" if the present memory and all future memory are locked; "locked so far" if only the present memory is
        locked, because the process has a limit; "free" if no memory is locked.
    """
    most = most_locked()
    if most is None:
        return "free"
    if most == float("inf") and c_library.call("mlockall", CURRENT | FUTURE | TOUCHED) == 0:
        return "locked"
    return "locked so far" if c_library.call("mlockall", CURRENT | TOUCHED) == 0 else "free"


def leave_no_core() -> None:
    """Disable core dumps, since a force would persist while a core dump of this process is written."""
    with suppress(ImportError, OSError, ValueError):
        import resource

        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


class Timespec(ctypes.Structure):
    """The C structure timespec."""

    _fields_ = [("seconds", ctypes.c_long), ("nanoseconds", ctypes.c_long)]


def sleeper() -> Callable[[int], None]:
    """Return a function that sleeps until a given time of the monotonic clock [ns].

    On Linux the function uses an absolute sleep, on other systems a relative sleep.
    """
    function = c_library.function("clock_nanosleep")
    if function is None:
        return lambda deadline: time.sleep(max(0.0, 1e-9 * (deadline - time.monotonic_ns())))
    function.argtypes = (ctypes.c_int, ctypes.c_int, ctypes.POINTER(Timespec), ctypes.c_void_p)

    def sleep(deadline: int) -> None:
        seconds, rest = divmod(deadline, 10**9)
        function(MONOTONIC, ABSOLUTE, ctypes.byref(Timespec(seconds, rest)), None)

    return sleep
