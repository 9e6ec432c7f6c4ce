"""The OpenHaptics library (HD) and its scheduler; a process has one scheduler, which calls a function periodically."""

from __future__ import annotations

import ctypes
from contextlib import suppress
from functools import cache
from threading import Lock, RLock
from typing import Any, Protocol

import numpy as np

from graspfx.devices._device import library_functions, load_library
from graspfx.protocols import Calls, DeviceError, Mailbox, VelocityEstimator, adapt

LONGEST = 0.5  # longest wait for the scheduler to call back [s]
SETTLED = 2  # number of callbacks after which a written force is displayed

TITLE = "the OpenHaptics library"
LIBRARIES = {"win32": ("hd.dll",), "darwin": ("HD.framework/HD",)}
ELSEWHERE = "libHD.so", "libHD.so.3.4", "libHD.so.3"

NO_DEVICE = 0xFFFFFFFF
POSITION, FORCE, FORCE_OUTPUT = 0x2050, 0x2700, 0x4000  # mm, N
FIRST = 0xFFFF  # highest priority of a callback
RATE = 1000  # rate of the scheduler [Hz]
ERRORS = {
    0x102: "the operation is not allowed in this state",
    0x200: "the motors are warm: let them cool down",
    0x201: "the force was above the device's maximum",
    0x202: "the force changed by more than the device allows",
    0x203: "the handle was faster than the device allows",
    0x204: "the force cannot be displayed",
    0x300: "the device has a fault: it may be unplugged, switched off, or in use by another program",
    0x302: "the device does not answer: check its cable",
    0x304: "the scheduler's timer does not run",
}


class _Error(ctypes.Structure):
    """HDErrorInfo."""

    _fields_ = (("code", ctypes.c_uint), ("internal", ctypes.c_int), ("handle", ctypes.c_uint))


_handle, _number = ctypes.c_uint, ctypes.c_uint
SIGNATURES: dict[str, tuple[Any, ...]] = {
    "hdInitDevice": (_handle, ctypes.c_char_p),
    "hdDisableDevice": (None, _handle),
    "hdMakeCurrentDevice": (None, _handle),
    "hdEnable": (None, _number),
    "hdBeginFrame": (None, _handle),
    "hdEndFrame": (None, _handle),
    "hdGetDoublev": (None, _number, ctypes.c_void_p),
    "hdSetDoublev": (None, _number, ctypes.c_void_p),
    "hdScheduleAsynchronous": (ctypes.c_ulong, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_ushort),
    "hdUnschedule": (None, ctypes.c_ulong),
    "hdSetSchedulerRate": (None, ctypes.c_ulong),
    "hdStartScheduler": (None,),
    "hdStopScheduler": (None,),
    "hdGetError": (_Error,),
}
MOST = 64  # largest number of errors taken from the stack after a call


class Hd:
    """Functions of the library (HD) by name; an error on the library's stack after a call raises a DeviceError.

    Args:
        path: Path of the library, the loaded library, or None to try the library's usual file names.

    Attributes:
        library: Loaded library.
    """

    def __init__(self, path: str | ctypes.CDLL | None) -> None:
        self.library = load_library(path, TITLE, LIBRARIES, ELSEWHERE)
        self._functions = library_functions(self.library, TITLE, "libHD", SIGNATURES)

    def call(self, name: str, *arguments: object) -> Any:
        """Call a function and return its result.

        Raises:
            DeviceError: If the function leaves an error on the stack.
        """
        result = self._functions[name](*arguments)
        errors: list[int] = []
        while len(errors) < MOST and (code := int(self._functions["hdGetError"]().code)):
            errors.append(code)
        if errors:
            raise DeviceError(f"{name} of OpenHaptics: {error_text(errors[-1])}")
        return result


def error_text(code: int) -> str:
    """Return the description of an error code of the library."""
    return f"{ERRORS.get(code, 'an error')} (0x{code:X})"


class Member(Protocol):
    """A device of the scheduler."""

    handle: int

    def now(self) -> float: ...

    def sleep(self, duration: float) -> None: ...


class Scheduler:
    """The open devices of one library in this process, and the thread that exchanges data with them.

    Devices are initialised before the scheduler starts; adding another device stops the scheduler temporarily.

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
        """Initialise a device; return its C functions, which may be called only in the scheduler's thread.

        Args:
            member: Device to add.
            unit: Name of the device in the vendor's setup tool; None for the default device.
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
        """Stop and disable a device; the scheduler continues with the other devices."""
        with self._lock:
            if member not in self._members:
                return
            self._halt()
            i = self._members.index(member)
            del self._members[i], self._calls[i]
            with suppress(DeviceError):  # the hardware may be disconnected
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
        """Set zero forces, then remove the callback and stop the scheduler."""
        mailbox, self._mailbox = self._mailbox, None
        if mailbox is None:
            return
        mailbox.release(LONGEST)
        for i in range(len(self._calls)):
            mailbox.write(i, np.zeros((1, 3)))
        mailbox.wait(SETTLED, 0.05)
        with suppress(DeviceError):
            self._hd.call("hdUnschedule", self._number)
        with suppress(DeviceError):
            self._hd.call("hdStopScheduler")


def _calls(hd: Hd, handle: int, velocity: VelocityEstimator) -> Calls:
    """Adapt the library's functions for one device: each device has a frame, frames are nested, lengths are in mm."""
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


_CREATION = Lock()  # several threads may call `quench` at once, but a library has one scheduler


def scheduler_of(library: str | ctypes.CDLL | None) -> Scheduler:
    """Return the scheduler of a library, shared by all devices of this process; the library is loaded on first use."""
    with _CREATION:
        return _scheduler(library)


@cache
def _scheduler(library: str | ctypes.CDLL | None) -> Scheduler:
    return Scheduler(Hd(library))
