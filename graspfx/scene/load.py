"""Loading of scenes by name or path: TOML files, and Python files with `def scene(**parameters) -> Scene`."""

from __future__ import annotations

import inspect
import re
import tomllib
from collections.abc import Iterator, Mapping
from collections.abc import Set as AbstractSet
from dataclasses import replace
from os import PathLike
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from graspfx import plugins
from graspfx.errors import Fault, GraspFXError, InputError, SceneError, UnknownNameError, closest
from graspfx.scene.model import Scene, make_scene
from graspfx.scene.overrides import by_key
from graspfx.scene.source import Source
from graspfx.scene.tables.reading import Readable
from graspfx.scene.tables.scene_table import Preset
from graspfx.scene.toml_text import excess, read_bytes

PLACE = re.compile(r"\s*\(at (?:line (\d+), column \d+|end of document)\)$")
OPEN_ENDED = (inspect.Parameter.VAR_KEYWORD, inspect.Parameter.VAR_POSITIONAL)
SIMPLE = re.compile(r"^[A-Za-z_]\w*$")


def load(name: str | PathLike[str], overrides: Mapping[str, Any] | None = None, *, preset: str | None = None) -> Scene:
    """Load a built-in or installed scene by name, or a scene from a .toml or .py file by path.

    Args:
        name: Name of the scene, or path of its file.
        overrides: Values by dotted key, for example {"coupling.internal.stiffness": 50.0, "finger.*.device.mass": 0.2}.
            If the scene is a Python file, a key without a dot that is a parameter of its `scene()` is passed to
            `scene()`. All other keys replace values of the scene that `scene()` returns.
        preset: Name of one of the scene's presets. The values of the preset are applied before `overrides`.

    Raises:
        SceneError: If the scene has faults. The message lists all of them, with their lines if the file is TOML.
        UnknownNameError: If there is no scene of this name, or the scene has no such preset.
        InputError: If the file does not exist, or contains no scene.
        PluginError: If a Python file cannot be imported, or its `scene()` raises an exception.
    """
    path = plugins.find("scenes", name)
    text = file_text(path)
    source = Source(plugins.shown_path(path), text, path, by_key(overrides))
    if path.suffix == ".py":
        return _from_python(path, source, preset)
    table = parse(text, source.name)
    source = with_preset(source, table, preset)
    return make_scene(table, source.changes, source, lines_from=text)


def to_scene(scene: Scene | str | PathLike[str], overrides: Mapping[str, Any] | None = None) -> Scene:
    """Return a scene, which may be given by name or path, with values replaced by dotted key.

    Raises:
        InputError: If the argument is neither a scene nor a name or path. Other errors are those of `load`.
        SceneError: If the scene with its overrides has faults; the message lists all of them.
    """
    if isinstance(scene, str | PathLike):
        return load(scene, overrides)
    if not isinstance(scene, Readable):
        raise InputError("scene", scene, "a scene", "gx.load(name), or gx.Scene(...)")
    changes = by_key(overrides)
    return scene.replace(changes) if changes else scene


def file_text(path: Path) -> str:
    """Return the text of a scene's file.

    Raises:
        SceneError: If the file is not encoded in UTF-8; the message states the line.
    """
    name = plugins.shown_path(path)
    data = read_bytes(path, name)
    try:
        return data.decode()
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        fault = Fault("", f"not UTF-8: byte 0x{data[error.start]:02x}; save the file as UTF-8", line)
        raise SceneError(name, [fault]) from error


def parse(text: str, name: str) -> dict[str, Any]:
    """Return the tables of a TOML text; `name` is the name of the file in error messages.

    Raises:
        SceneError: If the text is not TOML, or exceeds the limits of `excess`; the message states the line.
    """
    if fault := excess(text):
        raise SceneError(name, [fault])
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        match = PLACE.search(str(error))
        line = int(match[1]) if match and match[1] else text.count("\n") + 1
        message = f"not TOML: {PLACE.sub('', str(error))}"
        raise SceneError(name, [Fault("", message, line)]) from error


def _from_python(path: Path, source: Source, preset: str | None) -> Scene:
    make = getattr(plugins.load_blaming("scenes", path), "scene", None)
    if not callable(make):
        raise InputError("scene", source.name, "a Python file with `def scene(**parameters) -> gx.Scene`")
    parameters = inspect.signature(make).parameters
    open_ended = any(each.kind is inspect.Parameter.VAR_KEYWORD for each in parameters.values())
    names = {name for name, each in parameters.items() if each.kind not in OPEN_ENDED}
    arguments = {
        key: value
        for key, value in source.overrides.items()
        if key in names or (open_ended and SIMPLE.match(key) and key not in Scene.model_fields)
    }
    faults = [*_unknown(source.overrides.keys() - arguments.keys(), names), *_missing(parameters, source.overrides)]
    if faults:
        raise SceneError(source.name, faults)
    try:
        with plugins.blaming(path):
            scene = make(**arguments)
    except SceneError as error:
        raise SceneError(source.name, error.faults) from error
    except plugins.PluginError:
        raise
    except GraspFXError as error:
        raise plugins.blamed(path, error, str(error)) from error
    if not isinstance(scene, Scene):
        raise InputError(f"scene() in {source.name}", scene, "a gx.Scene")
    table = scene.to_dict()
    source = with_preset(source, table, preset)
    rest = {key: value for key, value in source.changes.items() if key not in arguments}
    return make_scene(table, rest, source)


def _unknown(keys: AbstractSet[str], parameters: AbstractSet[str]) -> Iterator[Fault]:
    """Yield faults for keys of overrides that are neither parameters of `scene()` nor keys of a scene."""
    names = parameters | Scene.model_fields.keys()
    for key in sorted(keys):
        if key.split(".")[0] not in names:
            close = closest(key.partition(".")[0], names)
            hint = (
                f"; did you mean {close!r}?" if close else f"; scene() takes {', '.join(sorted(parameters)) or 'none'}"
            )
            yield Fault(key, f"unknown key{hint} (set by an override)")


def _missing(parameters: Mapping[str, inspect.Parameter], arguments: Mapping[str, Any]) -> Iterator[Fault]:
    for name, each in sorted(parameters.items()):
        if each.default is inspect.Parameter.empty and each.kind not in OPEN_ENDED and name not in arguments:
            yield Fault(name, "required by scene(), but not given")


# Presets -------------------------------------------------------------------------------------------------------------


def with_preset(source: Source, table: Mapping[str, Any], name: str | None) -> Source:
    """Return a source with the values of a preset of the scene; the same source if `name` is None.

    An invalid preset is treated as one without values. The validation of the scene reports its faults.

    Raises:
        UnknownNameError: If the scene has no preset of this name.
        InputError: If the name of the preset is not a string.
    """
    if name is None:
        return source
    if not isinstance(name, str):
        raise InputError("preset", name, "the name of a preset of the scene, as a string")
    presets = table.get("preset", {})
    if isinstance(presets, Mapping) and name not in presets:
        raise UnknownNameError("preset", name, presets, "" if presets else f"{source.name} has no presets")
    try:
        values = Preset.model_validate(presets[name] if isinstance(presets, Mapping) else None).set
    except ValidationError:
        values = {}
    return replace(source, preset=name, preset_values=values)


def preset_faults(scene: Scene) -> list[Fault]:
    """Return the faults that a scene has with each of its presets; none for a scene with a preset or overrides."""
    source = scene.source
    if source.changes:
        return []
    is_toml = source.path is not None and source.path.suffix == ".toml"
    table = tomllib.loads(source.text) if is_toml else scene.to_dict()
    faults: list[Fault] = []
    for name in scene.preset:
        under = with_preset(source, table, name)
        try:
            make_scene(table, under.changes, under, lines_from=source.text if is_toml else None).require_reach()
        except SceneError as error:
            faults += error.faults
    return faults
