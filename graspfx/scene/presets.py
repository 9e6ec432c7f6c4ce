"""Presets of a scene: named sets of overrides, each with a reason."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from pydantic import ValidationError

from graspfx.errors import Fault, InputError, SceneError, UnknownNameError
from graspfx.scene.model import Scene, make_scene
from graspfx.scene.source import Source
from graspfx.scene.tables.preset_table import Preset


def with_preset(source: Source, table: Mapping[str, Any], name: str | None) -> Source:
    """Add the values of a named preset to a scene's source; None adds nothing.

    An invalid preset has no values; the validation of the scene reports its faults.

    Raises:
        UnknownNameError: The scene has no preset of that name.
        InputError: The name is not a string.
    """
    if name is None:
        return source
    if not isinstance(name, str):
        raise InputError("preset", name, "the name of one of the scene's presets")
    presets = table.get("preset", {})
    if isinstance(presets, Mapping) and name not in presets:
        raise UnknownNameError("preset", name, presets, "" if presets else f"{source.name} has no presets")
    try:
        values = Preset.model_validate(presets[name] if isinstance(presets, Mapping) else None).set
    except ValidationError:
        values = {}
    return replace(source, preset=name, preset_values=values)


def preset_faults(scene: Scene) -> list[Fault]:
    """Find the faults of a scene under each of its presets; a scene with changes has none."""
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
