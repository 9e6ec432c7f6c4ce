"""Velocity by first-order adaptive windowing: against its definition, its error bound and the plain difference."""

from __future__ import annotations

import numpy as np
import pytest

from graspfx.compile.machine import compiled
from graspfx.errors import InputError
from graspfx.loop.velocity import SLACK, WINDOW, VelocityEstimate, VelocityEstimator, estimate, estimate_size

T = 0.001


def by_definition(x, k, h, window):
    """The longest n such that all lines x_k to x_(k-j), j <= n, pass within h of the positions between."""
    used = min(k, 1)
    for n in range(2, min(window, k) + 1):
        slope = (x[k] - x[k - n]) / n
        if any(abs(x[k] - i * slope - x[k - i]) > h * (1.0 + SLACK) for i in range(1, n)):
            break
        used = n
    return used, (x[k] - x[k - used]) / (used * T) if used else 0.0


def followed(estimator, x):
    v, n = [], []
    for position in x:
        v.append(estimator.update(position).copy())
        n.append(estimator.window.copy())
    return np.array(v), np.array(n)


@pytest.mark.parametrize("noise", [5e-6, 2e-5, 1e-3])
def test_estimate_is_its_definition(noise):
    rng = np.random.default_rng(1)
    x = np.cumsum(np.cumsum(rng.normal(0.0, 2e-6, (300, 2, 2)), axis=0), axis=0)
    x = np.rint(x / (2.0 * noise)) * 2.0 * noise
    v, n = followed(VelocityEstimator(T, (2, 2), noise, 12), x)
    for k in range(len(x)):
        for j in np.ndindex(2, 2):
            window, expected = by_definition(x[(slice(None), *j)], k, noise, 12)
            assert n[(k, *j)] == window
            assert v[(k, *j)] == pytest.approx(expected, rel=1e-12, abs=1e-15)
    assert set(np.unique(n)) >= {1, 2, 3, 12}  # the case is not an easy one


def test_no_noise_is_the_backward_difference_to_the_bit():
    x = np.random.default_rng(2).normal(size=(50, 3, 2))
    v, n = followed(VelocityEstimator(T, (3, 2)), x)
    assert not v[0].any()
    assert not n[0].any()
    np.testing.assert_array_equal(v[1:], (x[1:] - x[:-1]) / T)
    assert (n[1:] == 1).all()


@pytest.mark.parametrize("resolution", [1e-5, 1e-4])
def test_error_on_a_quantised_sine_is_within_the_bound(resolution):
    # 10 mm, 1 Hz at 1 kHz: A = a w^2 = 0.395 m/s^2. The plain difference has a quantisation error of up to r/T.
    a, w = 0.01, 2.0 * np.pi
    t = T * np.arange(3000)
    x = np.rint(a * np.sin(w * t) / resolution) * resolution
    v, n = followed(VelocityEstimator(T, (1,), 0.5 * resolution, WINDOW), x[:, None])
    true = a * w * np.cos(w * t)
    error, n = np.abs(v[1:, 0] - true[1:]), n[1:, 0]
    bound = resolution / (n * T) + a * w**2 * n * T / 2.0
    assert (error <= bound).all()
    plain = np.diff(x) / T - true[1:]
    assert np.sqrt(np.mean(plain**2)) > 2.0 * np.sqrt(np.mean(error**2))


def test_steady_motion_is_exact_and_gets_the_longest_window():
    # 0.25 m/s in whole multiples of the resolution: each line is exact, 0.25 at every sample.
    x = 0.25 * T * np.arange(40)
    v, n = followed(VelocityEstimator(T, (1,), 1e-6, 10), x[:, None])
    np.testing.assert_allclose(v[1:, 0], 0.25, rtol=1e-12)
    np.testing.assert_array_equal(n[:, 0], np.minimum(np.arange(40), 10))


def test_a_single_count_after_rest_counts_over_two_samples():
    # Line over two samples: half a count at the middle, off by exactly the bound r/2; over three: by 2/3 r, too far.
    r = 1e-5
    x = np.array([7.0] * 20 + [8.0]) * r
    v, n = followed(VelocityEstimator(T, (1,), 0.5 * r, 16), x[:, None])
    assert n[-1, 0] == 2
    assert v[-1, 0] == pytest.approx(r / (2.0 * T), rel=1e-9)
    assert not v[:-1].any()


def test_a_turn_shortens_the_window():
    x = np.concatenate([np.arange(20), 19 - np.arange(1, 6)]) * 1e-3
    v, n = followed(VelocityEstimator(T, (1,), 1e-6, 16), x[:, None])
    assert n[19, 0] == 16
    np.testing.assert_allclose(v[20:, 0], -1.0, rtol=1e-9)
    np.testing.assert_array_equal(n[20:, 0], [1, 2, 3, 4, 5])


def test_reset_forgets():
    estimator = VelocityEstimator(T, (2,), 1e-6)
    followed(estimator, np.arange(10.0)[:, None] * [1.0, -1.0])
    estimator.reset()
    assert not estimator.update([5.0, 5.0]).any()
    estimator.reset([1.0, 2.0])
    np.testing.assert_allclose(estimator.update([1.0 + 3.0 * T, 2.0]), [3.0, 0.0], rtol=1e-12)


def test_velocity_is_one_array_of_the_estimators_own():
    estimator = VelocityEstimator(T, (1, 2))
    x = np.zeros((1, 2))
    first = estimator.update(x)
    assert estimator.update(x) is first
    assert not np.shares_memory(first, x)


def test_a_position_that_is_not_finite_shows_and_passes():
    x = np.arange(12.0) * 0.1 * T
    x[5] = np.nan
    v, _ = followed(VelocityEstimator(T, (1,), 1e-6), x[:, None])
    np.testing.assert_array_equal(np.isfinite(v[:, 0]), [k not in (5, 6) for k in range(12)])
    np.testing.assert_allclose(v[7:, 0], 0.1, rtol=1e-9)


def test_kernel_runs_compiled_with_the_same_result():
    machine_code = compiled(estimate)
    rng = np.random.default_rng(3)
    states = np.zeros((2, estimate_size(8)))
    states[:, :3] = T, 5e-6, 8
    for x in np.rint(np.cumsum(rng.normal(0.0, 1.0, 200))) * 1e-5:
        assert machine_code(states[0], 0, x) == estimate(VelocityEstimate(states[1].data), x)
    np.testing.assert_array_equal(*states)


@pytest.mark.parametrize(
    ("arguments", "name"),
    [
        ({"period": 0.0}, "period"),
        ({"period": np.nan}, "period"),
        ({"noise": -1e-6}, "noise"),
        ({"noise": np.inf}, "noise"),
        ({"window": 0}, "window"),
        ({"window": 2.5}, "window"),
    ],
)
def test_what_cannot_be_estimated(arguments, name):
    with pytest.raises(InputError, match=name):
        VelocityEstimator(**{"period": T, "shape": (1,), "noise": 1e-6, "window": 4, **arguments})


def test_times_of_samples_are_the_true_intervals():
    """Samples that come when they will, on a motion of 0.1 m/s: the bound of two sensor errors over the interval holds.

    By counts of samples the error is that of the intervals, here five times as large.
    """
    times = np.cumsum(np.random.default_rng(5).uniform(0.5, 1.5, 400)) * T
    v, by_count = VelocityEstimator(T, (1,), 5e-6, 12), VelocityEstimator(T, (1,), 5e-6, 12)
    errors = []
    for k, time in enumerate(times):
        x = round(0.1 * time / 1e-5) * 1e-5
        velocity = v.update([x], time)
        assert k == 0 or abs(velocity[0] - 0.1) <= 1e-5 / (times[k] - times[k - v.window[0]]) + 1e-12
        errors.append([abs(velocity[0] - 0.1), abs(by_count.update([x])[0] - 0.1)])
    timed, counted = np.mean(errors[1:], axis=0)
    assert timed < 0.2 * counted


def test_regular_times_are_no_times():
    x = np.cumsum(np.cumsum(np.random.default_rng(6).normal(0.0, 2e-6, (300, 2)), axis=0), axis=0)
    x = np.rint(x / 1e-5) * 1e-5
    by_count, by_time = VelocityEstimator(T, (2,), 5e-6, 8), VelocityEstimator(T, (2,), 5e-6, 8)
    for k, position in enumerate(x):
        expected = by_count.update(position)
        np.testing.assert_allclose(by_time.update(position, k * T), expected, rtol=1e-9, atol=1e-12)
        assert np.array_equal(by_count.window, by_time.window)


@pytest.mark.parametrize("window", [1, 12])
def test_a_sample_that_is_held_leaves_the_velocity(window):
    v = VelocityEstimator(T, (1,), 5e-6, window)
    v.update([0.0], 0.0)
    assert v.update([1e-4], 0.001).tolist() == pytest.approx([0.1])
    assert v.update([5.0], 0.001).tolist() == pytest.approx([0.1])
    assert v.update([3e-4], 0.003).tolist() == pytest.approx([0.1])
    v.reset([0.0])
    assert v.update([0.0], 0.0).tolist() == [0.0]


@pytest.mark.parametrize("time", [-1.0, np.nan, np.inf])
def test_times_go_forward(time):
    v = VelocityEstimator(T, (1,), 5e-6, 4)
    v.update([0.0], 0.0)
    with pytest.raises(InputError, match="time: given"):
        v.update([0.0], time)
