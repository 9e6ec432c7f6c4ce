"""Vendors' libraries, loaded by name when a device is opened."""

from __future__ import annotations

import ctypes
import sys
from collections.abc import Mapping, Sequence
from typing import Any

from graspfx.protocols import DeviceError, InputError


def load_library(library: object, title: str, names: Mapping[str, Sequence[str]], others: Sequence[str]) -> Any:
    """Load a library from its path; any other object must have the library's functions and is returned unchanged.

    Args:
        library: Path of the library; None for its usual names.
        title: Name of the library in messages.
        names: Usual names, by operating system.
        others: Usual names on other systems.

    Raises:
        DeviceError: If the library cannot be loaded.
    """
    if library is not None and not isinstance(library, str):
        return library
    for name in names.get(sys.platform, others) if library is None else (library,):
        try:
            return ctypes.CDLL(name)
        except OSError as error:
            reason = error
    raise DeviceError(
        f"{title} cannot be loaded ({reason}): install the vendor's SDK, or set the library's path as `library`"
    ) from reason


def check_library(library: object, name: str) -> None:
    """Raise InputError if the path of a library is empty, before anything is loaded.

    Args:
        library: Value of the setting.
        name: Name of the library in the message.
    """
    if isinstance(library, str) and not library:
        raise InputError("library", library, f"the path of {name}, or None for its usual names")
