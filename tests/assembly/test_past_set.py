"""Writes into a block past `session.set`: what a program or a recording would not see raises."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

import pytest

import graspfx as gx
from graspfx.assembly.build import build
from graspfx.compile.records import name_of, start_of
from graspfx.coupling.grasp_state import GraspState
from graspfx.errors import InputError
from graspfx.recording.header import Header
from graspfx.recording.recorder import Recorder
from tests.support.steering import KEP, KID, KIP


def entry(name: str) -> int:
    return start_of(GraspState, name)


@pytest.mark.parametrize("engine", ["interpreted", "compiled", "auto"])
def test_gains_that_are_moved_apart_in_the_block_raise(engine: str) -> None:
    """Built with kep = kip and then moved apart by hand a run computed forces that were wrong by 7.4 mN."""
    scene = gx.load("paper-waving", {KIP: 30.0})
    with build(scene, engine=engine) as servo, Recorder(servo.layout, Header(scene.period)) as recorder:
        servo.objects[0].grasped.block[entry("internal_stiffness")] = 70.0
        with pytest.raises(InputError, match="equal: given True, expected a switch that agrees with the gains"):
            servo.run(1, recorder)
        assert servo.ticks == 0


@pytest.mark.parametrize("engine", ["compiled", "auto"])
@pytest.mark.parametrize(("field", "value"), [("equal", 0.0), ("damped", 1.0), ("implicit", 1.0), ("count", 3.0)])
def test_a_write_to_what_chooses_the_computation_raises(engine: str, field: str, value: float) -> None:
    scene = gx.load("paper-waving", {KIP: 30.0})
    with build(scene, engine=engine, record=False) as servo:
        servo.run(2, None)
        block = servo.objects[0].grasped.block
        before = block[entry(field)]
        block[entry(field)] = value
        with pytest.raises(InputError, match=rf"{field}: given"):
            servo.run(1, None)
        assert servo.ticks == 2
        block[entry(field)] = before
        servo.run(1, None)
        assert servo.ticks == 3


MATRICES = {KEP: [[60.0, 0.0], [0.0, 20.0]], KIP: [[70.0, 0.0], [0.0, 90.0]]}
PAST: dict[str, tuple[str, Mapping[str, Any], str, float]] = {  # scene, overrides, a field, what is written there
    "a matrix": ("paper-waving", MATRICES, "matrices[3]", 45.0),
    "an arm of the blend": ("thin-plate", {}, "arm_low", 0.01),
    "a gap of the fade": ("sphere-three-fingers", {}, "fade_end", 0.02),
    "a share": ("sphere-three-fingers", {}, "fingers[0].share", 5.0),
    "a patch": ("soft-pinch", {}, "fingers[1].patch", 0.02),
    "where the reaction is": ("paper-waving", {}, "at_contact", 1.0),
    "a free direction": ("thin-plate", {}, "body.free_rotation.z", 0.0),
}


@pytest.mark.filterwarnings("ignore::graspfx.grasp.impedance.ActiveCouplingWarning")
@pytest.mark.parametrize("engine", ["interpreted", "compiled", "auto"])
@pytest.mark.parametrize("case", PAST)
def test_a_number_that_is_written_past_set_raises(case: str, engine: str) -> None:
    """Matrices had no effect, and a recording divided forces by numbers that were no longer the sample's own."""
    name, overrides, field, value = PAST[case]
    for ticks in (0, 20):
        with gx.open(name, {**overrides, "engine": engine}, live=[KEP]) as session:
            if ticks:
                session.step(ticks)
            block = session.servo.objects[0].grasped.block
            [k] = [
                k for k in session.servo.objects[0].grasped.watched_entries if name_of(GraspState, k, block) == field
            ]
            before, block[k] = block[k], value
            old = session.get(KEP)
            where = re.escape(re.sub(r"\[\d+\]", "", field.rpartition(".")[2]))
            for attempt in (session.step, lambda s=session, v=old: s.set(KEP, v)):
                with pytest.raises(InputError, match=rf"{where}.*: given {value}, expected {before}.*use session.set"):
                    attempt()
            assert session.tick == ticks and not session.recording.changes
            block[k] = before
            session.step()


def test_gains_that_fit_the_switches_may_be_written() -> None:
    with build(gx.load("paper-waving"), engine="interpreted", record=False) as servo:
        servo.run(3, None)
        for stiffness in (65.0, 75.0):
            servo.objects[0].grasped.block[entry("internal_stiffness")] = stiffness
            servo.run(3, None)
            assert servo.objects[0].grasped.state.internal_stiffness == stiffness
        servo.objects[0].grasped.block[entry("internal_stiffness")] = 30.0
        with pytest.raises(InputError, match="equal: given False"):
            servo.run(1, None)


def test_live_entries_are_not_folded() -> None:
    names = ["equal", "damped", "singular", "gradual", "rays", "internal_stiffness", "internal_damping"]
    scene = gx.load("paper-spring", {KIP: 30.0})
    with build(scene, live=[KIP, KID]) as servo, build(scene) as plain:
        live, folded = (set(each.objects[0].grasped.structure.tolist()) for each in (servo, plain))
    assert not live & {entry(name) for name in names} and {entry(name) for name in names[:5]} <= folded
