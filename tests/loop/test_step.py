"""The step is the tick of the paper, stage by stage, and its rows hold what the parts hold."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import graspfx as gx
from graspfx.assembly.build import build
from graspfx.compile.kernel import written
from graspfx.compile.records import Floats
from graspfx.loop import step
from graspfx.loop.world import BEGIN, WRITE, ServoState, World
from tests.support.engines import TICKS, recorded
from tests.support.small_scenes import line

SINE = {"kind": "sine", "amplitude": 0.002, "frequency": 4.0, "axis": [1.0]}
SCENES: dict[str, gx.Scene] = {
    "line": line(),
    "limits": line(finger__1__device__force_limit=0.1, finger__0__device__resolution=1e-5),
    "a ledger": line(coupling__passivity="control"),
    "a safety chain": line(safety__force=0.5, safety__rate=20.0),
    "implicit": line(object__integrator="implicit", coupling__friction=0.5),
    "a fault": line(finger__0__device__workspace=[[-0.0252], [-0.0249]], finger__0__hand__squeeze=0.02),
    "hands that move": line(finger__0__hand__motion=SINE, finger__1__hand__motion=SINE),
    "reference-1dof": gx.load("reference-1dof"),
    "paper-spring-arms": gx.load("paper-spring-arms"),
    "sphere-three-fingers": gx.load("sphere-three-fingers"),
}


def plain_loop(scene: gx.Scene, ticks: int) -> dict[str, Any]:
    """Tick by tick in plain Python, stage by stage, on records; what is seen is read from the parts by their own views.

    Positions, velocities and forces as they stand when forces are displayed; bodies as they stand then.
    """
    seen: dict[str, list[Any]] = {name: [] for name in ("position", "velocity", "force", "displayed", "body")}
    with build(scene, engine="interpreted") as servo:
        arena = servo.arena
        world = World(arena.buffer, arena.offset)
        own = ServoState(arena.buffer, world.servo)
        rows = Floats(np.zeros(servo.layout.width))
        for k in range(ticks):
            for stage, arguments in (
                (step.take, (k,)), (step.read, (k,)), (step.predict, ()), (step.couple_objects, (k,)),
                (step.add_work, (k,)),
            ):  # fmt: skip
                written(stage)(world, own, *arguments)
            if own.faulted:
                step.release(world)
            step.display(world, own, k)
            if own.faulted:
                step.stop(world)
            fingers: dict[str, Any] = {name: np.zeros((arena.n, arena.d)) for name in ("position", "velocity", "force")}
            for part in servo.objects:
                fingers["position"][part.fingers] = part.grasped.finger_position
                fingers["velocity"][part.fingers] = part.grasped.finger_velocity
                fingers["force"][part.fingers] = part.grasped.force
            for name, values in fingers.items():
                seen[name].append(values)
            seen["displayed"].append([[own.displayed[f, a] for a in range(arena.d)] for f in range(arena.n)])
            seen["body"].append([mover.body.position.copy() for mover in servo.movers])
            written(step.record)(world, k, 0, rows)
            step.move(world, own, k)
            step.advance(world, own, k)
    return {name: np.array(values) for name, values in seen.items()}


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize("engine", ["interpreted", "compiled"])
def test_rows_are_what_a_plain_loop_over_the_stages_sees(name: str, engine: str) -> None:
    scene = SCENES[name]
    ticks = 40 if scene.dimensions == 1 else 6
    seen, recording = plain_loop(scene, ticks), recorded(scene, engine, ticks=ticks)
    assert recording.finger_position.tobytes() == seen["position"].tobytes()
    assert recording.finger_velocity.tobytes() == seen["velocity"].tobytes()
    assert recording.finger_force.tobytes() == seen["force"].tobytes()
    assert np.array_equal(recording.displayed_force, seen["displayed"])  # a force that was stopped is 0, or -0
    for i, thing in enumerate(recording.objects.values()):
        assert thing.position.tobytes() == np.ascontiguousarray(seen["body"][:, i]).tobytes()
    assert np.ptp(recording.finger_position) > 0.0
    assert bool(recording.faults) == (name == "a fault")


def test_a_tick_with_devices_in_plain_python_is_two_calls(tmp_path: Any) -> None:
    from tests.support import foreign_parts

    files = foreign_parts.write(tmp_path)
    scene = line(finger__0__device=foreign_parts.device(files, "device", mass=0.15, damping=0.2))
    with build(scene, engine="interpreted", record=False) as servo:
        engine, world = servo.engine, servo.arena.world
        engine.write_to(np.empty((1, servo.layout.width)))
        assert world.phase == BEGIN
        assert engine.run(0, 5, 0) == 0 and world.phase == WRITE
        assert engine.run(0, 5, 0) == 1 and world.phase == BEGIN


@pytest.mark.parametrize("engine", ["interpreted", "compiled"])
def test_the_tick_of_the_first_fault_is_the_last_of_a_call(engine: str) -> None:
    scene = SCENES["a fault"]
    [fault] = recorded(scene, engine).faults
    with build(scene, engine=engine, record=False) as servo:
        run = servo.engine
        run.write_to(np.empty((1, servo.layout.width)))
        assert run.run(0, TICKS, 0) == fault.tick + 1
        assert run.run(fault.tick + 1, 7, 0) == 7
        assert ServoState(servo.arena.own.data).tick == fault.tick


@pytest.mark.parametrize("engine", ["interpreted", "compiled"])
def test_every_third_tick_is_recorded_where_the_scene_says_so(engine: str) -> None:
    whole = gx.run(line(engine=engine), duration=0.1)
    thin = gx.run(line(engine=engine, record={"every": 3}), duration=0.1)
    assert thin.finger_force.tobytes() == whole.finger_force[::3].tobytes()
    assert thin.displayed_force.tobytes() == whole.displayed_force[::3].tobytes()
