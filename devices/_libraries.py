"""Makers' libraries, loaded by their names when a device is opened."""

from __future__ import annotations

import ctypes
import sys
from collections.abc import Mapping, Sequence
from typing import Any

from graspfx.protocols import DeviceError, InputError


def load_library(library: object, title: str, names: Mapping[str, Sequence[str]], others: Sequence[str]) -> Any:
    """Load a library; one that is no path is an object with its functions, and is given back.

    Args:
        library: its path; None for its usual names.
        title: of the library, in messages.
        names: usual ones, by the system.
        others: those on other systems.

    Raises:
        DeviceError: it does not load.
    """
    if library is not None and not isinstance(library, str):
        return library
    for name in names.get(sys.platform, others) if library is None else (library,):
        try:
            return ctypes.CDLL(name)
        except OSError as error:
            reason = error
    raise DeviceError(
        f"{title} does not load ({reason}): install the maker's SDK, or give its path as `library`"
    ) from reason


def check_library(library: object, name: str) -> None:
    """Refuse what can be no library, before anything is loaded.

    Args:
        library: as it was set.
        name: of the library, in the message.
    """
    if isinstance(library, str) and not library:
        raise InputError("library", library, f"the path of {name}, or None for its usual names")
