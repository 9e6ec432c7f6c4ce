"""`coupling.damping_depth` in scenes: every solver, both engines, batches, books; what is said where it is idle."""

from __future__ import annotations

from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import graspfx as gx
from graspfx.assembly.build import build
from graspfx.certificate.plan import plan
from graspfx.commands.output import doubts
from graspfx.coupling.grasp_state import FingerState
from graspfx.coupling.rules import Rules
from graspfx.errors import InputError, SceneError
from graspfx.loop.tick_listing import used
from graspfx.objects.body import NativeBody
from graspfx.surfaces.closed_form.shape import Box
from tests.support import small_scenes
from tests.support.grasps import finger_grasp, grasped, law, respond

T = 0.005


@pytest.mark.parametrize(("ked", "kid"), [(0.2, 0.5), (0.5, 0.2), (0.4, 0.4)])
@pytest.mark.parametrize("matrices", [False, True])
def test_implicit_sample_solves_the_softer_damping_with_the_motion(ked: float, kid: float, matrices: bool) -> None:
    """On a line: f = K (p - x+) + D_s (p' - v+) with the new state that this very force makes, to 1e-13 N."""
    values = [np.full(2, v) if matrices else v for v in (30.0, 70.0)]
    damped = [np.full(2, v) if matrices else v for v in (ked, kid)]
    settings: dict[str, Any] = {"integrator": "implicit", "viscosity": 0.8, "velocity": [0.05], "period": T}
    p, v = np.array([[-0.0243], [0.0238]]), np.array([[0.02], [-0.01]])
    results = []
    for gains, depth in ((law(*values), 0.0), (law(*values, *damped), 2e-3)):
        g = grasped(
            2, 1, gains, Rules(fade=None, damping_depth=depth), shape=Box((0.05,)), inertia=None,
            rotational_viscosity=0.0, **settings,
        )  # fmt: skip
        native = NativeBody(g.body_state)
        native.free_motion(T)
        results.append(respond(g, p, v)[:, 0])
        native.step(T)
    f0, f = results
    s = np.minimum(1.0, np.abs(f0) / (70.0 * 2e-3))
    assert (s < 1.0).all()
    P = np.full((2, 2), 0.5)
    K, D = (a * P + b * (np.eye(2) - P) for a, b in ((30.0, 70.0), (ked, kid)))
    D_s = np.linalg.inv(np.linalg.inv(D) + np.diag((1.0 - s) / (s * max(ked, kid))))
    e = p[:, 0] - native.position[0] - np.array([-0.025, 0.025])
    np.testing.assert_allclose(f, K @ e + D_s @ (v[:, 0] - native.velocity[0]), rtol=0.0, atol=1e-13)


@pytest.mark.parametrize("softest", [1.5e-3, 0.0])
@pytest.mark.parametrize("kind", ["stick", "rough"])
def test_implicit_grasp_in_the_plane_is_one_system(kind: str, softest: float) -> None:
    """Held: f = K (e - G'u) + (D_s/T)(T e' - H'u), u = C (G f_K + H f_D), by numpy from an SVD's P, to 1e-12 N."""
    m, inertia, b = 0.1, 4e-5, 1e-4
    contacts = np.array([[-0.025, 0.004], [0.025, -0.002], [0.003, -0.025]])
    e = np.array([[0.4e-3, 0.0], [-0.9e-3, 0.0], [0.0, 1.4e-3]])
    v = np.array([[1.0, 0.3], [-0.5, 0.2], [0.1, 0.7]]) * 1e-3
    values = (60.0, 160.0, 0.4, 0.9)
    results = []
    for gains, depth in ((law(*values[:2]), 0.0), (law(*values), softest)):
        g = finger_grasp(3, 2, gains, kind, depth, shape=Box((0.05, 0.05)), integrator="implicit")
        NativeBody(g.body_state).free_motion(T)
        results.append(respond(g, contacts + e, v))
    f0, f = results
    s = np.minimum(1.0, (f0 * g.inward()).sum(axis=1) / (160.0 * max(softest, 1e-9)))
    assert (s > 0.0).all() and (s < 1.0).any() == (softest > 0.0)
    split = gx.Grasp(contacts).split()
    K, D = law(*values).stiffness(split), law(*values).damping(split)
    D_s = np.linalg.inv(np.linalg.inv(D) + np.diag(np.repeat((1.0 - s) / (s * 0.9), 2)))
    G, H = gx.grasp_matrix(contacts), gx.grasp_matrix(contacts + e)
    C = np.diag([T * T / m, T * T / m, T * T / (inertia + T * b)])
    # [f_K; f_D] = [K (e - G'u); D_s (e' - H'u/T)]
    system = np.eye(12) + np.vstack([K @ G.T, D_s @ H.T / T]) @ C @ np.hstack([G, H])
    parts = np.linalg.solve(system, np.concatenate([K @ e.ravel(), D_s @ v.ravel()]))
    np.testing.assert_allclose(f.ravel(), parts[:6] + parts[6:], rtol=0.0, atol=1e-12)


def test_soft_fingers_have_a_damper_in_series_with_torsion_too() -> None:
    """Four coordinates a finger: the rates of shift and turn through (D^-1 + C)^-1, D from the sample without depth."""
    p = np.array([[-0.0247, 0.001, 0.0], [0.0242, 0.0, 0.002], [0.0, -0.0245, 0.001]])
    results = []
    for depth in (0.0, 1.2e-3):
        g = finger_grasp(3, 3, law(100.0, 100.0, 0.5, 0.9), "rough", depth, patch=0.006)
        f0 = respond(g, p)
        columns = []
        for k in range(12):  # of the fingers' coordinates: three of motion, and torsion by its row of the block
            rate = np.zeros((3, 4))
            rate[k // 4, k % 4] = 1e-7
            columns.append(rate)
        results.append((g, f0, columns))
    D, D_s = (_responses(g, p, columns) for g, _, columns in results)
    s = np.minimum(1.0, (results[1][1] * g.inward()).sum(axis=1) / (100.0 * 1.2e-3))
    assert (s < 1.0).all()
    C = np.diag(np.repeat((1.0 - s) / (s * 0.9), 4))
    np.testing.assert_allclose(D_s, np.linalg.inv(np.linalg.inv(D) + C), rtol=0.0, atol=1e-7)


def _responses(g: Any, p: np.ndarray, rates: list[np.ndarray]) -> np.ndarray:
    """The forces in the object's axes and torsions by small rates of each, (12, 12), at a pose that is not turned."""
    from graspfx.coupling.sample import respond as sample_forces

    respond(g, p)
    f0 = g.array(FingerState.local).copy()
    columns = []
    for rate in rates:
        before = g.block.copy()
        g.array(FingerState.rate)[:] = rate
        assert sample_forces(g._grasp, False) == 0
        columns.append((g.array(FingerState.local) - f0).ravel() / 1e-7)
        g.block[:] = before
    return np.array(columns).T


# Scenes -----------------------------------------------------------------------------------------------------------


DAMPED: dict[str, Any] = {
    "coupling__external__damping": 2.0, "coupling__internal__damping": 3.0, "coupling__damping_depth": 1e-3,
}  # fmt: skip


def closing(**changes: Any) -> gx.Scene:
    return small_scenes.closing(**(DAMPED | changes))


MATRICES = {"coupling__external__damping": [2.0, 2.0, 2.0], "coupling__form": "symmetric"}
SOLVERS: list[dict[str, Any]] = [
    {},
    {"coupling__friction": 0.0},
    {"coupling__friction": "stick"},
    {"coupling__external__damping": 4.0},
    {"coupling__external__damping": 4.0, "coupling__friction": 0.0},
    {"coupling__external": {"stiffness": 400.0, "damping": 3.0}},
    {"coupling__external": {"stiffness": 400.0, "damping": 3.0}, "coupling__friction": "stick"},
    MATRICES,
    {"object__integrator": "implicit"},
    {"object__integrator": "implicit", "coupling__friction": "stick"},
    {"coupling__metric": "mass", "finger__0__device__mass": 0.2},
    {"coupling__passivity": "control"},
]


@pytest.mark.parametrize("changes", SOLVERS, ids=str)
def test_a_touch_steps_by_less_with_every_solver(changes: dict[str, Any]) -> None:
    """Per way of the finger by less than 0.65 of what it is without the key, and no fault."""
    scene = closing(**changes)
    rec = gx.run(scene)
    assert not rec.faults and rec.touching[-1].all()
    assert touch_step(rec) < 0.65 * touch_step(gx.run(scene.replace({"coupling.damping_depth": 0.0})))
    [row] = [each for each in plan(scene) if each.step == "damping by depth"]
    assert row.runs and "over 1 mm of penetration depth" in row.why


@pytest.mark.parametrize("changes", [SOLVERS[0], MATRICES], ids=str)
def test_both_engines_agree(changes: dict[str, Any]) -> None:
    """Compiled and interpreted runs have the same bits, from the first touch to the hold."""
    one, other = (gx.run(closing(**changes, engine=kind)) for kind in ("compiled", "interpreted"))
    assert np.array_equal(one.finger_force, other.finger_force)
    assert np.array_equal(one.finger_position, other.finger_position)


def touch_step(rec: gx.Recording) -> float:
    """The largest step of a finger's force in the sample in which it first touches, per motion there [mN/um]."""
    f = np.linalg.norm(rec.finger_force, axis=2)
    moved = np.linalg.norm(np.diff(rec.finger_position, axis=0), axis=2)
    touched = rec.touching[1:] & ~rec.touching[:-1]
    return float((np.diff(f, axis=0)[touched] / moved[touched]).max()) / 1e3


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"coupling__damping_depth": 0.0}, "full damping at once"),
        ({"coupling__external__damping": 0.0, "coupling__internal__damping": 0.0}, "there is no damping"),
        ({"coupling__contact": "attached", "coupling__friction": 0.0}, "attached contacts"),
    ],
)
def test_where_it_does_nothing_it_costs_nothing(changes: dict[str, Any], why: str) -> None:
    """The bits and the kernels of the scene without the key; `graspfx check` skips it and says why, or notes it."""
    scene = closing(**changes)
    bare = scene.replace({"coupling.damping_depth": 0.0})
    assert np.array_equal(gx.run(scene).finger_force, gx.run(bare).finger_force)
    with build(scene) as one, build(bare) as other, build(closing()) as gradual:
        ran = used(one).kernels
        assert ran == used(other).kernels
        assert {"damping_share", "compliance"} <= used(gradual).kernels
        assert not {"damping_share", "compliance", "add_compliance"} & ran
        assert one.objects[0].grasped.block.size == other.objects[0].grasped.block.size
    [row] = [each for each in plan(scene) if each.step == "damping by depth"]
    assert not row.runs and why in row.why
    depth = scene.coupling.damping_depth
    assert any("has no effect" in each for each in doubts(scene)) is (depth > 0.0)


@pytest.mark.parametrize("wrong", [-1e-3, "1 mm", float("nan"), [1e-3]])
def test_what_is_no_length_is_one_clear_fault(wrong: Any) -> None:
    with pytest.raises(SceneError, match=r"coupling\.damping_depth") as error:
        closing(coupling__damping_depth=wrong)
    assert len(error.value.faults) == 1
    if not isinstance(wrong, str | list):
        with pytest.raises(InputError, match=r"a length, zero or more \[m\]"):
            grasped(2, 1, law(30.0, 70.0, 1.0, 1.0), Rules(damping_depth=wrong), shape=Box((0.05,)))


def test_a_depth_in_millimetres_is_asked_about() -> None:
    assert any("damping_depth = 1 m: check the unit" in each for each in doubts(closing(coupling__damping_depth=1.0)))
    assert not any("damping_depth" in each for each in doubts(closing()))


def test_a_batch_over_depths_is_the_single_runs() -> None:
    """Two depths, one of them zero, with two dampings: the bits of four single runs."""
    keys: dict[str, list[float]] = {
        "coupling.damping_depth": [0.0, 5e-4, 2e-3],
        "coupling.internal.damping": [1.0, 4.0],
    }
    scene = closing(coupling__friction=0.0)
    batch = gx.run_batch(scene, keys, keep="recordings")
    assert batch.recordings is not None
    for place, rec in np.ndenumerate(batch.recordings):
        values = {key: batch.values[key][place].item() for key in keys}
        assert np.array_equal(rec.finger_force, gx.run(scene.replace(values)).finger_force)
    forces = [rec.finger_force for rec in batch.recordings.ravel()]
    assert not any(np.array_equal(one, other) for one, other in combinations(forces, 2))


@pytest.mark.parametrize("friction", ["stick", 0.6])
def test_the_books_close(friction: Any) -> None:
    """With the energies observed the gap is rounding, and damping has taken energy in the end."""
    rec = gx.run(closing(coupling__passivity="observe", coupling__friction=friction))
    books = rec.energy["object"]
    assert np.abs(books["gap"]).max() < 1e-14 * np.abs(books["fingers"]).max() * len(rec)
    assert books["damped"].sum(axis=1)[-1] > 0.0


def touches(rec: gx.Recording) -> list[tuple[float, float]]:
    """Force [N], and force over the way against the object [mN/um], of each sample in which a finger touches."""
    places = [rec.objects[rec.layout.objects[k]].position for k in rec.layout.finger_objects]
    way = np.linalg.norm(np.diff(rec.finger_position - np.stack(places, axis=1), axis=0), axis=2)
    force = np.linalg.norm(rec.finger_force, axis=2)[1:]
    touched = rec.touching[1:] & ~rec.touching[:-1]
    return [(f, f / x / 1e3) for f, x in zip(force[touched].tolist(), way[touched].tolist(), strict=True)]


@pytest.mark.parametrize(
    ("name", "until"),
    [("pick-and-place", 0.3), ("two-objects", 0.262), ("carry-bar", 0.22), ("knob", 0.26), ("twenty-fingers", 0.02)],
)
def test_the_gallery_tells_the_steps_of_its_touches(name: str, until: float) -> None:
    """The table in docs/scenes.md, from recordings: with the key, and without; all but one below kip, that one near."""
    if name == "two-objects":
        pytest.importorskip("pybullet", reason="pybullet has no wheel for this Python or platform")
    page = (Path(__file__).parents[2] / "docs" / "scenes.md").read_text(encoding="utf-8")
    [line] = [each for each in page.splitlines() if each.startswith(f"| `{name}` | ")]
    force, step, softer, less, kip = (float(cell.split()[0]) for cell in line.split("|")[2:7])
    scene = gx.load(name)
    assert scene.coupling.damping_depth == 1e-3
    assert scene.coupling.internal.stiffness == 1e3 * kip
    for variant, stated in ((scene, (softer, less)), (scene.replace({"coupling.damping_depth": 0.0}), (force, step))):
        most = max(touches(gx.run(variant, duration=until)), key=lambda touch: touch[1])
        assert most == pytest.approx(stated, abs=0.006) and most[0] == pytest.approx(stated[0], abs=6e-4)
    assert less < 0.6 * step and less < 1.5 * kip < 1.5 * step
