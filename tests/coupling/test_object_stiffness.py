"""The stiffness of the object shared out among the contacts: against dense algebra, short arms, energy, who leaves."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import graspfx as gx
from graspfx.coupling.closed_motion import worst_turn
from graspfx.coupling.grasped import GraspedObject
from graspfx.coupling.rules import Rules
from graspfx.objects import integrators as body
from graspfx.objects.body import NativeBody
from graspfx.surfaces.closed_form.shape import Box, Sphere
from tests.support.grasps import INERTIA, free_mask, grasped, polygon, respond
from tests.support.scatter import positive

FloatArray = NDArray[np.float64]

FREEDOMS = {1: 1, 2: 3, 3: 6}


def object_gain(rng: np.random.Generator, d: int) -> FloatArray:
    """A stiffness of the object with coupled freedoms: of the order of 100 N/m and 0.1 N m/rad."""
    unit = np.array([1.0] * d + [0.03] * (FREEDOMS[d] - d))
    return positive(rng, FREEDOMS[d], FREEDOMS[d]) * np.outer(unit, unit)


def share(G: FloatArray, K: FloatArray, weights: FloatArray) -> tuple[FloatArray, FloatArray]:
    """X K_c X' and P of THEORY 9, by pseudo-inverses in units of 30 mm."""
    unit = np.ones(len(G))
    unit[len(G) - {1: 0, 3: 1, 6: 3}.get(len(G), 0) :] = 1.0 / 0.03
    G, K, M = unit[:, None] * G, K * np.outer(unit, unit), np.diag(weights)
    U, values, _ = np.linalg.svd(G)
    N = U[:, (values > 1e-9 * values[0]).sum() :]
    Kc = K - K @ N @ np.linalg.pinv(N.T @ K @ N) @ N.T @ K
    X = M @ G.T @ np.linalg.pinv(G @ M @ G.T, rcond=1e-12)
    return X @ Kc @ X.T, X @ G


def matrices(g: GraspedObject) -> FloatArray:
    """K and D in world axes."""
    n, d = g.fingers, g.dimensions
    start = body.NEXT_ROTATION if g.implicit else body.ROTATION
    turn = np.kron(np.eye(n), g.body_state[start : start + 9].reshape(3, 3)[:d, :d])
    return np.asarray(turn @ np.stack([g.state.stiffness.array(n * d), g.state.damping.array(n * d)]) @ turn.T)


def sampled(g: GraspedObject, p: FloatArray) -> FloatArray:
    respond(g, p)
    return matrices(g)[0]


@pytest.mark.parametrize("inner", ["number", "per finger", "matrix"])
@pytest.mark.parametrize("d", [1, 2, 3])
@pytest.mark.parametrize("n", [1, 2, 3, 6])
def test_it_is_that_of_dense_algebra(n: int, d: int, inner: str) -> None:
    """One to six fingers, weights that differ, a turned object: 1e-10 of the largest entry, symmetric to the bit."""
    rng = np.random.default_rng([n, d, len(inner)])
    K_o, D_o = object_gain(rng, d), 0.01 * object_gain(rng, d)
    kip: Any = {"number": 70.0, "per finger": rng.uniform(20.0, 80.0, n), "matrix": positive(rng, d, d)}[inner]
    gains = gx.Coupling(gx.ObjectImpedance(K_o, D_o), gx.Impedance(kip, 0.2), form="symmetric")
    weights = rng.uniform(0.2, 2.0, n)
    contacts = rng.normal(size=(n, d)) * 0.03
    turned = {1: None, 2: 0.7, 3: np.array([0.1, 0.5, -0.3, np.sqrt(0.65)])}[d]
    rules = Rules(attached=True, share=weights.tolist(), blend=(1e-9, 2e-9))
    g = grasped(n, d, gains, rules, contacts=contacts, inertia=INERTIA[d], orientation=turned)
    p, v = rng.normal(size=(2, n, d))
    force = respond(g, p, v)
    G, W = gx.grasp_matrix(contacts), np.repeat(weights, d)
    blocks = np.zeros((n * d, n * d))
    L = np.diag(np.sqrt(W))
    for i in range(n):
        own = kip if inner == "matrix" else np.broadcast_to(kip, n)[i] * np.eye(d)
        blocks[i * d : i * d + d, i * d : i * d + d] = own
    R = g.body_state[body.ROTATION : body.ROTATION + 9].reshape(3, 3)[:d, :d]
    turn = np.kron(np.eye(n), R)
    e = turn.T @ (p - contacts @ R.T).ravel()
    expected = []
    for gain, own in ((K_o, L @ blocks @ L), (D_o, 0.2 * np.diag(W))):
        Kep, P = share(G, gain, W)
        expected.append(Kep + (np.eye(n * d) - P) @ own @ (np.eye(n * d) - P).T)
    K, D = matrices(g)
    for found, wanted in zip((K, D), expected, strict=True):
        np.testing.assert_allclose(found, turn @ wanted @ turn.T, rtol=0.0, atol=1e-10 * np.abs(wanted).max())
    own = g.state.stiffness.array(n * d)
    assert np.array_equal(own, own.T)
    of_law = gains.turned(R).stiffness(gx.Grasp(contacts @ R.T).split(metric=weights))
    np.testing.assert_allclose(K, of_law, rtol=0.0, atol=1e-10 * np.abs(K).max())
    damped = expected[1] @ turn.T @ v.ravel()
    whole = turn @ (expected[0] @ e + damped)
    np.testing.assert_allclose(force.ravel(), whole, rtol=0.0, atol=1e-9 * np.abs(force).max())


@pytest.mark.parametrize("kind", ["all", "no turning", "knob", "rail"])
@pytest.mark.parametrize("integrator", ["exact", "implicit"])
def test_locked_freedoms_lose_their_rows_and_columns(kind: str, integrator: str) -> None:
    """G K G' is K_o on what is left, along the world's directions as they stand in the turned object."""
    rng = np.random.default_rng(3)
    K_o, free = object_gain(rng, 2), free_mask(2, kind)
    gains = gx.Coupling(gx.ObjectImpedance(K_o), gx.Impedance(70.0))
    contacts = rng.normal(size=(3, 2)) * 0.03
    g = grasped(
        3, 2, gains, Rules(attached=True), contacts=contacts, free=free, integrator=integrator,
        angular_velocity=40.0 * free[2],
    )  # fmt: skip
    for _ in range(2):
        if g.implicit:
            NativeBody(g.body_state).free_motion(0.005)
        g.finger_position[:] = contacts
        assert g.sample() == 0
        start = body.NEXT_ROTATION if g.implicit else body.ROTATION
        T = np.eye(3)
        T[:2, :2] = R = g.body_state[start : start + 9].reshape(3, 3)[:2, :2]
        G = gx.grasp_matrix(contacts @ R.T, free=free)
        wanted = (T @ K_o @ T.T)[np.ix_(free, free)]
        np.testing.assert_allclose(G @ matrices(g)[0] @ G.T, wanted, rtol=0.0, atol=1e-10 * np.abs(K_o).max())
        NativeBody(g.body_state).step(0.005)


@pytest.mark.parametrize("turning", [(0.27, 0.27, 0.54), (0.0, 0.0, 0.0)])
def test_a_moment_that_is_rounding_holds_nothing(turning: tuple[float, ...]) -> None:
    """One finger whose arm lies along an axis: r^2/k_r + 1/k across it, k along it, zero where nothing resists a turn.

    Its moment about that axis is 1e-18 N m a newton, and is not taken for a hold.
    """
    gains = gx.Coupling(gx.ObjectImpedance(np.diag([600.0, 600.0, 600.0, *turning])), gx.Impedance(400.0))
    contacts = np.array([[0.03 * np.cos(1e-17), 3e-19, -2e-19]])
    K = sampled(grasped(1, 3, gains, Rules(attached=True), contacts=contacts, inertia=INERTIA[3]), contacts)
    across = [0.0 if k == 0.0 else 1.0 / (1.0 / 600.0 + 0.03**2 / k) for k in turning]
    wanted = np.diag([600.0, across[2], across[1]])
    np.testing.assert_allclose(K, wanted, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(gains.stiffness(gx.Grasp(contacts).split()), wanted, rtol=0.0, atol=1e-9)


def test_a_stated_point_is_where_it_is_meant() -> None:
    """K_o about a point of the object: a turn about that point is answered by the moment there alone, 1e-12."""
    rng = np.random.default_rng(5)
    point = np.array([0.01, -0.02, 0.015])
    K_o = np.diag([100.0, 120.0, 80.0, 0.2, 0.3, 0.1])
    contacts = rng.normal(size=(4, 3)) * 0.03
    gains = gx.Coupling(gx.ObjectImpedance(K_o, point=point), gx.Impedance(70.0))
    g = grasped(4, 3, gains, Rules(attached=True), contacts=contacts, inertia=INERTIA[3])
    w = 1e-3 * rng.normal(size=3)
    force = respond(g, contacts + np.cross(w, contacts - point))
    np.testing.assert_allclose(force.sum(axis=0), 0.0, atol=1e-12)
    moment = np.cross(contacts - point, force).sum(axis=0)
    np.testing.assert_allclose(moment, K_o[3:, 3:] @ w, rtol=1e-10)


def fingertip(offset: float, **blend: Any) -> FloatArray:
    """K of three fingers, the middle one off the line of the others by an offset [m]."""
    contacts = np.array([[-0.03, 0.0, 0.0], [0.0, offset, 0.0], [0.03, 0.0, 0.0]])
    K_o = np.diag([100.0, 120.0, 80.0, 0.2, 0.3, 0.1])
    K_o[0, 3] = K_o[3, 0] = 2.0  # so that what the rotation does not hold is felt by others
    gains = gx.Coupling(gx.ObjectImpedance(K_o), gx.Impedance(200.0))
    g = grasped(3, 3, gains, Rules(attached=True, **blend), contacts=contacts, inertia=INERTIA[3])
    respond(g, contacts)
    return np.asarray(g.state.stiffness.array(9).copy())


def test_a_short_arm_stays_bounded_and_continuous() -> None:
    """Arms of 10 to 0.1 mm: no fingertip stiffer than K_o / (W l2^2) + kip, and no step.

    Without a blend 0.2 N m/rad is 600 kN/m on an arm of 0.33 mm. Steps shrink with those of the arm.
    """
    low, high = 0.001, 0.01
    arms = np.geomspace(0.01, 0.0001, 500)
    bound = 0.2 / (3.0 * high**2) + 200.0 + 120.0 / 3.0
    offsets = arms * 3.0 / np.sqrt(2.0)  # of one contact of three, rms from the line through their centroid
    previous, steps = fingertip(float(offsets[0]), blend=(low, high)), []
    for offset in offsets[1:]:
        K = fingertip(float(offset), blend=(low, high))
        values = np.linalg.eigvalsh(K)
        assert values[0] > -1e-9 and values[-1] <= bound
        steps.append(np.abs(K - previous).max())
        previous = K
    coarse = [fingertip(float(offset), blend=(low, high)) for offset in offsets[::10]]
    jumps = [np.abs(b - a).max() for a, b in pairwise(coarse)]
    assert max(steps) < 0.15 * max(jumps)  # a tenth of the way is a tenth of the change: nothing jumps
    assert np.linalg.eigvalsh(fingertip(0.0007, blend=None))[-1] > 1e5


def test_a_finger_that_fades_leaves_no_step() -> None:
    """From all of its weight to none: K_o stays what the object feels, and K follows the weight continuously."""
    K_o = np.diag([100.0, 120.0, 80.0, 0.2, 0.3, 0.1])
    gains = gx.Coupling(gx.ObjectImpedance(K_o), gx.Impedance(200.0))
    g = grasped(4, 3, gains, Rules(fade=(0.002, 0.01)), shape=Sphere(0.03), inertia=INERTIA[3])
    places = np.array([[1.0, 0.0, 0.0], [-0.5, 0.8, 0.3], [-0.5, -0.8, 0.3], [0.0, 0.1, -1.0]])
    places *= 0.0299 / np.linalg.norm(places, axis=1)[:, None]
    previous, steps = None, []
    for gap in np.linspace(-0.0001, 0.0102, 800):
        p = places.copy()
        p[3] *= (0.03 + gap) / 0.0299
        respond(g, p)
        K, G = g.state.stiffness.array(12).copy(), gx.grasp_matrix(g.contact_position)
        held = G[:, :9] @ K[:9, :9] @ G[:, :9].T if gap > 0.01 else G @ K @ G.T
        np.testing.assert_allclose(held, K_o, rtol=0.0, atol=1e-3 if gap > 0.01 else 1e-8)
        if previous is not None:
            steps.append(np.abs(K - previous).max())
        previous = K
    assert max(steps) < 1.0


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("kind", ["attached", "stick"])
def test_closed_motions_create_nothing(kind: str, d: int) -> None:
    """Turns of +-0.5 rad with shifts, K_o with coupled freedoms, weights: 1e-9 of the largest energy stored."""
    rng = np.random.default_rng(d)
    gains = gx.Coupling(gx.ObjectImpedance(object_gain(rng, d)), gx.Impedance(200.0))
    contacts = np.pad(polygon(4, 0.025), ((0, 0), (0, d - 2)))
    contacts[:, -1] += rng.uniform(0.0, 0.01, 4)
    rules = Rules(attached=kind == "attached", stick=kind == "stick", share=[0.5, 1.0, 1.5, 1.0], fade=None)
    g = grasped(4, d, gains, rules, contacts=contacts, shape=Box((0.05,) * d), inertia=INERTIA[d])
    energy = worst_turn(g, contacts * 0.95)
    assert energy.peak > 1e-3
    assert abs(energy.share) < 1e-9


RHO = 0.008  # patch length of soft fingers [m]


@pytest.mark.parametrize("n", [1, 2, 3])
def test_soft_fingers_take_moments_by_their_patch_length(n: int) -> None:
    """K of forces and torsions over rho is X K_c X' with M = rho^2 on torsions: 1e-9 of the largest entry.

    Two soft fingers hold all six freedoms, where two points leave the turn about their line free: G K G' = K_o.
    """
    rng = np.random.default_rng(n)
    K_o, kip = object_gain(rng, 3), 70.0
    gains = gx.Coupling(gx.ObjectImpedance(K_o), gx.Impedance(kip))
    contacts = rng.normal(size=(n, 3))
    contacts *= 0.03 / np.linalg.norm(contacts, axis=1)[:, None]
    weights = rng.uniform(0.5, 1.5, n)
    rules = Rules(attached=True, patch=RHO, share=weights.tolist(), blend=(1e-9, 2e-9))
    g = grasped(n, 3, gains, rules, shape=Sphere(0.03), inertia=INERTIA[3])
    g.meet(contacts)
    respond(g, contacts)
    own = g.state.stiffness.array(4 * n)
    grasp = gx.Grasp(contacts, -contacts, model="soft")
    split = grasp.split(metric=grasp.metric(torsion_length=RHO, weights=weights))
    unit = np.where(grasp.torsion_columns, 1.0 / RHO, 1.0)
    wanted = gains.stiffness(split) * np.outer(unit, unit)
    np.testing.assert_allclose(own, wanted, rtol=0.0, atol=1e-9 * np.abs(wanted).max())
    assert np.array_equal(own, own.T)
    if n > 1:
        G = grasp.matrix / unit
        np.testing.assert_allclose(G @ own @ G.T, K_o, rtol=0.0, atol=1e-9 * np.abs(K_o).max())


def test_soft_fingers_create_nothing_on_closed_motions() -> None:
    """Turns of +-0.5 rad with shifts, weights, fingertips pressed in: 1e-9 of the largest energy stored."""
    gains = gx.Coupling(gx.ObjectImpedance(object_gain(np.random.default_rng(3), 3)), gx.Impedance(200.0))
    contacts = np.pad(polygon(3, 0.025), ((0, 0), (0, 1)))
    contacts *= 0.03 / np.linalg.norm(contacts, axis=1)[:, None]
    rules = Rules(attached=True, patch=RHO, share=[0.5, 1.0, 1.5])
    g = grasped(3, 3, gains, rules, shape=Sphere(0.03), inertia=INERTIA[3])
    g.meet(contacts)
    energy = worst_turn(g, contacts * 0.95)
    assert energy.peak > 1e-3
    assert abs(energy.share) < 1e-9
