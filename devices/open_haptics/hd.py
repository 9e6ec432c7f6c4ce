"""Functions and constants of the OpenHaptics library (HD), by name; the library is loaded when a device is opened."""

from __future__ import annotations

import ctypes
from typing import Any

from graspfx.devices._libraries import load_library
from graspfx.protocols import DeviceError, InputError

LIBRARIES = {"win32": ("hd.dll",), "darwin": ("HD.framework/HD",)}
ELSEWHERE = "libHD.so", "libHD.so.3.4", "libHD.so.3"

NO_DEVICE = 0xFFFFFFFF
POSITION, FORCE, FORCE_OUTPUT = 0x2050, 0x2700, 0x4000  # mm, N
FIRST = 0xFFFF  # priority of a callback before all others
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
}
MOST = 64  # largest number of errors popped from the stack


class _Error(ctypes.Structure):
    """HDErrorInfo."""

    _fields_ = (("code", ctypes.c_uint), ("internal", ctypes.c_int), ("handle", ctypes.c_uint))


class Hd:
    """The library's functions with their argument types; an error on its stack after a call raises a DeviceError.

    Args:
        library: Path of the library, None for its usual names, or an object with ctypes functions of these names.

    Attributes:
        library: Loaded library, or the object given.
    """

    def __init__(self, library: object) -> None:
        self.library = loaded = load_library(library, "the OpenHaptics library", LIBRARIES, ELSEWHERE)
        self._functions = {}
        for name, kinds in {**SIGNATURES, "hdGetError": (_Error,)}.items():
            function = getattr(loaded, name, None)
            if function is None:
                raise DeviceError(
                    f"the OpenHaptics library has no function {name}: install a newer SDK, or set `library` to libHD"
                )
            if isinstance(loaded, ctypes.CDLL):
                function.restype, function.argtypes = kinds[0], kinds[1:]
            self._functions[name] = function

    def call(self, name: str, *arguments: object) -> Any:
        """Call a function and return its result.

        Raises:
            DeviceError: If it leaves an error on the stack.
        """
        result = self._functions[name](*arguments)
        errors: list[int] = []
        while len(errors) < MOST and (code := int(self._functions["hdGetError"]().code)):
            errors.append(code)
        if errors:
            raise DeviceError(f"{name} of OpenHaptics: {error_text(errors[-1])}")
        return result


def error_text(code: int) -> str:
    """Explain an error of the library."""
    return f"{ERRORS.get(code, 'an error')} (0x{code:X})"


def check_unit(unit: object) -> None:
    """Reject values that cannot be the name of a device."""
    if unit is not None and not (isinstance(unit, str) and unit):
        raise InputError("unit", unit, "the device's name in the vendor's setup tool, or None")
