"""Priority of a process that must not be late: its memory stays, its thread comes first, its timers are exact."""

from __future__ import annotations

import ctypes
import gc
import os
import sys
from contextlib import suppress
from pathlib import Path
from typing import Any

SERVO, GUARD = 80, 79  # real-time priorities
SLACK = 29  # PR_SET_TIMERSLACK
DEATH = 1  # PR_SET_PDEATHSIG
CURRENT, FUTURE, TOUCHED = 1, 2, 4  # of mlockall: what is not touched is not locked, and takes no time as it ends
SWITCH = 1e-4  # after which Python's threads change [s]
GOVERNOR = "/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor"
REMEDY = (
    "the servo runs without real-time priority, and other programs make it late: add '@realtime - rtprio 80' and "
    "'@realtime - memlock unlimited' to /etc/security/limits.d/graspfx.conf, and yourself to the group realtime"
)


class RealTimeWarning(UserWarning):
    """A machine that does not let a run have what real time needs."""


def take_priority() -> dict[str, Any]:
    """Give this thread and process what real time needs, as far as the system lets them; tell what they have.

    Entries are `policy`, `memory`, `slack` [s], `governor`.
    """
    memory = _lock_memory()
    _leave_no_core()
    policy = set_fifo(SERVO)
    slack = _call("prctl", SLACK, 1, 0, 0, 0) == 0
    sys.setswitchinterval(SWITCH)
    gc.collect()
    gc.freeze()
    gc.disable()
    return {
        "policy": policy,
        "memory": memory,
        **({"slack": 1e-9} if slack else {}),
        **({"governor": governor} if (governor := _governor()) else {}),
    }


def set_fifo(priority: int) -> str:
    """Let this thread run before all others of a lower priority; name the policy that it has.

    Threads that it starts do not come by it.
    """
    fifo = getattr(os, "SCHED_FIFO", None)
    if fifo is None or not hasattr(os, "sched_setscheduler"):
        return "other"
    with suppress(OSError):
        os.sched_setscheduler(0, fifo | getattr(os, "SCHED_RESET_ON_FORK", 0), os.sched_param(priority))
        return f"fifo {priority}"
    return "other"


def die_with_parent(number: int) -> None:
    """Let the end of the thread that began this process send it a signal, on Linux."""
    _call("prctl", DEATH, number, 0, 0, 0)


def _lock_memory() -> str:
    """Keep this process's memory from being moved to disk: all that is to come too, where there is no limit."""
    try:
        import resource

        limit, _ = resource.getrlimit(resource.RLIMIT_MEMLOCK)
        free = limit == resource.RLIM_INFINITY or os.geteuid() == 0
    except (ImportError, AttributeError, OSError, ValueError):
        return "free"
    if free and _call("mlockall", CURRENT | FUTURE | TOUCHED) == 0:
        return "locked"
    return "locked so far" if _call("mlockall", CURRENT | TOUCHED) == 0 else "free"


def _leave_no_core() -> None:
    """Let a crash write no image of the memory: until that is written nobody can take the force away."""
    with suppress(ImportError, OSError, ValueError):
        import resource

        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def _governor() -> str:
    try:
        return Path(GOVERNOR).read_text().strip()
    except OSError:
        return ""


def _call(name: str, *numbers: int) -> int:
    """Call a function of the C library; -1 where there is none."""
    if not sys.platform.startswith("linux"):
        return -1
    function = getattr(ctypes.CDLL(None, use_errno=True), name, None)
    return -1 if function is None else int(function(*(ctypes.c_long(number) for number in numbers)))
