"""The tank of energy that pays for stiffness: gain changes in a session, and soft starts under load."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import graspfx as gx
from graspfx.coupling.grasp_state import GraspState
from graspfx.errors import InputError
from graspfx.loop.safety.safety_state import SafetyState
from tests.support.optional import require

INTERNAL, EXTERNAL = "coupling.internal.stiffness", "coupling.external.stiffness"


def squeeze(**changes: Any) -> gx.Scene:
    """Two fingers on a line that squeeze a box held still by its viscosity: at 30 N/m with 0.1 N or so each."""
    table = {
        "dimensions": 1, "period": 0.001, "duration": 1.0,
        "object": {"mass": 0.1, "viscosity": 5.0, "shape": {"kind": "box", "size": [0.05]}},
        "coupling": {"external": {"stiffness": 30.0}, "internal": {"stiffness": 30.0}, "absent": "follow"},
        "safety": {"soft_start": 0.0, "force": 3.0},
        "finger": [
            {
                "start": [side * 0.025], "device": {"name": "simulated", "mass": 0.1, "damping": 1.0},
                "hand": {"stiffness": 100.0, "damping": 2.0, "squeeze": 0.015, "closing": [-side]},
            }
            for side in (-1.0, 1.0)
        ],
    }  # fmt: skip
    return gx.Scene(**table).replace({key.replace("__", "."): value for key, value in changes.items()})


def chain(session: gx.Session) -> SafetyState:
    return SafetyState(require(session.servo.safety).buffers[0])


def grasp(session: gx.Session) -> GraspState:
    return session.servo.objects[0].grasped.state


def stored(session: gx.Session) -> float:
    """Energy of the springs by numpy: f'K^-1 f/2 of the projectors of two fingers on a line."""
    block, gain = grasp(session), chain(session).gain
    f = np.array([finger.elastic.x for finger in block.fingers])
    P = np.full((2, 2), 0.5)
    K = gain * (block.external_stiffness * P + block.internal_stiffness * (np.eye(2) - P))
    return 0.5 * float(f @ np.linalg.solve(K, f))


@pytest.mark.parametrize("engine", ["interpreted", "compiled"])
def test_a_gain_change_under_load_is_paid_by_the_tank(engine: str) -> None:
    """30 to 400 N/m under 0.3 N: dV = w'dK w/2 leaves the tank, exactly, and the springs store so much more.

    The tank is full at first: 9 N at both fingers by 30 N/m is 2.7 J.
    """
    with gx.open(squeeze(engine=engine, safety__force=9.0), live=[INTERNAL, EXTERNAL]) as session:
        session.step(400)
        assert chain(session).tank.level == chain(session).tank.most == pytest.approx(2.7, rel=1e-12)
        force, before = session.force.copy(), stored(session)
        w = force[:, 0] / 30.0  # of a pure squeeze, while gains are equal
        assert w[0] > 0.005
        price = 0.5 * 370.0 * float(w @ w)
        session.set({INTERNAL: 400.0, EXTERNAL: 400.0})
        session.step()
        assert chain(session).tank.level == pytest.approx(2.7 - price, rel=1e-12)
        assert (grasp(session).internal_stiffness, bool(grasp(session).equal)) == (400.0, True)
        assert stored(session) - before == pytest.approx(price, rel=0.01)  # but for the motion of one sample
        session.step(50)
        w = session.force[:, 0] / 400.0
        level = chain(session).tank.level
        session.set({INTERNAL: 30.0, EXTERNAL: 30.0})  # and back: what softer springs release is in the tank again
        session.step()
        assert chain(session).tank.level == pytest.approx(level + 0.5 * 370.0 * float(w @ w), rel=1e-12)
        assert [change.value for change in session.recording.changes] == [400.0, 400.0, 30.0, 30.0]


def test_modes_that_carry_no_load_cost_nothing() -> None:
    """A pure squeeze: kep from 30 to 400 is free, kip pays for itself; from unequal gains, by the modes."""
    with gx.open(squeeze(coupling__external__stiffness=31.0), live=[INTERNAL, EXTERNAL]) as session:
        session.step(600)
        level = chain(session).tank.level
        f = session.force[:, 0]
        push, pinch = float(f.sum()) ** 2 / 2.0, float(f[0] - f[1]) ** 2 / 2.0
        session.set(EXTERNAL, 400.0)
        session.step()
        assert level - chain(session).tank.level == pytest.approx(0.5 * 369.0 * push / 31.0**2, abs=1e-12)
        assert push < 1e-12
        level = chain(session).tank.level
        f = session.force[:, 0]
        push, pinch = float(f.sum()) ** 2 / 2.0, float(f[0] - f[1]) ** 2 / 2.0
        session.set(INTERNAL, 60.0)
        session.step()
        assert level - chain(session).tank.level == pytest.approx(0.5 * 30.0 * pinch / 30.0**2, rel=1e-9)


def test_a_tank_with_too_little_takes_a_part_of_the_change() -> None:
    """With 1 mJ left, K0 + (E/dV) dK, then nothing more until something fills it: here the load is let go of."""
    squeezes = ["finger.0.hand.squeeze", "finger.1.hand.squeeze"]
    with gx.open(squeeze(), live=[INTERNAL, EXTERNAL, *squeezes]) as session:
        session.step(400)
        chain(session).tank.level = 1e-3
        w = session.force[:, 0] / 30.0
        price = 0.5 * 370.0 * float(w @ w)
        assert price > 2e-3
        before, force = stored(session), session.force.copy()
        session.set({INTERNAL: 400.0, EXTERNAL: 400.0})
        session.step()
        k = 30.0 + 370.0 * 1e-3 / price
        assert grasp(session).internal_stiffness == pytest.approx(k, rel=1e-12)
        assert grasp(session).external_stiffness == grasp(session).internal_stiffness
        assert chain(session).tank.level == pytest.approx(0.0, abs=1e-15)
        assert stored(session) - before < 1e-3 + float(np.abs(force).sum()) * 1e-4  # and the work of one sample
        session.step(100)
        assert grasp(session).internal_stiffness == pytest.approx(k, rel=1e-12)
        assert chain(session).changing
        session.set(dict.fromkeys(squeezes, 0.0))
        session.step(300)
        assert not session.force.any()
        assert grasp(session).internal_stiffness == 400.0
        assert not chain(session).changing


@pytest.mark.parametrize(("new", "share"), [(400.0, 0.0), (20.0, 1.0)])
def test_a_tank_below_zero_pays_for_nothing_and_takes_what_is_released(new: float, share: float) -> None:
    """Damping that gave energy back may have drawn it: gains stay, or fall, and never move the other way."""
    with gx.open(squeeze(safety__soft_start=0.2), live=[INTERNAL, EXTERNAL]) as session:
        session.step(400)
        chain(session).tank.level = -0.5
        session.set({INTERNAL: new, EXTERNAL: new})
        session.step()
        assert grasp(session).internal_stiffness == 30.0 + share * (new - 30.0)
        level = chain(session).tank.level
        assert level == -0.5 if share == 0.0 else -0.5 < level < -0.4
    with gx.open(squeeze(safety__soft_start=0.2)) as session:
        session.step(150)
        chain(session).tank.level = -0.5
        gain = chain(session).gain
        assert session.force.any()
        session.step(100)
        assert chain(session).gain == gain < 1.0


def test_other_switches_follow_on_the_way() -> None:
    """Unequal gains of which one is paid for in part are split, and equal again at the end: as if built with them."""
    scene = squeeze(coupling__external__stiffness=200.0)
    with gx.open(scene, live=[INTERNAL, EXTERNAL, "coupling.internal.damping"]) as session:
        session.step(400)
        chain(session).tank.level = 1e-4
        assert not grasp(session).equal
        session.set({INTERNAL: 200.0, "coupling.internal.damping": 0.5})
        session.step()
        assert 30.0 < grasp(session).internal_stiffness < 200.0
        assert not grasp(session).equal
        assert grasp(session).damped
        chain(session).tank.level = 1.0
        session.step()
        assert grasp(session).internal_stiffness == 200.0
        assert grasp(session).internal_damping == 0.5
        assert not chain(session).changing


def test_damping_fills_the_tank_where_a_ledger_books_it() -> None:
    """The tank gains, until it is full, as much as damping takes by the ledger."""
    with gx.open(
        squeeze(coupling__external__damping=0.5, coupling__internal__damping=0.5, coupling__passivity="observe"),
        live=[INTERNAL],
    ) as session:
        session.step(2)
        chain(session).tank.level = 0.0
        damped = session.recording.energy["object"]["damped"][-1].sum()
        session.step(300)
        gained = session.recording.energy["object"]["damped"][-1].sum() - damped
        assert gained > 1e-5
        assert chain(session).tank.level == pytest.approx(gained, rel=1e-9)


def test_a_soft_start_under_load_is_paid_by_the_tank() -> None:
    """Fingers 3 mm inside: the springs get K e'e/2 from nothing, and the tank loses it, to the error of its steps."""
    scene = squeeze(safety__soft_start=0.2, object__viscosity=500.0)
    starts = {f"finger.{i}.start": [side * 0.022] for i, side in enumerate((-1.0, 1.0))}
    holds = {f"finger.{i}.hand": {"stiffness": 1e5, "damping": 50.0} for i in range(2)}
    with gx.open(scene.replace(starts | holds)) as session:
        session.step(201)
        assert chain(session).gain == 1.0
        assert 0.3 - chain(session).tank.level == pytest.approx(2 * 0.5 * 30.0 * 0.003**2, rel=0.02)


def test_a_tank_with_too_little_slows_a_soft_start() -> None:
    """Held 3 mm inside with 0.1 mJ: gamma stops where gamma K e'e/2 is that; 10 mm inside it costs more each."""
    scene = squeeze(safety__soft_start=0.2, object__viscosity=500.0)
    starts = {f"finger.{i}.start": [side * 0.022] for i, side in enumerate((-1.0, 1.0))}
    holds = {f"finger.{i}.hand": {"stiffness": 1e5, "damping": 50.0} for i in range(2)}
    with gx.open(scene.replace(starts | holds)) as session:
        chain(session).tank.level = 1e-4
        session.step(300)
        assert chain(session).gain == pytest.approx(1e-4 / 2.7e-4, rel=0.02)
        assert chain(session).tank.level == pytest.approx(0.0, abs=1e-12)
        assert session.recording.array("objects/object/scale")[-1, 0] == chain(session).gain


def test_matrices_do_not_change_under_a_chain() -> None:
    scene = squeeze(coupling__internal__stiffness=[30.0, 31.0], coupling__form="symmetric")
    with pytest.raises(InputError, match="does not support matrices"):
        gx.open(scene, live=[INTERNAL]).close()
