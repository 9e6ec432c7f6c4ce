"""Services of the operating system for hardware: signals that end a run with zero force, priority and locked memory."""

from __future__ import annotations

import gc
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import Any

from graspfx.system import scheduling

NAMES = ("SIGINT", "SIGTERM", "SIGHUP")  # signals that end a run, where the system has them
SERVO, GUARD = 80, 79  # real-time priorities of the servo and of its guard
SWITCH = 1e-4  # switch interval of Python's threads [s]
GOVERNOR = "/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor"
REMEDY = (
    "the servo runs without real-time priority and may be delayed by other programs: add '@realtime - rtprio 80' and "
    "'@realtime - memlock unlimited' to /etc/security/limits.d/graspfx.conf, and your user to the group realtime"
)


class Interruption(BaseException):
    """Immediate end of a run by a signal, without decay of forces; a driver's call in progress is interrupted."""


class Exits:
    """Signals that ask a run to end, in the order of arrival.

    Between calls of drivers a signal is only recorded, and forces decay in the following ticks. A driver's call may
    block for long, so an exception interrupts it.

    Attributes:
        inside: Whether a driver's call is in progress.
        heed: Function called at once with the number of each signal, or None.
        at_once: Whether forces must be zero at once, because a signal interrupted a driver's call or a second signal
            arrived.
    """

    def __init__(self) -> None:
        self.inside = self.at_once = False
        self.numbers: list[int] = []
        self.heed: Callable[[int], object] | None = None

    @property
    def cause(self) -> str:
        """Name of the first signal; empty if none has arrived."""
        return signal.Signals(self.numbers[0]).name if self.numbers else ""

    def ask(self, number: int, frame: FrameType | None) -> None:
        """Handle a signal: record it, and interrupt a driver's call that is in progress."""
        self.numbers.append(number)
        if self.heed is not None:
            self.heed(number)
        self.at_once = self.at_once or self.inside or len(self.numbers) > 1
        if self.inside:
            raise Interruption(signal.Signals(number).name)


@contextmanager
def signals_end() -> Iterator[Exits]:
    """Let signals end the block in an orderly way, and pass them on to their previous handlers afterwards.

    Python calls handlers in the main thread only, so a block in another thread receives no signals. Ignored signals
    remain ignored.

    Raises:
        KeyboardInterrupt: If a signal interrupted the block, and its previous handler let the process continue.
    """
    exits, handlers = Exits(), {}
    if threading.current_thread() is threading.main_thread():
        for name in NAMES:
            number = getattr(signal, name, None)
            if number is not None and signal.getsignal(number) not in (signal.SIG_IGN, None):
                handlers[number] = signal.signal(number, exits.ask)
    interrupted = False
    try:
        yield exits
    except Interruption:
        interrupted = True
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)
        for number in dict.fromkeys(exits.numbers):
            signal.raise_signal(number)
    if interrupted:
        raise KeyboardInterrupt


# Priority and memory --------------------------------------------------------------------------------------------------


class RealTimeWarning(UserWarning):
    """Warning that the system does not grant real-time priority or locked memory."""


def take_priority() -> dict[str, Any]:
    """Request real-time priority and locked memory for this thread and process; return what the system granted.

    Garbage collection is disabled from then on. The entries are `policy`, `memory`, `slack` [s] if the system grants
    exact timers, and the processor's `governor` if it is known.
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


@contextmanager
def frozen_memory() -> Iterator[None]:
    """Exclude all present objects from garbage collection, which would take tens of ms for them.

    Present garbage is collected after the block, because a collection before the loop would take as long.
    """
    gc.freeze()
    try:
        yield
    finally:
        gc.unfreeze()
