"""The library's scheduler, one in a process: it starts once all devices are there, and calls one function a period."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from threading import RLock
from typing import Protocol

from graspfx.devices.open_haptics.hd import FIRST, FORCE, FORCE_OUTPUT, NO_DEVICE, POSITION, RATE, Hd
from graspfx.protocols import Calls, DeviceError, Mailbox, VelocityEstimator, adapt

LONGEST = 0.5  # for a scheduler to call [s]
SETTLED = 2  # turns after which what was written is displayed


class Member(Protocol):
    """A device of the scheduler."""

    handle: int

    def now(self) -> float: ...

    def sleep(self, duration: float) -> None: ...


class Scheduler:
    """The devices of one library that are open in this process, and the thread that exchanges with them.

    Devices are initialised before it starts; one more stops it for that time.

    Args:
        hd: functions of the library.
    """

    def __init__(self, hd: Hd) -> None:
        self._hd, self._members = hd, list[Member]()
        self._calls: list[Calls] = []
        self._mailbox: Mailbox | None = None  # while it runs
        self._number = 0  # of the callback
        self._lock = RLock()

    def add(self, member: Member, unit: str | None, velocity: VelocityEstimator) -> Calls:
        """Initialise a device; give its C functions, which may be called in the scheduler's thread only.

        Args:
            member: the device.
            unit: its name in the maker's setup tool.
            velocity: estimates velocities, a period of the scheduler after the other.
        """
        hd = self._hd
        with self._lock:
            self._halt()
            handle = int(hd.call("hdInitDevice", None if unit is None else unit.encode()))
            if handle == NO_DEVICE:
                raise DeviceError("OpenHaptics gives no handle for the device")
            member.handle = handle
            try:
                hd.call("hdMakeCurrentDevice", handle)
                hd.call("hdEnable", FORCE_OUTPUT)
                calls = _calls(hd, handle, velocity)
            except BaseException:  # a signal may break it off too
                with suppress(DeviceError):
                    hd.call("hdDisableDevice", handle)
                raise
            self._members.append(member)
            self._calls.append(calls)
            return calls

    def remove(self, member: Member) -> None:
        """Stop, disable a device, and go on with the others."""
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
        """Start, unless it runs; give the exchange with its devices."""
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
                    raise DeviceError("the scheduler of OpenHaptics does not call: its driver may not run")
            except DeviceError:
                self._halt()
                raise
            return mailbox

    @property
    def mailbox(self) -> Mailbox | None:
        """The exchange with its devices, while it runs."""
        return self._mailbox

    def place(self, member: Member) -> int:
        """Give the number of a device in the mailbox."""
        return self._members.index(member)

    def _halt(self) -> None:
        """Take the callback away and stop, when forces are zero."""
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
    """Adapt the library's functions: a frame of each device, frames inside one another, lengths in mm."""
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


_SCHEDULERS: dict[object, Scheduler] = {}  # by library: one for all devices of this process


def library_key(library: object) -> object:
    """Name a library by its path, or the object that it is."""
    return library if library is None or isinstance(library, str) else id(library)


def scheduler_of(library: object) -> Scheduler:
    """Give the scheduler of a library, which is loaded the first time."""
    key = library_key(library)
    if key not in _SCHEDULERS:
        _SCHEDULERS[key] = Scheduler(Hd(library))
    return _SCHEDULERS[key]
