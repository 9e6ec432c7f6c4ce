"""The library's scheduler, one per process: it starts when all devices are added, and calls one function per period."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from threading import RLock
from typing import Protocol

from graspfx.devices.open_haptics.hd import FIRST, FORCE, FORCE_OUTPUT, NO_DEVICE, POSITION, RATE, Hd
from graspfx.protocols import Calls, DeviceError, Mailbox, VelocityEstimator, adapt

LONGEST = 0.5  # time for the scheduler to call back [s]
SETTLED = 2  # turns after which a written force is displayed


class Member(Protocol):
    """A device of the scheduler."""

    handle: int

    def now(self) -> float: ...

    def sleep(self, duration: float) -> None: ...


class Scheduler:
    """The open devices of one library in this process, and the thread that exchanges data with them.

    Devices are initialised before the scheduler starts; adding another device stops it temporarily.

    Args:
        hd: Functions of the library.
    """

    def __init__(self, hd: Hd) -> None:
        self._hd, self._members = hd, list[Member]()
        self._calls: list[Calls] = []
        self._mailbox: Mailbox | None = None  # None unless the scheduler runs
        self._number = 0  # handle of the callback
        self._lock = RLock()

    def add(self, member: Member, unit: str | None, velocity: VelocityEstimator) -> Calls:
        """Initialise a device; return its C functions, which may be called in the scheduler's thread only.

        Args:
            member: Device to add.
            unit: Name of the device in the vendor's setup tool.
            velocity: Estimator of velocities, called once per period of the scheduler.
        """
        hd = self._hd
        with self._lock:
            self._halt()
            handle = int(hd.call("hdInitDevice", None if unit is None else unit.encode()))
            if handle == NO_DEVICE:
                raise DeviceError("OpenHaptics returned no handle for the device")
            member.handle = handle
            try:
                hd.call("hdMakeCurrentDevice", handle)
                hd.call("hdEnable", FORCE_OUTPUT)
                calls = _calls(hd, handle, velocity)
            except BaseException:  # including interruptions by a signal
                with suppress(DeviceError):
                    hd.call("hdDisableDevice", handle)
                raise
            self._members.append(member)
            self._calls.append(calls)
            return calls

    def remove(self, member: Member) -> None:
        """Stop and disable a device, and continue with the others."""
        with self._lock:
            if member not in self._members:
                return
            self._halt()
            i = self._members.index(member)
            del self._members[i], self._calls[i]
            with suppress(DeviceError):  # the hardware may be gone
                self._hd.call("hdMakeCurrentDevice", member.handle)
            with suppress(DeviceError):
                self._hd.call("hdDisableDevice", member.handle)
            if self._members:
                with suppress(DeviceError):
                    self.start()

    def start(self) -> Mailbox:
        """Start the scheduler unless it already runs; return the mailbox of its devices."""
        with self._lock:
            if self._mailbox is not None:
                return self._mailbox
            hd, mailbox = self._hd, Mailbox(self._calls, (1, 3), self._members[0].now, self._members[0].sleep)
            self._number = int(hd.call("hdScheduleAsynchronous", mailbox.function, mailbox.context, FIRST))
            self._mailbox = mailbox
            try:
                hd.call("hdSetSchedulerRate", RATE)
                hd.call("hdStartScheduler")
                if not mailbox.wait(SETTLED, LONGEST):
                    raise DeviceError(
                        "the scheduler of OpenHaptics does not call back: the vendor's driver may not be running"
                    )
            except DeviceError:
                self._halt()
                raise
            return mailbox

    @property
    def mailbox(self) -> Mailbox | None:
        """The mailbox of the devices while the scheduler runs, else None."""
        return self._mailbox

    def place(self, member: Member) -> int:
        """Return the index of a device in the mailbox."""
        return self._members.index(member)

    def _halt(self) -> None:
        """Remove the callback and stop the scheduler, once forces are zero."""
        mailbox, self._mailbox = self._mailbox, None
        if mailbox is None:
            return
        mailbox.release(LONGEST)
        for i in range(len(self._calls)):
            mailbox.write(i, mailbox.read(i)[1] * 0.0)
        mailbox.wait(SETTLED, 0.05)
        steps: list[Callable[[], object]] = [
            lambda: self._hd.call("hdUnschedule", self._number),
            lambda: self._hd.call("hdStopScheduler"),
        ]
        for step in steps:
            with suppress(DeviceError):
                step()


def _calls(hd: Hd, handle: int, velocity: VelocityEstimator) -> Calls:
    """Adapt the library's functions: one frame per device, nested frames, lengths in mm."""
    return adapt(
        hd.library,
        ask="void hdBeginFrame(u32 handle)",
        read=f"void hdMakeCurrentDevice(u32 handle); void hdGetDoublev(u32 {POSITION}, out 0:3 * 0.001)",
        write=f"void hdMakeCurrentDevice(u32 handle); void hdSetDoublev(u32 {FORCE}, in 0:3); "
        "void hdEndFrame(u32 handle)",
        stop=f"void hdMakeCurrentDevice(u32 handle); void hdSetDoublev(u32 {FORCE}, double[3] zero); "
        "void hdEndFrame(u32 handle)",
        errors="u32[3] hdGetError()",
        velocity=velocity,
        handle=handle,
    )


_SCHEDULERS: dict[object, Scheduler] = {}  # by library; shared by all devices of this process


def library_key(library: object) -> object:
    """Return a key for a library: its path, or the object itself."""
    return library if library is None or isinstance(library, str) else id(library)


def scheduler_of(library: object) -> Scheduler:
    """Return the scheduler of a library, which is loaded on first use."""
    key = library_key(library)
    if key not in _SCHEDULERS:
        _SCHEDULERS[key] = Scheduler(Hd(library))
    return _SCHEDULERS[key]
