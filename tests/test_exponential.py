"""e^A - I of small matrices against sixty digits, and what is no matrix."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest
from scipy.linalg import expm

from graspfx.errors import InputError
from graspfx.exponential import expm1

EPS = 2.0**-52


def exact(A):
    with mpmath.workdps(60):
        E = mpmath.expm(mpmath.matrix(A.tolist()), method="taylor") - mpmath.eye(len(A))
        return np.array(E.tolist(), dtype=float)


def norm(A):
    return np.linalg.norm(A, 1)


def error(found, A):
    return norm(found - exact(A)) / norm(exact(A))


def held(mass, friction, stiffness, T):
    """A point that a spring holds to a target that moves along a cubic, under an effort that is held: seven states."""
    A = np.zeros((7, 7))
    A[0, 1] = A[2, 3] = A[3, 4] = A[4, 5] = 1.0
    A[1, 0], A[1, 1], A[1, 2], A[1, 6] = np.array([-T * stiffness, -friction, T * stiffness, T]) * T / mass
    return A


@pytest.mark.parametrize("mass", [1e-6, 1e-3, 0.15, 1e3])
@pytest.mark.parametrize("friction", [0.0, 0.2, 15.0])
@pytest.mark.parametrize("T", [5e-5, 5e-3, 2e-2])
def test_a_held_point_is_right_to_rounding(mass, friction, T):
    """From b T/m = 0 to 3e5: with the identity left out, and powers' norms, no digit is lost to the squarings."""
    A = held(mass, friction, min(33.0, 100.0 * mass / T**2), T)
    assert error(expm1(A), A) < 20 * EPS


@pytest.mark.parametrize("seed", range(20))
def test_random_matrices_are_as_exact_as_scipys(seed):
    rng = np.random.default_rng(seed)
    k = int(rng.integers(2, 8))
    A = rng.normal(size=(k, k)) * 10.0 ** rng.uniform(-3.0, 1.5)
    scipys = norm(expm(A) - np.eye(k) - exact(A)) / norm(exact(A))
    assert error(expm1(A), A) < max(3 * scipys, 20 * EPS)


@pytest.mark.parametrize("scale", [1e-12, 1e-6, 1e-3])
def test_a_small_change_is_known_to_its_own_digits(scale):
    A = scale * np.random.default_rng(1).normal(size=(4, 4))
    assert error(expm1(A), A) < 8 * EPS


@pytest.mark.parametrize("size", [1.0, 1e6, 1e12, 1e80])
def test_a_nilpotent_matrix_needs_no_squaring(size):
    A = np.array([[0.0, size, 1.0], [0.0, 0.0, size], [0.0, 0.0, 0.0]])
    expected = np.array([[0.0, size, 1.0 + 0.5 * size * size], [0.0, 0.0, size], [0.0, 0.0, 0.0]])
    np.testing.assert_allclose(expm1(A), expected, rtol=4 * EPS)


def test_zero_and_nothing():
    assert not expm1(np.zeros((3, 3))).any()
    assert expm1(np.zeros((0, 0))).shape == (0, 0)


@pytest.mark.parametrize("A", [np.zeros(3), np.zeros((2, 3)), np.array([[np.nan]]), np.array([[1.0, np.inf], [0, 0]])])
def test_what_has_no_exponential(A):
    with pytest.raises(InputError, match=r"^A: "):
        expm1(A)
