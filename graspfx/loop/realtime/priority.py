"""Priority of a process that must not be late: its memory stays, its thread comes first, its timers are exact."""

from __future__ import annotations

import gc
import sys
from pathlib import Path
from typing import Any

from graspfx.system import scheduling

SERVO, GUARD = 80, 79  # real-time priorities
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
    memory = scheduling.lock_memory()
    scheduling.leave_no_core()
    policy = scheduling.set_fifo(SERVO)
    slack = scheduling.set_exact_timers()
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


def _governor() -> str:
    try:
        return Path(GOVERNOR).read_text(encoding="utf-8").strip()
    except OSError:
        return ""
