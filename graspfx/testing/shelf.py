"""Drivers by name or path, as a scene finds them: for tests and benches that use a device by itself."""

from __future__ import annotations

from os import PathLike
from types import ModuleType

from graspfx import plugins


def driver(name: str | PathLike[str]) -> ModuleType:
    """Import a driver: a module with `connect(**settings)`, which returns a `graspfx.protocols.Device`.

    Args:
        name: on the shelf, of another distribution's, or the path of a .py file.

    Raises:
        UnknownNameError: no driver has that name.
        InputError: the path leads to no file.
        PluginError: a file that cannot be imported.
    """
    return plugins.load_blaming("devices", name)
