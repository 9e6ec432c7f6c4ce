"""Functions of Force Dimension's library (DHD), by name; the library is loaded when a device is opened."""

from __future__ import annotations

import ctypes
from typing import Any

from graspfx.devices._libraries import load_library
from graspfx.protocols import DeviceError

NAMES = {"win32": ("drd64.dll", "dhd64.dll"), "darwin": ("libdrd.dylib", "libdhd.dylib")}
ELSEWHERE = "libdrd.so", "libdrd.so.3", "libdhd.so"

# Return values: a negative value is an error.
NO_NEW_DATA = 1  # for a reading: the time guard keeps the last sample

STATUS = 17  # number of entries of dhdGetStatus
FORCE, OFF_CAUSE = 5, 14
OFF = {
    0: "no cause reported: its force may not have been switched on, or its encoders not initialised",
    1: "the button on the device was pressed",
    2: "the velocity was above the device's safety threshold",
    3: "the device's watchdog: no force arrived in time",
    4: "a program disabled it",
    5: "the USB cable; check its connection",
    6: "the deadman switch was released",
}

_int, _char, _byte, _double = ctypes.c_int, ctypes.c_byte, ctypes.c_ubyte, ctypes.c_double
_numbers = ctypes.POINTER(_double)
ARGUMENTS: dict[str, tuple[Any, ...]] = {
    "dhdOpen": (),
    "dhdOpenSerial": (_int,),
    "dhdClose": (_char,),
    "dhdStop": (_char,),
    "dhdEnableForce": (_byte, _char),
    "dhdSetMaxForce": (_double, _char),
    "dhdGetPosition": (_numbers, _numbers, _numbers, _char),
    "dhdSetForce": (_double, _double, _double, _char),
    "dhdGetStatus": (ctypes.POINTER(_int), _char),
}
EXPERT: dict[str, tuple[Any, ...]] = {  # functions that only some versions of the library have
    "dhdEnableExpertMode": (),
    "dhdDisableExpertMode": (),
    "dhdGetWatchdog": (ctypes.POINTER(_byte), _char),
    "dhdSetWatchdog": (_byte, _char),
}


class Dhd:
    """The library's functions with their argument types; a failed call raises a DeviceError.

    Args:
        library: Path of the library, None for its usual names, or an object with functions of these names.

    Attributes:
        library: Loaded library, or the object given.
    """

    def __init__(self, library: object) -> None:
        self.library = loaded = load_library(library, "Force Dimension's library", NAMES, ELSEWHERE)
        self._last = self._function(loaded, "dhdErrorGetLastStr", (), ctypes.c_char_p)
        self._functions = {name: self._function(loaded, name, kinds) for name, kinds in ARGUMENTS.items()}
        self.expert = all(hasattr(loaded, name) for name in EXPERT)
        if self.expert:
            self._functions |= {name: self._function(loaded, name, kinds) for name, kinds in EXPERT.items()}

    def call(self, name: str, *arguments: object) -> int:
        """Call a function and return its non-negative result.

        Raises:
            DeviceError: If the result is negative.
        """
        code = int(self._functions[name](*arguments))
        if code < 0:
            text = (self._last() or b"").decode(errors="replace")
            raise DeviceError(f"{name} of Force Dimension's library returned {code}: {text}")
        return code

    @staticmethod
    def _function(library: Any, name: str, kinds: tuple[Any, ...], gives: Any = ctypes.c_int) -> Any:
        try:
            function = getattr(library, name)
        except AttributeError as error:
            raise DeviceError(
                f"Force Dimension's library has no function {name}: install a newer SDK, or set `library` to libdrd"
            ) from error
        if isinstance(library, ctypes.CDLL):
            function.argtypes, function.restype = kinds, gives
        return function


def is_of_c(library: object) -> bool:
    """Tell whether a library has C functions, like a library loaded from a path."""
    function = getattr(library, "dhdSetForce", None)
    return library is None or isinstance(library, str) or (hasattr(function, "argtypes") and function is not None)
