"""Friction in the sample: the public law, anchors, holding and slipping, damping, continuity, many fingers."""

from __future__ import annotations

from typing import Any

import mpmath as mp
import numpy as np
import pytest

import graspfx as gx
from graspfx.certificate.plan import plan
from graspfx.coupling.grasp_state import FingerState
from graspfx.coupling.grasped import GraspedObject
from graspfx.coupling.rules import Rules
from graspfx.errors import InputError, SceneError
from graspfx.objects.body import NativeBody
from graspfx.surfaces.closed_form.shape import Box, Sphere
from tests.support.grasps import INERTIA, SHARP, grasped, law, respond

T = 0.005


def held(n: int, d: int, gains: gx.Coupling, mu: Any, shape: object = None, **settings: Any) -> GraspedObject:
    turning = {"inertia": INERTIA[d], **({"rotational_viscosity": 0.0} if d == 1 else {})}
    how = {"stick": True} if mu == "stick" else {"friction": mu}
    rules = Rules(fade=None, blend=SHARP, share=settings.pop("share", None), **how)
    return grasped(n, d, gains, rules, shape=shape or Box((0.05,) * d), **{**turning, **settings})


def stiffness(g: GraspedObject, gains: gx.Coupling, share: np.ndarray | None) -> np.ndarray:
    """K of the analysis at the sample's contacts; under the implicit integrator with the object's compliance."""
    c, d = g.contact_position, g.dimensions
    K = gains.stiffness(gx.Grasp(c).split(metric=share, tolerance=1e-12))
    if not g.implicit:
        return K
    turns = {1: [], 2: [4e-5], 3: [1e-5, 2e-5, 3e-5]}[d]
    give = np.diag([T * T / 0.1] * d + [T * T / (j + T * 1e-4) for j in turns])
    G = gx.grasp_matrix(c)
    made = np.linalg.inv(np.linalg.inv(K) + G.T @ give @ G)
    return np.asarray((made + made.T) / 2)


@pytest.mark.parametrize("integrator", ["exact", "implicit"])
@pytest.mark.parametrize("d", [1, 2, 3])
def test_forces_are_those_of_the_public_law(d: int, integrator: str) -> None:
    """Random states after a random motion, so that anchors are sheared: 2e-14 of the largest force of K e.

    The oracle assembles K from an SVD of G and solves in n d unknowns; the sample does neither (nor the other way).
    Gains are numbers, or the same as matrices; fingers slip freely, stick or have a coefficient, in any metric.
    """
    rng = np.random.default_rng(d)
    seen, mus = set(), np.array([0.0, 0.1, 0.5, 1.5, "stick"], dtype=object)
    for k in range(80):
        n, mu = int(rng.integers(1, 6)), mus[k % 5]
        values = ([40.0, 160.0], [160.0, 40.0], [70.0, 70.0])[k % 3]
        share = rng.uniform(0.5, 2.0, n) if k % 7 == 0 else None
        gains = law(*(value * np.eye(d) for value in values) if k % 11 == 0 else values)
        shape = (Box((0.05,) * d), Sphere(0.03))[k % 2]
        g = held(n, d, gains, mu, shape, integrator=integrator, share=None if share is None else share.tolist())
        if g.implicit:
            NativeBody(g.body_state).free_motion(T)
        p = rng.uniform(-0.028, 0.028, size=(n, d))
        respond(g, p)
        p += rng.normal(size=(n, d)) * rng.choice([1e-4, 3e-3])
        f = respond(g, p).ravel()
        K, e = stiffness(g, gains, share), (p - g.contact_position).ravel()
        touch = gx.unilateral_force(K, e, g.inward(), mu)
        np.testing.assert_allclose(f, touch.force, rtol=0.0, atol=2e-14 * np.abs(K @ e).max())
        assert g.state.residual <= 2e-14 * np.abs(K @ e).max()
        if touch.law in ("frictionless", "stick"):
            continue
        assert touch.law == ("coulomb", "associated")[int(g.state.law)]
        status = [("free", "stick", "slide")[int(s)] for s in g.array(FingerState.status)]
        if (np.abs(f) > 1e-12).any():
            assert status == list(touch.status)
        seen.update(status)
    assert seen >= ({"free", "stick"} if d == 1 else {"free", "stick", "slide"})


@pytest.mark.parametrize("mu", [0.0, 0.5])
@pytest.mark.parametrize(("kep", "kip"), [(100.0, 1e-4), (1e-4, 100.0)])
def test_gains_as_far_apart_as_they_may_be(mu: float, kep: float, kip: float) -> None:
    """f = K (e + s) and f's = 0 at a millionth of the other gain, in 50 digits: 1e-6 of the force; less is refused."""
    rng = np.random.default_rng(8)
    out = rng.normal(size=(3, 3))
    out /= np.linalg.norm(out, axis=1, keepdims=True)
    gains = law(kep, kip)
    g = held(3, 3, gains, mu, Sphere(0.03))
    respond(g, 0.028 * out)
    p = 0.027 * out + 1e-3 * rng.normal(size=(3, 3))
    f = respond(g, p)
    e = p - g.contact_position
    with mp.workdps(50):
        K = exact_stiffness(g.contact_position, mp.mpf(gains.external.stiffness), mp.mpf(gains.internal.stiffness))
        w = K**-1 * mp.matrix(f.ravel().tolist())  # e + s
        slip = np.array([float(a - b) for a, b in zip(w, e.ravel().tolist(), strict=True)]).reshape(3, 3)
    inward = g.inward()
    across = slip - (slip * inward).sum(axis=1, keepdims=True) * inward
    pushes = (f * inward).sum(axis=1)
    assert (pushes >= 0.0).all() and pushes.max() > 0.0
    size = np.abs(e).max()
    for i in range(3):
        if pushes[i] > 0.0:
            lift = mu * np.linalg.norm(across[i]) if g.state.law else 0.0  # that of the associated law
            assert slip[i] @ inward[i] == pytest.approx(lift, abs=1e-6 * size)
            tangent = f[i] - pushes[i] * inward[i]
            if np.linalg.norm(tangent) < (1.0 - 1e-9) * mu * pushes[i]:
                assert np.linalg.norm(across[i]) <= 1e-6 * size
            elif mu:
                assert across[i] @ tangent <= -(1.0 - 1e-6) * np.linalg.norm(across[i]) * np.linalg.norm(tangent)
        else:
            assert slip[i] @ inward[i] >= -1e-6 * size
    for name in ("stiffness", "damping"):
        values = (1e-5, 100.0, 1.0, 1.0) if name == "stiffness" else (1.0, 1.0, 1e-7, 1.0)
        with pytest.raises(InputError, match=f"{name}.*at least 1e-06 times the other gain"):
            held(3, 3, law(*values), mu, Sphere(0.03))


def exact_stiffness(c: np.ndarray, kep: Any, kip: Any) -> Any:
    """kip I + (kep - kip) G'(G G')^-1 G of hard contacts in space."""
    rows = [[mp.mpf(int(a == b)) for _ in c for b in range(3)] for a in range(3)]
    for p, q in ((1, 2), (2, 0), (0, 1)):
        rows.append([mp.mpf(-r[q] if b == p else r[p] if b == q else 0.0) for r in c.tolist() for b in range(3)])
    G = mp.matrix(rows)
    return kip * mp.eye(3 * len(c)) + (kep - kip) * G.T * (G * G.T) ** -1 * G


def test_no_coefficient_for_a_finger_is_no_friction_for_it() -> None:
    """mu = (0.5, 0): the second finger's force stays along its normal however it is dragged."""
    g = held(2, 2, law(40.0, 160.0), [0.5, 0.0])
    for y in np.linspace(0.0, 0.01, 20):
        f = respond(g, [[-0.023, y], [0.023, y]])
        assert f[1, 1] == 0.0
    assert f[0, 1] == pytest.approx(0.5 * f[0, 0], rel=1e-12)  # dragged 10 mm at 1 mm depth: it slides


def test_a_dragged_finger_slides_at_mu_and_a_held_one_never_moves_its_anchor() -> None:
    """Equal gains, 100 N/m, 2 mm deep: held up to 1 mm aside at mu = 0.5, then dragged along 1 mm behind."""
    g = held(1, 2, law(100.0, 100.0), 0.5)
    respond(g, [[-0.023, 0.0]])
    for y in np.linspace(0.0, 0.000999, 50):
        f = respond(g, [[-0.023, y]])
        assert f[0, 1] == pytest.approx(100.0 * y, rel=1e-12, abs=1e-16)
        assert g.contact_position[0].tolist() == [-0.025, 0.0]
    for y in np.linspace(0.001, 0.005, 50):
        f = respond(g, [[-0.023, y]])
        assert f[0, 1] == pytest.approx(0.1, rel=1e-12)
    respond(g, [[-0.023, 0.005]])
    assert g.contact_position[0, 1] == pytest.approx(0.004, abs=1e-15)
    f = respond(g, [[-0.023, 0.004]])  # and back by as much: no shear left
    assert abs(f[0, 1]) < 1e-14


@pytest.mark.parametrize("kind", ["smooth", "fading", "stick", "rough", "soft"])
@pytest.mark.parametrize("damping", [(0.3, 0.8), (0.0, 0.5), (0.5, 0.0), (0.5, 0.5)])
def test_damping_is_passive_and_stays_in_the_cones(damping: tuple[float, float], kind: str) -> None:
    """(f - f0)'e' >= 0, |f_t| <= mu f_n to rounding and nothing where f0 is nothing: random states, singular D too."""
    rng = np.random.default_rng(6)
    for k in range(30):
        n, d, mu = int(rng.integers(1, 5)), 3 if kind == "soft" else 1 + k % 3, float(rng.choice([0.1, 0.5, 1.5]))
        turning: dict[str, Any] = {"inertia": INERTIA[d], **({"rotational_viscosity": 0.0} if d == 1 else {})}
        rubs = kind in ("rough", "soft")
        rules = Rules(
            fade=(0.002, 0.01) if kind == "fading" else None, stick=kind == "stick", friction=mu if rubs else 0.0,
            patch=0.005 if kind == "soft" else 0.0,
        )  # fmt: skip
        g = grasped(n, d, law(40.0, 160.0, *damping), rules, shape=Box((0.05,) * d), **turning)
        respond(g, rng.uniform(-0.028, 0.028, size=(n, d)))
        p, v = g.finger_position + rng.normal(size=(n, d)) * 1e-3, rng.normal(size=(n, d)) * 0.1
        before = g.block.copy()
        g.state.damped = False
        respond(g, p, v)
        f0 = g.array(FingerState.local).copy()
        g.block[:] = before
        respond(g, p, v)
        f, rate, normal = (g.array(field) for field in (FingerState.local, FingerState.rate, FingerState.normal))
        push = (f[:, :3] * normal).sum(axis=1)
        tangent = np.hypot(np.linalg.norm(f[:, :3] - push[:, None] * normal, axis=1), f[:, 3])
        size = np.abs(f).max() + 1e-300
        assert ((f - f0) * rate).sum() >= -1e-12 * size
        assert push.min() >= -1e-14 * size
        if kind != "stick":
            assert (tangent <= mu * rubs * push + 1e-14 * size).all()
        assert not f[(f0[:, :3] * normal).sum(axis=1) <= 0.0].any()


@pytest.mark.parametrize(("mu", "bound"), [(0.1, 160.0), (0.5, 160.0)])
@pytest.mark.parametrize("d", [2, 3])
def test_force_is_continuous_through_touch_slip_and_release(d: int, mu: float, bound: float) -> None:
    """In steps of 6 um and less no force changes by more than the stiffest mode times the step."""
    n = 3 if d == 2 else 4
    out = np.array([[-1.0, 0.1, 0.05], [1.0, -0.2, 0.1], [0.1, 1.0, -0.1], [-0.1, -1.0, 0.2]])[:n, :d]
    side = np.stack([-out[:, 1], out[:, 0], 0.3 * np.ones(n)], axis=1)[:, :d]
    rate = np.arange(1, n + 1)
    g = held(n, d, law(40.0, 160.0), mu)
    changes, last = 0, None
    for t in np.linspace(0.0, 0.25, 600):
        deep = 0.002 * np.sin(2 * np.pi * rate * t + rate) - 0.001 * rate / n
        p = out * (0.025 + deep)[:, None] + side * (0.002 * np.sin(2 * np.pi * (rate + 0.5) * t))[:, None]
        f, status = respond(g, p), g.array(FingerState.status).copy()
        if last is not None and t > 0.001:  # the first sample finds contacts, the second lets them slip
            assert np.abs(f - last[0]).max() <= bound * np.abs(p - last[1]).max()
            changes += int((status != last[2]).sum())
        last = f, p, status
    assert changes >= 4


def test_twenty_fingers_are_many_but_not_too_many_unknowns() -> None:
    """No finger unresolved, with friction and without, and without equal to the pivoted answer to 1e-14."""
    rng = np.random.default_rng(9)
    p = rng.normal(size=(20, 3))
    p *= 0.0235 / np.abs(p).max(axis=1, keepdims=True)
    smooth, pivoted, rough = (held(20, 3, law(40.0, 160.0, 0.3, 0.8), mu) for mu in (0.0, 0.0, 0.5))
    pivoted.state.rays = False
    for _ in range(2):
        p, v = p + rng.normal(size=p.shape) * 1e-4, rng.normal(size=p.shape) * 0.01
        f = respond(smooth, p, v)
        respond(rough, p, v)
        np.testing.assert_allclose(f, respond(pivoted, p, v), rtol=0.0, atol=1e-14 * np.abs(f).max())


# Scenes -----------------------------------------------------------------------------------------------------------


def pinch(duration: float, mu: object, *, opening: float = 0.0, above: float = 0.0, turns: bool = False) -> gx.Scene:
    """A box of 0.1 kg between two fingers in the plane, under gravity; they squeeze 2.5 N at first, then open."""
    kip, hand = 500.0, 300.0

    def finger(side: float) -> dict[str, Any]:
        path = {"kind": "path", "times": [0.0, 0.5, duration], "positions": [[0, 0], [0, 0], [side * opening, 0]]}
        path["positions"] = [[float(x) for x in row] for row in path["positions"]]  # type: ignore[attr-defined]
        rest = [side * (0.02 - 0.005 * kip / hand), above]
        return {
            "device": {"name": "simulated", "mass": 0.1, "damping": 0.5},
            "start": [side * 0.02, above],
            "hand": {"stiffness": hand, "damping": 5.0, "rest": rest, "motion": path},
        }

    return gx.Scene(
        dimensions=2, period=0.001, duration=duration, gravity=[0.0, -9.81],
        object={
            "mass": 0.1, "viscosity": 0.5, "rotational_viscosity": 1e-3, "free": [True, True, turns],
            "shape": {"kind": "box", "size": [0.05, 0.05]},
        },
        coupling={
            "external": {"stiffness": 200.0, "damping": 0.5}, "internal": {"stiffness": kip, "damping": 0.5},
            "friction": mu,
        },
        finger=[finger(-1.0), finger(1.0)],
    )  # fmt: skip


def test_a_pinched_box_slips_where_its_weight_is_twice_mu_times_the_squeeze() -> None:
    """m g = 2 mu f_n: the squeeze falls by 2.5 N in 0.9 s, and the box slips within 1 % of m g/(2 mu) = 0.981 N."""
    rec = gx.run(pinch(1.4, 0.5, opening=0.0125))
    assert rec.status is not None and rec.objects["object"].law is not None
    falls = (rec.status[600:] == 2).all(axis=1)
    first = 600 + int(np.argmax(falls))
    squeeze = np.abs(rec.finger_force[first, :, 0])
    assert falls.any() and squeeze == pytest.approx(0.981, rel=0.01)
    assert np.ptp(rec.object_position[500:first, 1]) < 2e-4  # until then it hangs on two springs
    assert rec.object_position[-1, 1] < rec.object_position[first, 1] - 0.005
    summary = rec.summary()
    assert summary["associated"] == 0.0 and summary["friction_residual"] < 1e-13 and not rec.faults


def test_a_held_box_does_not_creep() -> None:
    """Held 5 mm above its centre, free to turn: once it has settled it stays, to less than 0.1 um."""
    rec = gx.run(pinch(2.0, 0.8, above=0.005, turns=True))
    assert rec.status is not None and (rec.status[500:] == 1).all()
    assert np.abs(rec.object_position[-1] - rec.object_position[1500]).max() < 1e-7


def test_a_recording_keeps_status_law_and_residual(tmp_path: Any) -> None:
    rec = gx.run(pinch(0.6, 0.5, opening=0.0125), duration=0.05)
    rec.save(tmp_path / "r.h5")
    back = gx.Recording.load(tmp_path / "r.h5")
    assert back.status is not None and rec.status is not None and np.array_equal(back.status, rec.status)
    found, made = back.objects["object"], rec.objects["object"]
    assert np.array_equal(found.law, made.law) and np.array_equal(found.residual, made.residual)  # type: ignore[arg-type]
    smooth = gx.run(pinch(0.6, 0.0), duration=0.01)
    assert smooth.status is None and smooth.objects["object"].law is None and smooth.summary()["associated"] is None


def test_fingers_may_have_coefficients_of_their_own() -> None:
    scene = pinch(0.6, 0.5).replace({"finger.1.friction": 0.1})
    assert scene.coefficients == (0.5, 0.1)
    with pytest.raises(SceneError, match="'stick' prevents all slip"):
        scene.replace({"coupling.friction": "stick"})


def test_the_plan_says_which_law_runs() -> None:
    rows = {row.step: row.why for row in plan(pinch(0.6, 0.5))}
    assert "mu = 0.5" in rows["letting go"] and "associated" in rows["letting go"]
