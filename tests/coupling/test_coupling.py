"""One sample: forces against the public law, transitions, reaction, damping, the implicit sample, faults."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

import graspfx as gx
from graspfx.coupling.contacts import LOST, NOT_FINITE
from graspfx.coupling.grasped import GraspedObject
from graspfx.coupling.rules import Rules
from graspfx.errors import InputError
from graspfx.objects import integrators as body
from graspfx.objects.body import NativeBody
from graspfx.surfaces.closed_form.shape import Box, Sphere
from tests.support.families import efforts
from tests.support.grasps import RIGID, free_mask, grasped, law, respond

FOLLOW = Rules(fade=None)
STICK = Rules(fade=None, stick=True)


@pytest.mark.parametrize("gains", [law(30.0, 70.0, 0.4, 0.9), law(40.0, 40.0, 0.3, 0.3)], ids=["separate", "equal"])
@pytest.mark.parametrize(("d", "kind"), [(1, "all"), *itertools.product((2, 3), ("all", "no turning", "knob", "rail"))])
@pytest.mark.parametrize("n", [1, 2, 3, 5])
def test_attached_force_is_equation_4(n: int, d: int, kind: str, gains: gx.Coupling) -> None:
    """Against the analysis' Split and Coupling in the metric of the weights, by an SVD: 1e-13 of the largest force."""
    rng = np.random.default_rng(n + 10 * d)
    share = rng.uniform(0.5, 2.0, n)
    contacts = rng.normal(size=(n, d)) * 0.03
    turned = {1: None, 2: 0.7, 3: np.array([0.1, 0.5, -0.3, np.sqrt(0.65)])}[d]
    free = free_mask(d, kind)
    rules = Rules(attached=True, share=share.tolist())
    g = grasped(n, d, gains, rules, contacts=contacts, free=free, orientation=turned, position=rng.normal(size=d))
    R = g.body_state[body.ROTATION : body.ROTATION + 9].reshape(3, 3)[:d, :d]
    arms = contacts @ R.T
    p = g.body_state[body.POSITION : body.POSITION + d] + arms + rng.normal(size=(n, d)) * 0.004
    v = rng.normal(size=(n, d)) * 0.1
    split = gx.Grasp(arms, free=free).split(metric=share)
    e = (p - g.body_state[body.POSITION : body.POSITION + d] - arms).ravel()
    expected = gains.force(split, e, v.ravel()).reshape(n, d)
    np.testing.assert_allclose(respond(g, p, v), expected, atol=1e-13 * np.abs(expected).max())


def test_equal_gains_are_the_conventional_method_bit_for_bit() -> None:
    rng = np.random.default_rng(2)
    contacts = rng.normal(size=(4, 3)) * 0.03
    g = grasped(4, 3, law(70.0, 70.0, 0.4, 0.4), RIGID, contacts=contacts, inertia=(1e-5, 2e-5, 3e-5))
    p, v = contacts + rng.normal(size=(4, 3)) * 1e-3, rng.normal(size=(4, 3))
    assert np.array_equal(respond(g, p, v), 70.0 * (p - contacts) + 0.4 * v)


def sweep_step(g: GraspedObject, paths: np.ndarray) -> float:
    """The largest force step along finger paths (steps, n, d), per metre of finger motion."""
    worst, last = 0.0, respond(g, paths[0])
    for before, now in itertools.pairwise(paths):
        f = respond(g, now)
        worst = max(worst, np.abs(f - last).max() / np.abs(now - before).max())
        last = f
    return float(worst)


@pytest.mark.parametrize("fade", [None, (0.006, 0.02)])
@pytest.mark.parametrize(("d", "n"), [(1, 2), (2, 2), (2, 3), (3, 2), (3, 4)])
def test_force_is_continuous_through_every_transition(d: int, n: int, fade: tuple[float, float] | None) -> None:
    """Grasp -> push -> free -> push with the other -> grasp, friction 0, no damping.

    Between samples it changes by no more than the stiffest mode times the motion, and where a finger begins or ceases
    to touch, its last instants before and after, 1e-12 of the path apart, agree to 1e-10 N.
    """
    shape = Sphere(0.03) if d == 3 else Box((0.05,) * d)
    radius = 0.03 if d == 3 else 0.025
    inertia = None if d == 1 else 4e-5
    angles = np.linspace(0, 2 * np.pi, n, endpoint=False) + 0.1 * (d > 1)
    out = np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1)[:, :d]
    if d == 1:
        out = np.array([[-1.0], [1.0]])
    if d == 2 and n == 3:  # on faces, away from corners
        out = np.array([[-1.0, 0.1], [1.0, -0.2], [0.1, 1.0]])

    def place(t: float) -> np.ndarray:
        rate = np.arange(1, n + 1)
        gap = 0.006 * np.sin(2 * np.pi * rate * t + rate - 1) - 0.002 * rate / n  # in and out, each at its own rate
        return out * (radius + gap)[:, None]

    g = grasped(n, d, law(40.0, 160.0), Rules(fade=fade), shape=shape, inertia=inertia)
    assert sweep_step(g, np.array([place(t) for t in np.linspace(0.0, 1.0, 500)])) < 1.1 * 160.0

    def touching(t: float) -> tuple[np.ndarray, list[float]]:
        return respond(g, place(t)), g.touching.tolist()

    changes = 0
    times = np.linspace(0.0, 1.0, 200)
    for low, high in itertools.pairwise(times.tolist()):
        if touching(low)[1] == touching(high)[1]:
            continue
        changes += 1
        before = touching(low)[1]
        while high - low > 1e-12:
            middle = 0.5 * (low + high)
            low, high = (middle, high) if touching(middle)[1] == before else (low, middle)
        assert np.abs(touching(low)[0] - touching(high)[0]).max() < 1e-10
    assert changes >= 2 * n  # every finger leaves and comes back


def test_sticking_finger_jumps_by_its_own_shear() -> None:
    """Equal gains, so that no force is shared: at release the finger's force changes by the shear, the other's by 0."""
    g = grasped(2, 2, law(50.0, 50.0), STICK, shape=Box((0.05, 0.05)))
    respond(g, [[-0.024, 0.0], [0.024, 0.0]])
    held = respond(g, [[-0.025 + 1e-12, 0.003], [0.024, 0.0]])
    gone = respond(g, [[-0.025 - 1e-12, 0.003], [0.024, 0.0]])
    np.testing.assert_allclose(held[0] - gone[0], [0.0, 50.0 * 0.003], atol=1e-10)
    np.testing.assert_allclose(held[1], gone[1], atol=1e-15)


def test_free_finger_leaves_the_split_when_it_fades() -> None:
    """40/160 on a line: beyond h2 a lone finger feels kep = 40 N/m, within h1 it feels 64 N/m."""
    g = grasped(2, 1, law(40.0, 160.0), Rules(fade=(0.002, 0.01)), shape=Box((0.05,)))
    near = respond(g, [[-0.024], [0.0265]])
    far = respond(g, [[-0.024], [0.036]])
    assert near[0, 0] == pytest.approx(64.0 * 0.001, rel=1e-13)
    assert far[0, 0] == pytest.approx(40.0 * 0.001, rel=1e-13)
    assert g.shortfall == 0.0


def test_fade_that_begins_too_near_is_noticed() -> None:
    """A finger 0.5 mm off the surface is still held here: the fade should begin at half |1/kep - 1/kip| sum |f|."""
    g = grasped(2, 1, law(40.0, 160.0), Rules(fade=(0.0005, 0.001)), shape=Box((0.05,)))
    f = respond(g, [[-0.015], [0.0255]])
    assert g.shortfall == pytest.approx(0.5 * (1 / 40 - 1 / 160) * np.abs(f).sum() - 0.0005, rel=1e-12)


@pytest.mark.parametrize("reaction", [False, True])
def test_reaction_and_rate_go_together(reaction: bool) -> None:
    """Moment arms and rates both from the fingertip, or both from the contact."""
    rules = Rules(attached=True, at_contact=reaction)
    contacts = np.array([[0.02, 0.0], [-0.02, 0.01]])
    g = grasped(2, 2, law(30.0, 70.0, 0.2, 0.5), rules, contacts=contacts, velocity=[0.1, 0.0], angular_velocity=3.0)
    p = contacts + np.array([[0.003, 0.001], [0.0, -0.002]])
    f = respond(g, p)
    arms = contacts if reaction else p
    rate = -np.array([0.1, 0.0]) - 3.0 * np.stack([-arms[:, 1], arms[:, 0]], axis=1)
    expected = law(30.0, 70.0, 0.2, 0.5).force(gx.Grasp(contacts).split(), (p - contacts).ravel(), rate.ravel())
    np.testing.assert_allclose(f.ravel(), expected, atol=1e-15)
    assert g.wrench[2] == pytest.approx((arms[:, 0] * f[:, 1] - arms[:, 1] * f[:, 0]).sum(), abs=1e-17)


def test_implicit_sample_solves_force_and_motion_together() -> None:
    """On a line, attached and damped: f = K (p - x+) + D (p' - v+) with the new state that this very force makes."""
    T, m, b = 0.005, 0.1, 0.8
    g = grasped(
        2, 1, law(30.0, 70.0, 0.2, 0.5), RIGID, integrator="implicit", viscosity=b, velocity=[0.05], inertia=None,
        rotational_viscosity=0.0, period=T,
    )  # fmt: skip
    native = NativeBody(g.body_state)
    native.free_motion(T)
    p, v = np.array([[0.004], [-0.001]]), np.array([[0.02], [0.0]])
    f = respond(g, p, v)
    native.step(T)
    x, u = native.position[0], native.velocity[0]
    e, de = p[:, 0] - x, v[:, 0] - u
    P = np.full((2, 2), 0.5)
    K, D = 30 * P + 70 * (np.eye(2) - P), 0.2 * P + 0.5 * (np.eye(2) - P)
    np.testing.assert_allclose(f[:, 0], K @ e + D @ de, atol=1e-15)
    assert m * (u - 0.05) / T + b * u == pytest.approx(f.sum(), rel=1e-12)


@pytest.mark.parametrize("kip", [40.0, 160.0])
@pytest.mark.parametrize("kind", ["all", "knob", "rail"])
def test_implicit_force_on_a_turned_object(kind: str, kip: float) -> None:
    """Attached: f = (K^-1 + G'CG)^-1 e with G of the free world directions, equal gains too."""
    T, m, inertia, b = 0.005, 0.1, 4e-5, 1e-4
    free = free_mask(2, kind)
    contacts = np.array([[0.02, 0.01], [-0.02, 0.0], [0.0, 0.03]])
    g = grasped(3, 2, law(40.0, kip), RIGID, contacts=contacts, integrator="implicit", free=free, orientation=0.6)
    NativeBody(g.body_state).free_motion(T)
    c, s = np.cos(0.6), np.sin(0.6)
    arms = contacts @ np.array([[c, -s], [s, c]]).T
    e = np.array([[1.0, -2.0], [0.5, 0.3], [2.0, 1.0]]) * 1e-3
    K = law(40.0, kip).stiffness(gx.Grasp(arms, free=free).split())
    G = gx.grasp_matrix(arms, free=free)
    give = np.diag([T * T / m, T * T / m, T * T / (inertia + T * b)])[np.ix_(free, free)]
    expected = np.linalg.solve(np.linalg.inv(K) + G.T @ give @ G, e.ravel())
    np.testing.assert_allclose(respond(g, arms + e).ravel(), expected, atol=1e-14)


@pytest.mark.parametrize("rules", [RIGID, FOLLOW, STICK])
def test_an_object_that_is_lost_gives_zero_force(rules: Rules) -> None:
    g = grasped(2, 1, law(30.0, 70.0), rules, shape=Box((0.05,)))
    assert respond(g, [[-0.02], [0.02]]).any()
    g.body_state[body.POSITION] = np.nan
    assert g.sample() == LOST
    assert not g.force.any() and not g.wrench.any()


@pytest.mark.parametrize("rules", [FOLLOW, STICK, Rules()])
def test_equal_gains_finger_by_finger_are_the_projection(rules: Rules) -> None:
    """The conventional method's short way against the projection that all other gains take, and no split for either."""
    rng = np.random.default_rng(9)
    for _ in range(30):
        p, v = rng.uniform(-0.03, 0.03, size=(3, 2)), rng.normal(size=(3, 2)) * 0.05
        short = grasped(3, 2, law(70.0, 70.0, 0.4, 0.4), rules, shape=Box((0.05, 0.05)))
        gains = law(70.0 * np.eye(2), 70.0 * np.eye(2), 0.4 * np.eye(2), 0.4 * np.eye(2))
        whole = grasped(3, 2, gains, rules, shape=Box((0.05, 0.05)))
        np.testing.assert_allclose(respond(whole, p, v), respond(short, p, v), atol=1e-14)
        assert not short.state.split_known and not whole.state.split_known


@pytest.mark.parametrize(("ked", "kid"), [(0.7, 0.1), (0.01, 0.5)])
def test_implicit_damping_does_not_see_how_far_a_free_finger_is(ked: float, kid: float) -> None:
    """On an object of a tonne, a wall: 5 mm deep against 42 N/m is 0.21 N, wherever the other finger hovers."""
    for away in (0.03, 0.2):
        g = grasped(
            2, 1, law(30.0, 70.0, ked, kid), FOLLOW, shape=Box((0.05,)), integrator="implicit", mass=1000.0,
            inertia=None, rotational_viscosity=0.0,
        )  # fmt: skip
        NativeBody(g.body_state).free_motion(0.005)
        f = respond(g, [[-0.02], [0.025 + away]])
        assert f[0, 0] == pytest.approx(0.21, rel=1e-4) and f[1, 0] == 0.0


@efforts(short=300, full=2000)
def test_damping_reaches_the_power_it_should_in_many_states(cases: int) -> None:
    """Random states with one gain zero: none unresolved, none active beyond 1e-9 of the power at hand."""
    rng = np.random.default_rng(11)
    for k in range(cases):
        rules, gains = (FOLLOW, STICK)[k % 2], ((0.0, 0.5), (0.5, 0.0))[k // 2 % 2]
        p, v = rng.uniform(-0.03, 0.03, size=(3, 1)), rng.normal(size=(3, 1))
        f0 = respond(grasped(3, 1, law(40.0, 160.0), rules, shape=Box((0.05,))), p, v)
        f = respond(grasped(3, 1, law(40.0, 160.0, *gains), rules, shape=Box((0.05,))), p, v)
        assert ((f - f0) * v).sum() >= -1e-9 * (v**2).sum()


def test_a_finger_whose_shear_lets_it_go_touches_again_at_once() -> None:
    """Deep inside, released because its anchor lies far to the side: it goes on from the nearest point."""
    rng = np.random.default_rng(12)
    start = np.array([[-0.023, 0.0], [0.023, 0.005], [0.0, -0.022]])
    for _ in range(100):
        g = grasped(3, 2, law(40.0, 160.0), STICK, shape=Box((0.05, 0.05)))
        respond(g, start)
        moved = start + rng.normal(size=(3, 2)) * 0.008
        first, touching = respond(g, moved), g.touching.copy()
        np.testing.assert_allclose(respond(g, moved), first, atol=1e-14)
        assert np.array_equal(g.touching, touching)


@pytest.mark.parametrize("lost", [np.nan, np.inf, 1e200])  # the square of the last one overflows: so would the gap
def test_not_finite_motion_gives_zero_force(lost: float) -> None:
    g = grasped(2, 1, law(30.0, 70.0), FOLLOW, shape=Box((0.05,)))
    assert respond(g, [[-0.02], [0.02]]).any()
    g.finger_position[1, 0] = lost
    assert g.sample() == NOT_FINITE
    assert not g.force.any() and not g.wrench.any()


def test_unilateral_contact_needs_a_shape_and_stiffness() -> None:
    with pytest.raises(InputError, match="shape"):
        grasped(2, 1, law(30.0, 70.0), FOLLOW)
    with pytest.raises(InputError, match="above zero"):
        grasped(2, 1, law(30.0, 0.0), FOLLOW, shape=Box((0.05,)))
