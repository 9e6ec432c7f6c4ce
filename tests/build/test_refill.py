"""Numbers of a scene go to declared fields by one function each, and filling them in is building, bit by bit."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest

import graspfx as gx
from graspfx.build.build import build
from graspfx.build.reach import reach
from graspfx.build.refill import refill
from graspfx.build.resolve import resolve
from graspfx.compile.entry_names import name_of
from graspfx.coupling.grasp_state import GraspState
from graspfx.errors import InputError
from graspfx.loop.tick.text import write

CASES: dict[str, dict[str, tuple[Any, set[str]]]] = {  # by scene and key: another value, and what it changes
    "reference-1dof": {
        "coupling.external.stiffness": (35.0, {"external_stiffness"}),
        "coupling.internal.stiffness": (65.0, {"internal_stiffness"}),
        "coupling.external.damping": (0.1, {"external_damping", "damped"}),
        "object.mass": (0.13, {"body.mass"}),
        "object.viscosity": (0.9, {"body.viscosity"}),
        "finger.*.hand.stiffness": (36.0, {"plant"}),
        "finger.0.hand.stiffness": (36.0, {"plant"}),
        "finger.*.device.mass": (0.16, {"plant"}),
        "finger.0.start": ([0.003], {"plant"}),
    },
    "paper-waving": {
        "coupling.internal.stiffness": (90.0, {"internal_stiffness"}),
        "object.mass": (0.12, {"body.mass", "body.inertia"}),
        "object.velocity": ([0.01, 0.0], {"body.motion.velocity"}),
        "object.position": (
            [0.001, 0.0],
            {"body.motion.position", "fingers.contact_world", "fingers.displacement", "fingers.gap"},
        ),
    },
    "twenty-fingers": {  # on a mesh, where contacts walk from triangle to triangle
        "finger.*.radius": (
            0.004,
            {
                "fingers.radius",
                "fingers.contact",
                "fingers.normal",
                "fingers.face",
                "fingers.frame",
                "fingers.gap",
                "fingers.contact_world",
                "fingers.displacement",
                "walks",
                "hand",
            },
        ),
    },
    "unequal-devices": {
        "coupling.external.stiffness": (31.0, {"external_stiffness", "fade_start", "fade_end"}),
        "finger.0.device.mass": (0.21, {"fingers.share", "fingers.weight", "plant"}),
    },
}


@pytest.mark.parametrize(("name", "key"), [(name, key) for name, keys in CASES.items() for key in keys])
def test_a_key_reaches_the_fields_that_its_part_declares_and_filling_in_is_building(name: str, key: str) -> None:
    """The fields of grasps, and the other blocks, in which two scenes as they are built differ; then they are equal."""
    value, fields = CASES[name][key]
    scene = gx.load(name)
    other = scene.replace({key: value})
    with build(scene) as servo, build(other) as fresh:
        blocks, expected = write(servo.parts).script.arrays, write(fresh.parts).script.arrays
        grasps = {id(held.grasped.block) for held in servo.objects}
        differ = set()
        for each, array in blocks.items():
            for entry in np.flatnonzero(array.view(np.int64) != expected[each].view(np.int64)).tolist():
                if id(array) in grasps:
                    text = re.sub(r"\[[^]]*\]|\.[xyzw]+$", "", name_of(GraspState, entry, array))
                    differ.add(text or "walks")  # they stand behind the declared fields
                else:
                    differ.add(each.rstrip("0123456789"))
        refill(servo, resolve(other))
        assert {each: array.tobytes() for each, array in blocks.items()} == {
            each: array.tobytes() for each, array in expected.items()
        }
    declared = reach(key)
    assert {each for each in differ if each not in ("device", "plant", "hand")} <= declared.get("grasp", set())
    assert differ & {"device", "plant", "hand"} <= declared.keys()
    assert differ == fields


def test_a_scene_with_more_than_blocks_is_to_be_built() -> None:
    scene = gx.load("reference-1dof")
    with build(scene) as servo, pytest.raises(InputError, match="another period"):
        refill(servo, resolve(scene.replace({"period": 0.002})))
    with build(scene.replace({"coupling.passivity": "observe"})) as servo, pytest.raises(InputError, match="a ledger"):
        refill(servo, resolve(scene))
