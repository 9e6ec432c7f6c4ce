"""Checks of timing: lateness of a loop, and duration of an exchange with the hardware."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from threading import Thread

import numpy as np

from graspfx.errors import DeviceError, GraspFXError, message
from graspfx.loop.device import LimitedDevice
from graspfx.loop.device_exchange import DeviceExchange, DevicePort, Port
from graspfx.loop.realtime.lifecycle import opened, settle
from graspfx.loop.realtime.pacing import Clock, Lateness, Pacer, WallClock
from graspfx.loop.realtime.process import SERVO
from graspfx.loop.realtime.readings import GUARDS
from graspfx.loop.servo_parts import DeviceWiring
from graspfx.machine.system_checks import Finding
from graspfx.system.scheduling import set_fifo, sleeper

TRIP_DURATION = 1.0  # shortest test [s]
LEAST = 100  # fewest exchanges
TRIP_SHARE = 0.5  # longest exchange at the 99th percentile, as a share of the period
FRESH = 0.95  # smallest share of readings with a new sample


def round_trip_findings(
    stations: Sequence[DeviceWiring], names: Sequence[str], period: float, clock: Clock | None = None
) -> Iterator[Finding]:
    """Open the devices, exchange data at zero force at the period of a run, close the devices, and yield the results.

    Args:
        stations: Connected devices, none of them simulated.
        names: Names of the fingers.
        period: Period of the exchanges [s].
        clock: Clock that gives the time; None for `WallClock`.
    """
    clock = clock or WallClock()
    devices = DeviceExchange([_port(i, each, names, period) for i, each in enumerate(stations)])
    labels = ", ".join(each.name for each in devices.ports)
    trips: list[float] = []
    try:
        with opened(devices, period):
            rest = settle(devices, period, clock)
            first = [each.readings.samples for each in devices.ports]
            count = max(LEAST, math.ceil(TRIP_DURATION / period))
            _exchange(devices, period, clock, count, trips)
            fresh = [each.readings.samples - n for each, n in zip(devices.ports, first, strict=True)]
    except GraspFXError as error:
        yield Finding(labels, message(error), "correct this, and run the check again")
        return
    yield Finding(labels, f"stationary at zero force; a round trip takes {1e6 * rest.round_trip:.0f} us")
    middle, most = (float(np.percentile(trips, share)) for share in (50.0, 99.0))
    text = f"p50 {1e6 * middle:.0f} us, p99 {1e6 * most:.0f} us, max {1e6 * max(trips):.0f} us"
    slow = most > TRIP_SHARE * period
    remedy = f"use a period of {1e3 * most / TRIP_SHARE:.1f} ms or more, or a faster connection" if slow else ""
    yield Finding("round trip", f"{text}, at a period of {1e3 * period:g} ms", remedy)
    for each, samples in zip(devices.ports, fresh, strict=True):
        part = samples * each.fitting.every / count
        few = part < FRESH
        remedy = "use a longer period, or set `rate` in the device's table" if few else ""
        yield Finding(f"samples of {each.name}", f"{min(part, 1.0):.1%} of the readings were new", remedy)


def _exchange(devices: DeviceExchange, period: float, clock: Clock, count: int, trips: list[float]) -> None:
    """Read and write `count` times at zero force; append the duration of each exchange [s] to `trips`."""
    pacer = Pacer(period, clock)
    for _ in range(count):
        skipped = pacer.wait()
        began = clock.now()
        faults = [*devices.read(1 + skipped), devices.write()]
        trips.append(clock.now() - began)
        text = next((each for each in faults if each), "")
        if text:
            raise DeviceError(text)


def _port(i: int, station: DeviceWiring, names: Sequence[str], period: float) -> DevicePort:
    """Return the port of device i with newly allocated memory, as in a run; its forces are zero."""
    features = station.device.features
    shape = features.fingers, features.dimensions
    size = shape[0] * shape[1]
    memory = np.zeros(1 + 3 * size + shape[0])
    position, velocity, command = memory[1 : 1 + 3 * size].reshape(3, *shape)
    limit = memory[1 + 3 * size :] if isinstance(station.device, LimitedDevice) else None
    return DevicePort(Port(i, position, velocity, command, memory, limit), station, names, period, GUARDS)


WAKE_DURATION = 3.0  # of both loops together [s]
TURNS = 3  # turns of each loop, alternating, so that both run under the same conditions
MISSED = 1e-3  # largest number of skipped periods per tick
MUCH, LITTLE = 3.0, 100e-6  # the pacer's 99th percentile may be this factor of the bare loop's, plus this [s]

REMEDY = (
    "close other programs; prevent the processors from sleeping (governor performance, no deep sleep states); "
    "boot a PREEMPT_RT kernel; or use a longer period"
)


class Jitter:
    """Lateness of two loops that only wait for the next tick, at the real-time priority of a servo.

    Args:
        period: Period of the ticks [s].
        duration: Sum of the durations of both loops [s].

    Attributes:
        pacer: Lateness of a loop that waits by the pacer of a run.
        bare: Lateness of a loop that waits by nanosleep until absolute times.
        missed, bare_missed: Numbers of periods that the two loops skipped.
        ticks: Number of ticks of each loop.
    """

    def __init__(self, period: float, duration: float = WAKE_DURATION) -> None:
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
        """Yield results: skipped periods of the pacer, and the 99th percentiles of both loops' lateness compared."""
        ours, bare = self.pacer.figures, self.bare.figures
        text = f"{_figures_text(ours)}; {self.missed} of {self.ticks} ticks of {1e3 * self.period:g} ms skipped"
        bad = self.missed > MISSED * self.ticks
        yield Finding("jitter of the loop", text, REMEDY if bad else "")
        worse = ours["p99"] > MUCH * bare["p99"] + LITTLE and not bad
        remedy = "report this as a bug of GraspFX: the pacer is later than this computer requires" if worse else ""
        yield Finding("jitter of a bare loop", f"{_figures_text(bare)}; {self.bare_missed} skipped", remedy)


def _figures_text(figures: object) -> str:
    values = figures if isinstance(figures, dict) else {}
    return ", ".join(f"{name} {1e6 * value:.0f} us" for name, value in values.items())
