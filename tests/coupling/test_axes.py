"""Gains that are matrices in the object's, the world's and the contacts' axes: the energy of closed motions."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import graspfx as gx
from graspfx.assembly.grasps import axes_notes
from graspfx.assembly.resolve import resolve
from graspfx.certificate.linearise import linearise
from graspfx.coupling.closed_motion import worst_turn
from graspfx.coupling.grasped import GraspedObject
from graspfx.coupling.rules import Rules
from graspfx.errors import SceneError
from graspfx.grasp.impedance import ActiveCouplingWarning, Coupling, Impedance
from graspfx.grasp.object_impedance import ObjectImpedance
from graspfx.objects.body import NativeBody
from graspfx.surfaces.closed_form.shape import Box, Sphere
from tests.support.closed_paths import gain_per_loop
from tests.support.grasps import grasped, law, respond
from tests.support.meshes import plate
from tests.support.scatter import positive

FloatArray = NDArray[np.float64]

IGNORED = pytest.mark.filterwarnings("ignore::graspfx.grasp.impedance.ActiveCouplingWarning")
DISC = 0.025 * np.array([[np.cos(a), np.sin(a)] for a in 2.0 * np.pi * np.arange(3) / 3])
EQUAL = np.diag([120.0, 30.0])
LARGER = np.diag([150.0, 60.0])  # 30 N/m more in every direction: the difference commutes with P


def in_space(gains: Coupling, n: int) -> tuple[GraspedObject, FloatArray]:
    """n fingers attached to a body that is free in space."""
    start = np.random.default_rng(n).uniform(-0.03, 0.03, (n, 3))
    return grasped(n, 3, gains, Rules(attached=True), contacts=start), start


def on_a_disc(gains: Coupling, **rules: Any) -> GraspedObject:
    return grasped(3, 2, gains, Rules(attached=True, **rules), contacts=DISC, inertia=4e-5)


@IGNORED
@pytest.mark.parametrize("form", ["literal", "symmetric"])
@pytest.mark.parametrize("kind", ["equal", "commutes", "d x d", "per finger", "full"])
def test_springs_in_the_objects_axes_create_no_energy(kind: str, form: str) -> None:
    """Closed motions of object and fingers in space, 1e-10 of the peak; literally only where Kep - Kip commutes."""
    rng = np.random.default_rng(7)
    for n in (2, 3, 5):
        A = positive(rng, 3, 3)
        pairs: dict[str, tuple[Any, Any]] = {
            "equal": (A, A),
            "commutes": (A, A + 40.0 * np.eye(3)),
            "d x d": (A, positive(rng, 3, 3)),
            "per finger": (positive(rng, n, 3, 3), positive(rng, n, 3, 3)),
            "full": (positive(rng, 3 * n, 3 * n), positive(rng, 3 * n, 3 * n)),
        }
        g, start = in_space(law(*pairs[kind], form=form), n)
        worst = max(abs(gain_per_loop(g, start, seed)) for seed in range(2))
        if form == "symmetric" or kind in ("equal", "commutes"):
            assert worst < 1e-10
        else:
            assert worst > 1e-3  # and the warning says so


@pytest.mark.parametrize("gains", [(EQUAL, EQUAL), (EQUAL, LARGER)])
def test_springs_in_world_axes_create_energy_on_a_turning_object(gains: tuple[FloatArray, FloatArray]) -> None:
    """Three fingers on a disc, closed turns of half a radian: 72 and 71 % of the peak, in the symmetric form too."""
    for form in ("literal", "symmetric"):
        world = on_a_disc(law(*gains, form=form), axes="world")
        assert abs(worst_turn(world, DISC).share) == pytest.approx(0.71, abs=0.01)
        assert abs(worst_turn(on_a_disc(law(*gains, form=form)), DISC).share) < 1e-14


def test_the_line_integral_is_that_of_numpy() -> None:
    """The disc and one of its motions written out: f = diag(120, 30) e in the world, wrench times velocity."""
    found = worst_turn(on_a_disc(law(EQUAL, EQUAL), axes="world"), DISC)
    shares = []
    for angle in (0.0, 0.25 * np.pi, 0.5 * np.pi, -0.25 * np.pi):
        u, work, stored = np.array([np.cos(angle), np.sin(angle)]), 0.0, []
        for phase in 2.0 * np.pi * np.arange(4096) / 4096:
            c, s = np.cos(0.5 * np.sin(phase)), np.sin(0.5 * np.sin(phase))
            x = 0.00625 * (1.0 + np.cos(phase)) * u
            e = DISC - x - DISC @ np.array([[c, s], [-s, c]])
            f = e @ EQUAL
            arm = DISC - x
            power = -0.00625 * np.sin(phase) * float(f.sum(axis=0) @ u)
            power += 0.5 * np.cos(phase) * float((arm[:, 0] * f[:, 1] - arm[:, 1] * f[:, 0]).sum())
            work += power * 2.0 * np.pi / 4096
            stored.append(0.5 * float((f * e).sum()))
        shares.append(abs(work) / max(stored))
    assert abs(found.share) == pytest.approx(max(shares), rel=0.01)  # the peak is that of 24 samples


@pytest.mark.parametrize("friction", [0.4, "stick"])
def test_the_implicit_and_the_frictional_samples_have_the_objects_axes(friction: float | str) -> None:
    """A body that is turned by 0.5 rad, and gains turned back with world axes: the same forces to rounding."""
    angle = 0.5
    R = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    rules: dict[str, Any] = (
        {"fade": None, "stick": True} if friction == "stick" else {"fade": None, "friction": friction}
    )
    A, B = positive(np.random.default_rng(1), 2, 2), positive(np.random.default_rng(2), 2, 2)
    fingers = np.array([[-0.023, 0.002], [0.022, -0.001]]) @ R.T
    for integrator in ("exact", "implicit"):
        forces = []
        for axes, turn in (("object", np.eye(2)), ("world", R)):
            rules["axes"] = axes
            gains = law(turn @ A @ turn.T, turn @ B @ turn.T, 0.1, 0.2, form="symmetric")
            settings: dict[str, Any] = {"inertia": 4e-5, "orientation": angle, "integrator": integrator}
            g = grasped(2, 2, gains, Rules(**rules), shape=Box((0.05, 0.05)), **settings)
            if g.implicit:
                NativeBody(g.body_state).free_motion(0.005)
            g.meet(1.2 * fingers)
            for depth in (1.1, 1.0, 1.0):
                g.finger_position[:] = depth * fingers
                assert g.sample() == 0
            forces.append(g.force.copy())
        assert np.abs(forces[0]).max() > 0.03
        np.testing.assert_allclose(forces[0], forces[1], rtol=0.0, atol=1e-12)


def test_contact_axes_are_a_normal_and_a_tangential_gain() -> None:
    """A ball that is touched askew: kn along each contact's normal, kt along the surface, whichever way that is."""
    gains = np.diag([120.0, 30.0, 30.0])
    points = 0.03 * np.array([[1.0, 0.0, 0.0], [0.0, 0.6, 0.8], [-0.6, -0.8, 0.0]])
    g = grasped(3, 3, law(gains, gains), Rules(axes="contact", stick=True, fade=None), shape=Sphere(0.03))
    g.meet(points)
    e = np.random.default_rng(3).normal(size=(3, 3)) * 1e-3 - 0.1 * points
    g.touching[:] = 1.0  # contacts hold where they are
    g.finger_position[:] = points + e
    assert g.sample() == 0
    n = -points / 0.03
    deep = (n * e).sum(axis=1, keepdims=True) * n
    np.testing.assert_allclose(g.force, 120.0 * deep + 30.0 * (e - deep), rtol=0.0, atol=1e-13)


def energy_of_sliding(seed: int, count: int, of_object: bool = False) -> float:
    """Measure what a finger spends on a closed path deep in a ball that stays, over the most that its springs hold.

    With the object's stiffness its translations count as free, so that all of a lone finger's force is external.
    """
    K = np.diag([120.0, 30.0, 60.0])
    gains = law(K, K, form="symmetric")
    if of_object:
        gains = Coupling(ObjectImpedance([120.0, 30.0, 60.0, 0.0, 0.0, 0.0]), Impedance(70.0))
    free = [of_object] * 3 + [False] * 3
    g = grasped(1, 3, gains, Rules(fade=None), shape=Sphere(0.03), free=free)
    rng = np.random.default_rng(seed)
    a, middle = rng.normal(size=(3, 2, 3)), rng.normal(size=3)
    phase = 2.0 * np.pi * np.arange(2 * count) / count  # the second round counts
    path = np.tile(middle / np.linalg.norm(middle), (2 * count, 1))
    for k in range(2):
        path += 0.4 * (np.outer(np.cos((k + 1) * phase), a[0, k]) + np.outer(np.sin((k + 1) * phase), a[1, k]))
    path /= np.linalg.norm(path, axis=1, keepdims=True)
    path *= (0.024 + 0.004 * np.sin(phase + rng.uniform(0.0, 6.0)))[:, None]
    g.meet(1.6 * path[:1])
    f = np.array([respond(g, p)[0] for p in path])[count:]
    step = np.roll(path[:count], -1, axis=0) - path[:count]
    spent = ((f + np.roll(f, -1, axis=0)) / 2.0 * step).sum()
    return float(spent / (0.5 * np.einsum("ki,ij,kj->k", f, np.linalg.inv(K), f)).max())


@pytest.mark.parametrize("of_object", [False, True])
@pytest.mark.parametrize("seed", [1, 6, 7, 10])
def test_contacts_that_slip_freely_keep_what_the_springs_hold(seed: int, of_object: bool) -> None:
    """Equal matrices without friction, as the limit of a small coefficient: what sliding makes goes with the step.

    With the closest point as the contact these paths make or take 25, 36, 27 and 12 % of the peak at any step.
    """
    coarse, fine = (abs(energy_of_sliding(seed, count, of_object)) for count in (400, 800))
    assert fine < 0.006
    assert fine < 0.8 * coarse


def scene(**coupling: Any) -> gx.Scene:
    matrix = {"stiffness": EQUAL.tolist()}
    changes = {"external": matrix, "internal": matrix} | coupling
    return gx.load("paper-waving-turning", {f"coupling.{key}": value for key, value in changes.items()})


def test_check_and_run_warn_of_world_axes_with_the_figure() -> None:
    assert axes_notes(resolve(scene())) == []
    (note,) = axes_notes(resolve(scene(axes="world")))
    assert "world axes generate energy on object as it rotates: up to " in note and "axes = 'object'" in note
    with pytest.warns(ActiveCouplingWarning, match="world axes generate energy"):
        gx.run(scene(axes="world"), duration=0.05)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        gx.run(scene(), duration=0.05)


def test_matrices_on_a_turned_object() -> None:
    """The default turns with the object; the world's axes do not."""
    runs = [
        gx.run(scene(form="symmetric", **axes).replace({"object.orientation": 0.5}), duration=1.0)
        for axes in ({}, {"axes": "object"})
    ]
    with pytest.warns(ActiveCouplingWarning):
        world = gx.run(scene(axes="world").replace({"object.orientation": 0.5}), duration=1.0)
    assert np.array_equal(runs[0].finger_force, runs[1].finger_force)
    assert np.abs(runs[0].finger_force - world.finger_force).max() > 1e-3


@pytest.mark.parametrize("contact", ["attached", "unilateral"])
def test_the_certificate_has_the_axes_of_the_run(contact: str) -> None:
    """K of the linearised grasp at the start, on a body turned by 0.5 rad, against world axes with turned matrices."""
    c, s = np.cos(0.5), np.sin(0.5)
    R = np.array([[c, -s], [s, c]])
    K = []
    for axes, turn in (("object", np.eye(2)), ("world", R)):
        gains = [{"stiffness": (turn @ each @ turn.T).tolist()} for each in (EQUAL, LARGER)]
        made = scene(axes=axes, external=gains[0], internal=gains[1], form="symmetric", contact=contact)
        K.append(linearise(made.replace({"object.orientation": 0.5}), at="start").linear.stiffness)
    np.testing.assert_allclose(K[0], K[1], rtol=0.0, atol=1e-12 * np.abs(K[0]).max())
    plain = linearise(
        scene(axes="world", external={"stiffness": EQUAL.tolist()}, form="symmetric", contact=contact), "start"
    )
    assert np.abs(K[0] - plain.linear.stiffness).max() > 1.0


def test_contact_axes_refuse_what_they_cannot_be() -> None:
    with pytest.raises(SceneError, match=r"contact axes, expected \[\[k_n, 0\], \[0, k_t\]\]"):
        scene(axes="contact", internal={"stiffness": [[100.0, 5.0], [5.0, 30.0]]})
    assert scene(axes="contact").coupling.axes == "contact"


def test_a_meshs_gains_stand_in_the_axes_of_its_file() -> None:
    """A box as a mesh with its long side along y has its body's axes elsewhere: forces are those of the box."""
    forces = []
    size = np.array([0.04, 0.06, 0.05])
    corners, faces = plate(*size.tolist())
    matrix = {"stiffness": np.diag([120.0, 60.0, 30.0]).tolist()}
    motion = {"kind": "reach", "displacement": [0.0, 0.003, 0.002], "duration": 0.2}
    for shape in (
        {"kind": "box", "size": size.tolist()},
        {"kind": "mesh", "vertices": corners.tolist(), "faces": faces.tolist()},
    ):
        table = {
            "dimensions": 3,
            "period": 0.001,
            "duration": 0.2,
            "object": {"mass": 0.1, "viscosity": 0.8, "rotational_viscosity": 1e-3, "shape": shape},
            "coupling": {"external": matrix, "internal": matrix, "friction": "stick", "form": "symmetric"},
            "finger": [
                {
                    "device": {"name": "simulated", "mass": 0.15, "damping": 0.2},
                    "hand": {"stiffness": 100.0, "squeeze": 0.004, "squeeze_ramp": 0.02, "motion": motion},
                    "start": [s * 0.021, 0.004, 0.003 * s],
                }
                for s in (-1.0, 1.0)
            ],
        }
        forces.append(gx.run(gx.Scene.model_validate(table)).finger_force)
    assert np.abs(forces[0][..., 1]).max() > 1e-3
    np.testing.assert_allclose(forces[0], forces[1], rtol=0.0, atol=1e-9 * np.abs(forces[0]).max())


def test_the_symmetric_form_in_the_blends_band_lies_between_the_gains() -> None:
    """40/160 as matrices on an arm of 0.8 mm: the rotation has b 40 + (1 - b) 160 N/m, never less than either."""
    contacts = 0.0008 * DISC / 0.025
    for A, B in ((40.0, 160.0), (40.0 * np.eye(2), 160.0 * np.eye(2))):
        g = grasped(3, 2, law(A, B, form="symmetric"), Rules(attached=True), contacts=contacts, inertia=4e-5)
        turn = np.stack([-contacts[:, 1], contacts[:, 0]], axis=1)
        g.finger_position[:] = contacts + turn
        assert g.sample() == 0
        t = (0.8 - 0.25) / 0.75
        b = t * t * (3.0 - 2.0 * t)
        np.testing.assert_allclose(g.force, (b * 40.0 + (1.0 - b) * 160.0) * turn, rtol=0.0, atol=1e-15)


@pytest.mark.parametrize("axes", ["object", "contact"])
def test_compiled_ticks_of_matrices_have_the_same_bits(axes: str) -> None:
    """Contacts that slip freely keep e + s in both engines."""
    damped = {"stiffness": EQUAL.tolist(), "damping": 0.2}, {"stiffness": LARGER.tolist(), "damping": 0.2}
    made = scene(axes=axes, external=damped[0], internal=damped[1], form="symmetric", friction=0.0)
    runs = [gx.run(made.replace({"engine": engine}), duration=0.2) for engine in ("interpreted", "compiled")]
    assert np.abs(runs[0].finger_force).max() > 0.02
    assert np.array_equal(runs[0].rows, runs[1].rows)
