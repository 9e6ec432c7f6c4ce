"""The plan says what a scene's sample does, what it skips, and why."""

from __future__ import annotations

from typing import Any

import pytest

from graspfx.assembly.build import build
from graspfx.assembly.run_scene import run
from graspfx.certificate.plan import PlanRow, equal_gains, packages, plan
from graspfx.compile.kernel import source_function
from graspfx.coupling.contacts import refactor
from graspfx.grasp.rigid_modes import rigid_modes
from graspfx.loop.tick_listing import used
from graspfx.scene.model import Scene
from tests.support.carriers import CARRIERS, require
from tests.support.plan_kernels import rows_with_kernels


def scene(**changes: Any) -> Scene:
    """Two fingers on a box in the plane whose rotation is free, with 30/70 N/m; changes by dotted key, _ for dots."""
    finger = {"device": {"name": "simulated", "mass": 0.15}, "hand": {"stiffness": 33.0}}
    made = Scene(
        dimensions=2,
        period=0.005,
        duration=1.0,
        object={
            "mass": 0.1,
            "viscosity": 0.8,
            "rotational_viscosity": 3e-4,
            "shape": {"kind": "box", "size": [0.05, 0.05]},
        },
        coupling={"external": {"stiffness": 30.0}, "internal": {"stiffness": 70.0}},
        finger=[finger | {"start": [-0.03, 0.0]}, finger | {"start": [0.03, 0.0]}],
    )
    return made.replace({key.replace("__", "."): value for key, value in changes.items()})


def row(made: Scene, step: str) -> PlanRow:
    [found] = [each for each in plan(made) if each.step == step]
    return found


IMPLICIT = {"object__integrator": "implicit"}
EQUAL: dict[str, Any] = {"coupling__internal__stiffness": 30.0}
TURN = [{"kind": "reach", "angle": 1.0, "duration": 1.0}]
DEPTH = {"coupling__damping_depth": 0.002}
DAMPED = {"coupling__internal__damping": 0.1}
NUMBERS = {"coupling__external__stiffness": [30.0, 30.0], "coupling__internal__stiffness": [30.0, 30.0]}
CASES: list[tuple[dict[str, Any], str, bool, str]] = [
    ({}, "split", True, "eq. (3), when a contact has moved"),
    ({"coupling__contact": "attached"}, "split", True, "once: contacts are fixed"),
    ({"object__free": [False, True, True]}, "split", True, "in every sample: locked directions"),
    (EQUAL, "split", False, "equal external and internal gains: the conventional method"),
    (EQUAL | IMPLICIT, "split", True, "the rigid modes of eq. (3) are the implicit integrator's unknowns"),
    (DAMPED, "rate of displacement", True, "damping"),
    ({}, "rate of displacement", False, "no damping"),
    (DAMPED | DEPTH, "damping by depth", True, "grows to its value over 2 mm of penetration depth"),
    (DAMPED, "damping by depth", False, "full damping at once"),
    (DEPTH, "damping by depth", False, "there is no damping"),
    ({}, "split: rotation", True, "between 0.25 and 1 mm of arm"),
    ({"object__free": [True, True, False]}, "split: rotation", False, "locked"),
    ({"object__free": [True, True, False]}, "turn", False, "every rotation is locked"),
    ({}, "turn", True, "angular velocity"),
    ({}, "fade", True, "grows from 2 to 10 mm"),
    ({"coupling__absent": "follow"}, "fade", False, "absent = 'follow'"),
    (EQUAL, "fade", False, "equal gains"),
    ({}, "letting go", True, "slips freely"),
    ({"coupling__friction": "stick"}, "letting go", True, "holds where it touched"),
    ({"coupling__contact": "attached"}, "letting go", False, "attached: the contact is bilateral"),
    ({"coupling__contact": "attached"}, "contact points", False, "attached: contact points are fixed in the object"),
    ({}, "contact points", True, "closed form on box"),
    (IMPLICIT, "predict", True, "forces and the motion of the object are solved together"),
    ({}, "predict", False, "present state"),
    ({}, "move", True, "native, exact"),
    ({"coupling__external__stiffness": [30.0, 30.0]}, "impedance", True, "per finger or matrices, literal form"),
    ({}, "impedance", True, "one projection of one vector"),
    ({"coupling__reaction": "contact"}, "reaction", True, "contact point"),
    ({}, "read", True, "2 x simulated"),
    ({}, "hand", True, "2 of 2 fingers held; finger0, finger1 by themselves (motion: rest)"),
    ({"finger__1__hand__squeeze": 0.002}, "hand", True, "finger0 by itself (motion: rest); finger1 by itself"),
    ({"finger__*__hand__turn": TURN}, "hand", True, "(motion: rest; turn: reach)"),
]


@pytest.mark.parametrize(("changes", "step", "runs", "why"), CASES)
def test_steps(changes: dict[str, Any], step: str, runs: bool, why: str) -> None:
    found = row(scene(**changes), step)
    assert found.runs is runs
    assert why in found.why


@pytest.mark.parametrize("dynamics", CARRIERS)
def test_others_name_their_package_and_ignore_an_integrator(dynamics: str) -> None:
    require(dynamics)
    package = {"bullet": "pybullet", "mujoco": "mujoco"}[dynamics]
    given = scene(object__dynamics=dynamics, object__integrator="implicit")
    assert "(integrator = 'implicit' is ignored)" in row(given, "move").why
    assert not row(given, "predict").runs
    assert f"{package} (dynamics)" in packages(given)
    assert "ignored" not in row(scene(object__dynamics=dynamics), "move").why
    assert not any("(dynamics)" in each for each in packages(scene()))


def test_the_conventional_method_is_equal_gains_of_both_kinds() -> None:
    assert equal_gains(scene(coupling__internal__stiffness=30.0))
    assert not equal_gains(scene(coupling__internal__stiffness=30.0, coupling__internal__damping=0.1))


def test_several_objects_have_rows_of_their_own() -> None:
    things = [{"name": name, "mass": 0.1, "viscosity": 0.8} for name in ("left", "right")]
    table = scene().to_dict() | {"dimensions": 1, "object": things}
    table["coupling"]["contact"] = "attached"
    for finger, name in zip(table["finger"], ("left", "right"), strict=True):
        finger |= {"start": [0.0], "object": name}
        del finger["hand"]
    steps = [each.step for each in plan(Scene(**table))]
    assert {"move left", "move right", "turn left", "turn right"} <= set(steps)
    assert len(steps) == len(set(steps))
    assert not row(Scene(**table), "hand").runs


@pytest.mark.parametrize("changes", [{}, {"coupling__contact": "attached"}, {"object__free": [False, True, True]}])
def test_the_split_is_made_as_often_as_the_plan_says(changes: dict[str, Any], monkeypatch: pytest.MonkeyPatch) -> None:
    """Counted in a run as it stands, in which the fingers slide as the hands pull them along."""
    made = 0

    def counted(*arguments: Any) -> Any:
        nonlocal made
        made += 1
        return source_function(rigid_modes)(*arguments)

    monkeypatch.setitem(source_function(refactor).__globals__, "rigid_modes_k", counted)
    given = scene(**changes, engine="interpreted", object__velocity=[0.0, 0.02])
    run(given, duration=20 * given.period)
    why = row(given, "split").why
    assert made == 1 if "once" in why else made == 20 if "every" in why else 1 < made <= 20


@pytest.mark.parametrize(
    "changes",
    [
        *{str(changes): changes for changes, *_ in CASES}.values(),
        EQUAL | {"coupling__friction": 0.5},
        EQUAL | {"coupling__passivity": "observe"},
        NUMBERS,
        NUMBERS | IMPLICIT,
    ],
    ids=str,
)
def test_ticks_run_what_the_plan_runs_and_nothing_that_it_skips(changes: dict[str, Any]) -> None:
    """While two fingers press on the object."""
    pressing = {"finger.0.start": [-0.0251, 0.0], "finger.1.start": [0.0251, 0.0], "finger.*.hand.squeeze": 0.005}
    made = scene(**changes).replace({**pressing, "finger.*.hand.squeeze_ramp": 0.02})
    with build(made, engine="interpreted") as servo:
        ran = used(servo, 40).kernels
    for each, kernel in rows_with_kernels(made):
        assert (kernel in ran) is each.runs, each
