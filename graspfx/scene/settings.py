"""A device table against the signature of its driver's `connect`; imports the drivers that the scene names."""

from __future__ import annotations

import inspect
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from graspfx import plugins
from graspfx.errors import InputError, UnknownNameError, closest, shown
from graspfx.scene.parts import Device, SceneTable

Location = tuple[str | int, ...]
OPEN_ENDED = inspect.Parameter.VAR_KEYWORD
AUTOMATIC = "dimensions"  # given to a driver that takes it, from the scene's own key


def setting_faults(
    scene: SceneTable, at: Location, device: Device, folder: Path | None
) -> Iterator[tuple[Location, str]]:
    """Unknown and missing settings of a device, and values that are no finite numbers."""
    settings = device.settings
    for key, value in settings.items():
        if not _finite(value):
            yield (*at, key), f"expected finite numbers; given {shown(value)}"
    try:
        connect = plugins.load("devices", device.name, folder).connect
    except (UnknownNameError, InputError) as error:
        yield (*at, "name"), str(error)
        return
    except ImportError as error:
        yield (*at, "name"), f"the driver {device.name!r} cannot be imported: {error}"
        return
    except AttributeError:
        yield (*at, "name"), f"the driver {device.name!r} has no function connect(**settings)"
        return
    parameters = inspect.signature(connect).parameters
    named = {name for name, each in parameters.items() if each.kind is not OPEN_ENDED}
    unknown = [key for key in settings if key not in named] if len(named) == len(parameters) else []
    meant = {key: closest(key, named) for key in unknown}
    for key, close in meant.items():
        hint = f"; did you mean {close!r}?" if close else f" (known: {', '.join(sorted(named - {AUTOMATIC}))})"
        yield (*at, key), f"unknown setting of {device.name!r}{hint}"
    for name in sorted(named - {AUTOMATIC} - settings.keys() - set(meant.values())):
        if parameters[name].default is inspect.Parameter.empty:
            yield (*at, name), f"required by {device.name!r}, but not given"
    if AUTOMATIC in settings and AUTOMATIC in named and settings[AUTOMATIC] != scene.dimensions:
        yield (*at, AUTOMATIC), f"expected {scene.dimensions}, as the scene; leave it out"


def _finite(value: Any) -> bool:
    if isinstance(value, float):
        return math.isfinite(value)
    if isinstance(value, list | tuple):
        return all(map(_finite, value))
    return all(map(_finite, value.values())) if isinstance(value, dict) else True
