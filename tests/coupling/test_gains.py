"""K and D of matrices for gains as the sample makes them: against the analysis' law, the blend, when they are made."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import graspfx as gx
from graspfx.coupling.grasp_state import FingerState
from graspfx.coupling.grasped import GraspedObject
from graspfx.coupling.rules import Rules
from graspfx.errors import InputError
from graspfx.grasp.impedance import ActiveCouplingWarning, per_finger
from graspfx.objects import integrators as body
from graspfx.objects.body import NativeBody
from graspfx.surfaces.closed_form.shape import Box
from tests.support.grasps import RIGID, free_mask, grasped, law, respond
from tests.support.scatter import positive

FloatArray = NDArray[np.float64]

KINDS = ("number", "per finger", "matrix", "matrix per finger", "full")
IGNORED = pytest.mark.filterwarnings("ignore::graspfx.grasp.impedance.ActiveCouplingWarning")


def gain(rng: np.random.Generator, kind: str, n: int, d: int) -> Any:
    if kind == "number":
        return float(rng.uniform(20.0, 80.0))
    if kind == "per finger":
        return rng.uniform(20.0, 80.0, n)
    return positive(rng, *{"matrix": (d, d), "matrix per finger": (n, d, d), "full": (n * d, n * d)}[kind])


def matrices(g: GraspedObject) -> FloatArray:
    """K and D in world axes."""
    n, d = g.fingers, g.dimensions
    start = body.NEXT_ROTATION if g.implicit else body.ROTATION
    turn = np.kron(np.eye(n), g.body_state[start : start + 9].reshape(3, 3)[:d, :d])
    return np.asarray(turn @ np.stack([g.state.stiffness.array(n * d), g.state.damping.array(n * d)]) @ turn.T)


def sampled(g: GraspedObject, p: FloatArray) -> FloatArray:
    g.finger_position[:] = p
    assert g.sample() == 0
    return matrices(g)


def turned(d: int) -> Any:
    return {1: None, 2: 0.7, 3: np.array([0.1, 0.5, -0.3, np.sqrt(0.65)])}[d]


@IGNORED
@pytest.mark.parametrize("form", ["literal", "symmetric"])
@pytest.mark.parametrize("d", [1, 2, 3])
@pytest.mark.parametrize("inner", KINDS)
@pytest.mark.parametrize("outer", KINDS[1:])
def test_they_are_those_of_the_law(outer: str, inner: str, d: int, form: str) -> None:
    """Every pair of kinds, weights that differ, a turned object, three fingers and one: 1e-13 of the largest entry."""
    for n in (1, 3):
        rng = np.random.default_rng([n, d, KINDS.index(outer), KINDS.index(inner)])
        pairs = [(gain(rng, outer, n, d), gain(rng, inner, n, d)) for _ in range(2)]
        gains = law(pairs[0][0], pairs[0][1], pairs[1][0], pairs[1][1], form)
        weights = rng.uniform(0.2, 2.0, n)
        contacts = rng.normal(size=(n, d)) * 0.03
        inertia = {1: None, 2: 4e-5, 3: (1e-5, 2e-5, 3e-5)}[d]
        rules = Rules(attached=True, share=weights.tolist(), axes="world")
        g = grasped(n, d, gains, rules, contacts=contacts, inertia=inertia, orientation=turned(d))
        p, v = rng.normal(size=(2, n, d))
        force = respond(g, p, v)
        K, D = matrices(g)
        R = g.body_state[body.ROTATION : body.ROTATION + 9].reshape(3, 3)[:d, :d]
        split = gx.Grasp(contacts @ R.T).split(metric=weights)
        of_law = gains.force(split, (p - contacts @ R.T).ravel(), v.ravel()).reshape(n, d)
        for made, expected in ((K, gains.stiffness(split)), (D, gains.damping(split)), (force, of_law)):
            np.testing.assert_allclose(made, expected, rtol=0.0, atol=1e-13 * np.abs(expected).max())


@pytest.mark.parametrize("kind", ["all", "no turning", "knob", "rail"])
@pytest.mark.parametrize("integrator", ["exact", "implicit"])
def test_locked_freedoms_and_the_implicit_pose(kind: str, integrator: str) -> None:
    """Free directions stay those of the world while the object turns; the implicit sample is about the next pose."""
    rng = np.random.default_rng(3)
    gains = law(positive(rng, 2, 2), rng.uniform(20.0, 80.0, 3), form="symmetric")
    contacts, free = rng.normal(size=(3, 2)) * 0.03, free_mask(2, kind)
    spin = 40.0 * free[2]
    rules = Rules(attached=True, axes="world")
    g = grasped(3, 2, gains, rules, contacts=contacts, free=free, integrator=integrator, angular_velocity=spin)
    for _ in range(2):
        if g.implicit:
            NativeBody(g.body_state).free_motion(0.005)
        K = sampled(g, contacts)[0]
        start = body.NEXT_ROTATION if g.implicit else body.ROTATION
        R = g.body_state[start : start + 9].reshape(3, 3)[:2, :2]
        expected = gains.stiffness(gx.Grasp(contacts @ R.T, free=free).split())
        np.testing.assert_allclose(K, expected, rtol=0.0, atol=1e-13 * np.abs(expected).max())
        NativeBody(g.body_state).step(0.005)
    assert (R[0, 1] != 0.0) == free[2]


@IGNORED
@pytest.mark.parametrize("form", ["literal", "symmetric"])
def test_a_rotation_joins_bit_by_bit(form: str) -> None:
    """Three contacts near a line: P = sum b_k q_k q_k', or roots of b and 1 - b on both sides; b of 0, 1, between."""
    rng = np.random.default_rng(4)
    A, B = positive(rng, 3, 3), positive(rng, 3, 3, 3)
    found = []
    for offset in (0.0, 0.001, 0.004):
        contacts = np.array([[-0.03, 0.0, 0.0], [0.0, offset, 0.0], [0.03, 0.0, 0.0]])
        K = sampled(
            grasped(3, 3, law(A, B, form=form), RIGID, contacts=contacts, inertia=(1e-5, 2e-5, 3e-5)), contacts
        )[0]
        arms = contacts - contacts.mean(axis=0)
        arm = np.sqrt((arms[:, 1] ** 2).mean())
        t = np.clip((arm - 0.00025) / 0.00075, 0.0, 1.0)
        P = np.zeros((9, 9))
        fields = [np.tile(axis, (3, 1)) for axis in np.eye(3)] + [np.cross(axis, arms) for axis in np.eye(3)[1:]]
        Q = np.linalg.qr(np.array([field.ravel() for field in fields]).T)[0]
        about = np.cross(np.eye(3)[0], arms).ravel()
        beta = t * t * (3.0 - 2.0 * t)
        P = Q @ Q.T
        about -= P @ about
        F, H = P.copy(), np.eye(9) - P
        if arm:
            Z = np.outer(about, about) / (about @ about)
            P += beta * Z
            F += np.sqrt(beta) * Z
            H -= (1.0 - np.sqrt(1.0 - beta)) * Z
        found.append(beta)
        full, I = np.kron(np.eye(3), A), np.eye(9)  # noqa: E741
        each = np.zeros((9, 9))
        for i in range(3):
            each[3 * i : 3 * i + 3, 3 * i : 3 * i + 3] = B[i]
        expected = P @ full + (I - P) @ each if form == "literal" else F @ full @ F + H @ each @ H
        np.testing.assert_allclose(K, expected, rtol=0.0, atol=1e-13 * np.abs(expected).max())
    assert found[0] == 0.0 < found[1] < 1.0 == found[2]


def test_a_finger_without_weight_leaves_the_others_theirs() -> None:
    """Faded to nothing: K of the remaining two, and entries of the third that are next to nothing."""
    gains = law(np.array([30.0, 40.0, 50.0]), np.diag([70.0, 60.0]), form="symmetric")
    g = grasped(3, 2, gains, Rules(), shape=Box((0.05, 0.05)))
    K = sampled(g, np.array([[-0.024, 0.001], [0.024, -0.002], [0.0, 0.06]]))[0]
    pair = law(np.array([30.0, 40.0]), np.diag([70.0, 60.0]), form="symmetric")
    expected = pair.stiffness(gx.Grasp(g.contact_position[:2]).split())
    np.testing.assert_allclose(K[:4, :4], expected, rtol=0.0, atol=1e-4)  # a weight of 1e-12 is 1e-6 of a length
    assert np.abs(K[4:]).max() < 1e-4
    assert g.touching.tolist() == [1.0, 1.0, 0.0]


def test_equal_gains_are_taken_as_they_stand() -> None:
    """No split, and no projector in it: the gain of each finger by itself."""
    rng = np.random.default_rng(5)
    A = positive(rng, 3, 3)
    g = grasped(2, 3, law(A, np.stack([A, A])), RIGID, contacts=rng.normal(size=(2, 3)), inertia=4e-5)
    assert np.array_equal(sampled(g, np.zeros((2, 3)))[0], np.kron(np.eye(2), A))
    assert g.state.split_known == 0.0


@pytest.mark.parametrize(
    ("outer", "axes", "turns"), [("per finger", "world", False), ("matrix", "world", True), ("matrix", "object", False)]
)
def test_they_are_made_anew_where_something_has_changed(outer: str, axes: Any, turns: bool) -> None:
    """A contact or a weight; the rotation only where a gain has the world's axes."""
    rng = np.random.default_rng(6)
    gains = law(gain(rng, outer, 3, 2), 70.0, form="symmetric")
    g = grasped(3, 2, gains, Rules(attached=True, axes=axes), contacts=rng.normal(size=(3, 2)) * 0.03)
    o = g.state.stiffness.offset

    def made() -> bool:
        g.block[o] = 12345.0
        assert g.sample() == 0
        return bool(g.block[o] != 12345.0)

    assert made() and not made()
    g.array(FingerState.contact)[1, 0] += 1e-9
    assert made() and not made()
    g.array(FingerState.weight)[2] = 0.5
    assert made() and not made()
    c, s = np.cos(0.1), np.sin(0.1)
    g.body_state[body.ROTATION : body.ROTATION + 5] = [c, -s, 0.0, s, c]
    assert made() == turns and not made()


def test_a_run_warns_once_of_gains_that_create_energy() -> None:
    """Kep 80|40 with kip 60|30 as in the analysis: the skew part of 2.5 N/m, when the run is over."""
    finger = {
        "device": {"name": "simulated", "mass": 0.15, "damping": 0.2},
        "hand": {"stiffness": 33.0, "rest": [0.0]},
        "start": [0.002],
    }
    table = {
        "dimensions": 1, "period": 0.005, "duration": 0.05, "object": {"mass": 0.1, "viscosity": 0.8},
        "coupling": {
            "contact": "attached", "external": {"stiffness": [80.0, 40.0]}, "internal": {"stiffness": [60.0, 30.0]},
        },
        "finger": [finger, finger],
    }  # fmt: skip
    with pytest.warns(ActiveCouplingWarning, match=r"skew part of 2\.5 N/m") as told:
        gx.run(gx.Scene.model_validate(table))
    assert len(told) == 1


def test_a_gain_that_does_not_fit_is_refused() -> None:
    with pytest.raises(InputError, match=r"gain: given an array of shape \(4,\), expected a number, 3 numbers"):
        per_finger(np.ones(4), 3, 2)
    with pytest.raises(InputError, match=r"\(3, 3\)"):
        grasped(2, 2, law(np.eye(3), 70.0), RIGID)
