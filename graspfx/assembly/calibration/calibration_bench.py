"""A device on the bench: open and settled, ticks on the wall's clock, small forces, within bounds."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from statistics import median

import numpy as np
from numpy.typing import NDArray

from graspfx.assembly.resolve import Parts
from graspfx.assembly.scene_guards import guards_of
from graspfx.assembly.wiring import Wire
from graspfx.errors import DeviceError
from graspfx.loop.device_exchange import DeviceExchange, DevicePort, Port
from graspfx.loop.parts import DeviceWiring
from graspfx.loop.realtime.lifecycle import opened, settle
from graspfx.loop.realtime.pacing import Clock, Pacer, late_text
from graspfx.loop.realtime.process import Interruption, frozen_memory, signals_end
from graspfx.numeric import SMALLEST

FloatArray = NDArray[np.float64]

FARTHEST = 0.03  # from where a finger was opened: beyond, it is not held by what it should be [m]
FASTEST = 0.5  # [m/s]
WINDOW = 0.02  # of a velocity [s]


@dataclass(frozen=True, eq=False)
class Sample:
    """A tick of the bench.

    Attributes:
        due: its deadline [s].
        start: of its reading, `end` of its writing [s].
        position: of the fingers, (k, d) [m].
        is_fresh: whether the reading brought a new sample.
    """

    due: float
    start: float
    end: float
    position: FloatArray
    is_fresh: bool


class Bench:
    """One device, at zero force unless a tick says otherwise, in its own axes.

    Args:
        port: of the device, open and at rest.
        exchange: it alone.
        period: between two calls of it [s].
        limits: largest force of each channel [N].
        clock: of the ticks.
        late: periods in a row that may be left out while a force is on.

    Attributes:
        samples: of all ticks so far.
    """

    def __init__(
        self, port: DevicePort, exchange: DeviceExchange, period: float, limits: FloatArray, clock: Clock, late: int
    ) -> None:  # fmt: skip
        self.port, self.period, self.limits, self.clock = port, period, limits, clock
        self._exchange, self._pacer, self._late = exchange, Pacer(period, clock), late
        self.samples: list[Sample] = []
        self.home = port.readings.position.copy()

    @property
    def shape(self) -> tuple[int, int]:
        """Channels and dimensions."""
        k, d = self.home.shape
        return k, d

    def tick(self, channel: int = 0, force: FloatArray | None = None) -> Sample:
        """Read, then write a force (d,) on one channel; all others, and that one without a force, are at zero.

        Raises:
            DeviceError: a fault of the device, a finger that goes too far or too fast, or a force that stood for too
                long because this machine was too late.
            Interruption: a signal.
        """
        exchange, pacer, command = self._exchange, self._pacer, self.port.port.command
        skipped = pacer.wait(lambda: bool(exchange.exits.numbers))
        if exchange.exits.numbers:
            raise Interruption(exchange.exits.cause)
        if command.any() and pacer.row > self._late:  # a pause without a force is none
            raise DeviceError(f"{self.port.name}: {late_text(pacer.row, self.period, self._late)}")
        start = self.clock.now()
        _require(exchange.read(1 + skipped))
        self._stay()
        command[...] = 0.0
        if force is not None:
            size = float(np.linalg.norm(force))
            command[channel] = force * min(1.0, float(self.limits[channel]) / max(size, SMALLEST))
        _require([exchange.write()])
        readings = self.port.readings
        sample = Sample(
            pacer.deadline or start, start, self.clock.now(), readings.position.copy(), readings.is_fresh
        )  # fmt: skip
        self.samples.append(sample)
        return sample

    def rest(self, duration: float) -> list[Sample]:
        """Tick at zero force."""
        return [self.tick() for _ in range(max(1, round(duration / self.period)))]

    @property
    def velocity(self) -> FloatArray:
        """Mean over the last samples, (k, d) [m/s]: a device's own estimate may be taken from two counts."""
        recent = self.samples[-1 - max(1, round(WINDOW / self.period)) :]
        if len(recent) < 2:
            return np.zeros_like(self.home)
        passed = recent[-1].start - recent[0].start
        return np.asarray((recent[-1].position - recent[0].position) / passed)

    def _stay(self) -> None:
        away = float(np.linalg.norm(self.port.readings.position - self.home, axis=1).max())
        if not self.watched:
            return
        if away > FARTHEST:
            raise DeviceError(
                f"{self.port.name} went {1e3 * away:.0f} mm from where it was; let it stand free and level"
            )
        if float(np.abs(self.velocity).max()) > FASTEST:
            raise DeviceError(f"{self.port.name} goes faster than {FASTEST:g} m/s: nothing that it was told to do")

    watched = True  # whether a finger has to stay near home; not while a person moves it

    @property
    def round_trip(self) -> float:
        """Median time of a reading and a writing [s]."""
        return median(each.end - each.start for each in self.samples)

    @property
    def lateness(self) -> tuple[float, float]:
        """Ends of 98 % of the times from a deadline to the end of the writing [s]."""
        low, high = np.percentile([each.end - each.due for each in self.samples], (1.0, 99.0))
        return float(low), float(high)


@contextmanager
def on_bench(parts: Parts, wire: Wire, clock: Clock) -> Iterator[Bench]:
    """Open one device of a scene and settle it; zero force is the last that it is told, whatever happens.

    Raises:
        DeviceError: it does not open or is not at rest.
        KeyboardInterrupt: a signal.
    """
    scene = parts.scene
    period = scene.period * wire.fitting.every
    k, d = wire.device.features.fingers, scene.dimensions
    memory = np.zeros(1 + 3 * k * d)
    arrays = [memory[1 + i * k * d : 1 + (i + 1) * k * d].reshape(k, d) for i in range(3)]
    plain = replace(wire.fitting, frame=None, every=1)
    port = DevicePort(
        Port(0, arrays[0], arrays[1], arrays[2], memory),
        DeviceWiring(wire.device, wire.fingers, plain), scene.finger_names, period, guards_of(parts),
    )  # fmt: skip
    exchange = DeviceExchange([port])
    with frozen_memory(), signals_end() as exits:
        exchange.exits = exits
        with opened(exchange, period):
            settle(exchange, period, clock)
            yield Bench(port, exchange, period, _limits(parts, wire), clock, guards_of(parts).late)


def _limits(parts: Parts, wire: Wire) -> FloatArray:
    """Give the largest force of each channel in the device's own units, (k,) [N]; infinite where nobody tells one."""
    limits = np.full(len(wire.fingers), np.inf)
    if wire.device.features.peak_force is not None:
        limits[:] = wire.device.features.peak_force
    if parts.limits is not None:
        for channel, finger in enumerate(wire.fingers.tolist()):
            if finger >= 0:
                limits[channel] = min(limits[channel], float(parts.limits[finger]) * wire.fitting.scale)
    return limits


def _require(faults: list[str]) -> None:
    for text in faults:
        if text:
            raise DeviceError(text)
