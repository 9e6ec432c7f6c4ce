"""Turns: rigid, at the right rate, one after another, against SciPy's rotations and 40 digits."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from graspfx.errors import InputError
from graspfx.loop.motion.motion import Levels, Reach, Rest, Sine
from graspfx.loop.motion.turn import Turn

POINTS = np.random.default_rng(21).normal(0.0, 0.05, (5, 3))
STILL = np.zeros((5, 3))


def test_in_space_it_is_scipys_rotation_about_the_centre():
    axis, centre = np.array([1.0, -2.0, 3.0]), np.array([0.1, 0.2, -0.1])
    turn = Turn(Sine(2.5, 0.7, [1.0]), centre, axis)
    for t in np.linspace(0.0, 3.0, 31):
        angle = 2.5 * np.sin(2 * np.pi * 0.7 * t)
        R = Rotation.from_rotvec(angle * axis / np.linalg.norm(axis)).as_matrix()
        r, _ = turn.turned(float(t), POINTS, STILL)
        np.testing.assert_allclose(r, centre + (POINTS - centre) @ R.T, atol=1e-15)


def test_in_the_plane_it_is_counterclockwise_about_z():
    # A quarter turn of (1, 0) about (1, 1): (0, -1) from the centre becomes (1, 0).
    turn = Turn(Reach([np.pi / 2], 0.0, 1.0), [1.0, 1.0])
    r, v = turn.turned(1.0, np.array([[1.0, 0.0]]), np.zeros((1, 2)))
    np.testing.assert_allclose(r, [[2.0, 1.0]], atol=1e-15)
    assert not v.any()
    # Halfway the rate is 15/8 pi/2 and the arm (sin 45, -cos 45): velocity = rate (cos 45, sin 45).
    _, v = turn.turned(0.5, np.array([[1.0, 0.0]]), np.zeros((1, 2)))
    np.testing.assert_allclose(v, [[1.875 * np.pi / 2 * np.sqrt(0.5)] * 2], rtol=1e-14)


def test_distances_stay_while_it_turns():
    turns = [Turn(Reach([3.0], 0.0, 2.0), [0.1, 0.0, 0.0], [1.0, 1.0, 1.0]), Turn(Sine(1.0, 1.0, [1.0]), [0.0] * 3, 2)]
    apart = np.linalg.norm(POINTS[:, None] - POINTS, axis=2)
    for t in np.linspace(0.0, 2.5, 40):
        r, v = POINTS, STILL
        for turn in turns:
            r, v = turn.turned(float(t), r, v)
        assert np.abs(np.linalg.norm(r[:, None] - r, axis=2) - apart).max() < 1e-15
        # Rigid in velocity too, (v_i - v_j) . (r_i - r_j) = 0: 6 rad/s at 0.2 m and 0.2 m apart, rounding of that.
        assert np.abs(((v[:, None] - v) * (r[:, None] - r)).sum(axis=2)).max() < 1e-15


def test_the_velocity_is_the_derivative_at_forty_digits():
    """Points that move by themselves too turn twice, about different axes."""
    turns = [
        Turn(Sine(0.8, 0.3, [1.0]), [0.1, 0.0, 0.2], 0),
        Turn(Sine(1.1, 0.9, [1.0]), [0.0, -0.1, 0.0], [0.0, 0.0, 2.0]),
    ]
    mpf, matrix, sin, cos = mpmath.mpf, mpmath.matrix, mpmath.sin, mpmath.cos

    def exact(t):
        p = matrix([mpf(0.05) + mpf(0.01) * t, mpf(0.02) * t**2, mpf(-0.03)])
        a = mpf(0.8) * sin(2 * mpmath.pi * mpf(0.3) * t)
        c = matrix([mpf(0.1), 0, mpf(0.2)])
        p = c + matrix([[1, 0, 0], [0, cos(a), -sin(a)], [0, sin(a), cos(a)]]) * (p - c)
        a = mpf(1.1) * sin(2 * mpmath.pi * mpf(0.9) * t)
        c = matrix([0, mpf(-0.1), 0])
        return c + matrix([[cos(a), -sin(a), 0], [sin(a), cos(a), 0], [0, 0, 1]]) * (p - c)

    with mpmath.workdps(40):
        for t in (0.0, 0.37, 1.0, 2.21):
            r, v = np.array([[0.05 + 0.01 * t, 0.02 * t**2, -0.03]]), np.array([[0.01, 0.04 * t, 0.0]])
            for turn in turns:
                r, v = turn.turned(t, r, v)
            for a in range(3):
                assert abs(r[0, a] - float(exact(mpf(t))[a])) < 1e-15
                assert abs(v[0, a] - float(mpmath.diff(lambda s, a=a: exact(s)[a], mpf(t)))) < 1e-14


def test_before_it_begins_nothing_changes_to_the_bit():
    r, v = Turn(Reach([1.0], 2.0, 1.0), [0.3, 0.2, 0.1], 0).turned(1.9, POINTS, STILL)
    assert r is POINTS
    assert v is STILL
    assert Turn(Rest(), [0.0, 0.0, 0.0], 0).turned(5.0, POINTS, STILL)[0] is POINTS


def test_an_angle_in_levels_goes_there_and_back():
    turn = Turn(Levels([[1.0, 0.0, 1.0], [0.0, 2.0, 1.0]]), [0.0, 0.0])
    r, _ = turn.turned(1.5, np.eye(2), np.zeros((2, 2)))
    np.testing.assert_allclose(r[0], [np.cos(1.0), np.sin(1.0)], atol=1e-16)
    corner = np.eye(2)
    assert turn.turned(3.0, corner, np.zeros((2, 2)))[0] is corner


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: Turn(Reach([1.0]), [0.0]), "centre"),
        (lambda: Turn(Reach([1.0]), [0.0, np.nan]), "centre"),
        (lambda: Turn(Reach([1.0, 2.0]), [0.0, 0.0]), "angle.*one-dimensional"),
        (lambda: Turn(Reach([1.0]), [0.0, 0.0], 2), "axis.*always z"),
        (lambda: Turn(Reach([1.0]), [0.0, 0.0, 0.0]), "axis.*in space"),
        (lambda: Turn(Reach([1.0]), [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]), "axis.*other than zero"),
        (lambda: Turn(Reach([1.0]), [0.0, 0.0, 0.0], [1.0, 0.0]), "axis.*3 components"),
    ],
)
def test_what_is_no_turn(make, said):
    with pytest.raises(InputError, match=said):
        make()
