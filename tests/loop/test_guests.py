"""Bodies that other software moves: the same bits by kernels between two calls, tick by tick and by `step`."""

from __future__ import annotations

import gc
import sys
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import graspfx as gx
from graspfx.assembly.build import build
from graspfx.loop.servo_parts import BodyGroup, guest_of
from graspfx.objects import guest
from graspfx.objects import integrators as at
from graspfx.objects.body import fill_body
from graspfx.objects.bullet.bullet import BulletBody, pybullet
from graspfx.recording.header import Header
from graspfx.recording.recorder import Recorder
from graspfx.spatial import Vector
from tests.support.carriers import require

Array = NDArray[np.float64]
SCENES: dict[str, tuple[str, dict[str, Any]]] = {
    "line": ("reference-1dof", {"object.dynamics": "bullet"}),
    "plane": ("paper-waving-turning", {"object.dynamics": "bullet"}),
    "world": ("two-objects", {}),
    "plane, MuJoCo": ("paper-waving-turning", {"object.dynamics": "mujoco"}),
    "world, MuJoCo": ("two-objects", {"object.*.dynamics": "mujoco"}),
}


def rows(name: str, ticks: int, engine: str, run: Callable[[Any, Recorder, int], None], **changes: Any) -> Any:
    scene, overrides = SCENES[name]
    require("mujoco" if "MuJoCo" in name else "bullet")
    loaded = gx.load(scene, {**overrides, "engine": engine, **changes})
    with build(loaded) as servo, Recorder(servo.layout, Header(loaded.period)) as recorder:
        run(servo, recorder, ticks)
        end = [held.grasped.body_state.copy() for held in servo.objects]
        return recorder.finish(), end


def at_once(servo: Any, recorder: Recorder, ticks: int) -> None:
    servo.run(ticks, recorder)


def one_by_one(servo: Any, recorder: Recorder, ticks: int) -> None:
    for _ in range(ticks):
        servo.tick(recorder)


def watched(servo: Any, recorder: Recorder, ticks: int) -> None:
    servo.run(ticks, recorder, stop=lambda: False)


def by_steps(servo: Any, recorder: Recorder, ticks: int) -> None:
    """Move the body as one without kernels would be moved."""
    servo.movers = [BodyGroup(Stepped(mover.body), mover.objects) for mover in servo.movers]
    servo.run(ticks, recorder)


class Stepped:
    """A body of which only `step` is shown."""

    def __init__(self, body: Any) -> None:
        self.step = body.step


@pytest.mark.parametrize("name", SCENES)
def test_all_ways_to_run_give_the_same_bits(name: str) -> None:
    expected, end = rows(name, 60, "interpreted", by_steps)
    for way in (at_once, one_by_one, watched):
        found, state = rows(name, 60, "interpreted", way)
        np.testing.assert_array_equal(found.rows, expected.rows)
        np.testing.assert_array_equal(state, end)


@pytest.mark.parametrize("name", ["line", "plane", "plane, MuJoCo"])
def test_compiled_and_interpreted_give_the_same_bits(name: str) -> None:
    pytest.importorskip("llvmlite")
    expected, end = rows(name, 300, "interpreted", at_once)
    found, state = rows(name, 300, "compiled", at_once)
    np.testing.assert_array_equal(found.rows, expected.rows)
    np.testing.assert_array_equal(state, end)


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize("way", [at_once, one_by_one, watched])
def test_exchanges_in_machine_code_and_in_python_give_the_same_bits(
    name: str, way: Callable[[Any, Recorder, int], None]
) -> None:
    pytest.importorskip("llvmlite")
    expected, end = rows(name, 150, "interpreted", at_once)
    found, state = rows(name, 150, "compiled", way)
    np.testing.assert_array_equal(found.rows.view(np.int64), expected.rows.view(np.int64))
    np.testing.assert_array_equal(np.asarray(state).view(np.int64), np.asarray(end).view(np.int64))


@pytest.mark.parametrize("engine", ["interpreted", "compiled"])
def test_what_pybullet_raises_ends_the_run_where_it_stood(engine: str) -> None:
    """The ticks before are there; that of the exchange is none yet."""
    require("bullet")
    pytest.importorskip("llvmlite")
    scene, overrides = SCENES["plane"]
    loaded = gx.load(scene, {**overrides, "engine": engine})
    with build(loaded) as servo, Recorder(servo.layout, Header(loaded.period)) as recorder:
        servo.run(100, recorder)
        servo.movers[0].body.close()
        with pytest.raises(pybullet().error, match="Not connected"):
            servo.run(100, recorder)
        assert servo.ticks == recorder.ticks == 100


def test_a_hundred_thousand_exchanges_leave_nothing_behind() -> None:
    """Neither memory nor references: what PyBullet is given and gives is let go."""
    require("bullet")
    pytest.importorskip("llvmlite")
    leave_nothing_behind(BulletBody)


@pytest.mark.parametrize("engine", ["interpreted", "compiled"])
@pytest.mark.parametrize("way", [at_once, one_by_one, watched])
@pytest.mark.parametrize("ticks", [1, 3])
def test_a_turn_too_fast_is_a_fault_of_the_next_tick(
    way: Callable[[Any, Recorder, int], None], ticks: int, engine: str
) -> None:
    """45 degrees a sample are 157.1 rad/s at 5 ms; the fault is there when the run is over, whatever comes after."""
    recording, [state] = rows("plane", ticks, engine, way, **{"object.angular_velocity": 900.0})
    [fault] = recording.faults
    assert fault.tick == 1
    assert "at most 157.1 rad/s" in fault.message
    assert not recording.finger_force[1:].any()
    assert state[at.ANGLE] == 0.0  # stays as it was


def test_a_hundred_thousand_steps_of_mujoco_leave_nothing_behind() -> None:
    """Neither memory nor references, nor are its arrays moved."""
    pytest.importorskip("llvmlite")
    require("mujoco")
    from graspfx.objects.mujoco.mujoco import MujocoBody

    leave_nothing_behind(MujocoBody)


def leave_nothing_behind(kind: Any) -> None:
    """Move a body by a hundred thousand exchanges, and count references and blocks of memory before and after."""
    from graspfx.compile.exchange import MachineExchange

    state = np.zeros(at.SIZE)
    fill_body(state, dimensions=2, mass=0.1, inertia=1e-4, viscosity=0.8)
    body = kind(state)
    body.hold(1e-6)
    run = MachineExchange(body.calls)
    push = guest.GuestState(memoryview(body.buffer))
    push.push, push.twist = Vector(1e-3, 2e-3, 0.0), Vector(0.0, 0.0, 1e-9)
    parts = [part for call in body.calls for part in (call.function, call.arguments, call.sends) if part != ()]
    for _ in range(1000):
        run()
    gains = []
    for _ in range(3):  # threads that other tests left may allocate meanwhile; a leak would show every time
        gc.collect()
        before = *map(sys.getrefcount, parts), sys.getallocatedblocks()
        for _ in range(100_000):
            run()
        gc.collect()
        after = *map(sys.getrefcount, parts), sys.getallocatedblocks()
        assert after[:-1] == before[:-1]
        gains.append(abs(after[-1] - before[-1]))
    assert min(gains) < 200
    assert push.velocity.y == pytest.approx(2.0 * push.velocity.x) != 0.0
    body.close()


def test_what_pybullet_is_not_asked_for_is_what_it_would_say() -> None:
    """The position of bodies that cannot turn, to the last bit: masses 1 mg to 1 t, from 1 mm to 1 km away."""
    require("bullet")
    rng = np.random.default_rng(7)
    for case in range(20):
        d = 1 + case % 3
        state = np.zeros(at.SIZE)
        fill_body(
            state, dimensions=d, mass=10 ** rng.uniform(-6, 3), viscosity=0.8 * (case % 2), inertia=1.0,
            position=rng.normal(size=d) * 10 ** rng.uniform(-3, 3), velocity=rng.normal(size=d),
            free=[True] * d + [False] * (0, 1, 3)[d - 1],
        )  # fmt: skip
        body = BulletBody(state)
        for _ in range(200):
            state[at.FORCE : at.FORCE + d] = rng.normal(size=d) * state[at.MASS]
            body.step(0.0037)
            place, _ = pybullet().getBasePositionAndOrientation(body.carried[0].body, body.client)
            assert tuple(state[at.POSITION : at.POSITION + 3]) == place
        body.close()


def test_a_step_of_ones_own_is_called() -> None:
    require("bullet")

    class Slower(BulletBody):
        def step(self, T: float) -> None:
            super().step(0.5 * T)

    class Told(BulletBody):
        def exchange(self) -> None:
            super().exchange()

    state = np.zeros(at.SIZE)
    fill_body(state, dimensions=1, mass=0.1)
    assert guest_of(Slower(state)) is None
    assert guest_of(object()) is None
    for kind in (BulletBody, Told):
        body = kind(state)
        assert guest_of(body) is body
