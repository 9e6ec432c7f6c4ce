"""Intended motions: closed forms, velocities that are their derivatives, and what the recorded path promises."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest
from numpy.polynomial import Polynomial
from scipy.interpolate import PchipInterpolator

from graspfx.errors import InputError
from graspfx.loop.motion.motion import Levels, Path, Reach, Rest, Sine, Sum, direction
from graspfx.loop.motion.targets import minimum_jerk

TIMES = np.array([0.0, 0.4, 1.0, 1.5, 2.5])
POINTS = np.array([[0.0, 0.0], [0.01, -0.02], [0.03, -0.02], [0.02, 0.01], [0.05, 0.02]])

MOTIONS = {
    "sine": Sine(0.05, 0.5, [1.0, 0.0], 0.2),
    "sine with ramp": Sine(0.05, 0.5, [3.0, 4.0], 0.2, 1.0),
    "reach": Reach([0.1, -0.2, 0.05], 0.3, 1.2),
    "path": Path(TIMES, POINTS),
    "levels": Levels([[0.01, 0.3, 0.9], [-0.02, 1.2, 0.3], [0.0, 1.5, 1.0]]),
    "sum": Sum([Reach([0.0, 0.1], 0.3, 1.2), Rest(), Sine(0.05, 0.5, [1.0, 1.0], 0.2, 0.8), Path(TIMES, POINTS)]),
}


def sampled(motion, times):
    pairs = [motion.at(float(t)) for t in times]
    return np.array([x for x, _ in pairs]), np.array([v for _, v in pairs])


@pytest.mark.parametrize("name", MOTIONS)
def test_velocity_is_the_derivative(name):
    # Central differences, h = 1e-5 s: truncation h^2/6 x''' below 1e-9, rounding eps |x| / h below 1e-11.
    h, motion = 1e-5, MOTIONS[name]
    t = np.random.default_rng(4).uniform(0.0, 3.0, 400)
    corners = np.concatenate([TIMES, [0.2, 0.3, 1.2, 1.5]])
    t = t[np.abs(t[:, None] - corners).min(axis=1) > 2.0 * h]
    _, v = sampled(motion, t)
    difference = (sampled(motion, t + h)[0] - sampled(motion, t - h)[0]) / (2.0 * h)
    np.testing.assert_allclose(v, difference, atol=2e-8)


def test_minimum_jerk_step():
    # s(1/2) = 1/2, s'(1/2) = 15/8; s', s'' vanish at both ends.
    s = Polynomial([0.0, 0.0, 0.0, 10.0, -15.0, 6.0])
    for t in np.linspace(0.0, 1.0, 21):
        np.testing.assert_allclose(minimum_jerk(float(t)), (s(t), s.deriv()(t)), atol=1e-14)
    assert minimum_jerk(0.5) == pytest.approx((0.5, 1.875), rel=1e-15)
    assert minimum_jerk(-3.0) == (0.0, 0.0)
    assert minimum_jerk(1.0) == minimum_jerk(7.0) == (1.0, 0.0)
    assert s.deriv(2)(0.0) == s.deriv(2)(1.0) == 0.0


STEPS = [(0.01, 0.3, 0.9), (-0.02, 1.2, 0.3), (0.005, 2.0, 1.0)]  # the second begins as the first ends


def exact_levels(t):
    """The levels of STEPS at 40 digits."""
    x = mpmath.mpf(0)
    for to, begin, duration in STEPS:
        s = (t - mpmath.mpf(begin)) / mpmath.mpf(duration)
        if s > 0:
            s = min(s, mpmath.mpf(1))
            x += (mpmath.mpf(to) - x) * (10 * s**3 - 15 * s**4 + 6 * s**5)
    return x


def test_levels_and_their_rate_at_forty_digits():
    # The polynomial's terms add up to 10 + 15 + 6: half an ulp of each is 31 eps/2 of a step of 30 mm, 1e-16 m; the
    # rate is at most 15/8 of 30 mm in 0.3 s, 0.19 m/s: some rounding errors of that.
    motion = Levels(STEPS)
    with mpmath.workdps(40):
        for t in np.random.default_rng(14).uniform(0.0, 3.5, 60).tolist():
            x, v = motion.at(t)
            assert abs(x[0] - float(exact_levels(mpmath.mpf(t)))) < 1e-16
            assert abs(v[0] - float(mpmath.diff(exact_levels, mpmath.mpf(t)))) < 2e-15


def test_levels_hold_exactly_and_join_without_a_jump_of_acceleration():
    # At a join the one-sided second difference of O(h^2) is 11/12 h^2 of the fourth derivative, at most
    # 360 |dx|/duration^4 = 1333 m/s^4: 1.2e-5 m/s^2 at h = 0.1 ms, and rounding 1e-9. A parabola has |dx|/duration^2.
    motion, h = Levels(STEPS), 1e-4
    held = [float(motion.at(t)[0][0]) for t in (-1.0, 0.3, 1.2, 1.5, 1.9, 3.0, 99.0)]
    assert held == [0.0, 0.0, 0.01, -0.02, -0.02, 0.005, 0.005]
    for _, begin, duration in STEPS:
        for join in (begin, begin + duration):
            for side in (-h, h):
                x, v = sampled(motion, [join + k * side for k in range(4)])
                assert abs(v[0, 0]) < 1e-14
                assert abs(2 * x[0] - 5 * x[1] + 4 * x[2] - x[3])[0] / h**2 < 2e-5
    assert (motion.end, motion.last) == (3.0, 0.005)


def test_a_level_may_jump():
    motion = Levels([[0.01, 0.5, 0.0], [0.02, 0.5, 1.0]])
    np.testing.assert_array_equal(motion.at(0.4999), [[0.0], [0.0]])
    np.testing.assert_array_equal(motion.at(0.5), [[0.01], [0.0]])
    np.testing.assert_allclose(motion.at(1.0), [[0.015], [0.01 * 1.875]], rtol=1e-14)


def test_a_sum_of_reaches_goes_there_and_back():
    motion = Sum([Reach([0.0, 0.2], 0.0, 1.0), Reach([0.1, 0.0], 0.5, 1.0), Reach([-0.1, -0.2], 3.0, 1.0)])
    assert motion.dimensions == 2
    np.testing.assert_allclose(motion.at(2.0), [[0.1, 0.2], [0.0, 0.0]], atol=1e-17)
    np.testing.assert_allclose(motion.at(4.0), np.zeros((2, 2)), atol=1e-17)
    assert Sum([Rest()]).dimensions is None


def test_rest():
    x, v = Rest().at(3.0)
    assert not x.any()
    assert not v.any()
    assert Rest().dimensions is None


def test_sine_is_the_papers_waving():
    # 50 mm, 0.5 Hz: the first peak 0.5 s after it begins, the fastest 50 mm pi = 0.157 m/s.
    motion = Sine(0.05, 0.5, 0, 1.0, dimensions=2)
    for t, x, v in [(0.99, 0.0, 0.0), (1.0, 0.0, 0.05 * np.pi), (1.5, 0.05, 0.0), (2.0, 0.0, -0.05 * np.pi)]:
        at, rate = motion.at(t)
        np.testing.assert_allclose(at, [x, 0.0], atol=1e-16)
        np.testing.assert_allclose(rate, [v, 0.0], atol=1e-16)


def test_sine_ramp_lets_no_velocity_jump_and_ends_in_the_sine():
    motion, plain = Sine(0.05, 2.0, [0.0, 1.0], 0.5, 1.0), Sine(0.05, 2.0, [0.0, 1.0], 0.5)
    t = np.arange(0.4, 2.0, 1e-4)
    _, v = sampled(motion, t)
    # |x''| <= a (w^2 + 2 w 15/8 + 5.78): 11.0 m/s^2; a jump of velocity would be a w = 0.63 m/s.
    assert np.abs(np.diff(v, axis=0)).max() < 11.0 * 1e-4
    for time in (1.5, 1.77, 30.0):
        np.testing.assert_array_equal(motion.at(time), plain.at(time))
    np.testing.assert_array_equal(motion.at(0.5), np.zeros((2, 2)))


def test_reach_rests_at_both_ends_and_is_fastest_halfway():
    # 15/8 of the mean velocity at the middle: 1.875 * 0.2 / 0.5 = 0.75 m/s.
    motion = Reach([0.2], 1.0, 0.5)
    np.testing.assert_allclose(motion.at(1.25), [[0.1], [0.75]], rtol=1e-14)
    np.testing.assert_array_equal(motion.at(0.5), [[0.0], [0.0]])
    np.testing.assert_array_equal(motion.at(9.0), [[0.2], [0.0]])


def test_path_goes_through_its_points_and_equals_the_reference():
    motion = MOTIONS["path"]
    x, _ = sampled(motion, TIMES)
    np.testing.assert_allclose(x, POINTS, atol=1e-17)
    t = np.linspace(0.0, 2.5, 301)[1:-1]
    reference = PchipInterpolator(TIMES, POINTS)
    x, v = sampled(motion, t)
    np.testing.assert_allclose(x, reference(t), atol=1e-16)
    np.testing.assert_allclose(v, reference.derivative()(t), atol=1e-15)


def test_path_has_a_continuous_velocity_no_overshoot_and_holds_its_ends():
    motion = MOTIONS["path"]
    for t in TIMES[1:-1]:
        np.testing.assert_allclose(motion.at(t - 1e-9)[1], motion.at(t + 1e-9)[1], atol=1e-8)
    x, _ = sampled(motion, np.linspace(-1.0, 4.0, 2001))
    assert (x.min(axis=0) >= POINTS.min(axis=0) - 1e-17).all()
    assert (x.max(axis=0) <= POINTS.max(axis=0) + 1e-17).all()
    for time, end in ((-1.0, POINTS[0]), (0.0, POINTS[0]), (2.5, POINTS[-1]), (99.0, POINTS[-1])):
        np.testing.assert_array_equal(motion.at(time), [end, [0.0, 0.0]])


def test_path_gives_arrays_that_may_be_written_to():
    motion = Path([0.0, 1.0], [1.0, 2.0])
    for time in (-1.0, 0.5, 3.0):
        motion.at(time)[0][...] = 7.0
    np.testing.assert_array_equal(motion.at(-1.0)[0], [1.0])
    np.testing.assert_array_equal(motion.at(3.0)[0], [2.0])


def test_path_from_a_file(tmp_path):
    file = tmp_path / "path.csv"
    file.write_text("t, x, y\n0, 0.0, 0.1\n0.5, 0.02, 0.1\n\n1, 0.01, 0.3\n")
    motion, same = Path.read(file), Path([0.0, 0.5, 1.0], [[0.0, 0.1], [0.02, 0.1], [0.01, 0.3]])
    assert motion.dimensions == 2
    for t in (0.0, 0.3, 0.8, 1.0):
        np.testing.assert_array_equal(motion.at(t), same.at(t))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("time,x\n0,0\n1,1\n", r"path.csv:1: .*'time,x'.*t,x or t,x,y"),
        ("", r"path.csv:1"),
        ("t,x\n0,0\n1,one\n", r"path.csv:3: given '1,one', expected 2 finite numbers"),
        ("t,x\n0,0\n1,1,1\n", r"path.csv:3"),
        ("t,x\n0,0\n1,nan\n", r"path.csv:3"),
        ("t,x\n0,0\n", r"path.csv: times: .*two or more"),
        ("t,x\n0,0\n1,1\n1,2\n", r"path.csv: times: .*strictly increasing"),
    ],
)
def test_faults_of_a_file_name_their_line(tmp_path, text, said):
    file = tmp_path / "path.csv"
    file.write_text(text)
    with pytest.raises(InputError, match=said):
        Path.read(file)


def test_a_file_that_is_not_there(tmp_path):
    with pytest.raises(InputError, match="there is no file"):
        Path.read(tmp_path / "no.csv")


def test_direction():
    np.testing.assert_array_equal(direction(1, 3), [0.0, 1.0, 0.0])
    np.testing.assert_allclose(direction([3.0, 4.0]), [0.6, 0.8], rtol=1e-15)
    np.testing.assert_allclose(direction([3e200, -4e200]), [0.6, -0.8], rtol=1e-15)
    np.testing.assert_allclose(direction([0.0, 1e-300]), [0.0, 1.0], rtol=1e-15)


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: Sine(np.nan, 1.0, [1.0]), "amplitude"),
        (lambda: Sine(0.1, 0.0, [1.0]), "frequency"),
        (lambda: Sine(0.1, True, [1.0]), "frequency"),
        (lambda: Sine(0.1, 1.0, [0.0, 0.0]), "axis.*other than zero"),
        (lambda: Sine(0.1, 1.0, 0), "axis.*dimensions"),
        (lambda: Sine(0.1, 1.0, 2, dimensions=2), "axis.*from 0 to 1"),
        (lambda: Sine(0.1, 1.0, [1.0, 0.0], dimensions=3), "axis.*3 components"),
        (lambda: Sine(0.1, 1.0, "up"), "axis"),
        (lambda: Sine(0.1, 1.0, [1.0], np.inf), "begin"),
        (lambda: Sine(0.1, 1.0, [1.0], 0.0, -1.0), "ramp"),
        (lambda: Reach([[1.0]]), "displacement"),
        (lambda: Reach([np.nan]), "displacement"),
        (lambda: Reach([1.0], 0.0, 0.0), "duration"),
        (lambda: Levels([]), "steps"),
        (lambda: Levels([[1.0, 0.0]]), "steps"),
        (lambda: Levels([[1.0, 0.0, np.nan]]), "steps"),
        (lambda: Levels([[1.0, 0.0, -0.1]]), "steps.*zero or more"),
        (lambda: Levels([[1.0, 0.0, 1.0], [2.0, 0.9, 1.0]]), "steps.*after the end of the previous step"),
        (lambda: Sum([]), "motions.*one or more motions"),
        (lambda: Sum([Reach([1.0]), Reach([1.0, 2.0])]), "motions.*same number"),
        (lambda: Path([0.0], [[1.0]]), "times"),
        (lambda: Path([0.0, np.nan], [1.0, 2.0]), "times"),
        (lambda: Path([0.0, 0.0], [1.0, 2.0]), "times"),
        (lambda: Path([0.0, 1.0], [1.0, 2.0, 3.0]), "positions"),
        (lambda: Path([0.0, 1.0], [1.0, np.inf]), "positions"),
    ],
)
def test_what_is_no_motion(make, said):
    with pytest.raises(InputError, match=said):
        make()
