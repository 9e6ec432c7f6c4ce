"""The smoother against dense equations in fifty digits and against LAPACK's banded solver."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest
from scipy.linalg import solveh_banded

from graspfx.recording.vibration import fast_size
from graspfx.recording.vibration import roughness as smooth_rest


def roughness(x, q):
    return smooth_rest(x.T, q).T


def penalty(period):
    return (2.0 * np.sin(np.pi * 5.0 * period)) ** -8


def exactly(x, q):
    with mpmath.workdps(50):
        N = len(x)
        D = mpmath.matrix(np.diff(np.eye(N), 4, axis=0).tolist())
        left = mpmath.mpf(q) * D.T * D + mpmath.eye(N)
        x = mpmath.matrix(x.tolist())
        return np.array((x - mpmath.lu_solve(left, x)).tolist(), dtype=float)[:, 0]


def by_lapack(x, q):
    banded = np.repeat(q * np.array([70.0, -56.0, 28.0, -8.0, 1.0])[:, None], len(x) - 4, axis=1)
    banded[0] += 1.0
    z = solveh_banded(banded, np.diff(x, 4, axis=0), lower=True)
    return q * np.diff(np.pad(z, ((4, 4), (0, 0))), 4, axis=0)


@pytest.mark.parametrize("N", [*range(5, 23), 36, 40])
def test_any_number_of_rows_is_right(N):
    """Few rows are solved directly."""
    x = np.random.default_rng(N).normal(size=N)
    expected = exactly(x, 7.0)
    assert np.abs(roughness(x[:, None], 7.0)[:, 0] - expected).max() < 1e-14 * np.abs(x).max()


@pytest.mark.parametrize("N", [67, 68, 69, 76, 77, 92])
def test_any_number_of_rows_is_transformed(N):
    """Numbers of equations about the least that the Fourier transform takes, 64, and transforms that are full or not.

    Rounding is that of the equations' condition, 256 q, as for the transform of a long signal.
    """
    x = np.random.default_rng(N).normal(size=N)
    expected = exactly(x, 7.0)
    assert np.abs(roughness(x[:, None], 7.0)[:, 0] - expected).max() < 1e-16 * 256 * 7.0 * np.abs(x).max()


def test_sizes_of_transforms_are_fast_and_close():
    """Each is 2^a times 1, 3, 5, 9 or 15, and at most a fourth larger than required."""
    for least in range(9, 3000):
        size = fast_size(least)
        assert least <= size <= 1.25 * least
        assert size // (size & -size) in (1, 3, 5, 9, 15)


@pytest.mark.parametrize(("period", "tolerance"), [(0.02, 1e-12), (0.005, 1e-8), (0.002, 1e-5)])
def test_a_long_signal_is_as_lapack_has_it(period, tolerance):
    """Both err by the rounding times the equations' condition, 256 q: 5e5, 7e8 and 1e12."""
    x = np.random.default_rng(5).normal(size=(3001, 3)).cumsum(axis=0)
    expected = by_lapack(x, penalty(period))
    assert np.abs(roughness(x, penalty(period)) - expected).max() < tolerance * np.abs(expected).max()


def test_the_condition_costs_no_more_digits_than_it_has_to():
    """The error at 5 ms, against fifty digits, is 1e-16 times 256 q = 7e8."""
    x = np.random.default_rng(6).normal(size=40).cumsum()
    expected = exactly(x, penalty(0.005))
    assert np.abs(roughness(x[:, None], penalty(0.005))[:, 0] - expected).max() < 7e-8 * np.abs(expected).max()


def test_signals_do_not_mix():
    """Products of matrices round as the number of signals has it: by 1e-16 times the equations' condition, 256 q."""
    x = np.random.default_rng(8).normal(size=(100, 2))
    both = roughness(x, 50.0)
    for k in range(2):
        assert both[:, k] == pytest.approx(roughness(x[:, k : k + 1], 50.0)[:, 0], abs=1e-16 * 256 * 50.0)
