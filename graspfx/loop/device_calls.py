"""C functions of a device, for loops without Python."""

from __future__ import annotations

from typing import Any, NamedTuple, Protocol, runtime_checkable

FRESH, REPEAT = 0, 1  # return values; less than zero is a fault


class Calls(NamedTuple):
    """Addresses of C functions `int64 f(void *context, double *block)`, which return 0 (new), 1 (held) or < 0 (fault).

    The block of `ask` and `read` contains positions (k, d) [m], then velocities (k, d) [m/s]; a `read` that returns 0
    has filled both. A return value above 1 is a fault, too. The block of `write` and `stop` contains forces (k, d) [N];
    `write` receives only finite forces within `features.peak_force`. `stop` sets the force to zero, regardless of the
    block's contents. A function that waits delays the loop.

    In a vendor's thread, `ask` opens a frame of the library, and `write` or `stop` closes it. A device that was not
    asked in a turn, or whose forces were already written, is therefore asked again before it is stopped.

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
