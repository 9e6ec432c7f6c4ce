"""C functions of a device, for loops in which no Python runs."""

from __future__ import annotations

from typing import Any, NamedTuple, Protocol, runtime_checkable

FRESH, REPEAT = 0, 1  # what the functions return; less than zero is a fault


class Calls(NamedTuple):
    """Addresses of C functions `int64 f(void *context, double *block)`: 0 fresh, 1 held, less than zero a fault.

    The block of `ask` and `read` has room for positions (k, d) [m], then velocities (k, d) [m/s]: a `read` that returns
    0 has filled both, and any other number than these is a fault. That of `write` and `stop` has the forces (k, d) [N];
    `write` is told finite ones within `features.peak_force` only. `stop` is zero force, whatever stands in the block. A
    function that waits makes the loop wait.

    Attributes:
        ask: sends the request that the next `read` takes the answer of; 0 for a device that is not asked.
        read, write, stop: as the methods of these names do.
        context: the first argument of each.
        keep: whatever has to live as long as somebody may call.
    """

    ask: int
    read: int
    write: int
    stop: int
    context: int
    keep: Any


@runtime_checkable
class CallsDevice(Protocol):
    """A device that offers C functions once it is open, so that no Python runs in its loop.

    It has all methods of a `Device` too: they are what opens it, reads it before the run and stops it afterwards, and
    they go on where the C functions stop.
    """

    @property
    def calls(self) -> Calls | None:
        """The functions, as long as the device is open; None before."""
        ...


@runtime_checkable
class DrivingDevice(Protocol):
    """A device whose maker's thread has the clock: it calls once a period, and its functions may be called only there.

    Devices that share such a thread are driven by one of them.
    """

    @property
    def thread(self) -> object:
        """Owner of the thread, known before `open`: equal for devices that share it."""
        ...

    def drive(self, function: int, context: int) -> None:
        """Let the thread call `unsigned function(void *context)` from now on: 1 for a tick, 0 for none."""

    def release(self, wait: float) -> bool:
        """Let the thread call the function no more; tell whether it has come back from it within so long [s]."""
        ...

    @property
    def drives(self) -> bool:
        """Whether the thread goes on to call."""
        ...
