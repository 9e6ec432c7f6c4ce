"""A scene by name or path: a TOML table, or a Python file with `def scene(**parameters) -> Scene`."""

from __future__ import annotations

import inspect
import re
import tomllib
from collections.abc import Mapping
from os import PathLike
from pathlib import Path
from typing import Any

from graspfx import plugins
from graspfx.errors import Fault, InputError, SceneError
from graspfx.scene.model import Scene, Source, make_scene

PLACE = re.compile(r"\s*\(at (?:line (\d+), column \d+|end of document)\)$")
SIMPLE = re.compile(r"^[A-Za-z_]\w*$")


def load(name: str | PathLike[str], overrides: Mapping[str, Any] | None = None) -> Scene:
    """The scene behind a name on the shelf or the path of a .toml or .py file.

    Args:
        name: of a scene, or a path.
        overrides: values by dotted key, as in {"coupling.internal.stiffness": 50.0, "finger.*.device.mass": 0.2}.
            For a Python scene a key without a dot that `scene()` takes is its parameter, any other a key of what it
            returns.

    Raises:
        SceneError: with every fault at once, each with its line.
        UnknownNameError: no scene has that name.
        InputError: the path leads to no file, or the file holds no scene.
    """
    path = plugins.find("scenes", name)
    text = path.read_text(encoding="utf-8")
    source = Source(_shown_path(path), text, path, dict(overrides or {}))
    if path.suffix == ".py":
        return _from_python(path, source)
    return make_scene(_parsed(text, source.name), source.overrides, source, lines_from=text)


def _parsed(text: str, name: str) -> dict[str, Any]:
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        found = PLACE.search(str(error))
        line = int(found[1]) if found and found[1] else text.count("\n") + 1
        message = f"not TOML: {PLACE.sub('', str(error))}"
        raise SceneError(name, [Fault("", message, line)]) from error


def _from_python(path: Path, source: Source) -> Scene:
    make = getattr(plugins.load("scenes", path), "scene", None)
    if not callable(make):
        raise InputError("scene", source.name, "a Python file with `def scene(**parameters) -> gx.Scene`")
    parameters = inspect.signature(make).parameters
    open_ended = any(each.kind is inspect.Parameter.VAR_KEYWORD for each in parameters.values())
    named = {name for name, each in parameters.items() if each.kind is not inspect.Parameter.VAR_KEYWORD}
    taken = {
        key: value
        for key, value in source.overrides.items()
        if key in named or (open_ended and SIMPLE.match(key) and key not in Scene.model_fields)
    }
    missing = [
        name for name in named if parameters[name].default is inspect.Parameter.empty and name not in source.overrides
    ]
    if missing:
        raise SceneError(source.name, [Fault(name, "required by scene(), but not given") for name in sorted(missing)])
    try:
        scene = make(**taken)
    except SceneError as error:
        raise SceneError(source.name, error.faults) from error
    if not isinstance(scene, Scene):
        raise InputError(f"scene() in {source.name}", scene, "a gx.Scene")
    rest = {key: value for key, value in source.overrides.items() if key not in taken}
    return make_scene(scene.to_dict(), rest, source)


def _shown_path(path: Path) -> str:
    """Relative to the current folder when it lies inside, as a terminal can follow it."""
    here = Path.cwd()
    return str(path.relative_to(here)) if path.is_relative_to(here) else str(path)
