"""The tables `safety` of a scene: defaults, and faults that say what was given and what was expected."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import graspfx as gx
from graspfx.assembly.resolve import resolve
from graspfx.errors import SceneError
from tests.support.optional import require

FAULTS: list[tuple[dict[str, Any], str, str]] = [
    ({"safety.force": 0.0}, "safety.force", "expected more than 0"),
    ({"safety.force": "much"}, "safety.force", "expected a number"),
    ({"safety.rate": -1.0}, "safety.rate", "expected more than 0"),
    ({"safety.speed": float("nan")}, "safety.speed", "expected a finite number"),
    ({"safety.hold": 1.5}, "safety.hold", "expected a whole number"),
    ({"safety.hold": -1}, "safety.hold", "expected no less than 0"),
    ({"safety.soft_start": -0.1}, "safety.soft_start", "expected no less than 0"),
    ({"safety.watchdog": 1e-4}, "safety.watchdog", "expected no less than the period, 0.005 s; given 0.0001"),
    ({"safety.workspace": [[0.1], [-0.1]]}, "safety.workspace", "with lower < upper on every axis"),
    ({"safety.workspace": [[-0.1, -0.1]]}, "safety.workspace", "two corners"),
    ({"safety.workspace": 3.0}, "safety.workspace", "two corners"),
    ({"safety.workspace": "mine"}, "safety.workspace", "'device' or 'none'"),
    ({"safety.workspace": [[-0.1, -0.1], [0.1, 0.1]]}, "safety.workspace", "two corners of 1 number"),
    ({"safety.forse": 2.0}, "safety.forse", "did you mean"),
    ({"finger.0.safety.force": 2.0}, "finger.0.safety", "a simulation has no safety chain"),
    ({"safety.hold": 3, "finger.0.safety.rate": 0.0}, "finger.0.safety.rate", "expected more than 0"),
    ({"safety.hold": 3, "finger.1.safety.workspace": [[0.0, 0.0], [1.0, 1.0]]}, "finger.1.safety.workspace",
     "two corners of 1 number"),
]  # fmt: skip


@pytest.mark.parametrize(("changes", "key", "text"), FAULTS)
def test_a_value_that_is_none_is_a_fault_at_its_key(changes: dict[str, Any], key: str, text: str) -> None:
    with pytest.raises(SceneError) as caught:
        gx.load("reference-1dof", changes)
    [fault] = caught.value.faults
    assert fault.key == key
    assert text in fault.message


def test_a_scene_without_the_table_has_no_limits_of_it() -> None:
    scene = gx.load("reference-1dof")
    assert scene.safety is None
    assert resolve(scene).safety is None
    assert resolve(scene).limits is None


def test_defaults() -> None:
    """3 N where the device tells no continuous force; no rate, no speed, no box; 3 samples, half a second."""
    limits = require(resolve(gx.load("reference-1dof", {"safety.hold": 3})).safety)
    np.testing.assert_array_equal(limits.force, [3.0, 3.0])
    assert (limits.hold, limits.soft_start) == (3, 0.5)
    for values in (limits.rate, limits.speed, -limits.lower, limits.upper):
        assert np.isinf(values).all()


def test_a_devices_own_figures_are_taken() -> None:
    """0.6 of the continuous force and the box that a two-link arm tells; a finger's own value comes first."""
    scene = gx.load("paper-waving", {"safety.hold": 3, "finger.0.safety.rate": 10.0, "safety.rate": 20.0})
    parts = resolve(scene)
    limits = require(parts.safety)
    for wire in parts.wires:
        continuous, box = wire.features.continuous_force, wire.features.workspace
        for f in wire.used.tolist():
            assert limits.force[f] == (3.0 if continuous is None else 0.6 * continuous)
            if box is not None:
                np.testing.assert_array_equal([limits.lower[f], limits.upper[f]], box)
    np.testing.assert_array_equal(limits.rate, [10.0, 20.0])


def test_a_scene_writes_and_reads_its_table() -> None:
    scene = gx.load("reference-1dof", {"safety.workspace": [[-0.1], [0.1]], "safety.force": 2.0})
    assert scene.to_dict()["safety"] == {"workspace": [[-0.1], [0.1]], "force": 2.0}
    assert gx.Scene(**scene.to_dict()) == scene
