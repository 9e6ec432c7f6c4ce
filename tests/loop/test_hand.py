"""Hands: gains per finger and as arm and grip (Kawai and Yoshikawa, fig. 9), targets, and hands joined."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from graspfx.devices.simulated import PointDevice, connect
from graspfx.errors import InputError
from graspfx.loop.hand import Hand, join
from graspfx.loop.motion.motion import Levels, Reach, Sine, Sum
from graspfx.loop.motion.turn import Turn

REST = np.array([[-0.025, 0.0], [0.025, 0.0], [0.0, 0.03]])


def test_each_finger_its_own():
    hand = Hand(REST, 33.0, [0.5, 0.7])
    np.testing.assert_array_equal(hand.stiffness, [33.0 * np.eye(3)] * 2)
    np.testing.assert_array_equal(hand.damping, [0.5 * np.eye(3), 0.7 * np.eye(3)])
    for time in (0.0, 5.0):
        r, v = hand.target(time)
        np.testing.assert_array_equal(r, REST)
        assert not v.any()


@pytest.mark.parametrize("n", [1, 2, 5])
def test_arm_and_grip_act_on_mean_and_deviations(n):
    # K is k_arm on (1 ... 1) and k_grip on everything that sums to zero; the forces add up to n k_arm x_e.
    rng = np.random.default_rng(5)
    hand = Hand.arm_and_grip(rng.normal(size=(n, 2)), arm=([40.0, 90.0], 2.0), grip=(200.0, [0.3, 0.4]))
    x = rng.normal(size=n)
    mean = np.full(n, x.mean())
    for a, arm, grip in ((0, 40.0, 200.0), (1, 90.0, 200.0)):
        np.testing.assert_allclose(hand.stiffness[a] @ x, arm * mean + grip * (x - mean), rtol=1e-13, atol=1e-13)
        assert (hand.stiffness[a] @ x).sum() == pytest.approx(n * arm * x.mean(), rel=1e-12)
    for a, grip in ((0, 0.3), (1, 0.4)):
        np.testing.assert_allclose(hand.damping[a] @ x, 2.0 * mean + grip * (x - mean), rtol=1e-13, atol=1e-13)


def test_two_fingers_of_an_arm_and_a_grip_are_the_papers_z_plus_and_z_minus():
    # (13), (16): x = (x_e - x_i, x_e + x_i): the sum of the forces is 2 k_arm x_e, half their difference k_grip x_i.
    hand = Hand.arm_and_grip([[0.0], [0.0]], arm=(30.0, 0.0), grip=(100.0, 0.0))
    x_e, x_i = 0.007, 0.003
    f = hand.stiffness[0] @ [x_e - x_i, x_e + x_i]
    assert f.sum() == pytest.approx(2.0 * 30.0 * x_e, rel=1e-14)
    assert (f[1] - f[0]) / 2.0 == pytest.approx(100.0 * x_i, rel=1e-14)


def test_equal_arm_and_grip_are_fingers_by_themselves():
    hand = Hand.arm_and_grip(REST, arm=(33.0, 1.0), grip=(33.0, 1.0))
    np.testing.assert_allclose(hand.stiffness, Hand(REST, 33.0).stiffness, atol=1e-14)


def test_target_is_rest_motion_and_squeeze():
    inward = [[2.0, 0.0], [-5.0, 0.0], [0.0, 0.0]]
    motion = Sine(0.05, 0.5, [0.0, 1.0])
    hand = Hand(REST, 33.0, 1.0, motion, 0.01, inward, 0.8)
    unit = np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 0.0]])
    for time, share, rate in ((0.0, 0.0, 0.0), (0.4, 0.5, 1.875 / 0.8), (0.8, 1.0, 0.0), (3.0, 1.0, 0.0)):
        x, v = motion.at(time)
        r, dr = hand.target(time)
        np.testing.assert_allclose(r, REST + x + 0.01 * share * unit, atol=1e-16)
        np.testing.assert_allclose(dr, v + 0.01 * rate * unit, atol=1e-15)


def test_squeeze_at_once_and_target_velocity_is_the_derivative():
    inward = np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, -1.0]])
    at_once = Hand(REST, 1.0, squeeze=0.01, inward=inward, squeeze_ramp=0.0)
    np.testing.assert_allclose(at_once.target(0.0)[0], REST + 0.01 * inward, atol=1e-17)
    hand = Hand(REST, 1.0, motion=Reach([0.1, 0.2], 0.1, 1.0), squeeze=0.01, inward=inward)
    for t in (0.05, 0.3, 0.45, 0.7):
        difference = (hand.target(t + 1e-5)[0] - hand.target(t - 1e-5)[0]) / 2e-5
        np.testing.assert_allclose(hand.target(t)[1], difference, atol=1e-7)


STARTS = np.array([[0.03, 0.0, 0.01], [-0.02, 0.03, 0.0], [-0.01, -0.03, -0.01]])
SHARES = [1.0, 0.5, -0.25]
CENTRE = np.array([0.01, 0.0, -0.02])
LIFT, WAVE = Reach([0.0, 0.0, 0.05], 0.2, 0.5), Sine(0.02, 1.5, [1.0, 1.0, 0.0], 0.1, 0.4)
FIRST, SECOND = Reach([1.2], 0.1, 0.6), Sine(0.5, 1.0, [1.0], 0.2, 0.3)
SQUEEZE = Levels([[0.006, 0.0, 0.3], [-0.004, 0.6, 0.3]])
JOINS = [0.0, 0.1, 0.2, 0.3, 0.5, 0.6, 0.7, 0.9, 1.2]  # the third derivative jumps there


def handling():
    """Three fingers in space that close, turn about two axes one after another, are carried, and open."""
    return Hand.arm_and_grip(
        STARTS,
        arm=(40.0, 2.0),
        grip=(150.0, 1.5),
        motion=Sum([LIFT, WAVE]),
        squeeze=SQUEEZE,
        inward=-STARTS,
        share=SHARES,
        turns=[Turn(FIRST, CENTRE, [0.0, 1.0, 1.0]), Turn(SECOND, CENTRE, 0)],
    )


def test_target_is_closed_turned_and_carried():
    # r_i = c + R (rest_i + s share_i u_i - c) + x, the first turn made first.
    hand, u = handling(), -STARTS / np.linalg.norm(STARTS, axis=1, keepdims=True)
    for t in np.linspace(0.0, 1.2, 25).tolist():
        s, first, second = (float(motion.at(t)[0][0]) for motion in (SQUEEZE, FIRST, SECOND))
        R = Rotation.from_rotvec([second, 0.0, 0.0]) * Rotation.from_rotvec(first * np.sqrt(0.5) * np.array([0, 1, 1]))
        closed = STARTS + s * np.array(SHARES)[:, None] * u
        expected = CENTRE + R.apply(closed - CENTRE) + LIFT.at(t)[0] + WAVE.at(t)[0]
        np.testing.assert_allclose(hand.target(t)[0], expected, atol=1e-16)


def test_the_rate_of_a_handling_is_its_derivative_to_sixth_order():
    # Central differences over seven points; their error is h^6/140 of the seventh derivative, halved steps divide it
    # by 64. Rounding, 1e-17 m / h, stays below 1e-14.
    hand = handling()
    t = np.random.default_rng(31).uniform(0.0, 1.2, 300)
    t = t[np.abs(t[:, None] - JOINS).min(axis=1) > 0.031].tolist()

    def difference(a, h):
        pairs = [(hand.target(a + k * h)[0], hand.target(a - k * h)[0]) for k in (1, 2, 3)]
        return sum(w * (after - before) for w, (after, before) in zip((45, -9, 1), pairs, strict=True)) / (60 * h)

    errors = [max(np.abs(difference(a, h) - hand.target(a)[1]).max() for a in t) for h in (0.01, 0.005)]
    assert errors[1] < 1e-7
    assert np.log2(errors[0] / errors[1]) == pytest.approx(6.0, abs=0.3)


def test_a_turning_hand_keeps_the_distances_between_its_targets():
    turns = [Turn(Reach([2.0], 0.0, 1.0), [0.2, 0.0, 0.0], [1.0, 2.0, 3.0])]
    carried = Reach([0.1, 0.0, 0.0], 0.0, 1.0)
    hand = Hand(STARTS, 1.0, motion=carried, squeeze=0.01, inward=-STARTS, squeeze_ramp=0.0, turns=turns)
    first = hand.target(0.0)[0]
    apart = np.linalg.norm(first[:, None] - first, axis=2)
    for t in np.linspace(0.0, 1.5, 31).tolist():
        r = hand.target(t)[0]
        assert np.abs(np.linalg.norm(r[:, None] - r, axis=2) - apart).max() < 1e-15


def test_nothing_jumps_where_the_parts_of_a_handling_join():
    # Position, velocity and acceleration, from second-order one-sided differences of the velocity on both sides: they
    # differ by 2/3 h^2 of the velocity's third derivative, below 2e4 m/s^4, and by rounding, 1e-16 / h.
    hand, h = handling(), 1e-5
    for t in JOINS[1:-1]:
        (r, v), (before, _), (after, _) = hand.target(t), hand.target(t - 1e-12), hand.target(t + 1e-12)
        assert np.abs(after - before).max() < 1e-11
        sides = []
        for step in (-h, h):
            near, far = (hand.target(t + k * step)[1] for k in (1, 2))
            sides.append((4 * near - far - 3 * v) / (2 * step))
            assert np.abs(near - v).max() < 20.0 * h
        assert np.abs(sides[0] - sides[1]).max() < 2e4 * h**2 + 1e-9
        assert np.isfinite(r).all()


def follow(steps, end=1.2):
    """Where three unequal points are after `end` behind `handling`, in equal samples."""
    devices = [connect(mass=m, damping=b, dimensions=3) for m, b in ((0.1, 0.3), (0.2, 0.0), (0.15, 0.5))]
    plant, hand = PointDevice.plant(devices), handling()
    plant.place(STARTS)
    for _ in range(steps):
        plant.advance(np.zeros((3, 3)), hand, end / steps)
    return plant.position.copy()


def test_a_plant_follows_a_turning_hand_as_an_integrator_of_order_eight_does():
    # At 0.5 ms within 1e-10 m; with the joins on the samples the error falls as the cubic's, T^4.
    hand, m, b = handling(), np.array([[0.1], [0.2], [0.15]]), np.array([[0.3], [0.0], [0.5]])

    def rate(t, z):
        x, v = z.reshape(2, 3, 3)
        r, dr = hand.target(t)
        f = np.einsum("aij,ja->ia", hand.stiffness, r - x) + np.einsum("aij,ja->ia", hand.damping, dr - v)
        return np.concatenate([v.ravel(), ((f - b * v) / m).ravel()])

    z = np.concatenate([STARTS.ravel(), np.zeros(9)])
    for begin, end in pairwise(JOINS):
        z = solve_ivp(rate, (begin, end), z, "DOP853", rtol=1e-12, atol=1e-14).y[:, -1]
    expected = z[:9].reshape(3, 3)
    assert np.abs(follow(2400) - expected).max() < 1e-10
    steps = np.array([24, 48, 96, 192])
    errors = [np.abs(follow(n) - expected).max() for n in steps]
    assert -np.polyfit(np.log(steps), np.log(errors), 1)[0] > 3.8


def test_gains_as_matrices_and_their_arrays_are_read_only():
    K = np.array([[[3.0, -1.0], [-1.0, 3.0]]])
    hand = Hand([[0.0], [1.0]], K)
    np.testing.assert_array_equal(hand.stiffness, K)
    assert hand.stiffness is hand.stiffness
    for array in (hand.stiffness, hand.damping, hand.target(9.0)[0]):
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 0.0


def test_joined_hands_are_block_diagonal_and_in_order():
    first = Hand.arm_and_grip(REST, arm=(10.0, 1.0), grip=(20.0, 2.0))
    second = Hand([[1.0, 2.0]], 5.0, 0.1, Reach([0.1, 0.0]))
    hand = join([first, second])
    assert hand.stiffness.shape == hand.damping.shape == (2, 4, 4)
    np.testing.assert_array_equal(hand.stiffness[:, :3, :3], first.stiffness)
    np.testing.assert_array_equal(hand.damping[:, 3:, 3:], second.damping)
    assert not hand.stiffness[:, :3, 3:].any()
    assert not hand.damping[:, 3:, :3].any()
    r, v = hand.target(0.5)
    np.testing.assert_array_equal(r, np.vstack([first.target(0.5)[0], second.target(0.5)[0]]))
    np.testing.assert_array_equal(v, np.vstack([first.target(0.5)[1], second.target(0.5)[1]]))
    assert join([first]) is first


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: Hand([0.0, 1.0], 1.0), "rest"),
        (lambda: Hand([[0.0], [1.0, 2.0]], 1.0), "rest"),
        (lambda: Hand([[0.0]], "stiff"), "stiffness"),
        (lambda: Hand(np.zeros((1, 4)), 1.0), "rest"),
        (lambda: Hand([[np.nan]], 1.0), "rest"),
        (lambda: Hand([[0.0]], -1.0), "stiffness"),
        (lambda: Hand([[0.0]], np.inf), "stiffness"),
        (lambda: Hand(REST, [1.0, 2.0, 3.0]), "stiffness.*d = 2"),
        (lambda: Hand(REST, 1.0, np.zeros((2, 2, 2))), r"damping.*\(2, 3, 3\)"),
        (lambda: Hand([[0.0], [0.0]], [[[1.0, 2.0], [0.0, 1.0]]]), "stiffness.*symmetric"),
        (lambda: Hand([[0.0], [0.0]], [[[1.0, 2.0], [2.0, 1.0]]]), "stiffness.*eigenvalue is -1"),
        (lambda: Hand(REST, 1.0, motion=Reach([0.1])), "motion.*2 dimensions"),
        (lambda: Hand(REST, 1.0, squeeze=0.01), "inward"),
        (lambda: Hand(REST, 1.0, squeeze=0.01, inward=[[1.0, 0.0]]), "inward"),
        (lambda: Hand(REST, 1.0, squeeze=Levels([[0.01, 0.0, 1.0]])), "inward"),
        (lambda: Hand(REST, 1.0, squeeze=Reach([0.1, 0.2]), inward=REST), "squeeze.*one-dimensional"),
        (lambda: Hand(REST, 1.0, squeeze=0.1, inward=REST, share=[1.0, 2.0]), r"share.*\(3,\)"),
        (lambda: Hand(REST, 1.0, turns=[Turn(Reach([1.0]), [0.0, 0.0, 0.0], 2)]), "turns.*2 dimensions"),
        (lambda: Hand(REST, 1.0, squeeze=np.nan), "squeeze"),
        (lambda: Hand(REST, 1.0, squeeze_ramp=-1.0), "squeeze_ramp"),
        (lambda: Hand.arm_and_grip(REST, arm=(-1.0, 0.0), grip=(1.0, 0.0)), "arm stiffness"),
        (lambda: Hand.arm_and_grip(REST, arm=(1.0, 0.0), grip=(1.0, [0.0])), "grip damping"),
        (lambda: join([]), "hands"),
        (lambda: join([Hand([[0.0]], 1.0), Hand([[0.0, 0.0]], 1.0)]), "hands.*dimensions"),
    ],
)
def test_what_is_no_hand(make, said):
    with pytest.raises(InputError, match=said):
        make()
