"""Numbers of a scene are read by its program while it runs: another mass or period is no other program."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import pytest

import graspfx as gx
from graspfx.build.build import build
from graspfx.compile.program import program_key
from graspfx.errors import SceneError
from graspfx.loop.tick.engine_text import joined_texts, texts

SCENES = ("reference-1dof", "paper-spring-arms", "soft-pads", "sphere-three-fingers")


def numbers(table: Mapping[str, Any] | Sequence[Any], prefix: str = "") -> Iterator[tuple[str, float]]:
    """List the keys of a scene's numbers, those of zero apart: a zero says that something is not there."""
    for key, value in table.items() if isinstance(table, Mapping) else enumerate(table):
        if isinstance(value, Mapping | list):
            yield from numbers(value, f"{prefix}{key}.")
        elif isinstance(value, float) and value:
            yield f"{prefix}{key}", value


def programs(scene: gx.Scene) -> tuple[list[str], list[str]]:
    """Name the specialised programs of a scene, and write the texts that are compiled with generic kernels."""
    with build(scene, engine="interpreted") as servo:
        tick = servo.script
        script = tick.script
        keys = [program_key(text, script.kernels, list(script.arrays), script.frozen) for text in texts(tick).values()]
        return keys, list(joined_texts(tick).values())


@pytest.mark.parametrize("name", SCENES)
def test_no_number_of_a_scene_recompiles_its_program(name: str) -> None:
    scene = gx.load(name)
    before = programs(scene)
    keys = dict(numbers(scene.to_dict()))
    assert "period" in keys and any(key.endswith("mass") for key in keys)
    tried = 0
    for key, value in keys.items():
        try:
            other = programs(scene.replace({key: 1.03 * value}))
        except SceneError:  # an orientation that is none, an object inside an obstacle
            continue
        assert other == before, key
        tried += 1
    assert tried > 0.8 * len(keys)


def test_another_structure_is_another_program() -> None:
    scene = gx.load("reference-1dof")
    assert programs(scene)[0] != programs(scene.replace({"coupling.internal.stiffness": 30.0}))[0]  # equal gains
