"""Protocols of devices, and of optional abilities of devices such as kernels or C functions."""

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
    """Features of a device, known before the device is opened. A feature that is not known is None, not zero."""

    fingers: int  # k, the number of channels
    dimensions: int  # d
    workspace: tuple[FloatArray, FloatArray] | None = None  # lower and upper corner, (d,) each [m]
    continuous_force: float | None = None  # largest continuous force [N]; 0 for a device that displays no force
    peak_force: float | None = None  # force possible in every direction [N]; a `LimitedDevice` may report a larger one
    stiffness: float | None = None  # largest virtual stiffness that is stable at the device's rate [N/m]
    damping: float | None = None  # largest virtual damping that is stable at the device's rate [N s/m]
    mass: float | None = None  # effective mass at a fingertip [kg]
    friction: float | None = None  # effective viscous damping at a fingertip, `damping` of a scene [N s/m]
    resolution: float | None = None  # resolution of a fingertip position [m]
    delay: int | None = None  # output delay [samples]
    watchdog: float | None = None  # time without a `write` after which the hardware removes its force [s]; None: never
    rate: float | None = None  # largest rate of reading and writing [Hz]
    latency: float | None = None  # age of a sample when `read` returns it [s]
    lateness: float | None = None  # time from reading to displaying the force, in addition to `delay` samples [s]
    switches: int = 0  # number of switches of a `SwitchedDevice`

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
    """Hardware or simulation that moves k = `features.fingers` fingertips in d = `features.dimensions` dimensions.

    A driver is a module with a function `connect(**settings)` that returns a Device. `connect` must not communicate
    with the hardware; only `open` does. When a scene is checked, its devices are connected to read their features and
    to find wrong settings; for a wrong setting, `connect` must raise an InputError that names the setting. `read` and
    `write` must wait and allocate memory as little as possible. The arrays that `read` returns belong to the device,
    and the next `read` may overwrite them.

    A device that answers requests may also have the method `ask` (`AskedDevice`). If hardware retains its force after
    the last `write`, its driver must have the function `quench` (`QuenchableDriver`).
    """

    @property
    def features(self) -> Features:
        """Features of the device."""

    def open(self, period: float) -> None:
        """Open the device for one `read` and one `write` every `period` seconds."""

    def read(self) -> tuple[FloatArray, FloatArray, float]:
        """Return positions (k, d) [m], velocities (k, d) [m/s] and the time at which they were measured [s].

        If there is no new sample, the last sample is returned again with an unchanged time; this is not an error. If a
        reading fails or the hardware is lost, `read` must raise DeviceError, and must not return zeros as positions.
        """
        ...

    def write(self, forces: FloatArray) -> None:
        """Display forces (k, d) [N] to the operator until the next `write`.

        Forces up to `features.peak_force`, or up to the last `largest_force` of a `LimitedDevice`, must be displayed
        unchanged. Larger forces may be limited by the device; this reduction is not recorded. For a non-finite force,
        the device must display zero force and raise DeviceError.
        """

    def stop(self) -> None:
        """Display zero force immediately."""

    def close(self) -> None:
        """Display zero force and close the hardware; return without error if it is lost or already closed."""

    def __enter__(self) -> Self: ...

    def __exit__(self, *exc: object) -> None: ...


def lacking(device: object) -> list[str]:
    """List the methods of `Device` that an object does not have.

    `__enter__` and `__exit__` must be defined by the object's class, because `with` looks them up there.
    """
    missing = [name for name in METHODS if not callable(getattr(device, name, None))]
    return missing + [name for name in ("__enter__", "__exit__") if not hasattr(type(device), name)]


@runtime_checkable
class AskedDevice(Protocol):
    """Device that answers requests.

    All devices receive their requests before the first device is read, so that the round trips overlap in time.
    """

    def ask(self) -> None:
        """Send a request, so that the next `read` only receives the answer.

        If `ask` was not called, `read` must send the request. `ask` must raise DeviceError if the hardware is lost.
        """


@runtime_checkable
class QuenchableDriver(Protocol):
    """Driver that can remove the force of hardware after the program that used the hardware has ended unexpectedly.

    Every driver of hardware without a watchdog (`features.watchdog` is None) must have the function `quench`.
    """

    def quench(self, **settings: object) -> None:
        """Connect to the hardware, set its force to zero and disconnect.

        `quench` is called by another process after the process that opened the device has ended.

        Args:
            settings: Settings with which `connect` was called.

        Raises:
            DeviceError: If the hardware cannot be reached or does not accept zero force, so that its force may remain.
        """


@runtime_checkable
class LimitedDevice(Protocol):
    """Device whose largest force depends on its position."""

    @property
    def largest_force(self) -> FloatArray:
        """Largest force that each fingertip can exert in every direction at the last reading, (k,) [N]; above zero.

        For a `FusedDevice`, the array must be a view of the device's block, where the kernel `reading` updates it.
        """
        ...


@runtime_checkable
class RangedDevice(Protocol):
    """Device whose fingers can reach only a part of the box `features.workspace`."""

    def nearest(self, finger: int, place: FloatArray, room: float) -> FloatArray:
        """Return the position (d,) [m] nearest to `place` that is at least `room` inside the boundary of the reach.

        Args:
            finger: Channel of the finger.
            place: Position (d,) [m].
            room: Distance from the boundary of the finger's reach [m].
        """
        ...


@runtime_checkable
class SwitchedDevice(Protocol):
    """Device with switches, such as buttons, pedals, or a deadman switch, which is closed while it is held."""

    @property
    def switches(self) -> int:
        """States of the switches at the last reading: bit i is 1 if switch i is closed, i < `features.switches`."""
        ...


@runtime_checkable
class RawDevice(Protocol):
    """Device whose raw readings, such as encoder counts, are recorded."""

    @property
    def raw(self) -> NDArray[np.int64] | NDArray[np.float64]:
        """Raw numbers of the last reading, (m,) with m >= 1; the property must always return the same array.

        Integers up to 2^53 are recorded exactly.
        """
        ...


@runtime_checkable
class SimulatedDevice(Protocol):
    """Simulated device, whose actuators move a plant."""

    @property
    def effort(self) -> FloatArray:
        """Effort of the actuators until the next sample, (k, d), in the plant's units, after delay and limits."""
        ...

    @staticmethod
    def plant(devices: Sequence[Device]) -> Plant:
        """Make the plant that moves the channels of these devices, in the order of the devices."""
        ...


@runtime_checkable
class OperatedDevice(Protocol):
    """Simulated device that also supports operator models other than a spring and a damper."""

    @staticmethod
    def operated_plant(devices: Sequence[Device], operator: Operator, period: float) -> Plant:
        """Make a plant that supports hands with this operator, or with operators whose reaction delay is not longer.

        Args:
            devices: Devices whose channels the plant moves, in this order.
            operator: Operator with the longest reaction delay, which determines the length of the plant's delay line.
            period: Sampling period T [s].
        """
        ...


def is_hardware(device: object) -> bool:
    """Return whether a device is hardware, that is, not simulated; a person may hold it, and it needs real time."""
    return not isinstance(device, SimulatedDevice)


class DevicePorts(NamedTuple):
    """Entries of a device's block at which inputs and outputs start."""

    sensed: int  # values that the sensors measure, copied from the plant's block before `reading`
    position: int  # (k, d) [m] after `reading`
    velocity: int  # (k, d) [m/s] after `reading`
    command: int  # (k, d) [N], the forces to display, before `writing`
    effort: int  # (k, d) effort of the actuators after `writing`, in the plant's units


@runtime_checkable
class FusedDevice(SimulatedDevice, Protocol):
    """Simulated device that is read and written by kernels, without Python calls.

    The memory of the device is a block S. The device must be open, and its plant must be created and placed. In each
    sample, the entries `sensed` of the plant's block are copied to S at `ports.sensed`, `reading(S, 0)` is called,
    forces are written to S at `ports.command`, `writing(S, 0)` is called, and efforts are read from S at
    `ports.effort`. `read`, `write` and `stop` must have no other effects.
    """

    @property
    def state(self) -> FloatArray:
        """Block S, one-dimensional; the property must always return the same array."""
        ...

    @property
    def structure(self) -> Index:
        """Indices of the integer and Boolean entries of S that select the computation and are constant after `open`."""
        ...

    @property
    def ports(self) -> DevicePorts:
        """Entries of S at which the caller writes inputs and reads outputs."""
        ...

    @property
    def sensed(self) -> Index:
        """Indices of the entries of the plant's block that the sensors measure; empty before a plant is made."""
        ...

    @property
    def reading(self) -> Kernel:
        """Kernel reading(S, o), where the block starts at S[o]; it returns 0, or a fault code if the reading fails."""
        ...

    @property
    def writing(self) -> Kernel:
        """Kernel writing(S, o); it returns 0, or the fault code of the fault for which it has stopped the device."""
        ...

    @property
    def stopping(self) -> Kernel:
        """Kernel stopping(S, o), which sets the force to zero and discards delayed forces."""
        ...

    def fault_text(self, code: int) -> str:
        """Return the message for a fault code, with values from the block."""
        ...


def limit_port(device: FusedDevice) -> int | None:
    """Return the entry of a device's block at which `largest_force` starts; None if the device is not limited.

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
    """Return the device if kernels can replace its methods, otherwise None.

    The result is None if the device has no kernels, or if its class overrides `read`, `write` or `stop` of a base class
    with kernels.
    """
    if isinstance(device, FusedDevice) and unaltered(
        device, ("read", "write", "stop"), ("reading", "writing", "stopping")
    ):
        return device
    return None


class Calls(NamedTuple):
    """Addresses of C functions `int64 f(void *context, double *block)` of a device.

    A function returns 0 if it succeeds. `read` returns 1 if there is no new sample. Any other value, negative or above
    1, is a fault. The block of `ask` and `read` contains positions (k, d) [m], then velocities (k, d) [m/s]; a `read`
    that returns 0 has filled both. The block of `write` and `stop` contains forces (k, d) [N]; `write` receives only
    finite forces within `features.peak_force`. `stop` sets the force to zero and ignores the block. A function that
    waits delays the loop.

    In a vendor's thread, `ask` begins a frame of the vendor's library, and `write` or `stop` ends the frame. If a
    device has not been asked in a tick, or its forces have already been written, it is therefore asked again before it
    is stopped.

    Attributes:
        ask: Function that requests a sample for the next `read`; 0 if the device needs no requests.
        read, write, stop: Functions that replace the methods with the same names.
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
    """Device with C functions, which a real-time loop in machine code calls.

    The methods of `Device` are used to open the device, before and after such a loop, and in other loops.
    """

    @property
    def calls(self) -> Calls | None:
        """C functions of the device while it is open; None before it is opened."""
        ...


@runtime_checkable
class DrivingDevice(Protocol):
    """Device whose vendor's library has a thread that calls a function once per period.

    The C functions of the device may only be called in this thread. If several devices share a thread, only one of them
    is told to call the function.
    """

    @property
    def thread(self) -> object:
        """Object that identifies the thread, also before `open`; devices that share a thread have equal objects."""
        ...

    def drive(self, function: int, context: int) -> None:
        """Let the thread call a C function `unsigned function(void *context)` once per period.

        The function returns 1 if it has run a tick, otherwise 0.

        Args:
            function: Address of the C function.
            context: Address that is passed to the C function.
        """

    def release(self, wait: float) -> bool:
        """End the calls by the thread; return whether the last call has returned within `wait` seconds."""
        ...

    @property
    def drives(self) -> bool:
        """Whether the thread calls the function."""
        ...


def former_settings(**names: str) -> Callable[[Callable[..., T]], Callable[..., T]]:
    """Return a decorator with which a driver's `connect` also accepts former names of settings, with a FutureWarning.

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
