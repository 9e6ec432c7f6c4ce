"""Soft fingers: torsion against the analysis, its limit, what it holds, its energy, and scenes with them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import graspfx as gx
from graspfx.certificate.plan import plan
from graspfx.compile.records import numbers
from graspfx.coupling.grasp_state import FingerState
from graspfx.coupling.grasped import GraspedObject
from graspfx.coupling.rules import Rules
from graspfx.errors import InputError, SceneError
from graspfx.objects import integrators as body
from graspfx.objects.body import NativeBody
from graspfx.objects.body_state import BodyState
from graspfx.objects.integrators import orient
from graspfx.spatial import Quaternion, Vector, exponential
from graspfx.surfaces.closed_form.shape import Box, Sphere
from tests.support.grasps import grasped, law, respond

RHO = 0.006  # [m]
INERTIA = (1e-5, 2e-5, 3e-5)
OUT = np.array([[1.0, 0.2, 0.1], [-0.3, 1.0, 0.2], [-0.5, -0.6, 0.7], [0.1, 0.1, -1.0]])
OUT /= np.linalg.norm(OUT, axis=1, keepdims=True)


def soft(n: int, gains: gx.Coupling, *, patch: object = RHO, shape: object = None, **rules: Any) -> GraspedObject:
    settings = {k: rules.pop(k) for k in ("integrator", "free") if k in rules}
    made = Rules(patch=patch, **{"fade": None, **rules})  # type: ignore[arg-type]
    return grasped(n, 3, gains, made, shape=shape or Sphere(0.03), inertia=INERTIA, **settings)


def turn(g: GraspedObject, x: float, y: float, z: float) -> None:
    """Turns the object by a rotation vector in world axes [rad]."""
    S = g.body_state
    q = S[body.QUATERNION : body.QUATERNION + 4]
    q[:] = list(numbers(exponential(Vector(x, y, z)) @ Quaternion(*q.tolist())))
    orient(BodyState(memoryview(S)))


def scaled(K: np.ndarray, n: int) -> np.ndarray:
    """A matrix on forces and moments [N/m, N m/rad] as one on forces and moments over rho."""
    D = np.diag(np.tile([1.0, 1.0, 1.0, 1.0 / RHO], n))
    return np.asarray(D @ K @ D)


@pytest.mark.parametrize("kip", [40.0, 160.0])
@pytest.mark.parametrize("n", [1, 2, 4])
def test_attached_torsion_is_the_analysis_with_its_metric(n: int, kip: float) -> None:
    """f and tau of gx.Coupling with Grasp.metric(torsion_length=rho), damped: 1e-14 N and 1e-16 N m."""
    gains = law(40.0, kip, 0.3, 0.9 if kip > 40.0 else 0.3)
    g = soft(n, gains, attached=True)
    c = 0.03 * OUT[:n]
    g.meet(c)
    angles, spin = np.array([0.05, -0.02, 0.03]), np.array([0.4, 0.2, -0.1])
    g.body_state[body.ANGULAR_VELOCITY : body.ANGULAR_VELOCITY + 3] = spin
    p = c + np.random.default_rng(n).normal(size=(n, 3)) * 1e-3
    f = respond(g, p)
    assert not g.array(FingerState.displacement)[:, 3].any()
    turn(g, *angles)
    respond(g, p)
    R = g.body_state[body.ROTATION : body.ROTATION + 9].reshape(3, 3)
    here, normals = c @ R.T, -OUT[:n] @ R.T
    half = np.linalg.norm(angles) / 2
    axis = angles / (2 * half)
    theta = -2 * np.arctan2(np.sin(half) * (-OUT[:n] @ axis), np.cos(half))  # swing and twist, by hand
    grasp = gx.Grasp(here, normals, model="soft")
    split = grasp.split(metric=grasp.metric(torsion_length=RHO))
    swung = g.array(FingerState.twist_axis) @ R.T
    rate = -np.cross(spin, p)
    e = np.column_stack([p - here, theta]).ravel()
    de = np.column_stack([rate, -swung @ spin]).ravel()
    expected = gains.force(split, e, de).reshape(n, 4)
    f = g.force
    np.testing.assert_allclose(f, expected[:, :3], rtol=0.0, atol=1e-14)
    np.testing.assert_allclose(g.moment, expected[:, 3:] * swung, rtol=0.0, atol=1e-16)
    np.testing.assert_allclose(g.wrench[3:], (np.cross(p, f) + g.moment).sum(axis=0), rtol=0.0, atol=1e-16)
    np.testing.assert_allclose(swung, normals, atol=0.05)  # the normal, but for half the swing


@pytest.mark.parametrize("integrator", ["exact", "implicit"])
def test_friction_fulfils_coulombs_law_with_torsion(integrator: str) -> None:
    """s = K^-1 f - e on the analysis' K: zero where it sticks, against (f_t, tau/rho) on the limit surface: 1e-12 m."""
    rng = np.random.default_rng(5)
    gains = law(40.0, 160.0)
    seen: set[int] = set()
    for k in range(30):
        n, mu = 1 + k % 4, (0.1, 0.5, 1.0)[k % 3]
        g = soft(n, gains, friction=mu, blend=(1e-9, 2e-9), integrator=integrator)
        p = (0.03 - rng.uniform(-0.001, 0.004, size=(n, 1))) * OUT[:n]
        for step in range(2):
            if g.implicit:
                NativeBody(g.body_state).free_motion(0.005)
            respond(g, p)
            if step == 0:
                p = p + rng.normal(size=p.shape) * 5e-4
                turn(g, *(rng.normal(size=3) * 0.1))
        c, normals = g.array(FingerState.contact), g.array(FingerState.normal)
        grasp = gx.Grasp(c, normals, model="soft")
        K = scaled(gains.stiffness(grasp.split(metric=grasp.metric(torsion_length=RHO))), n)
        if g.implicit:
            G = gx.grasp_matrix(c, normals, model="soft").copy()
            G[3:, 3::4] = RHO * g.array(FingerState.twist_axis).T  # swung by half the object's turn
            give = np.diag([0.005**2 / 0.1] * 3 + [0.005**2 / (j + 0.005 * 1e-4) for j in INERTIA])
            K = np.linalg.inv(np.linalg.inv(K) + G.T @ give @ G)
        f, e = g.array(FingerState.local), g.array(FingerState.displacement)
        s = (np.linalg.solve(K, f.ravel()) - e.ravel()).reshape(n, 4)
        for i in range(n):
            status, normal = int(g.array(FingerState.status)[i]), np.append(normals[i], 0.0)
            push, deep = f[i] @ normal, s[i] @ normal
            drag, slip = f[i] - push * normal, s[i] - deep * normal
            seen.add(status)
            if status == 0:
                assert not f[i].any() and deep >= -1e-12
            else:
                assert push > 0.0 and abs(deep) < 1e-12
            if status == 1:
                assert np.linalg.norm(slip) < 1e-12 and np.linalg.norm(drag) <= mu * push * (1 + 1e-12)
            if status == 2:
                assert np.linalg.norm(drag) == pytest.approx(mu * push, rel=1e-12)
                assert drag @ slip == pytest.approx(-np.linalg.norm(drag) * np.linalg.norm(slip), abs=1e-14)
    assert seen == {0, 1, 2}


def test_a_turned_pinch_slips_at_rho_mu_times_the_squeeze() -> None:
    """Two fingers, 0.5 N each, mu = 0.4: the object turned about their line meets k rho theta, then mu rho f_n."""
    g = soft(2, law(100.0, 100.0), friction=0.4, shape=Box((0.05, 0.05, 0.05)))
    p = np.array([[-0.02, 0.0, 0.0], [0.02, 0.0, 0.0]])
    respond(g, p)
    limit, turned = RHO * 0.4 * 0.5, 0.0
    for _ in range(60):
        turn(g, 0.01, 0.0, 0.0)
        turned += 0.01
        respond(g, p)
        expected = -min(100.0 * RHO**2 * turned, limit)
        np.testing.assert_allclose(g.moment, [[expected, 0.0, 0.0]] * 2, rtol=1e-10, atol=1e-16)
        assert g.wrench[3] == pytest.approx(2 * expected, rel=1e-10)
    assert g.array(FingerState.status).tolist() == [2.0, 2.0]
    turn(g, -0.02, 0.0, 0.0)  # back: it sticks, from where it slipped to
    respond(g, p)
    np.testing.assert_allclose(g.moment[:, 0], -(limit - 100.0 * RHO**2 * 0.02), rtol=1e-10)
    assert g.array(FingerState.status).tolist() == [1.0, 1.0]


def test_sticking_torsion_counts_whole_turns() -> None:
    """friction = "stick" holds at any angle, 7 rad here, also beyond half a turn."""
    g = soft(2, law(100.0, 100.0), stick=True, shape=Box((0.05, 0.05, 0.05)))
    p = np.array([[-0.02, 0.0, 0.0], [0.02, 0.0, 0.0]])
    respond(g, p)
    for _ in range(70):
        turn(g, 0.1, 0.0, 0.0)
        respond(g, p)
    np.testing.assert_allclose(g.moment[:, 0], -100.0 * RHO**2 * 7.0, rtol=1e-12)


def test_a_hard_finger_beside_a_soft_one_has_no_torsion() -> None:
    g = soft(2, law(40.0, 160.0), patch=[RHO, 0.0], friction=0.5, shape=Box((0.05, 0.05, 0.05)))
    p = np.array([[-0.02, 0.0, 0.0], [0.02, 0.0, 0.0]])
    respond(g, p)
    turn(g, 0.1, 0.0, 0.0)
    respond(g, p)
    assert g.moment[0, 0] < -1e-5 and not g.moment[1].any()


@pytest.mark.parametrize(("at_contact", "low", "high"), [(False, 0.0, 2e-4), (True, 1e-3, 1.0)])
def test_torsion_at_the_fingertip_creates_no_energy(at_contact: bool, low: float, high: float) -> None:
    """A closed motion of 0.5 rad with attached contacts, trapezoidal: 2e-4 of the peak power's integral, as 1/N^2."""
    g = soft(3, law(40.0, 160.0), attached=True, at_contact=at_contact)
    c = 0.03 * OUT[:3]
    g.meet(c)
    N = 300
    work = size = 0.0
    before: Any = None
    for k in range(N + 1):
        t = 2 * np.pi * k / N
        a = 0.5 * np.array([np.sin(t), np.cos(t) - 1.0, np.sin(2 * t)])
        p = c * 0.95 + 0.004 * np.sin(t + np.arange(9).reshape(3, 3))
        S = g.body_state
        S[body.QUATERNION : body.QUATERNION + 4] = list(numbers(exponential(Vector(*a.tolist()))))
        orient(BodyState(memoryview(S)))
        respond(g, p)
        now = (p.copy(), S[body.QUATERNION : body.QUATERNION + 4].copy(), g.force.copy(), g.wrench.copy())
        if before is not None:
            v = np.array(list(numbers(Quaternion(*now[1].tolist()) @ Quaternion(*before[1].tolist()).conjugate)))
            step = 2 * np.arctan2(np.linalg.norm(v[:3]), v[3]) * v[:3] / np.linalg.norm(v[:3])
            done = (0.5 * (now[2] + before[2]) * (now[0] - before[0])).sum() - 0.5 * (now[3] + before[3])[3:] @ step
            work, size = work + done, size + abs(done)
        before = now
    assert low <= abs(work) / size < high


@pytest.mark.parametrize("kip", [40.0, 160.0])
def test_implicit_force_and_torsion_are_solved_with_the_objects_motion(kip: float) -> None:
    """Attached: f = (K^-1 + G'CG)^-1 e with G of soft contacts, 1e-13 N."""
    gains = law(40.0, kip)
    g = soft(4, gains, attached=True, integrator="implicit")
    NativeBody(g.body_state).free_motion(0.005)
    c = 0.03 * OUT
    g.meet(c)
    e = np.random.default_rng(3).normal(size=(4, 3)) * 1e-3
    respond(g, c + e)
    grasp = gx.Grasp(c, -OUT, model="soft")
    K = scaled(gains.stiffness(grasp.split(metric=grasp.metric(torsion_length=RHO))), 4)
    G = gx.grasp_matrix(c, -OUT, model="soft") @ np.diag(np.tile([1.0, 1.0, 1.0, RHO], 4))
    give = np.diag([0.005**2 / 0.1] * 3 + [0.005**2 / (j + 0.005 * 1e-4) for j in INERTIA])
    expected = np.linalg.solve(np.linalg.inv(K) + G.T @ give @ G, np.column_stack([e, np.zeros(4)]).ravel())
    np.testing.assert_allclose(g.array(FingerState.local).ravel(), expected, rtol=0.0, atol=1e-13)


# Scenes -----------------------------------------------------------------------------------------------------------


def pinch(model: str, **coupling: Any) -> gx.Scene:
    """A box of 0.1 kg held 5 mm beside its centre between two fingers, 2.5 N each, gravity along -y."""
    more = {"model": "soft", "patch": 0.01} if model == "soft" else {}

    def finger(side: float) -> dict[str, Any]:
        return {
            "device": {"name": "simulated", "mass": 0.1, "damping": 0.5}, "start": [side * 0.02, 0.0, 0.005],
            "hand": {"stiffness": 300.0, "damping": 5.0, "rest": [side * (0.02 - 2.5 / 300.0), 0.0, 0.005]}, **more,
        }  # fmt: skip

    return gx.Scene(
        dimensions=3, period=0.001, duration=1.0, gravity=[0.0, -9.81, 0.0],
        object={
            "mass": 0.1, "viscosity": 0.5, "rotational_viscosity": 2e-3, "shape": {"kind": "box", "size": [0.05] * 3},
        },
        coupling={
            "external": {"stiffness": 200.0, "damping": 0.5}, "internal": {"stiffness": 500.0, "damping": 0.5},
            "friction": 0.8, **coupling,
        },
        finger=[finger(-1.0), finger(1.0)],
    )  # fmt: skip


def test_soft_fingers_hold_what_would_turn_between_hard_ones() -> None:
    """m g 5 mm = 4.9 mN m about the line of the fingers, within the 40 mN m that they have; hard ones let it hang."""
    rec = gx.run(pinch("soft"))
    assert rec.finger_moment is not None and rec.finger_moment.shape == (1000, 2, 3) and not rec.faults
    levers = rec.finger_position[-1] - rec.object_position[-1]
    moment = np.cross(levers, rec.finger_force[-1]).sum(axis=0) + rec.finger_moment[-1].sum(axis=0)
    np.testing.assert_allclose(moment, rec.wrench[-1, 3:], atol=1e-15)
    assert rec.finger_moment[-1, :, 0].sum() == pytest.approx(0.1 * 9.81 * 0.005, rel=0.02)
    hard = gx.run(pinch("hard"), duration=0.3)
    assert hard.finger_moment is None and hard.object_orientation is not None and rec.object_orientation is not None
    assert abs(hard.object_orientation[-1, 0]) > 2 * abs(rec.object_orientation[:, 0]).max()
    assert "do not display it" in {row.step: row.why for row in plan(pinch("soft"))}["torsion"]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"coupling.friction": 0.0}, "torsion of a soft finger requires friction"),
        ({"finger.0.model": "hard"}, "only soft fingers have this setting"),
        ({"coupling.internal.stiffness": [500.0, 500.0]}, "one number for each gain"),
    ],
)
def test_soft_fingers_that_cannot_be(change: dict[str, Any], message: str) -> None:
    with pytest.raises(SceneError, match=message):
        pinch("soft").replace(change)


def test_a_soft_finger_needs_its_patch_and_friction() -> None:
    table = pinch("soft").to_dict()
    del table["finger"][0]["patch"]
    with pytest.raises(SceneError, match=r"finger\.0\.patch: required for a soft finger"):
        gx.Scene(**table)
    with pytest.raises(InputError, match="a coefficient of friction for each soft finger"):
        soft(2, law(40.0, 160.0))
