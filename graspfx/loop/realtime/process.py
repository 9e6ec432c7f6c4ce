"""What a process with hardware asks of its system: signals that end it with zero force, priority and still memory."""

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

NAMES = ("SIGINT", "SIGTERM", "SIGHUP")  # those that a system has
SERVO, GUARD = 80, 79  # real-time priorities
SWITCH = 1e-4  # after which Python's threads change [s]
GOVERNOR = "/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor"
REMEDY = (
    "the servo runs without real-time priority, and other programs make it late: add '@realtime - rtprio 80' and "
    "'@realtime - memlock unlimited' to /etc/security/limits.d/graspfx.conf, and yourself to the group realtime"
)


class Interruption(BaseException):
    """A signal that came while a driver had the thread: the driver's call is broken off."""


class Exits:
    """Signals that ask a run to end, in the order in which they came.

    Between the calls of drivers a signal is only noted: forces decay in the ticks that follow. A driver that has the
    thread may wait for long, and is broken off by an exception.

    Attributes:
        inside: whether a driver has the thread.
        heed: called with the number of each signal, at once; None for nobody.
        at_once: whether no force may come any more: a driver had the thread, or it is the second signal.
    """

    def __init__(self) -> None:
        self.inside = self.at_once = False
        self.numbers: list[int] = []
        self.heed: Callable[[int], object] | None = None

    @property
    def cause(self) -> str:
        """The first signal by its name; empty as long as there is none."""
        return signal.Signals(self.numbers[0]).name if self.numbers else ""

    def ask(self, number: int, frame: FrameType | None) -> None:
        """Note a signal, as its handler."""
        self.numbers.append(number)
        if self.heed is not None:
            self.heed(number)
        self.at_once = self.at_once or self.inside or len(self.numbers) > 1
        if self.inside:
            raise Interruption(signal.Signals(number).name)


@contextmanager
def signals_end() -> Iterator[Exits]:
    """Let signals end the block in good order, and pass them on to their own handlers when it is over.

    Only in the main thread, where Python calls handlers; signals that are ignored stay so.

    Raises:
        KeyboardInterrupt: a signal broke off what stands in the block, and its own handler let the process go on.
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


@contextmanager
def frozen_memory() -> Iterator[None]:
    """Keep the collector of cycles from all objects that there are now: to look through them takes tens of ms."""
    gc.collect()
    gc.freeze()
    try:
        yield
    finally:
        gc.unfreeze()
