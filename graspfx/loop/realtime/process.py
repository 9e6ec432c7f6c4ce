"""Services of the operating system for runs with hardware: signals, real-time priority and locked memory."""

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
    """Exception that ends a run immediately after a signal, without decay of forces; it may interrupt a driver."""


class Exits:
    """Signals that request the end of a run, in the order of arrival.

    If no call of a driver is in progress, a signal is only recorded, and forces decay in the following ticks. A call of
    a driver may take long, and is therefore interrupted by an exception.

    Attributes:
        inside: Whether a call of a driver is in progress.
        heed: Function that is called immediately with the number of each signal; None for no function.
        at_once: Whether forces must be zero immediately, because a signal interrupted a call of a driver or a second
            signal arrived.
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
        """Handle a signal: record it, and raise Interruption if a call of a driver is in progress."""
        self.numbers.append(number)
        if self.heed is not None:
            self.heed(number)
        self.at_once = self.at_once or self.inside or len(self.numbers) > 1
        if self.inside:
            raise Interruption(signal.Signals(number).name)


@contextmanager
def signals_end() -> Iterator[Exits]:
    """Record signals during the block, so that the block can end in an orderly way; then raise the signals again.

    Python calls signal handlers only in the main thread, so a block in another thread receives no signals. Ignored
    signals remain ignored.

    Raises:
        KeyboardInterrupt: If a signal interrupted the block, and the previous handler of the signal did not end the
            process.
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
    """Request real-time priority for this thread and locked memory for this process, and disable garbage collection.

    The result contains what the system granted: `policy`, `memory`, `slack` [s] if exact timers were granted, and the
    frequency `governor` of the processor if it is known.
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
    """Exclude all present objects from garbage collection during the block, because it would take tens of milliseconds.

    Objects that are already unreachable are collected after the block.
    """
    gc.freeze()
    try:
        yield
    finally:
        gc.unfreeze()
