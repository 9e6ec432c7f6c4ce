"""The servo: runs the tick of a scene, as many at a time as what is no kernel allows."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspfx.coupling.grasped import fault_text
from graspfx.errors import DeviceError, GraspFXError
from graspfx.loop import tick as at
from graspfx.loop.device import Device
from graspfx.loop.engine import ENGINES, Engine
from graspfx.loop.layout import Layout
from graspfx.loop.observer import Observer
from graspfx.loop.parts import Held, Moved, Mover, Parts, Station
from graspfx.loop.record import Recorder
from graspfx.loop.tick import Port, Tick

FloatArray = NDArray[np.float64]


class Servo:
    """Runs a scene that has been built.

    A motion that is not finite, a device, body or plant that raises one of our errors, or a projection that does not
    settle latches a fault: from that tick on every force is zero, and what had been computed in it is not displayed.

    Where all parts are kernels any number of ticks is one call; a device, body or plant that is none takes one call a
    tick (two for a device) and its own methods between. The recording is the same, bit by bit.
    """

    def __init__(
        self,
        period: float,
        layout: Layout,
        stations: Sequence[Station],
        objects: Sequence[Held],
        movers: Sequence[Mover],
        moved: Sequence[Moved] = (),
        observers: Sequence[Observer] = (),
        engine: str = "auto",
    ) -> None:
        self.ticks = 0  # time is ticks x period, never a reading of the wall: two runs are bit-identical
        self.period, self.layout = period, layout
        self.stations, self.objects, self.movers, self.moved = stations, objects, movers, moved
        self.observers = observers  # one for each object, or none at all
        self.faulted = False
        self.row = np.zeros(layout.width)  # of the last tick
        self._kind = engine
        self._engine: Engine | None = None  # made at the first tick
        self._told: list[str] = []  # faults of parts that are no kernels
        self._mover_of = {i: number for number, mover in enumerate(movers) for i in mover.objects}

    @property
    def fade_shortfall(self) -> float:
        """By how much free fingers began to fade too near the surface, at most so far [m]."""
        return max(held.grasped.shortfall for held in self.objects)

    @property
    def parts(self) -> Parts:
        """All that runs."""
        return Parts(self.period, self.layout, self.stations, self.objects, self.movers, self.moved, self.observers)

    @property
    def script(self) -> Tick:
        """The tick as it runs."""
        self._ready()
        return self._tick

    def run(self, ticks: int, recorder: Recorder, stop: Callable[[], bool] | None = None) -> None:
        """That many ticks, each recorded; fewer if `stop`, asked before each, says so."""
        engine = self._ready()
        engine.expect(ticks)
        single = stop is not None or bool(self._tick.ports or self._tick.bodies or self._tick.plants)
        last = self.ticks + ticks
        while self.ticks < last:
            rows, row, left = recorder.space()
            engine.write_to(rows)
            count = min(left, last - self.ticks, at.CHUNK)
            if single:
                for r in range(row, row + count):
                    if stop is not None and stop():
                        return
                    self._one(engine, recorder, r)
            else:
                self._look_ahead(count)
                engine.run(self.ticks, count, row)
                self.ticks += count
                recorder.take(count)
                self._notice(recorder)
            self.row = rows[recorder.used - 1]
            recorder.drain()
        for held in self.objects:
            held.grasped.check_activity()

    def tick(self, recorder: Recorder) -> None:
        """One sample."""
        self.run(1, recorder)

    def _ready(self) -> Engine:
        if self._engine is None:
            self._tick = at.write(self.parts)
            self._own: Any = memoryview(self._tick.own)
            self._engine = ENGINES[self._kind](self._tick)
        return self._engine

    def _one(self, engine: Engine, recorder: Recorder, row: int) -> None:
        """One tick with whatever is no kernel."""
        tick, k = self._tick, self.ticks
        self._look_ahead(1)
        for i in tick.bodies:
            if any(self.objects[o].grasped.implicit for o in self.movers[i].objects):
                self.movers[i].body.free_motion(self.period)
        if tick.ports:
            for port in tick.ports:
                self._read(k, port)
            engine.begin(k)
            for port in tick.ports:
                self._display(k, port)
            engine.end(k, row)
        else:
            engine.run(k, 1, row)
        for i in tick.bodies:
            self._step(k, i)
        for j in tick.plants:
            self._advance(k, j)
        self.ticks += 1
        recorder.take(1)
        self._notice(recorder)

    # What is no kernel --------------------------------------------------------------------------------------------

    def _read(self, k: int, port: Port) -> None:
        port.memory[0] = 0.0
        try:
            position, velocity, _ = self.stations[port.station].device.read()
        except DeviceError as error:
            self._tell(k, str(error))
            return
        port.position[...], port.velocity[...] = position, velocity
        port.memory[0] = 1.0

    def _display(self, k: int, port: Port) -> None:
        device: Device = self.stations[port.station].device
        try:
            device.write(port.command)
        except DeviceError as error:
            self._tell(k, str(error))
        if self._own[at.FAULTED]:
            for each in self._tick.ports:
                with suppress(DeviceError):  # one that is gone cannot be stopped, and the others must be
                    self.stations[each.station].device.stop()

    def _step(self, k: int, i: int) -> None:
        """A body to the end of the sample; one that cannot go on stays where it is."""
        if not self._own[at.STUCK + i]:
            try:
                self.movers[i].body.step(self.period)
            except GraspFXError as error:
                self._own[at.STUCK + i] = 1.0
                self._tell(k, f"{self._objects(i)}: {error}")

    def _advance(self, k: int, j: int) -> None:
        stuck, m = at.STUCK + len(self.movers) + j, self.moved[j]
        if not self._own[stuck]:
            try:
                m.plant.advance(np.concatenate([d.effort for d in m.devices]), m.hand, self.period)
            except GraspFXError as error:
                self._own[stuck] = 1.0
                self._tell(k, f"{self._fingers(j)}: {error}")

    def _look_ahead(self, count: int) -> None:
        """Asks hands that are no kernels where they mean to be over the coming ticks."""
        T, k = self.period, self.ticks
        for table in self._tick.tables:
            m = self.moved[table.moved]
            each = table.memory.reshape(at.CHUNK, -1, *m.plant.position.shape)
            for i in range(count):
                each[i, 0], each[i, 1] = m.hand.target((k + i + 1) * T)
                if table.middle:
                    each[i, 2], each[i, 3] = m.hand.target(0.5 * ((k + i) * T + (k + i + 1) * T))

    # Faults -------------------------------------------------------------------------------------------------------

    def _tell(self, k: int, message: str) -> None:
        self._told.append(message)
        at.latch(self._own, k, at.TOLD, 0, len(self._told) - 1)

    def _notice(self, recorder: Recorder) -> None:
        if not self.faulted and self._own[at.FAULTED]:
            self.faulted = True
            recorder.fault(int(self._own[at.TICK]), self.why(self._own))

    def why(self, own: Any) -> str:
        """The fault that is latched in the memory of a tick, `Tick.own`, in words."""
        kind, index, code = (int(own[entry]) for entry in (at.KIND, at.INDEX, at.CODE))
        if kind == at.TOLD:
            return self._told[code]
        if kind == at.STATION:
            return self.stations[index].device.fault_text(code)  # type: ignore[attr-defined,no-any-return]
        if kind == at.OBJECT_:
            return fault_text(code, [self.layout.fingers[f] for f in self.objects[index].fingers])
        if kind == at.MOVER:
            return f"{self._objects(index)}: {self.movers[index].body.fault_text(code)}"
        return f"{self._fingers(index)}: {self.moved[index].plant.fault_text(code)}"  # type: ignore[attr-defined]

    def _objects(self, mover: int) -> str:
        return ", ".join(self.objects[number].name for number in self.movers[mover].objects)

    def _fingers(self, moved: int) -> str:
        return ", ".join(self.layout.fingers[f] for f in self.moved[moved].fingers)
