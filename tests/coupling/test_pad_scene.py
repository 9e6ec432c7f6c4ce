"""`finger.pad` in scenes: every solver, both engines, batches, books; faults, the plan, and what rigid fingers pay."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import graspfx as gx
from graspfx.assembly.build import build
from graspfx.certificate.plan import plan
from graspfx.commands.output import doubts
from graspfx.coupling.law import normal_force
from graspfx.errors import SceneError
from graspfx.loop.tick_listing import used
from tests.support import small_scenes

PADS = np.array([2e4, 6e4, 1e5])


SOFT = {f"finger__{i}__pad": {"kind": "hertz", "stiffness": k} for i, k in enumerate(PADS.tolist())}


def closing(**changes: Any) -> gx.Scene:
    return small_scenes.closing(**(SOFT | changes))


DAMPED: dict[str, Any] = {"coupling__external__damping": 1.0, "coupling__internal__damping": 2.0}
MATRICES: dict[str, Any] = {"coupling__external__stiffness": [200.0] * 3, "coupling__form": "symmetric"}
SOLVERS: list[dict[str, Any]] = [
    {},
    {"coupling__friction": 0.0},
    {"coupling__friction": "stick"},
    {"coupling__external__stiffness": 800.0, "coupling__friction": 0.0},
    {"coupling__external__stiffness": 400.0, "coupling__friction": 0.0},
    {"coupling__external__stiffness": 400.0, "coupling__friction": "stick"},
    MATRICES,
    MATRICES | {"coupling__friction": 0.0},
    {"object__integrator": "implicit"},
    {"coupling__metric": "mass", "finger__0__device__mass": 0.2},
    {"finger__*__device__force_limit": 0.5},
]


@pytest.mark.parametrize("changes", SOLVERS, ids=str)
def test_depth_and_force_go_together_in_a_run(changes: dict[str, Any]) -> None:
    """In the block after 0.12 s with every solver: f_n = k delta^1.5 to 1e-13 of the largest force, and no fault."""
    with build(closing(**changes), record=False) as servo:
        servo.run(60, None)
        grasped = servo.objects[0].grasped
        assert grasped.touching.all()
        push = np.array([normal_force(finger) for finger in grasped.state.fingers])  # before the object moved on
        depth = np.array([pad.depth for pad in grasped.state.pads])
        np.testing.assert_allclose(push, PADS * depth**1.5, rtol=0.0, atol=3e-13 * push.max())
        assert (depth > 1e-4).all()


@pytest.mark.parametrize("changes", [DAMPED, MATRICES], ids=str)
def test_both_engines_agree(changes: dict[str, Any]) -> None:
    """Both give the same bits from the first touch to the hold."""
    one, other = (gx.run(closing(**changes, engine=kind)) for kind in ("compiled", "interpreted"))
    assert np.array_equal(one.finger_force, other.finger_force)
    assert np.array_equal(one.finger_position, other.finger_position)


def test_a_touch_gives_way() -> None:
    """In the first tick of the first touch a pad gives less than half of the force of a rigid finger."""
    force = []
    for rec in (gx.run(closing()), gx.run(closing(**{f"finger__{i}__pad": None for i in range(3)}))):
        first = int(np.argmax(rec.touching.any(axis=1)))
        force.append(float(np.linalg.norm(rec.finger_force[first], axis=1).max()))
    assert 0.0 < force[0] < 0.5 * force[1]


def test_rigid_fingers_pay_nothing() -> None:
    """No kernel of pads runs without them; `graspfx check` has the step only where a finger has one."""
    scene = closing()
    bare = scene.replace({f"finger.{i}.pad": None for i in range(3)})
    with build(scene) as one, build(bare) as other:
        assert {"press", "predict", "learn"} <= used(one).kernels
        assert not {"press", "predict", "learn", "relax"} & used(other).kernels
        assert other.objects[0].grasped.state.padded_count == 0
    [row] = [each for each in plan(scene) if each.step == "pads"]
    assert row.runs and "3 of 3 fingertips" in row.why and "20000 to 100000" in row.why
    [row] = [each for each in plan(bare) if each.step == "pads"]
    assert not row.runs and "rigid" in row.why


@pytest.mark.parametrize(
    ("changes", "key", "said"),
    [
        ({"coupling__contact": "attached", "coupling__friction": 0.0}, "finger.0.pad", "expected unilateral contact"),
        ({"object__integrator": "implicit", **DAMPED}, "finger.0.pad", "no damping with the integrator 'implicit'"),
        ({"finger__0__pad": {"kind": "hertz"}}, "finger.0.pad.stiffness", "required"),
        ({"finger__0__pad": {"kind": "hertz", "stiffness": 0.0}}, "finger.0.pad.stiffness", "more than 0"),
        ({"finger__0__pad": {"kind": "winkler", "stiffness": 1.0}}, "finger.0.pad.kind", "hertz"),
        ({"finger__0__pad": 2e4}, "finger.0.pad", "table"),
    ],
)
def test_what_cannot_hold_is_refused_by_name(changes: dict[str, Any], key: str, said: str) -> None:
    with pytest.raises(SceneError) as error:
        closing(**changes)
    texts = {fault.key: fault.message for fault in error.value.faults}
    assert said in texts[key]


def test_a_stiffness_in_millimetres_is_asked_about() -> None:
    """2e4 N/m^1.5 is 0.63 N/mm^1.5: at 1 N more than 100 mm deep, if it is taken for metres."""
    wrong = closing(finger__0__pad={"kind": "hertz", "stiffness": 0.63})
    assert any("finger.0.pad.stiffness = 0.63 N/m^1.5: check the unit" in each for each in doubts(wrong))
    assert not any("pad" in each for each in doubts(closing()))


def test_a_batch_over_stiffness_is_the_single_runs() -> None:
    """Two pads' stiffness, one of them of two fingers: the bits of four single runs."""
    keys: dict[str, list[float]] = {"finger.0.pad.stiffness": [1e4, 1e5], "coupling.internal.stiffness": [300.0, 500.0]}
    scene = closing(coupling__friction=0.0)
    batch = gx.run_batch(scene, keys, keep="recordings")
    assert batch.recordings is not None
    for place, rec in np.ndenumerate(batch.recordings):
        values = {key: batch.values[key][place].item() for key in keys}
        assert np.array_equal(rec.finger_force, gx.run(scene.replace(values)).finger_force)


@pytest.mark.parametrize("changes", [{}, MATRICES, {"coupling__friction": "stick"}, DAMPED], ids=str)
def test_the_books_close(changes: dict[str, Any]) -> None:
    """The gap is rounding; stored are 1/2 f'K^-1 f and 2/5 k delta^2.5; what sticks has slipped next to nothing."""
    scene = closing(coupling__passivity="observe", **changes)
    rec = gx.run(scene)
    books = rec.energy["object"]
    assert np.abs(books["gap"]).max() < 1e-14 * np.abs(books["fingers"]).max() * len(rec)
    # of third order in a step, but for the first touch, which is one step from nothing
    assert np.abs(books["reshaped"].sum(axis=1)).max() < 2e-2 * books["stored"].sum(axis=1).max()
    with build(scene, record=False) as servo:
        servo.run(len(rec), None)
        grasped = servo.objects[0].grasped
        elastic = np.array([[finger.elastic.x, finger.elastic.y] for finger in grasped.state.fingers])
        contacts = np.array([[finger.contact.x, finger.contact.y] for finger in grasped.state.fingers])
        law = gx.Coupling(external=gx.Impedance(200.0), internal=gx.Impedance(400.0))
        K = law.stiffness(gx.Grasp(contacts).split())
        depth = np.array([pad.depth for pad in grasped.state.pads])
        stored = 0.5 * elastic.ravel() @ np.linalg.solve(K, elastic.ravel()) + 0.4 * (PADS * depth**2.5).sum()
    assert books["stored"].sum(axis=1)[-1] == pytest.approx(float(stored), rel=1e-9)
