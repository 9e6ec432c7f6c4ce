"""How late a loop wakes up on this machine: the pacer of a run beside a bare loop of nanosleep."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from threading import Thread

from graspfx.loop.realtime.pacing import Lateness, Pacer
from graspfx.loop.realtime.process import SERVO
from graspfx.machine.finding import Finding
from graspfx.system.exact_sleep import sleeper
from graspfx.system.scheduling import set_fifo

DURATION = 3.0  # of both loops together [s]
TURNS = 3  # of each, one after the other, so that both meet the same machine
MISSED = 1e-3  # of the ticks that may be later than a period
MUCH, LITTLE = 3.0, 100e-6  # how much later the pacer may be at the 99th percentile, times and besides [s]

REMEDY = (
    "close other programs, keep processors awake (governor performance, no deep sleep), boot with PREEMPT_RT; "
    "a longer period needs less"
)


class Jitter:
    """Lateness of two loops that do nothing but wait, at the priority of a servo.

    Args:
        period: of their ticks [s].
        duration: of both together [s].

    Attributes:
        pacer, bare: lateness of a run's pacer, and of nanosleep to an absolute time alone.
        missed, bare_missed: periods left out of those.
        ticks: of each.
    """

    def __init__(self, period: float, duration: float = DURATION) -> None:
        self.period = period
        self.pacer, self.bare = Lateness(), Lateness()
        self.missed = self.bare_missed = 0
        count = max(2, round(0.5 * duration / TURNS / period))
        self.ticks = TURNS * count
        thread = Thread(target=self._measure, args=(count,))
        thread.start()
        thread.join()

    def _measure(self, count: int) -> None:
        set_fifo(SERVO)
        sleep = sleeper()
        for _ in range(TURNS):
            self._run_pacer(count)
            self._run_bare(count, sleep)

    def _run_pacer(self, count: int) -> None:
        pacer = Pacer(self.period)
        pacer.wait()
        for _ in range(count):
            self.missed += pacer.wait()
            self.pacer.add(pacer.late + pacer.left_out * self.period)

    def _run_bare(self, count: int, sleep: Callable[[int], None]) -> None:
        step = round(1e9 * self.period)
        deadline = time.monotonic_ns()
        for _ in range(count):
            deadline += step
            sleep(deadline)
            late = time.monotonic_ns() - deadline
            self.bare.add(1e-9 * late)
            self.bare_missed += late // step
            deadline += late // step * step

    def findings(self) -> Iterator[Finding]:
        """Judge both: a machine that misses ticks, and a pacer that does so more than it would have to."""
        ours, bare = self.pacer.figures, self.bare.figures
        text = f"{_figures_text(ours)}; {self.missed} of {self.ticks} ticks of {1e3 * self.period:g} ms left out"
        bad = self.missed > MISSED * self.ticks
        yield Finding("jitter of the loop", text, REMEDY if bad else "")
        worse = ours["p99"] > MUCH * bare["p99"] + LITTLE and not bad
        remedy = "report it: the machine could do better than the loop does" if worse else ""
        yield Finding("jitter of a bare loop", f"{_figures_text(bare)}; {self.bare_missed} left out", remedy)


def _figures_text(figures: object) -> str:
    values = figures if isinstance(figures, dict) else {}
    return ", ".join(f"{name} {1e6 * value:.0f} us" for name, value in values.items())
