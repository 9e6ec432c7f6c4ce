"""Hands: gains per finger and as arm and grip (Kawai and Yoshikawa, fig. 9), targets, and hands joined."""

from __future__ import annotations

import numpy as np
import pytest

from graspfx.errors import InputError
from graspfx.loop.hand import Hand, join
from graspfx.loop.motion import Reach, Sine

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
        (lambda: Hand([[0.0], [0.0]], [[[1.0, 2.0], [2.0, 1.0]]]), "stiffness.*eigenvalue -1"),
        (lambda: Hand(REST, 1.0, motion=Reach([0.1])), "motion.*2 dimensions"),
        (lambda: Hand(REST, 1.0, squeeze=0.01), "inward"),
        (lambda: Hand(REST, 1.0, squeeze=0.01, inward=[[1.0, 0.0]]), "inward"),
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
