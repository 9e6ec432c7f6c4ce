"""Structure of blocks: the entries that pick what is computed stay the same through a run of every scene."""

from __future__ import annotations

import numpy as np
import pytest

import graspfx as gx
from graspfx import plugins
from graspfx.assembly.build import build
from graspfx.compile.records import entries_of, start_of
from graspfx.coupling.grasp_state import FingerState, GraspState
from graspfx.recording.header import Header
from graspfx.recording.recorder import Recorder
from graspfx.surfaces.closed_form.proxy import MESH
from graspfx.surfaces.triangles import mesh_tree


@pytest.mark.parametrize("name", sorted(plugins.names("scenes")))
def test_structure_stays_the_same_through_a_run(name: str) -> None:
    """60 samples with the brake on, which is all that writes to the blocks; each entry a whole number, named once."""
    scene = gx.load(name, {"coupling.passivity": "control"})
    with build(scene) as servo:
        watched = [(held.grasped.block, held.grasped.structure) for held in servo.objects]
        before = [block.copy() for block, _ in watched]
        with Recorder(servo.layout, Header(scene.period)) as recorder:
            servo.run(60, recorder)
        assert servo.ticks == 60
        for (block, structure), old in zip(watched, before, strict=True):
            assert not np.array_equal(block, old, equal_nan=True)
            assert np.array_equal(block[structure], old[structure])
            assert np.array_equal(block[structure], np.round(block[structure]))
            assert len(structure) == len(set(structure.tolist()))


def test_what_a_finger_lacks_is_structure_and_what_it_has_is_not() -> None:
    with build(gx.load("soft-pinch")) as servo:
        soft = servo.objects[0].grasped
    with build(gx.load("paper-waving")) as servo:
        hard = servo.objects[0].grasped
    row = hard.state.fingers[1].offset
    patch, coefficient, radius = entries_of(FingerState, "patch", "coefficient", "radius", at=row)
    assert {patch, coefficient, radius} <= set(hard.structure.tolist())
    assert not {patch, coefficient} & set(soft.structure.tolist())


def test_offsets_of_a_mesh_are_structure() -> None:
    with build(gx.load("thin-plate")) as servo:
        thing = servo.objects[0].grasped
    assert thing.state.shape == MESH
    start = thing.state.mesh.offset
    walks = [finger.offset + start_of(FingerState, "walk") for finger in thing.state.fingers]
    assert {start_of(GraspState, "mesh"), *walks, *mesh_tree.choices(start)} <= set(thing.structure.tolist())
