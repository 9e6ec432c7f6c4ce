"""Scenes with a stiffness of the object: beside gains that are numbers, in every contact case, live, in batches."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import graspfx as gx
from graspfx.assembly.resolve import resolve
from graspfx.certificate.linearise import linearise
from graspfx.certificate.notes import blend_notes
from graspfx.errors import SceneError
from tests.support.scatter import positive

NUMBERS = ("reference-1dof", "paper-waving", "sphere-three-fingers")


def alike(scene: gx.Scene) -> gx.Scene:
    """The object's stiffness and damping that equal numbers for gains make on this grasp: kep G G'."""
    loop, d = linearise(scene, "start"), scene.dimensions
    G = gx.grasp_matrix(loop.contacts - np.array(scene.object[0].position or (0.0,) * d))
    outer = scene.coupling.external
    gains = {f"object_{name}": (getattr(outer, name) * G @ G.T).tolist() for name in ("stiffness", "damping")}
    return scene.replace({"coupling.external": gains, "coupling.blend": list(scene.coupling.blend)})


@pytest.mark.parametrize("name", NUMBERS)
def test_it_runs_and_is_judged_like_the_numbers_that_it_equals(name: str) -> None:
    """On grasps whose arms are alike kep G G' is kep P: forces to 1e-12, margins of every mode to 1e-9."""
    scene = gx.load(name)
    own = alike(scene)
    one, other = gx.run(scene, duration=0.5), gx.run(own, duration=0.5)
    np.testing.assert_allclose(other.finger_force, one.finger_force, rtol=0.0, atol=1e-12)
    rows = [{row.mode: row.margin for row in gx.certify(each)[0].limits} for each in (scene, own)]
    shared = [mode for mode in rows[0] if not mode.startswith("pushing")]
    assert shared
    for mode in shared:
        assert rows[1][mode] == pytest.approx(rows[0][mode], rel=1e-8)
    assert gx.check(own).ok


@pytest.mark.parametrize("d", [1, 2])
def test_the_limit_is_a_factor_on_it(d: int) -> None:
    """The spectral radius passes 1 where K_o times the margin is reached, by a run of the loop's matrices."""
    scene = alike(gx.load({1: "reference-1dof", 2: "paper-waving"}[d]))
    [row] = [row for row in gx.certify(scene)[0].limits if row.mode == "external"]
    K = np.array(scene.coupling.external.stiffness)
    for factor, stable in ((0.999, True), (1.001, False)):
        more = scene.replace({"coupling.external.object_stiffness": (row.margin * factor * K).tolist()})
        assert (gx.stability.spectral_radius(more.linearise("start")) < 1.0) == stable


def stated(scene: str, **changes: Any) -> gx.Scene:
    """A scene of the shelf with a stiffness of the object whose freedoms are coupled."""
    base = gx.load(scene)
    w = {1: 1, 2: 3, 3: 6}[base.dimensions]
    unit = np.array([1.0] * base.dimensions + [0.03] * (w - base.dimensions))
    K = 2.0 * positive(np.random.default_rng(1), w, w) * np.outer(unit, unit)
    gains = {"object_stiffness": K.tolist(), "object_damping": (2e-3 * K).tolist()}
    return base.replace(
        {"coupling.external": gains, **{key.replace("__", "."): value for key, value in changes.items()}}
    )


SOFT: dict[str, Any] = {
    f"finger__{i}__{key}": value for i in range(3) for key, value in (("model", "soft"), ("patch", 0.008))
}
KINDS: list[tuple[str, dict[str, Any]]] = [
    ("reference-1dof", {}),
    ("paper-waving", {}),
    ("paper-waving", {"coupling__friction": 0.0}),
    ("paper-waving", {"coupling__friction": 0.5}),
    ("paper-waving", {"object__integrator": "implicit"}),
    ("paper-waving", {"coupling__passivity": "observe"}),
    ("sphere-three-fingers", {}),
    ("sphere-three-fingers", {"coupling__friction": 0.0}),
    ("sphere-three-fingers", {"coupling__friction": "stick"}),
    ("sphere-three-fingers", {"coupling__split": "weights", "coupling__weights": [1.0, 2.0, 0.5]}),
    ("sphere-three-fingers", SOFT),
    ("sphere-three-fingers", SOFT | {"coupling__contact": "attached"}),
    ("sphere-three-fingers", SOFT | {"object__integrator": "implicit"}),
    ("sphere-three-fingers", SOFT | {"coupling__passivity": "observe", "coupling__damping_depth": 0.002}),
]


def name_of(changes: dict[str, Any]) -> str:
    soft = "soft " if SOFT.items() <= changes.items() else ""
    return f"{soft}{ {key: value for key, value in changes.items() if not soft or key not in SOFT} }"


@pytest.mark.parametrize(("name", "changes"), KINDS, ids=[f"{name} {name_of(changes)}" for name, changes in KINDS])
def test_every_contact_case_runs_to_the_same_bits(name: str, changes: dict[str, Any]) -> None:
    """Interpreted and compiled, and one of a batch: finite forces, the same bits."""
    scene = stated(name, **changes)
    one = gx.run(scene, duration=0.2)
    assert np.isfinite(one.finger_force).all() and np.abs(one.finger_force).max() > 0.0
    other = gx.run(scene.replace({"engine": "interpreted"}), duration=0.2)
    np.testing.assert_array_equal(one.finger_force, other.finger_force)
    np.testing.assert_array_equal(one.object_position, other.object_position)


def test_a_batch_has_the_bits_of_single_runs() -> None:
    """Three stiffnesses of the object side by side."""
    scene = stated("sphere-three-fingers")
    values = [(s * np.array(scene.coupling.external.stiffness)).tolist() for s in (0.5, 1.0, 1.5)]
    batch = gx.run_batch(scene.replace({"duration": 0.1}), {"coupling.external.object_stiffness": values})
    for k, value in enumerate(values):
        one = gx.run(scene.replace({"coupling.external.object_stiffness": value}), duration=0.1)
        for quantity in ("finger_force", "object_position"):
            np.testing.assert_array_equal(batch[quantity]["last"][k], getattr(one, quantity)[-1])
            np.testing.assert_array_equal(batch[quantity]["max"][k], getattr(one, quantity).max(axis=0))


def test_it_changes_while_the_scene_runs() -> None:
    """Set in mid-run at rest, the force is that of the new stiffness from the next tick on."""
    key = "coupling.external.object_stiffness"
    scene = stated("paper-waving")
    K = np.array(scene.coupling.external.stiffness)
    with gx.open(scene, live=[key]) as session:
        session.step(ticks=50)
        session.set(key, (3.0 * K).tolist())
        session.step(ticks=50)
        changed = session.recording
    start = gx.run(scene, duration=changed.time[50])
    np.testing.assert_array_equal(changed.finger_force[:50], start.finger_force[:50])
    assert np.abs(changed.finger_force[50:]).max() > 0.0
    with gx.open(scene.replace({key: (3.0 * K).tolist()}), live=[key]) as session:
        session.step(ticks=1)
        first = session.recording
    assert not np.array_equal(first.finger_force[0], start.finger_force[0]) or not first.finger_force[0].any()


@pytest.mark.parametrize(
    ("changes", "key"),
    [
        ({"coupling.external": {"object_stiffness": [1.0, 2.0]}}, "object_stiffness"),
        ({"coupling.external": {"object_stiffness": [1.0, 2.0, -1.0]}}, "object_stiffness"),
        ({"coupling.external": {"object_stiffness": [1.0, 2.0, 0.0]}}, "object_stiffness"),
        ({"coupling.external": {"object_stiffness": [1.0, 2.0, 0.1], "object_point": [0.0]}}, "object_point"),
        ({"coupling.external": {"object_stiffness": [1.0, 2.0, 0.1]}, "coupling.axes": "world"}, "axes"),
        ({"coupling.external": {"object_stiffness": [1.0, 2.0, 0.1], "stiffness": 30.0}}, "stiffness"),
        ({"coupling.external": {"object_damping": [1.0, 2.0, 0.1]}}, "object_stiffness"),
        ({"coupling.split": "weights"}, "weights"),
        ({"coupling.split": "weights", "coupling.weights": [1.0]}, "weights"),
        ({"coupling.weights": [1.0, 1.0]}, "weights"),
        ({"coupling.split": "weights", "coupling.weights": [1.0, 1.0], "coupling.metric": "mass"}, "metric"),
    ],
)
def test_faults_are_told_by_their_key(changes: dict[str, Any], key: str) -> None:
    with pytest.raises(SceneError, match=f"coupling[.a-z]*{key}"):
        gx.load("paper-waving", changes)


def test_a_short_arm_has_a_note() -> None:
    """30 mm / sqrt 2 in a blend up to 50 mm: 0.09 N m/rad is 12 N/m at most in three fingers, where 66.7 were asked."""
    gains = {"object_stiffness": [60.0, 60.0, 60.0, 0.09, 0.09, 0.09]}
    scene = gx.load("sphere-three-fingers", {"coupling.external": gains, "coupling.blend": [0.001, 0.05]})
    [note] = blend_notes(resolve(scene))
    assert "an arm of 21.2 mm" in note and "at most 12 N/m" in note and "up to 66.7 N/m" in note
    assert gx.load("sphere-three-fingers", {"coupling.external": gains}).coupling.blend == (0.001, 0.01)


def test_metric_is_another_name_for_the_mass_split() -> None:
    """The same forces, to the bit."""
    one, other = (
        gx.run(gx.load("paper-waving", {key: "mass"}), duration=0.2) for key in ("coupling.metric", "coupling.split")
    )
    np.testing.assert_array_equal(one.finger_force, other.finger_force)


def soft_pinch(damping: float, **changes: Any) -> gx.Scene:
    """Two soft fingers on a bar, with 0.2 N m/rad about the line between them and a damping of turns [N m s/rad]."""
    gains = {
        "object_stiffness": [600.0, 600.0, 600.0, 0.2, 0.2, 0.2],
        "object_damping": [1.0, 1.0, 1.0, damping, damping, damping],
        "object_point": [-0.015, 0.0, 0.0],  # on the line
    }
    return gx.load("soft-pinch", {"coupling.external": gains, "coupling.blend": [1e-4, 1e-3], **changes})


def test_two_soft_fingers_hold_a_bar_beside_its_centre() -> None:
    """0.2 N m/rad about the line of a pinch, which points cannot hold: the bar sags by m g 15 mm / 0.2, 1e-3."""
    scene = soft_pinch(1e-3)
    rec = gx.run(scene, duration=1.0)
    orientation = rec.objects["bar"].orientation
    assert orientation is not None
    turn = 2.0 * np.arcsin(orientation[-1, 1])
    assert abs(turn) == pytest.approx(0.03 * 9.81 * 0.015 / 0.2, rel=1e-3)


@pytest.mark.parametrize(("damping", "stable"), [(1e-4, True), (2e-3, False)])
def test_a_certificate_of_soft_fingers_is_that_of_the_run(damping: float, stable: bool) -> None:
    """A small turn of the bar about its axis dies away, or grows by the spectral radius in each sample, 0.5 %."""
    [certificate] = gx.certify(soft_pinch(damping))
    assert (certificate.spectral_radius < 1.0) == stable
    assert any("torsion that object_stiffness gives" in text for text in certificate.assumed)
    rec = gx.run(soft_pinch(damping, **{"object.angular_velocity": [1e-7, 0.0, 0.0]}), duration=0.1)
    velocity = rec.objects["bar"].angular_velocity
    assert velocity is not None
    spin = np.abs(velocity[:, 0])
    growth = (spin[45] / spin[15]) ** (1.0 / 30.0)
    assert growth < 1.0 if stable else growth == pytest.approx(certificate.spectral_radius, rel=5e-3)


def test_the_squeeze_adds_its_geometric_stiffness() -> None:
    """Two fingers in the plane: 2 kep r^2 [(1 - d/r)^2 + (kip/kep)(d/r)(1 - d/r)] where K_o has 2 kep r^2.

    To 1e-6 of the difference.
    """
    kep, kip, r = 30.0, 70.0, 0.025
    scene = gx.load("paper-waving", {
        "object.free": [True, True, True], "object.rotational_viscosity": 1e-3,
        "coupling.external": {"object_stiffness": [2.0 * kep, 2.0 * kep, 2.0 * kep * r**2]},
    })  # fmt: skip
    loop = linearise(scene, "squeezed")
    [geometric] = loop.geometric
    assert geometric is not None
    d = float(np.abs(loop.tips - loop.contacts)[:, 0].max()) / r
    added = 2.0 * kep * r**2 * ((1.0 - d) ** 2 + kip / kep * d * (1.0 - d) - 1.0)
    wanted = np.diag([0.0, 0.0, added])
    np.testing.assert_allclose(geometric, wanted, rtol=0.0, atol=1e-6 * added)
    [note] = gx.certify(scene)[0].notes
    assert f"add {added:+.3g} N m/rad in rotations" in note
    assert linearise(gx.load("paper-waving"), "squeezed").geometric == (None,)
