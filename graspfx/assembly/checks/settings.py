"""Faults of single values: settings of plug-ins, lengths of vectors, names of recorded columns."""

from __future__ import annotations

import inspect
import math
from collections.abc import Iterator, Mapping
from collections.abc import Set as AbstractSet
from pathlib import Path
from types import ModuleType
from typing import Any

from graspfx import plugins
from graspfx.assembly.bodies import Stock
from graspfx.assembly.wiring import AUTOMATIC, connect
from graspfx.compile.memory import within
from graspfx.errors import LONGEST_KEY, GraspFXError, InputError, UnknownNameError, abbreviate, closest
from graspfx.loop.columns import Layout, columns_of
from graspfx.loop.device import Features, lacking
from graspfx.scene.keys import Finding, Key
from graspfx.scene.tables.part_tables import Device
from graspfx.scene.tables.scene_table import SceneTable


def length_faults(scene: SceneTable, at: Key, part: Any, field: str) -> Iterator[Finding]:
    """Find a vector whose number of components is not the number of the scene's dimensions."""
    value = getattr(part, field)
    if value is not None and len(value) != scene.dimensions:
        yield (*at, field), f"expected {numbers(scene.dimensions)}; given {abbreviate(list(value))}"


def numbers(count: int) -> str:
    return "1 number (dimensions = 1)" if count == 1 else f"{count} numbers (dimensions = {count})"


def record_faults(scene: SceneTable) -> Iterator[Finding]:
    """Find names in `record.columns` of columns that no recording of the scene's fingers and objects can contain."""
    names = scene.record.columns
    if not names:
        return
    every = Layout(
        dimensions=scene.dimensions,
        fingers=scene.finger_names,
        objects=tuple(thing.name for thing in scene.object),
        finger_objects=(0,) * len(scene.finger),
        moments=True, slips=True, observed=True, controlled=True, limits=True, guarded=True, normals=True,
        torsion_axes=True,
        predicted=tuple(range(len(scene.object))),
    )  # fmt: skip
    for i, name in enumerate(names):
        if not columns_of(every, name):
            names_ = [*every.columns, *(column.name for column in every.derived)]
            close = closest(name, names_) if len(name) <= LONGEST_KEY else None
            hint = f"; did you mean {close!r}?" if close else f" (known: {', '.join(names_)})"
            yield ("record", "columns", i), f"expected the name of a column, given {name!r}{hint}"


OPEN_ENDED = inspect.Parameter.VAR_KEYWORD


def load_plugin(group: plugins.Group, what: str, name: str, folder: Path | None, function: str) -> ModuleType | str:
    """Load a plug-in that must have a function; return a text with the reason if it cannot be loaded."""
    try:
        module = plugins.load_blaming(group, name, folder)
    except (UnknownNameError, InputError) as error:
        return reason(error)
    except GraspFXError as error:
        return f"the {what} {name!r} cannot be imported: {error}"
    has = callable(getattr(module, function.partition("(")[0], None))
    return module if has else f"the {what} {name!r} has no function {function}"


def setting_faults(scene: SceneTable, at: Key, table: Device, stock: Stock) -> Iterator[Finding]:
    """Connect a device and store it in `stock`, or find the faults that prevent this."""
    driver = load_plugin("devices", "driver", table.name, stock.folder, "connect(**settings)")
    if isinstance(driver, str):
        yield (*at, "name"), driver
        return
    parameters, settings = inspect.signature(driver.connect).parameters, table.settings
    faults = list(signature_faults(at, table.name, settings, parameters, {AUTOMATIC}))
    twice = [key for key, now in table.former.items() if now in (table.model_extra or {})]
    faults += [
        ((*at, key), f"a former name of {table.former[key]!r}, which is also given: remove {key!r}") for key in twice
    ]
    if AUTOMATIC in settings and AUTOMATIC in parameters and settings[AUTOMATIC] != scene.dimensions:
        text = f"expected {scene.dimensions}, the scene's dimensions; given {abbreviate(settings[AUTOMATIC])}"
        faults.append(((*at, AUTOMATIC), f"{text}: remove {AUTOMATIC!r}"))
    yield from faults
    if not faults:
        yield from _connection(scene, at, table, driver, stock)


def reason(error: GraspFXError) -> str:
    """Return an error's text without the argument's name at its beginning, because a fault has a key instead."""
    return str(error).removeprefix(f"{error.name}: ") if isinstance(error, InputError) else str(error)


def _connection(scene: SceneTable, at: Key, table: Device, driver: ModuleType, stock: Stock) -> Iterator[Finding]:
    dimensions = scene.dimensions
    try:
        with plugins.blaming(Path(driver.__file__ or driver.__name__)), within(stock.memory):
            device = connect(driver, table, dimensions)
            features = getattr(device, "features", None)
            missing = lacking(device)
    except InputError as error:
        is_setting = error.name in table.settings
        yield ((*at, error.name), reason(error)) if is_setting else (at, str(error))
    except GraspFXError as error:
        yield at, f"{table.name!r} cannot be connected: {error}"
    else:
        if not isinstance(features, Features):
            expected = f"expected connect() of {table.name!r} to return a device with an attribute `features`"
            yield (*at, "name"), f"{expected}; given {abbreviate(device)}"
            return
        stock.devices[at] = device  # stored even if a method is missing, so that its features are checked
        if missing:
            file = plugins.shown_path(Path(driver.__file__ or driver.__name__))
            names, kind = ", ".join(f"{name}()" for name in missing), type(device).__name__
            yield (
                at,
                f"the device of {file} lacks {names}: add them to {kind}; graspfx.protocols.Device documents each "
                "method",
            )


def signature_faults(
    at: Key,
    name: str,
    settings: Mapping[str, Any],
    parameters: Mapping[str, inspect.Parameter],
    automatic: AbstractSet[str],
) -> Iterator[Finding]:
    """Find settings with infinite or nan values, settings that a plug-in does not accept, and missing settings.

    Settings in `automatic` need not be given, because the scene defines them.
    """
    for key, value in settings.items():
        if not _finite(value):
            yield (*at, key), f"expected finite numbers; given {abbreviate(value)}"
    names = {key for key, each in parameters.items() if each.kind is not OPEN_ENDED}
    unknown = [key for key in settings if key not in names] if len(names) == len(parameters) else []
    likely = {key: closest(key, names) for key in unknown}
    for key, close in likely.items():
        hint = f"; did you mean {close!r}?" if close else f" (known: {', '.join(sorted(names - automatic))})"
        yield (*at, key), f"unknown setting of {name!r}{hint}"
    for key in sorted(names - automatic - settings.keys() - set(likely.values())):
        if parameters[key].default is inspect.Parameter.empty:
            yield (*at, key), f"required by {name!r}, but not given"


def _finite(value: Any) -> bool:
    if isinstance(value, float):
        return math.isfinite(value)
    if isinstance(value, list | tuple):
        return all(map(_finite, value))
    return all(map(_finite, value.values())) if isinstance(value, dict) else True
