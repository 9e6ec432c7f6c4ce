"""Presets of a scene: sets of overrides that it states by name, each with its reason."""

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
    """Add the values of a preset, by its name, to where a scene comes from; None adds nothing.

    A preset that is not well-formed has no values: the scene's validation says what is wrong with it.

    Raises:
        UnknownNameError: the scene has no preset of that name.
        InputError: the name is no text.
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
    """Find the faults of a scene under each of its presets, as its file states it; none of one with changes."""
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
