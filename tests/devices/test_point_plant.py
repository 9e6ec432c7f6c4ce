"""Point masses that a hand holds: exact motion between samples, at once or through the block and its kernel."""

from __future__ import annotations

from typing import Any

import mpmath
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from graspfx.devices.simulated import PointDevice, connect, points
from graspfx.errors import DeviceError, InputError
from graspfx.loop.hand import Hand, join
from graspfx.loop.motion.motion import Sine

T = 0.005
M, B = 0.15, 0.2  # [kg], [N s/m]


def made(start, mass=M, friction=B):
    """A finger for each row of `start`, placed there."""
    start = np.array(start, dtype=float)
    n, d = start.shape
    plant = points.PointPlant([mass] * n, [friction] * n, d)
    plant.place(start)
    return plant


def nobody(n, d):
    return Hand(np.zeros((n, d)), 0.0)


def test_plant_equals_the_matrix_exponential_of_fingers_and_hand():
    # Two fingers on one axis with arm and grip at rest: z' = A z + u, per sample expm of (z, u, 1), over 2000 samples.
    k, b = np.array([[50.0, -20.0], [-20.0, 50.0]]), np.array([[1.0, -0.4], [-0.4, 1.0]])
    rest = np.array([0.01, -0.02])
    A = np.zeros((7, 7))  # x, x', u, 1
    A[:2, 2:4] = np.eye(2)
    A[2:4, :2], A[2:4, 2:4], A[2:4, 4:6], A[2:4, 6] = -k / M, -(b + B * np.eye(2)) / M, np.eye(2) / M, k @ rest / M
    step = expm(A * T)
    hand = Hand(rest[:, None], k[None], b[None])
    plant = made([[0.002], [-0.003]])
    z = np.array([0.002, -0.003, 0.0, 0.0, 0.0, 0.0, 1.0])
    rng = np.random.default_rng(6)
    worst = 0.0
    for u in rng.normal(0.0, 0.5, (2000, 2)):
        z[4:6] = u
        z = step @ z
        plant.advance(u[:, None], hand, T)
        worst = max(worst, np.abs(plant.position[:, 0] - z[:2]).max(), T * np.abs(plant.velocity[:, 0] - z[2:4]).max())
    assert worst < 1e-14


@pytest.mark.parametrize("stiffness", [0.0, 33.0, 1e5])
def test_one_sample_against_fifty_digits(stiffness):
    # One finger, target through r = 3 mm + 0.2 t + 5 t^2 - 40 t^3: a cubic, for which the plant is exact.
    class Cubic:
        dimensions = 1

        def at(self, t):
            return np.array([0.003 + 0.2 * t + 5.0 * t**2 - 40.0 * t**3]), np.array([0.2 + 10.0 * t - 120.0 * t**2])

    damping, u, x0 = 0.7, 0.4, 0.001
    with mpmath.workdps(50):
        k, c, b, m = (mpmath.mpf(v) for v in (stiffness, damping, B, M))
        A = mpmath.zeros(7)  # x, x', r, r', r'', r''', u/m
        A[0, 1] = A[2, 3] = A[3, 4] = A[4, 5] = A[1, 6] = 1
        A[1, 0], A[1, 1], A[1, 2], A[1, 3] = -k / m, -(b + c) / m, k / m, c / m
        z = mpmath.matrix([x0, 0, mpmath.mpf(0.003), mpmath.mpf(0.2), 10, -240, mpmath.mpf(u) / m])
        expected = mpmath.expm(A * mpmath.mpf(T)) * z
    plant = made([[x0]])
    plant.advance(np.array([[u]]), Hand([[0.0]], stiffness, damping, Cubic()), T)
    assert abs(plant.position[0, 0] - float(expected[0])) < 2e-16
    assert abs(plant.velocity[0, 0] - float(expected[1])) < 1e-13


def waving(frequency=0.5):
    return Hand([[0.01]], 33.0, 1.0, Sine(0.05, frequency, [1.0]))


def hermite(hand, t0, s):
    """The cubic through the target's values and velocities at t0 and t0 + T, and its velocity."""
    (r0, v0), (r1, v1) = ((float(a[0, 0]) for a in hand.target(t)) for t in (t0, t0 + T))
    h = s / T
    r = (1 + 2 * h) * (1 - h) ** 2 * r0 + h * (1 - h) ** 2 * T * v0 + h**2 * (3 - 2 * h) * r1 + h**2 * (h - 1) * T * v1
    v = 6 * h * (h - 1) / T * (r0 - r1) + (1 - h) * (1 - 3 * h) * v0 + h * (3 * h - 2) * v1
    return r, v


@pytest.mark.parametrize(("target", "tolerance"), [("cubic", 1e-13), ("sine", 2e-11)])
def test_plant_equals_an_integrator_of_order_eight(target, tolerance):
    # With the cubic in the integrator too only rounding is left; with the sine itself the cubic's own error,
    # T^4/384 a w^4 = 8e-12 m for 50 mm at 0.5 Hz.
    hand = waving()
    plant = made([[0.0]])
    z, worst = np.zeros(2), 0.0
    for i, u in enumerate(np.random.default_rng(7).normal(0.0, 0.5, 200)):
        t0 = i * T

        def rate(s, z, t0=t0, u=u):
            if target == "cubic":
                r, v = hermite(hand, t0, s)
            else:
                r, v = (float(a[0, 0]) for a in hand.target(t0 + s))
            return [z[1], (u - B * z[1] + 33.0 * (r - z[0]) + 1.0 * (v - z[1])) / M]

        z = solve_ivp(rate, (0.0, T), z, "DOP853", rtol=1e-13, atol=1e-16).y[:, -1]
        plant.advance(np.array([[u]]), hand, T)
        worst = max(worst, abs(plant.position[0, 0] - z[0]))
    assert worst < tolerance


def test_a_moving_target_is_followed_to_fourth_order():
    def end(steps):
        plant = made([[0.0]])
        hand = waving(2.0)
        for _ in range(steps):
            plant.advance(np.zeros((1, 1)), hand, 0.8 / steps)
        return plant.position[0, 0]

    steps = np.array([20, 40, 80, 160])
    errors = np.abs([end(n) - end(2560) for n in steps])
    order = -np.polyfit(np.log(steps), np.log(errors), 1)[0]
    assert order == pytest.approx(4.0, abs=0.15)


def test_alone_it_is_the_closed_form_of_a_viscous_mass():
    # x = u/b (t - m/b (1 - e^(-b t/m))), v = u/b (1 - e^(-b t/m)).
    u, n = 0.3, 400
    plant = made([[0.0, 0.0]])
    for _ in range(n):
        plant.advance(np.array([[u, 0.0]]), nobody(1, 2), T)
    v = u / B * -np.expm1(-B * n * T / M)
    assert plant.velocity[0, 0] == pytest.approx(v, rel=1e-13)
    assert plant.position[0, 0] == pytest.approx(u / B * n * T - M / B * v, rel=1e-13)
    np.testing.assert_array_equal(plant.position[:, 1], [0.0])


def test_without_friction_and_hand_it_is_the_parabola():
    plant = made([[0.0]], friction=0.0)
    for _ in range(200):
        plant.advance(np.array([[0.6]]), nobody(1, 1), T)
    assert plant.position[0, 0] == pytest.approx(0.5 * 0.6 / M, rel=1e-13)  # t = 1 s
    assert plant.velocity[0, 0] == pytest.approx(0.6 / M, rel=1e-13)


def test_what_rests_does_so_to_the_bit():
    start = np.array([[0.0123, -0.4], [1.7, 0.33]])
    plant = made(start)
    for _ in range(50):
        plant.advance(np.zeros((2, 2)), Hand(start, 33.0, 1.0), T)
    np.testing.assert_array_equal(plant.position, start)
    for _ in range(50):
        plant.advance(np.zeros((2, 2)), nobody(2, 2), T)
    np.testing.assert_array_equal(plant.position, start)


def test_mean_and_difference_of_two_fingers_do_not_know_each_other():
    # Arm (30, 1) on x_e, grip (200, 0.5) on x_i, (13)-(19): each alone equals one finger with that spring; forces too.
    hand = Hand.arm_and_grip([[0.0], [0.0]], arm=(30.0, 1.0), grip=(200.0, 0.5))
    rng = np.random.default_rng(8)
    e0, i0 = 0.004, 0.007
    both = made([[e0 - i0], [e0 + i0]])
    external = made([[e0]])
    internal = made([[i0]])
    apart = made([[-i0], [i0]])
    arm, grip = Hand([[0.0]], 30.0, 1.0), Hand([[0.0]], 200.0, 0.5)
    worst = leak = 0.0
    for f_e, f_i in rng.normal(0.0, 0.3, (1000, 2)):
        both.advance(np.array([[f_e - f_i], [f_e + f_i]]), hand, T)
        apart.advance(np.array([[-f_i], [f_i]]), hand, T)
        external.advance(np.array([[f_e]]), arm, T)
        internal.advance(np.array([[f_i]]), grip, T)
        x1, x2 = both.position[:, 0]
        worst = max(worst, abs((x1 + x2) / 2 - external.position[0, 0]), abs((x2 - x1) / 2 - internal.position[0, 0]))
        leak = max(leak, abs(apart.position.sum()))
    assert worst < 1e-14
    assert leak < 1e-15


def test_fingers_that_nothing_couples_move_to_the_bit_as_each_alone():
    # Three fingers of two hands and two devices with other masses, in space, against one plant each.
    rng = np.random.default_rng(9)
    start, forces = rng.normal(0.0, 0.01, (3, 3)), rng.normal(0.0, 0.5, (100, 3, 3))
    pair = connect(mass=0.1, damping=0.3, fingers=2, dimensions=3)
    single = connect(mass=0.2, dimensions=3)
    plant = PointDevice.plant([pair, single])
    plant.place(start)
    first = Hand(start[:2] + 0.01, [10.0, 20.0, 20.0], 0.5)
    second = Hand(start[2:], 40.0, 1.0, Sine(0.01, 1.0, [1.0, 2.0, 3.0]))
    alone = [
        made(start[i : i + 1], mass, friction)
        for i, (mass, friction) in enumerate([(0.1, 0.3), (0.1, 0.3), (0.2, 0.0)])
    ]
    own = [Hand(start[i : i + 1] + 0.01, [10.0, 20.0, 20.0], 0.5) for i in range(2)]
    hand = join([first, second])
    for f in forces:
        plant.advance(f, hand, T)
        for i, (one, its) in enumerate(zip(alone, [*own, second], strict=True)):
            one.advance(f[i : i + 1], its, T)
            np.testing.assert_array_equal(plant.position[i], one.position[0])
            np.testing.assert_array_equal(plant.velocity[i], one.velocity[0])


def test_axes_and_fingers_with_the_same_gains_share_a_matrix():
    plant = made(np.zeros((2, 3)))
    plant.advance(np.zeros((2, 3)), Hand(np.zeros((2, 3)), [10.0, 20.0, 20.0]), T)
    block = points.PointPlantState(plant.state)
    groups = [block.groups[k] for k in range(block.group_count)]
    assert [(group.axis, group.count) for group in groups] == [(0, 1), (0, 1), (1, 1), (1, 1), (2, 1), (2, 1)]
    assert len({group.matrix for group in groups}) == 2


def test_gains_period_and_hand_may_change_between_samples():
    # Each change against a plant that is handed the state and starts afresh with it.
    plant = made([[0.001], [0.002]])
    hands = [
        Hand([[0.0], [0.0]], 33.0, 1.0),
        Hand([[0.01], [0.0]], 33.0, 1.0),
        Hand.arm_and_grip([[0.0], [0.0]], arm=(5.0, 0.1), grip=(90.0, 1.0)),
    ]
    x = np.array([0.001, 0.002, 0.0, 0.0])
    for hand, period in [(hands[0], T), (hands[1], T), (hands[2], T), (hands[2], 0.001), (hands[0], 0.001)]:
        plant.advance(np.zeros((2, 1)), hand, period)
        A = np.zeros((5, 5))
        A[:2, 2:4] = np.eye(2)
        A[2:4, :2], A[2:4, 2:4] = -hand.stiffness[0] / M, -(hand.damping[0] + B * np.eye(2)) / M
        A[2:4, 4] = hand.stiffness[0] @ hand.target(0.0)[0][:, 0] / M
        x = (expm(A * period) @ [*x, 1.0])[:4]
        np.testing.assert_allclose(plant.position[:, 0], x[:2], atol=1e-16)
    assert plant.time == pytest.approx(3 * T + 2 * 0.001, rel=1e-15)


@pytest.mark.parametrize("where", ["effort", "position", "velocity"])
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_inputs_that_are_not_finite_move_nothing(where, bad):
    class Lost:
        stiffness, damping = np.full((1, 1, 1), 33.0), np.full((1, 1, 1), 1.0)

        def target(self, t):
            lost = t > 2.5 * T
            return tuple(np.full((1, 1), bad if lost and where == name else 0.0) for name in ("position", "velocity"))

    plant = made([[0.001]])
    plant.advance(np.ones((1, 1)), Lost(), T)
    plant.advance(np.ones((1, 1)), Lost(), T)
    x, v, time = plant.position[0, 0], plant.velocity[0, 0], plant.time
    with pytest.raises(DeviceError, match="efforts or the hand's targets are not finite"):
        plant.advance(np.full((1, 1), bad if where == "effort" else 1.0), Lost(), T)
    assert (plant.position[0, 0], plant.velocity[0, 0], plant.time) == (x, v, time)


def test_plants_that_cannot_be():
    with pytest.raises(InputError, match="at least one `simulated`"):
        PointDevice.plant([])
    with pytest.raises(InputError, match="the same number of dimensions"):
        PointDevice.plant([connect(mass=M, dimensions=1), connect(mass=M, dimensions=2)])
    plant = made([[0.0]])
    with pytest.raises(InputError, match="position"):
        plant.place(np.array([[np.nan]]))
    with pytest.raises(InputError, match=r"force.*\(1, 1\)"):
        plant.advance(np.zeros(1), nobody(1, 1), T)
    with pytest.raises(InputError, match=r"hand.stiffness.*\(1, 1, 1\)"):
        plant.advance(np.zeros((1, 1)), nobody(2, 1), T)
    with pytest.raises(InputError, match="T: given 0"):
        plant.advance(np.zeros((1, 1)), nobody(1, 1), 0.0)


def test_a_hand_that_stands_still_is_held_as_one_that_could_move():
    rest = np.array([[0.01, -0.02], [0.03, 0.04]])

    class Restless(Hand):
        def target(self, time):
            return super().target(time)

    still, could = Hand(rest, 30.0, 0.4), Restless(rest, 30.0, 0.4)
    closing = Hand(rest, 30.0, 0.4, squeeze=0.01, inward=[[1.0, 0.0], [-1.0, 0.0]])
    hands: list[Any] = [still, could, closing, join([still, still]), join([still, could])]
    assert [hand.still for hand in hands] == [
        True, False, False, True, False,
    ]  # fmt: skip
    plants = [PointDevice.plant([connect(mass=0.1, dimensions=2, fingers=2)]) for _ in range(2)]
    force = np.array([[0.1, 0.2], [-0.3, 0.0]])
    for plant in plants:
        plant.place(np.zeros((2, 2)))
    for _ in range(20):
        for plant, hand in zip(plants, (still, could), strict=True):
            plant.advance(force, hand, 0.002)
        assert np.array_equal(plants[0].position, plants[1].position)
        assert np.array_equal(plants[0].velocity, plants[1].velocity)
