"""A value in millimetres, grams or degrees is asked about, by its key; those of the shelf are not."""

from __future__ import annotations

from typing import Any

import pytest

import graspfx as gx
from graspfx import plugins
from graspfx.certificate.notes.units import unit_notes


@pytest.mark.parametrize(
    ("name", "changes", "said"),
    [
        ("mug", {"finger.1.radius": 7.0}, "finger.1.radius = 7 m: check the unit"),
        ("mug", {"finger.1.start": [0.0, 30.0, 40.0]}, "finger.1.start from its object = 50 m: check the unit"),
        ("paper-spring", {"object.mass": 150.0}, "object.0.mass = 150 kg: check the unit"),
        ("paper-spring", {"finger.0.hand.squeeze": 3.0}, "finger.0.hand.squeeze = 3 m: check the unit"),
        ("mug", {"hand.squeeze": [{"to": 15, "begin": 0, "duration": 1}]}, "hand.0.squeeze = 15 m: check the unit"),
        (
            "mug",
            {"hand.motion": {"kind": "reach", "displacement": [0.0, 0.0, 80.0], "duration": 0.5}},
            "hand.0.motion.displacement = 80 m: check the unit",
        ),
        (
            "mug",
            {"hand.turn": {"kind": "reach", "angle": -90.0, "axis": "y", "duration": 0.5}},
            "hand.0.turn.angle = -90 rad: check the unit",
        ),
    ],
)
def test_a_wrong_unit_is_asked_about(name: str, changes: dict[str, Any], said: str) -> None:
    assert unit_notes(gx.load(name, changes)) == [said]


def test_the_shelf_is_in_si_units() -> None:
    for name, owner in plugins.names("scenes").items():
        if owner.startswith("GraspFX"):
            assert unit_notes(gx.load(name)) == [], name
