"""The servo: read, couple, record, write, move; once per tick."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from graspfx.coupling.approach import LOST
from graspfx.coupling.grasped import GraspedObject, fault_text
from graspfx.errors import DeviceError, GraspFXError
from graspfx.loop.device import Device, SimulatedDevice
from graspfx.loop.layout import Layout
from graspfx.loop.observer import BY_MODE, OF_OBJECT, Observer
from graspfx.loop.plant import Hand, Plant
from graspfx.loop.record import Recorder

FloatArray = NDArray[np.float64]
Index = NDArray[np.intp]

READ = ("finger_position", "finger_velocity")
COMPUTED = ("contact_position", "finger_force", "finger_moment", "touching", "status", "gap")
OBJECT = ("position", "velocity", "orientation", "angular_velocity", "law", "residual", "wrench")


class Body(Protocol):
    """What moves one object, or a world of several: states and wrenches are in the objects' blocks."""

    def step(self, T: float) -> None: ...

    def free_motion(self, T: float) -> None: ...


@dataclass(frozen=True)
class Held:
    """An object and the numbers of the fingers that are assigned to it."""

    name: str
    grasped: GraspedObject
    fingers: Index


@dataclass(frozen=True)
class Mover:
    """A body, or a world of bodies that meet one another, and the numbers of the objects that it moves."""

    body: Body
    objects: Sequence[int]


@dataclass(frozen=True)
class Station:
    """A device and the finger that each of its channels is (-1: a channel that the scene does not use)."""

    device: Device
    fingers: Index


@dataclass(frozen=True)
class Moved:
    """A plant, the hand that holds it, the devices whose efforts drive it and the fingers that it moves."""

    plant: Plant
    hand: Hand
    devices: Sequence[SimulatedDevice]
    fingers: Index


class Servo:
    """Runs a scene that has been built, tick by tick.

    A motion that is not finite, a device, body or plant that raises one of our errors, or a projection that does not
    settle latches a fault: from that tick on every force is zero, and what had been computed in it is not displayed.

    Everything that is recorded lives in one row, so that recording is one copy.
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
    ) -> None:
        self.ticks = 0  # time is ticks x period, never a reading of the wall: two runs are bit-identical
        self.period, self.layout = period, layout
        self.stations, self.objects, self.movers, self.moved = stations, objects, movers, moved
        self.observers = observers  # one for each object, or none at all
        self.faulted = False
        self._stuck: set[int] = set()  # movers, then plants, that could not go on
        self._mover_of = {i: number for number, mover in enumerate(movers) for i in mover.objects}
        self.row = np.zeros(layout.width)
        self.position = self._view("finger_position")
        self.velocity = self._view("finger_velocity")
        self.force = self._view("finger_force")  # on the objects; the devices display its negative
        self._energy = self._view("device_energy")
        self._place = self._view("true_position") if layout.simulated else self.position
        self._before = np.zeros_like(self.position)
        self._displayed = np.zeros_like(self.position)
        self._commands = [np.zeros((len(s.fingers), layout.dimensions)) for s in stations]
        self._used = [s.fingers >= 0 for s in stations]
        self._efforts = [np.concatenate([d.effort for d in m.devices]) for m in moved]
        self._into = [self._pairs(held, READ) for held in objects]
        self._out_of = [self._pairs(held, COMPUTED, OBJECT) for held in objects]
        self._booked = [self._accounts(held, each) for held, each in zip(objects, observers, strict=False)]
        self._predicted = [mover.body for mover in movers if any(objects[i].grasped.implicit for i in mover.objects)]

    @property
    def fade_shortfall(self) -> float:
        """By how much free fingers began to fade too near the surface, at most so far [m]."""
        return max(held.grasped.shortfall for held in self.objects)

    def run(self, ticks: int, recorder: Recorder, stop: Callable[[], bool] | None = None) -> None:
        """That many ticks, each recorded; fewer if `stop`, asked before each, says so."""
        for _ in range(ticks):
            if stop is not None and stop():
                break
            self.tick(recorder)
            recorder.drain()
        for held in self.objects:
            held.grasped.check_activity()

    def tick(self, recorder: Recorder) -> None:
        """One sample."""
        k = self.ticks
        self._read(k, recorder)
        self._couple(k, recorder)
        self._display(k, recorder)
        recorder.row(k)[:] = self.row
        self._move(k, recorder)
        self.ticks += 1

    def _view(self, column: str) -> FloatArray:
        found = self.layout.columns[column]
        return self.row[found.where].reshape(found.shape)

    def _pairs(self, held: Held, per_finger: Sequence[str], of_object: Sequence[str] = ()) -> tuple[Index, Index]:
        """Entries of the row and the entries of the object's block that hold the same."""

        def each() -> Iterator[tuple[Index, Index]]:
            numbers = np.arange(self.layout.width)
            columns, where = self.layout.columns, held.grasped.where
            for name in per_finger:
                if name in columns:
                    yield numbers[columns[name].where].reshape(columns[name].shape)[held.fingers], where[name]
            for name in of_object:
                found = columns.get(f"objects/{held.name}/{name}")
                if found is not None:
                    yield numbers[found.where], where[name]

        pairs = list(each())
        return np.concatenate([a.ravel() for a, _ in pairs]), np.concatenate([b.ravel() for _, b in pairs])

    def _accounts(self, held: Held, observer: Observer) -> tuple[Index, Index]:
        """Entries of the row and the entries of an observer's buffer that hold the same."""
        numbers, columns = np.arange(self.layout.width), self.layout.columns
        found = {name: columns.get(f"objects/{held.name}/energy/{name}") for name in (*BY_MODE, *OF_OBJECT)}
        pairs = [(numbers[column.where], observer.where[name]) for name, column in found.items() if column is not None]
        return np.concatenate([a for a, _ in pairs]), np.concatenate([b for _, b in pairs])

    def _read(self, k: int, recorder: Recorder) -> None:
        for station, used in zip(self.stations, self._used, strict=True):
            try:
                position, velocity, _ = station.device.read()
            except DeviceError as error:
                self._fault(k, recorder, str(error))
                continue
            fingers = station.fingers[used]
            self.position[fingers] = position[used]
            self.velocity[fingers] = velocity[used]
        if self.layout.simulated:
            for m in self.moved:
                self._place[m.fingers] = m.plant.position

    def _couple(self, k: int, recorder: Recorder) -> None:
        """Forces and wrenches, all zero from a fault on; the work of the last sample's forces."""
        for body in self._predicted:
            body.free_motion(self.period)
        for i, (held, (row, block)) in enumerate(zip(self.objects, self._into, strict=True)):
            g = held.grasped
            g.block[block] = self.row[row]
            if not self.faulted:
                code = g.sample()
                if code:
                    self._fault(k, recorder, fault_text(code, [self.layout.fingers[f] for f in held.fingers]))
                if code == LOST:
                    self._stuck.add(self._mover_of[i])
                if self.observers and not self.faulted:
                    self.observers[i].sample()
        if k and not self.faulted:
            self._energy += (self._displayed * (self._place - self._before)).sum(axis=1)
        self._before[:] = self._place
        self._gather()

    def _gather(self) -> None:
        """What was computed into the row; zero forces from a fault on."""
        for held, (row, block) in zip(self.objects, self._out_of, strict=True):
            if self.faulted:
                held.grasped.let_go()
            self.row[row] = held.grasped.block[block]
        for observer, (row, buffer) in zip(self.observers, self._booked, strict=True):
            self.row[row] = observer.buffer[buffer]

    def _display(self, k: int, recorder: Recorder) -> None:
        np.negative(self.force, out=self._displayed)
        for station, used, command in zip(self.stations, self._used, self._commands, strict=True):
            command[used] = self._displayed[station.fingers[used]]
            try:
                station.device.write(command)
            except DeviceError as error:
                self._fault(k, recorder, str(error))
        if self.faulted:
            self._gather()
            self._displayed[:] = 0.0
            for station in self.stations:
                with suppress(DeviceError):  # one that is gone cannot be stopped, and the others must be
                    station.device.stop()

    def _move(self, k: int, recorder: Recorder) -> None:
        """Bodies and plants to the end of the sample; one that cannot go on stays where it is."""
        for i, mover in enumerate(self.movers):
            if i not in self._stuck:
                try:
                    mover.body.step(self.period)
                except GraspFXError as error:
                    self._stuck.add(i)
                    names = ", ".join(self.objects[number].name for number in mover.objects)
                    self._fault(k, recorder, f"{names}: {error}")
        for i, (m, effort) in enumerate(zip(self.moved, self._efforts, strict=True), len(self.movers)):
            if i not in self._stuck:
                first = 0
                for device in m.devices:
                    now = device.effort
                    effort[first : first + len(now)] = now
                    first += len(now)
                try:
                    m.plant.advance(effort, m.hand, self.period)
                except GraspFXError as error:
                    self._stuck.add(i)
                    names = ", ".join(self.layout.fingers[f] for f in m.fingers)
                    self._fault(k, recorder, f"{names}: {error}")

    def _fault(self, k: int, recorder: Recorder, message: str) -> None:
        if not self.faulted:
            self.faulted = True
            recorder.fault(k, message)
