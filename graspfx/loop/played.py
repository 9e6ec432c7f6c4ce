"""Devices that repeat the readings in a recording and display no forces."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import Any, Literal, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from graspfx.loop.columns import Layout, RunFault
from graspfx.loop.device import Device, Features, LimitedDevice
from graspfx.loop.device_exchange import Port
from graspfx.loop.device_mount import Fitting
from graspfx.loop.safety.trust import DEADMAN
from graspfx.loop.servo_parts import DeviceWiring, PlantWiring

FloatArray = NDArray[np.float64]

ROWS = 4096  # rows of a recording that are read at once
Phase = Literal["read", "write", "after"]  # phase of a tick in which a fault occurred
PHASES: tuple[Phase, ...] = ("write", "read", "after")


class Played(Protocol):
    """Protocol of a source of recorded rows, such as a `Recording`."""

    @property
    def layout(self) -> Layout: ...

    @property
    def faults(self) -> tuple[RunFault, ...]: ...

    def __len__(self) -> int: ...

    def read(self, column: str, first: int, stop: int) -> FloatArray:
        """Return the values of a column in the rows `first`, ..., `stop` - 1."""
        ...


class PlayedDevice:
    """Device that replaces a recorded device and has the same features; `Playback` writes the readings.

    Args:
        features: Features of the recorded device.
        d: Number of dimensions.
    """

    def __init__(self, features: Features, d: int) -> None:
        self.features = features
        self.effort: FloatArray = np.zeros((features.fingers, d))

    @staticmethod
    def plant(devices: Sequence[Device]) -> Any:
        """Raise NotImplementedError, because the motion is read from the recording."""
        raise NotImplementedError

    def open(self, period: float) -> None:
        """Do nothing, because no preparation is needed."""

    def read(self) -> Any:
        """Raise NotImplementedError, because `Playback` writes the readings."""
        raise NotImplementedError

    def write(self, forces: FloatArray) -> None:
        """Do nothing, because there is no hardware."""

    def stop(self) -> None:
        """Do nothing, because there is no hardware."""

    def close(self) -> None:
        """Do nothing, because there is no hardware."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exc: object) -> None: ...


class LimitedPlayedDevice(PlayedDevice):
    """Played device whose largest force depends on its position."""

    def __init__(self, features: Features, d: int) -> None:
        super().__init__(features, d)
        self.largest_force: FloatArray = np.full(features.fingers, np.inf)


class PlayedPlant:
    """Plant whose fingertips are at their recorded positions, independent of forces."""

    def __init__(self, n: int, d: int) -> None:
        self.position: FloatArray = np.zeros((n, d))
        self.velocity: FloatArray = np.zeros((n, d))

    def place(self, position: FloatArray, hand: Any) -> None:
        """Do nothing, because the positions are read from the recording."""

    def advance(self, effort: FloatArray, hand: Any, period: float) -> None:
        """Do nothing, because `Playback` sets the positions of the fingertips."""


class Playback:
    """Exchange that reads the rows of a recording instead of devices, and repeats the first fault in the recording.

    Args:
        recording: Recording in which every tick is recorded.
        largest: Recording that contains the largest forces of devices; None to read these from `recording`, if they
            were recorded.
        phase: Phase of the tick in which the first fault is repeated.
    """

    def __init__(self, recording: Played, largest: Played | None, phase: Phase) -> None:
        self._recording, self._phase = recording, phase
        columns = recording.layout.columns
        names = [name for name in ("fresh", "skipped", "switches", "true_position") if name in columns]
        self._sources: dict[str, Played] = dict.fromkeys(("finger_position", "finger_velocity", *names), recording)
        if "largest_force" in columns or largest is not None:
            self._sources["largest_force"] = largest or recording
        self._fault = recording.faults[0] if recording.faults else None
        self._first, self._rows = 0, dict[str, FloatArray]()
        self._k = -1
        self._ports: list[tuple[Port, NDArray[np.intp], NDArray[np.intp]]] = []
        self._misses, self._deadmen = list[_Misses](), list[int | None]()
        self._tips: FloatArray | None = None

    def wirings(self, wired: Sequence[DeviceWiring]) -> tuple[list[DeviceWiring], list[PlantWiring]]:
        """Replace devices by played devices; return them, and one plant if true fingertip positions are recorded."""
        layout = self._recording.layout
        n, d = len(layout.fingers), layout.dimensions
        stations = [DeviceWiring(_played(each.device, d), each.fingers, _calls(each.fitting)) for each in wired]
        if "true_position" not in self._sources:
            return stations, []
        plant = PlayedPlant(n, d)
        if self._tips is None:  # a servo built later serves only for its numbers and plays nothing
            self._tips = plant.position
        devices: list[Any] = [stations[0].device]
        return stations, [PlantWiring(plant, None, devices, np.arange(n))]  # type: ignore[arg-type]

    def attach(self, ports: Sequence[Port], stations: Sequence[DeviceWiring]) -> None:
        """Set the ports to which readings are written."""
        for port in ports:
            fingers = stations[port.station].fingers
            channels = np.flatnonzero(fingers >= 0)
            fitting = stations[port.station].fitting
            self._ports.append((port, channels, fingers[channels]))
            self._misses.append(_Misses(fitting.every))
            self._deadmen.append(fitting.deadman)

    def read(self, periods: int = 1) -> list[str]:
        """Write the readings of the next tick to the ports; return the recorded fault if it must be repeated now."""
        self._k += 1
        row = self._row(self._k)
        position, velocity = row["finger_position"], row["finger_velocity"]
        fresh, largest, switches = row.get("fresh"), row.get("largest_force"), row.get("switches")
        periods = 1 + int(row.get("skipped", 0))
        for (port, channels, fingers), misses, deadman in zip(self._ports, self._misses, self._deadmen, strict=True):
            port.begin(periods)
            port.position[channels], port.velocity[channels] = position[fingers], velocity[fingers]
            port.memory[0] = 1.0
            if port.limit is not None and largest is not None:
                port.limit[channels] = largest[fingers]
            if port.misses is not None:
                is_fresh = fresh is None or bool(fresh[fingers].any())
                port.misses[0] = misses.count(port.misses[0], periods, is_fresh=is_fresh)
            if deadman is not None and switches is not None and not int(switches[port.station]) >> deadman & 1:
                port.let_go(DEADMAN)
        if self._tips is not None:
            self._tips[...] = row["true_position"]
        return list(self._faults(0 if self._phase == "read" else 1)) if self._phase != "write" else []

    def write(self) -> str:
        """Return the recorded fault if it must be repeated now, otherwise an empty text; no forces are displayed."""
        return next(self._faults(0), "") if self._phase == "write" else ""

    def _faults(self, delay: int) -> Iterator[str]:
        if self._fault is not None and self._fault.tick + delay == self._k:
            yield self._fault.message

    def _row(self, k: int) -> Mapping[str, FloatArray]:
        if not self._rows or k >= self._first + ROWS:
            self._first = k
            stop = min(k + ROWS, len(self._recording))
            self._rows = {name: source.read(name, k, stop) for name, source in self._sources.items()}
        return MappingProxyType({name: rows[k - self._first] for name, rows in self._rows.items()})


class _Misses:
    """Count of successive calls without a new reading, for a device that may be called less often than every tick."""

    def __init__(self, every: int) -> None:
        self._every, self._since = every, 0

    def count(self, misses: float, periods: int, *, is_fresh: bool) -> float:
        """Return the new count in a tick, `periods` sampling periods after the last tick.

        Args:
            misses: Count in the last tick.
            periods: Number of sampling periods since the last tick.
            is_fresh: Whether the reading is new.
        """
        self._since = 0 if is_fresh else self._since + periods
        if is_fresh:
            return 0.0
        if self._since < self._every:
            return misses  # the device was not called
        self._since = 0
        return misses + 1.0


def _calls(fitting: Fitting) -> Fitting:
    """Return a fitting with only deadman switch and call interval; rows are in the scene's axes and need no frame."""
    return Fitting(None, fitting.deadman, fitting.every)


def _played(device: Device, d: int) -> PlayedDevice:
    """Make a played device with the features of another device, and a class with the same name for messages."""
    base = LimitedPlayedDevice if isinstance(device, LimitedDevice) else PlayedDevice
    kind: type[PlayedDevice] = type(type(device).__qualname__, (base,), {})
    return kind(device.features, d)
