"""Device protocol: features, reading and writing; kernels of simulations, and C functions for loops without Python."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import wraps
from typing import Any, NamedTuple, Protocol, Self, TypeVar, runtime_checkable

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
FRESH, REPEAT = 0, 1  # return values of C functions; less than zero is a fault
METHODS = ("open", "read", "write", "stop", "close")  # methods of every device


@dataclass(frozen=True, repr=False)
class Features(Carded):
    """Features of a device, known before the device is opened. An unknown feature is None, never zero."""

    fingers: int  # k, the number of channels
    dimensions: int  # d
    workspace: tuple[FloatArray, FloatArray] | None = None  # lower and upper corner, (d,) each [m]
    continuous_force: float | None = None  # [N]; 0 for a device that displays no force
    peak_force: float | None = None  # largest force in every direction [N]; a `LimitedDevice` may report more
    stiffness: float | None = None  # largest virtual stiffness that is stable at the device's rate [N/m]
    damping: float | None = None  # largest virtual damping that is stable at the device's rate [N s/m]
    mass: float | None = None  # effective mass at a fingertip [kg]
    friction: float | None = None  # effective viscous damping at a fingertip, `damping` of a scene [N s/m]
    resolution: float | None = None  # resolution of a fingertip position [m]
    delay: int | None = None  # output delay [samples]
    watchdog: float | None = None  # time after the last `write` until the hardware removes its force [s]; None: never
    rate: float | None = None  # largest rate of reading and writing [Hz]
    latency: float | None = None  # age of a sample when `read` returns it [s]
    lateness: float | None = None  # time from a tick's reading to its force, in addition to `delay` samples [s]
    switches: int = 0  # number of switches, whose state a `SwitchedDevice` reports

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
    """A piece of hardware, or its simulation, that moves `features.fingers` fingertips.

    A driver is a module with `connect(**settings) -> Device`. `connect` does not touch the hardware; `open` does.
    Checking a scene connects all of its devices to learn their features and to find wrong settings. A wrong setting
    raises an InputError that names it. `read` and `write` wait and allocate as little as possible. The arrays that
    `read` returns belong to the device, and the next `read` overwrites them.

    A device that answers requests may also offer `ask` (`AskedDevice`). A driver must offer `quench`
    (`QuenchableDriver`) if its hardware retains its force after the last `write`.
    """

    @property
    def features(self) -> Features:
        """Features reported by the device."""

    def open(self, period: float) -> None:
        """Open the device for one `read` and one `write` every `period` seconds."""

    def read(self) -> tuple[FloatArray, FloatArray, float]:
        """Read positions (k, d) [m], velocities (k, d) [m/s] and the time [s] at which they were taken.

        An unchanged time means that there is no new sample: the last one is returned again, which is not an error. Lost
        hardware raises DeviceError. A failed reading never returns a position of zero.
        """
        ...

    def write(self, forces: FloatArray) -> None:
        """Display forces (k, d) [N] to the operator until the next `write`.

        The device applies its own limit here, after all others. Forces up to `features.peak_force`, or up to the last
        `largest_force` of a `LimitedDevice`, are displayed unchanged. A reduction made here is not recorded. A
        non-finite force is displayed as zero and raises DeviceError.
        """

    def stop(self) -> None:
        """Display zero force immediately."""

    def close(self) -> None:
        """Display zero force and close the hardware. `close` also returns if the hardware is lost or already closed."""

    def __enter__(self) -> Self: ...

    def __exit__(self, *exc: object) -> None: ...


def lacking(device: object) -> list[str]:
    """List the `Device` methods that an object lacks; the two that `with` calls must be defined on the class."""
    missing = [name for name in METHODS if not callable(getattr(device, name, None))]
    return missing + [name for name in ("__enter__", "__exit__") if not hasattr(type(device), name)]


@runtime_checkable
class AskedDevice(Protocol):
    """A device that answers requests. All devices are asked before the first is read, so round trips overlap."""

    def ask(self) -> None:
        """Send a request, whose answer the next `read` receives. If `ask` was not called, `read` sends the request.

        Raise DeviceError if the hardware is lost.
        """


@runtime_checkable
class QuenchableDriver(Protocol):
    """A driver that can remove the force from hardware whose program has died.

    Every driver of hardware without a watchdog (`features.watchdog` is None) must offer `quench`.
    """

    def quench(self, **settings: object) -> None:
        """Connect to the hardware again, set its force to zero and disconnect.

        `quench` is called from another process, after the process that opened the device has ended.

        Args:
            settings: Settings of `connect`.

        Raises:
            DeviceError: If the hardware cannot be reached or does not accept zero force, so that its force may persist.
        """


@runtime_checkable
class LimitedDevice(Protocol):
    """A device whose largest force depends on its position."""

    @property
    def largest_force(self) -> FloatArray:
        """Largest force of each fingertip in every direction at the last reading, (k,), above zero [N].

        For a `FusedDevice` the array is a view of the device's block, which the kernel `reading` updates.
        """
        ...


@runtime_checkable
class RangedDevice(Protocol):
    """A device whose fingers reach only a part of the box `features.workspace`."""

    def nearest(self, finger: int, place: FloatArray, room: float) -> FloatArray:
        """Return the position (d,) nearest to `place` that lies at least `room` [m] inside the finger's reach."""
        ...


@runtime_checkable
class SwitchedDevice(Protocol):
    """A device with switches: buttons, pedals, or a deadman switch, which is closed while it is held."""

    @property
    def switches(self) -> int:
        """Switch states at the last reading as bits: bit i is 1 if switch i of `features.switches` is closed."""
        ...


@runtime_checkable
class RawDevice(Protocol):
    """A device that offers its raw readings, such as encoder counts, to the recording."""

    @property
    def raw(self) -> NDArray[np.int64] | NDArray[np.float64]:
        """Raw numbers of the last reading, (m,) with m >= 1; the same array for the device's lifetime.

        Whole numbers are recorded exactly up to 2^53.
        """
        ...


@runtime_checkable
class SimulatedDevice(Protocol):
    """A simulated device, whose effort moves a plant."""

    @property
    def effort(self) -> FloatArray:
        """Effort of its actuators until the next sample, after delay and limit, (k, d), in the plant's units."""
        ...

    @staticmethod
    def plant(devices: Sequence[Device]) -> Plant:
        """Make the plant that moves all channels of these devices, in their order."""
        ...


@runtime_checkable
class OperatedDevice(Protocol):
    """A simulated device that supports operator models beyond a spring and a damper."""

    @staticmethod
    def operated_plant(devices: Sequence[Device], operator: Operator, period: float) -> Plant:
        """Make a plant for hands with this `operator`, or with operators of at most the same reaction delay.

        The delay line of the plant has room for this delay, in samples of `period` [s].
        """
        ...


def is_hardware(device: object) -> bool:
    """Return whether a device is real hardware, which needs real time and which a person may hold."""
    return not isinstance(device, SimulatedDevice)


class DevicePorts(NamedTuple):
    """First entries of the inputs and outputs in a device's block."""

    sensed: int  # values that its sensors measure, copied from its plant's block before `reading`
    position: int  # (k, d) [m] after `reading`
    velocity: int  # (k, d) [m/s] after `reading`
    command: int  # (k, d) [N], the forces to display, before `writing`
    effort: int  # (k, d) effort of the actuators after `writing`, in the plant's units


@runtime_checkable
class FusedDevice(SimulatedDevice, Protocol):
    """A simulated device that exposes its block and its kernels: a run reads and writes it without Python calls.

    The device must be open, and its plant created and placed. Each sample then copies the entries `sensed` of the
    plant's block to the device's block at `ports.sensed`, calls `reading(S, 0)` once, writes forces at `ports.command`,
    calls `writing(S, 0)`, and reads efforts at `ports.effort`. `read`, `write` and `stop` do nothing else.
    """

    @property
    def state(self) -> FloatArray:
        """Block S, flat; the same array for the device's lifetime."""
        ...

    @property
    def structure(self) -> Index:
        """Indices of the block's integer and boolean entries that select the computation, fixed after `open`."""
        ...

    @property
    def ports(self) -> DevicePorts:
        """Entries that the caller writes and reads, counted from the block's beginning."""
        ...

    @property
    def sensed(self) -> Index:
        """Entries of the plant's block that the device's sensors measure, in order; empty before a plant is made."""
        ...

    @property
    def reading(self) -> Kernel:
        """Kernel reading(S, o) for the block that starts at S[o]; it returns 0, or the code of a failed reading."""
        ...

    @property
    def writing(self) -> Kernel:
        """Kernel writing(S, o). The kernel returns 0, or the code of the fault that has stopped the device."""
        ...

    @property
    def stopping(self) -> Kernel:
        """Kernel stopping(S, o), which sets the force to zero and discards delayed forces."""
        ...

    def fault_text(self, code: int) -> str:
        """Return the message for a code other than 0, with the values in the block."""
        ...


def limit_port(device: FusedDevice) -> int | None:
    """Find the entry of a device's block that contains its largest forces; None if they are constant.

    Raises:
        InputError: If `largest_force` is not a view of the block.
    """
    if not isinstance(device, LimitedDevice):
        return None
    piece, block = device.largest_force, device.state
    start = (piece.ctypes.data - block.ctypes.data) // block.itemsize
    if not (piece.flags.c_contiguous and np.shares_memory(piece, block) and 0 <= start <= block.size - piece.size):
        raise InputError("largest_force", type(device).__qualname__, "a view of the device's block, `state`")
    return start


def fused(device: Device) -> FusedDevice | None:
    """Return the device if its kernels replace all of its methods.

    Return None if the device has no kernels, or if its class overrides `read`, `write` or `stop` of a class with
    kernels.
    """
    if isinstance(device, FusedDevice) and unaltered(
        device, ("read", "write", "stop"), ("reading", "writing", "stopping")
    ):
        return device
    return None


class Calls(NamedTuple):
    """Addresses of C functions `int64 f(void *context, double *block)`, which return 0 (new), 1 (held) or < 0 (fault).

    The block of `ask` and `read` contains positions (k, d) [m], then velocities (k, d) [m/s]; a `read` that returns 0
    has filled both. A return value above 1 is a fault, too. The block of `write` and `stop` contains forces (k, d) [N];
    `write` receives only finite forces within `features.peak_force`. `stop` sets the force to zero, regardless of the
    block's contents. A function that waits delays the loop.

    In a vendor's thread, `ask` begins a frame of the vendor's library, and `write` or `stop` ends it. A device that was
    not asked in a turn, or whose forces were already written, is therefore asked again before it is stopped.

    Attributes:
        ask: Function that sends the request for the next `read`; 0 for a device without requests.
        read, write, stop: Functions equivalent to the methods of these names.
        context: First argument of each function.
        keep: Objects that must stay alive as long as the functions may be called.
    """

    ask: int
    read: int
    write: int
    stop: int
    context: int
    keep: Any


@runtime_checkable
class CallsDevice(Protocol):
    """A device that offers C functions while it is open, for a loop without Python.

    The device also has all methods of a `Device`. These methods open the device, read it before the run, stop it
    afterwards, and replace the C functions when the loop without Python ends.
    """

    @property
    def calls(self) -> Calls | None:
        """C functions while the device is open; None before that."""
        ...


@runtime_checkable
class DrivingDevice(Protocol):
    """A device driven by its vendor's thread, which calls a function once per period.

    The device's C functions may be called only in that thread. Devices that share a thread are driven through one of
    these devices.
    """

    @property
    def thread(self) -> object:
        """Owner of the thread, known before `open`; equal for devices that share the thread."""
        ...

    def drive(self, function: int, context: int) -> None:
        """Let the thread call `unsigned function(void *context)`, which returns 1 if it ran a tick, otherwise 0."""

    def release(self, wait: float) -> bool:
        """Stop the thread's calls; return whether the last call returned within `wait` [s]."""
        ...

    @property
    def drives(self) -> bool:
        """Whether the thread still calls the function."""
        ...


def former_settings(**names: str) -> Callable[[Callable[..., T]], Callable[..., T]]:
    """Let a driver's `connect` accept settings under former names, with a FutureWarning.

    Args:
        names: Present name of each setting, by its former name.
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
