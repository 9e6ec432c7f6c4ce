"""The device protocol: what a driver tells, reads and writes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import wraps
from typing import NamedTuple, Protocol, Self, TypeVar, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from graspfx import log
from graspfx.card import Card, Carded, counted, listed
from graspfx.errors import InputError
from graspfx.loop.operator import Operator
from graspfx.loop.plant import Kernel, Plant, unaltered

FloatArray = NDArray[np.float64]
Index = NDArray[np.intp]
T = TypeVar("T")

UNITS = {
    "continuous_force": "N",
    "peak_force": "N",
    "stiffness": "N/m",
    "damping": "N s/m",
    "mass": "kg",
    "friction": "N s/m",
    "resolution": "m",
    "delay": "samples",
    "watchdog": "s",
    "rate": "Hz",
    "latency": "s",
    "lateness": "s",
}
METHODS = ("open", "read", "write", "stop", "close")  # of every device


@dataclass(frozen=True, repr=False)
class Features(Carded):
    """The features of a device, known before it is opened. An unknown one is None, never zero."""

    fingers: int  # k, the number of channels
    dimensions: int  # d
    workspace: tuple[FloatArray, FloatArray] | None = None  # lower, upper corner, (d,) each [m]
    continuous_force: float | None = None  # [N]; 0: it displays no force
    peak_force: float | None = None  # largest at a fingertip in every direction [N]; unless `LimitedDevice` says more
    stiffness: float | None = None  # largest stiffness it displays stably at its rate [N/m]
    damping: float | None = None  # largest virtual damping at its rate [N s/m]
    mass: float | None = None  # effective mass at a fingertip [kg]
    friction: float | None = None  # effective viscous damping at a fingertip, `damping` of a scene [N s/m]
    resolution: float | None = None  # of a fingertip position [m]
    delay: int | None = None  # output delay [samples]
    watchdog: float | None = None  # after the last `write`, hardware drops its force [s]; None: never
    rate: float | None = None  # most exchanges of reading and writing in a second [Hz]
    latency: float | None = None  # age of a sample when `read` returns it [s]
    lateness: float | None = None  # from a tick's reading to its force besides `delay` samples, any time [s]
    switches: int = 0  # count of switches, whose state a `SwitchedDevice` tells

    def _card(self) -> Card:
        figures = {name: getattr(self, name) for name in UNITS}
        rows = [
            ("workspace", "" if self.workspace is None else " to ".join(str(each) for each in self.workspace) + " m"),
            *((name, f"{value:g} {UNITS[name]}") for name, value in figures.items() if value is not None),
            *([("switches", str(self.switches))] if self.switches else []),
            ("not known", listed((name for name, value in figures.items() if value is None), len(figures))),
        ]
        space = counted(self.dimensions, "dimension")
        return Card(f"Features of a device: {counted(self.fingers, 'finger')} in {space}", rows)


class Device(Protocol):
    """One piece of hardware, or its simulation, that moves `features.fingers` fingertips.

    A driver is a module with `connect(**settings) -> Device`. To connect has no effect: hardware is not touched before
    `open`, since checking a scene connects every device of it, for its features and for what is wrong with its
    settings (an InputError by the setting's name). `read` and `write` neither wait nor allocate more
    than they must; the arrays that `read` returns belong to the device and are overwritten by the next `read`.

    A device that answers requests may offer `ask` too (`AskedDevice`); a driver whose hardware keeps its force when
    nobody writes any more offers `quench` (`QuenchableDriver`).
    """

    @property
    def features(self) -> Features:
        """Figures that the device tells of itself."""

    def open(self, period: float) -> None:
        """Make ready for one `read` and one `write` every `period` seconds."""

    def read(self) -> tuple[FloatArray, FloatArray, float]:
        """Read positions (k, d) [m], velocities (k, d) [m/s] and the time [s] at which they were taken.

        A time that is that of the reading before says that there is no new sample: it is the last one again, which is
        no error. Hardware that is gone is a DeviceError. A failed reading is never a position of zero.
        """
        ...

    def write(self, forces: FloatArray) -> None:
        """Display forces (k, d) [N] to the operator until the next `write`.

        The device's own limit is applied here, last: forces that keep within `features.peak_force`, or within the
        `largest_force` that was read, are displayed as they are, and what is cut off here nobody else knows of. A
        force that is not finite is displayed as zero and raises DeviceError.
        """

    def stop(self) -> None:
        """Display zero force, now."""

    def close(self) -> None:
        """Display zero force and close the hardware; returns also with the hardware gone, and twice."""

    def __enter__(self) -> Self: ...

    def __exit__(self, *exc: object) -> None: ...


def lacking(device: object) -> list[str]:
    """List the methods of a `Device` that an object lacks; `with` looks for its two on the class."""
    missing = [name for name in METHODS if not callable(getattr(device, name, None))]
    return missing + [name for name in ("__enter__", "__exit__") if not hasattr(type(device), name)]


@runtime_checkable
class AskedDevice(Protocol):
    """A device that answers requests: all are asked before the first is read, so that n round trips cost one."""

    def ask(self) -> None:
        """Send the request that the next `read` takes the answer of; `read` without it asks by itself.

        DeviceError if the hardware is gone.
        """


@runtime_checkable
class QuenchableDriver(Protocol):
    """A driver that can take the force from hardware whose program has died.

    A driver whose hardware has no watchdog (`features.watchdog` is None) must have it.
    """

    def quench(self, **settings: object) -> None:
        """Reach the hardware afresh, set its force to zero and let go of it.

        It is called in another process than the one that opened the device, once that one is gone.

        Args:
            settings: those of `connect`.

        Raises:
            DeviceError: the hardware cannot be reached, so that its force may still be there.
        """


@runtime_checkable
class LimitedDevice(Protocol):
    """A device whose largest force depends on where it stands."""

    @property
    def largest_force(self) -> FloatArray:
        """Largest force that each fingertip can display in every direction at the last reading, (k,), above zero [N].

        Of a `FusedDevice` it is a piece of its block, which `reading` keeps up to date.
        """
        ...


@runtime_checkable
class RangedDevice(Protocol):
    """A device whose fingers reach less than the box of `features.workspace`."""

    def nearest(self, finger: int, place: FloatArray, room: float) -> FloatArray:
        """Give the place (d,) nearest to another one that a finger reaches, `room` inside the end of its reach [m]."""
        ...


@runtime_checkable
class SwitchedDevice(Protocol):
    """A device with switches: buttons, pedals, a switch that its user's hand closes."""

    @property
    def switches(self) -> int:
        """Switches at the last reading as bits: bit i is 1 while switch i of `features.switches` is closed."""
        ...


@runtime_checkable
class RawDevice(Protocol):
    """A device that shows what came over the wire, such as counts of encoders: a recording keeps it."""

    @property
    def raw(self) -> NDArray[np.int64] | NDArray[np.float64]:
        """Raw numbers of the last reading, (m,), m at least 1: the same array for the device's life.

        Whole numbers are recorded exactly up to 2^53.
        """
        ...


@runtime_checkable
class SimulatedDevice(Protocol):
    """A simulated device: it shows its effort, so that a plant can move it."""

    @property
    def effort(self) -> FloatArray:
        """Effort that its actuators hold until the next sample, (k, d): after delay and limit, in the plant's units."""
        ...

    @staticmethod
    def plant(devices: Sequence[Device]) -> Plant:
        """Make the plant that moves all channels of these devices together, in their order."""
        ...


@runtime_checkable
class OperatedDevice(Protocol):
    """A simulated device that an operator may hold who is more than a spring and a damper."""

    @staticmethod
    def operated_plant(devices: Sequence[Device], operator: Operator, period: float) -> Plant:
        """Make the plant of `plant` for a hand with this `operator`, or one whose reactions come no later."""
        ...


def is_hardware(device: object) -> bool:
    """Tell whether a device is no simulation: its clock is the wall's, and a person may hold it."""
    return not isinstance(device, SimulatedDevice)


class DevicePorts(NamedTuple):
    """Where a device's block takes its inputs and shows what comes of them: the first of their entries."""

    sensed: int  # what its sensors see, copied from its plant's block before `reading`
    position: int  # (k, d) [m] after `reading`
    velocity: int  # (k, d) [m/s] after `reading`
    command: int  # (k, d) [N], the forces to display, before `writing`
    effort: int  # (k, d) what the actuators hold after `writing`, in the plant's units


@runtime_checkable
class FusedDevice(SimulatedDevice, Protocol):
    """A simulated device that shows its block and its kernels, so that a run may read and write it without calling it.

    After `open`, and once its plant is made and placed, each sample: its plant's entries `sensed` copied to its block
    at `ports.sensed`, `reading(S, 0)` once, forces written at `ports.command`, `writing(S, 0)`, efforts read at
    `ports.effort`. `read`, `write` and `stop` do nothing else.
    """

    @property
    def state(self) -> FloatArray:
        """S, flat, the same array for the device's life."""
        ...

    @property
    def structure(self) -> Index:
        """Entries of the block, whole numbers, that do not change after `open` and pick what the kernels do."""
        ...

    @property
    def ports(self) -> DevicePorts:
        """Where in the block the caller writes and reads, counted from its beginning."""
        ...

    @property
    def sensed(self) -> Index:
        """Entries of its plant's block that its sensors see, in their order; none before it has a plant."""
        ...

    @property
    def reading(self) -> Kernel:
        """reading(S, o), for the block that starts at S[o], gives 0 or why there is no reading."""
        ...

    @property
    def writing(self) -> Kernel:
        """writing(S, o) gives 0, or why the forces are not displayed: then it has stopped."""
        ...

    @property
    def stopping(self) -> Kernel:
        """stopping(S, o): zero force now, and none on its way."""
        ...

    def fault_text(self, code: int) -> str:
        """Say what a number other than 0 means, by the figures in the block."""
        ...


def limit_port(device: FusedDevice) -> int | None:
    """Find where in its block a device has its largest forces; None for one whose never change.

    Raises:
        InputError: `largest_force` is no piece of the block.
    """
    if not isinstance(device, LimitedDevice):
        return None
    piece, block = device.largest_force, device.state
    start = (piece.ctypes.data - block.ctypes.data) // block.itemsize
    if not (piece.flags.c_contiguous and np.shares_memory(piece, block) and 0 <= start <= block.size - piece.size):
        raise InputError("largest_force", type(device).__qualname__, "a piece of the device's own block, `state`")
    return start


def fused(device: Device) -> FusedDevice | None:
    """Give the device, if its kernels do all that its methods do.

    None for one that lacks them, or whose class has a `read`, `write` or `stop` of its own over the kernels of one it
    is made from.
    """
    if isinstance(device, FusedDevice) and unaltered(
        device, ("read", "write", "stop"), ("reading", "writing", "stopping")
    ):
        return device
    return None


def former_settings(**names: str) -> Callable[[Callable[..., T]], Callable[..., T]]:
    """Let a driver's `connect` take settings under former names too, with a FutureWarning.

    Args:
        names: the name now, by the former one.
    """

    def wrap(connect: Callable[..., T]) -> Callable[..., T]:
        @wraps(connect)
        def call(**settings: object) -> T:
            for former in names.keys() & settings.keys():
                now = names[former]
                if now in settings:
                    raise InputError(former, settings[former], f"{now!r} alone: {former!r} is its former name")
                log.warn(f"{former!r} is called {now!r} now", FutureWarning)
                settings[now] = settings.pop(former)
            return connect(**settings)

        return call

    return wrap
