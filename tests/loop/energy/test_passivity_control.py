"""Damping where a grasp leaks: it ends growth, in its mode, within the cones, and is idle where nothing is owed."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import graspfx as gx
from graspfx.coupling.grasp_state import GraspState
from graspfx.coupling.grasped import GraspedObject
from graspfx.coupling.rules import Rules
from graspfx.grasp.impedance import Coupling, Impedance
from graspfx.loop.energy import brake, ledger
from graspfx.loop.energy import leak as po
from graspfx.loop.energy.books import FingerBooks, LedgerState
from graspfx.loop.energy.observer import Observer
from graspfx.objects.body import NativeBody, fill_body
from graspfx.surfaces.closed_form.shape import Box

T = 1e-3


def both(duration: float, **changes: Any) -> tuple[gx.Recording, gx.Recording]:
    """paper-spring, observed and controlled."""
    given = {key.replace("__", "."): value for key, value in changes.items()}
    made = [gx.load("paper-spring", given | {"coupling.passivity": p}) for p in ("observe", "control")]
    return gx.run(made[0], duration=duration), gx.run(made[1], duration=duration)


def sizes(rec: gx.Recording, mode: int) -> tuple[float, float]:
    """Half the span of the squeeze, or of the object's way, in the first and in the last fifth [m]."""
    e = (rec.finger_position - rec.contact_position)[:, :, 0]
    x = rec.object_position[:, 0] if mode else 0.5 * (e[:, 0] - e[:, 1])
    k = len(x) // 5
    return float(np.ptp(x[:k])) / 2, float(np.ptp(x[-k:])) / 2


@pytest.mark.parametrize("stiffness", [90.0, 100.0])
def test_a_squeeze_beyond_the_wall_limit_stops_growing(stiffness: float) -> None:
    """2 b/T = 80 N/m: K T/2 - b = 0.025 and 0.05 N s/m are missing."""
    observed, controlled = both(4.0, coupling__internal__stiffness=stiffness)
    first, last = sizes(observed, 0)
    assert last > 1.2 * first and observed.summary()["leak"][0] > 1e-5
    first, last = sizes(controlled, 0)
    assert last < 1.01 * first
    summary = controlled.summary()
    assert summary["braking"][1:] == [0.0, 0.0] and summary["braked"][0] > 0.0  # moving the object is left alone
    assert summary["leak"][0] < 0.1 * observed.summary()["leak"][0]
    assert summary["ledger_gap"] < 1e-12
    assert np.array_equal(controlled.array("objects/object/energy/damping")[:, 1], np.zeros(800))


def test_moving_an_object_beyond_its_limit_stops_growing() -> None:
    """Explicit, b_v = 0.8: the limit of kep is 51.8 N/m."""
    observed, controlled = both(10.0, coupling__external__stiffness=60.0)
    first, last = sizes(observed, 1)
    assert last > 5.0 * first
    first, last = sizes(controlled, 1)
    assert last < first
    summary = controlled.summary()
    assert summary["braking"][1] > 0.0 and summary["braked"][1] > 1e3 * summary["braked"][0]


@pytest.mark.parametrize(
    "changes",
    [
        {"coupling__internal__stiffness": 78.0, "coupling__external__stiffness": 30.0},
        {"coupling__internal__stiffness": 78.0, "coupling__external__stiffness": 52.0, "object__integrator": "exact"},
        {"object__integrator": "implicit", "object__velocity": [0.05]},  # 80 is the limit itself, 53.3 the other one's
    ],
)
def test_a_passive_setting_is_left_alone_to_the_bit(changes: dict[str, Any]) -> None:
    observed, controlled = both(1.5, **changes)
    for column in observed.layout.columns:
        assert np.array_equal(observed.array(column), controlled.array(column)), column
    assert controlled.summary()["braking"] == [0.0, 0.0, 0.0]


# One sample by hand ---------------------------------------------------------------------------------------------------


def blocks(grasp: GraspedObject, observer: Observer) -> tuple[GraspState, LedgerState]:
    return GraspState(grasp.block.data), LedgerState(observer.buffer.data)


def owing(mode: int, debt: float, **rules: Any) -> tuple[GraspedObject, Observer, np.ndarray]:
    """Four fingers on a cube, one sample after the first, with a debt in one mode; the force before control."""
    attached = not rules
    grasp = GraspedObject(
        4, 3, T, Coupling(external=Impedance(150.0), internal=Impedance(400.0)),
        Rules(attached=attached, fade=None, **rules),
        lambda state: fill_body(state, dimensions=3, mass=0.2, inertia=1e-4),
        shape=Box((0.04,) * 3),
    )  # fmt: skip
    tips = np.array([[-0.02, 0.003, 0.0], [0.02, -0.002, 0.004], [0.001, 0.02, -0.004], [0.0, -0.02, 0.003]])
    grasp.meet(tips * 1.05)
    observer = Observer(
        grasp, NativeBody(grasp.body_state), T, control=False, friction=np.zeros(4), mass=np.full(4, 0.1)
    )
    rng = np.random.default_rng(mode)
    p = tips * 0.95
    for _ in range(2):
        grasp.finger_position[:] = p
        assert grasp.sample() == 0
        ledger.observe(*blocks(grasp, observer), T)
        ledger.hold(*blocks(grasp, observer))
        ledger.report(*blocks(grasp, observer))
        p = p + 2e-4 * rng.normal(size=p.shape)
    grasp.finger_position[:] = p
    assert grasp.sample() == 0
    ledger.observe(*blocks(grasp, observer), T)
    accounts = LedgerState(observer.buffer.data).accounts.parts
    for account in accounts:
        po.book(account.work, -po.balance(account))
    po.book(accounts[mode].work, -debt)
    return grasp, observer, grasp.force.copy()


@pytest.mark.parametrize("mode", [0, 1, 2])
def test_the_added_force_is_damping_in_the_leaking_mode_alone(mode: int) -> None:
    """(I - P) of the last step for squeezing, P's translations or rotations for the others, by dense projectors."""
    grasp, observer, before = owing(mode, 1e-7)
    assert brake.control(*blocks(grasp, observer), T)
    added = (grasp.force - before).ravel()
    damping = observer.buffer[observer.where["damping"]]
    limit = brake.bound(GraspState(grasp.block.data), T, 10.0)
    assert 0.0 < damping[mode] <= limit and damping.sum() == pytest.approx(damping[mode], rel=1e-12)
    split = gx.Split(gx.grasp_matrix(grasp.contact_position))
    shifts = gx.Split(gx.grasp_matrix(grasp.contact_position, free=[True] * 3 + [False] * 3)).displacement_external
    P = split.displacement_external
    Q = (np.eye(12) - P, shifts, P - shifts)[mode]
    d = LedgerState(observer.buffer).fingers.array(FingerBooks.step)[:, :3].ravel()
    np.testing.assert_allclose(added, damping[mode] / T * Q @ d, rtol=1e-9, atol=1e-12)
    if damping[mode] < limit:
        assert added @ d == pytest.approx(1e-7, rel=1e-9)
    np.testing.assert_allclose(grasp.wrench[:3], grasp.force.sum(axis=0), atol=1e-14)  # the object feels it too
    if mode == 0:
        assert np.abs(gx.grasp_matrix(grasp.contact_position) @ added).max() < 1e-12 * np.abs(added).max()


@pytest.mark.parametrize("rules", [{"friction": 0.0}, {"friction": 0.4}, {"stick": True}])
@pytest.mark.parametrize("mode", [0, 1, 2])
def test_a_braked_finger_never_pulls_and_stays_in_its_cone(rules: dict[str, Any], mode: int) -> None:
    grasp, observer, before = owing(mode, 1.0, **rules)  # far more than can be paid
    assert brake.control(*blocks(grasp, observer), T)
    damping = observer.buffer[observer.where["damping"]]
    assert damping[mode] == pytest.approx(brake.bound(GraspState(grasp.block.data), T, 10.0))
    normal = (grasp.inward() * grasp.force).sum(axis=1)
    along = np.linalg.norm(grasp.force - normal[:, None] * grasp.inward(), axis=1)
    assert (normal >= -1e-15).all()
    if not rules.get("stick"):
        assert (along <= rules["friction"] * normal + 1e-12).all()
    assert not grasp.force[grasp.touching == 0.0].any()
    added = LedgerState(observer.buffer).fingers.array(FingerBooks.brake)[:, :3]
    np.testing.assert_allclose(added, grasp.force - before, atol=1e-14)


def test_the_bound_is_half_of_what_would_turn_a_step_around() -> None:
    """1/m = 1/m_i + n/m_v + sum r^2/I: held damping of m/(2 T) takes half of a step's speed in a sample."""
    grasp, _, _ = owing(0, 0.0)
    squares = ((grasp.finger_position) ** 2).sum()
    assert brake.bound(GraspState(grasp.block.data), T, 10.0) == pytest.approx(
        0.5 / T / (10.0 + 4 / 0.2 + squares / 1e-4)
    )
    freedom = GraspState(grasp.block).freedom
    freedom.shifts = freedom.turns = 0
    assert brake.bound(GraspState(grasp.block.data), T, 10.0) == pytest.approx(0.5 * 0.1 / T)
    assert brake.bound(GraspState(grasp.block.data), T, 0.0) == 0.0
