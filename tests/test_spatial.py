"""Rotations: group laws, agreement of quaternion and matrix, and small angles against 50 digits."""

from __future__ import annotations

import math
from typing import Any

import mpmath
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from graspfx.compile.kernel import kernel, written
from graspfx.compile.records import Table, numbers
from graspfx.spatial import (
    Matrix,
    Vector,
    angle_matrix,
    exponential,
    exponential_numbers,
    normalise,
    normalised,
    orthogonalise,
    product,
    quaternion,
    quaternion_matrix,
    rotate,
    rotate_numbers,
)
from graspfx.spatial import Quaternion as Quaternion4

EPS = np.finfo(float).eps
Quaternion = tuple[float, float, float, float]


def unit(rng: np.random.Generator) -> Quaternion:
    q = rng.normal(size=4)
    x, y, z, w = (q / np.linalg.norm(q)).tolist()
    return x, y, z, w


def matrix(q: Quaternion) -> NDArray[np.float64]:
    return np.array(list(numbers(quaternion_matrix(Quaternion4(*q))))).reshape(3, 3)


@pytest.mark.parametrize("seed", range(20))
def test_group_laws(seed: int) -> None:
    rng = np.random.default_rng(seed)
    a, b, c = unit(rng), unit(rng), unit(rng)
    one = (0.0, 0.0, 0.0, 1.0)
    inverse = (-a[0], -a[1], -a[2], a[3])
    assert product(*a, *one) == a
    assert product(*one, *a) == a
    np.testing.assert_allclose(product(*a, *inverse), one, atol=4 * EPS)
    np.testing.assert_allclose(product(*product(*a, *b), *c), product(*a, *product(*b, *c)), atol=4 * EPS)


@pytest.mark.parametrize("seed", range(20))
def test_quaternion_matrix_and_rotation_are_one_map(seed: int) -> None:
    rng = np.random.default_rng(seed)
    a, b, v = unit(rng), unit(rng), rng.normal(size=3)
    R = matrix(a)
    np.testing.assert_allclose(R, Rotation.from_quat(a).as_matrix(), atol=4 * EPS)
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=8 * EPS)
    np.testing.assert_allclose(rotate_numbers(*a, *v), R @ v, atol=8 * EPS)
    np.testing.assert_allclose(rotate_numbers(-a[0], -a[1], -a[2], a[3], *v), R.T @ v, atol=8 * EPS)
    np.testing.assert_allclose(matrix(product(*a, *b)), R @ matrix(b), atol=8 * EPS)


@pytest.mark.parametrize("angle", [0.0, 1e-300, 1e-160, 1e-12, 1e-6, 9.9e-5, 1.01e-4, 0.01, 1.0, math.pi, 6.0, 40.0])
def test_exponential_is_exact_to_rounding_at_every_angle(angle: float) -> None:
    """Each entry within 4 eps of 50 digits, relative to itself; the scalar part, zero at pi, absolutely."""
    axis = np.array([0.48, -0.6, 0.64])
    x, y, z, w = exponential_numbers(*(angle * axis).tolist())
    with mpmath.workdps(50):
        vector = [mpmath.mpf(float(angle * u)) for u in axis]
        exact = mpmath.sqrt(sum(u * u for u in vector))
        s = mpmath.sin(exact / 2) / exact if angle else mpmath.mpf("0.5")
        for got, u in zip((x, y, z), vector, strict=True):
            assert abs(got - u * s) <= 4 * EPS * max(abs(u * s), EPS * angle) * (1 + angle)
        assert abs(w - mpmath.cos(exact / 2)) <= 4 * EPS * (1 + angle)


def test_turns_about_one_axis_add() -> None:
    """exp(0.3 u) exp(0.4 u) = exp(0.7 u)."""
    u = np.array([2.0, -1.0, 2.0]) / 3.0
    both = product(*exponential_numbers(*(0.3 * u)), *exponential_numbers(*(0.4 * u)))
    np.testing.assert_allclose(both, exponential_numbers(*(0.7 * u)), atol=2 * EPS)


def test_plane_rotation_is_the_one_about_z() -> None:
    for angle in (-7.0, -1e-9, 0.0, 0.3, 100.0):
        R = np.array(list(numbers(angle_matrix(angle)))).reshape(3, 3)
        np.testing.assert_allclose(R, matrix(exponential_numbers(0.0, 0.0, angle)), atol=8 * EPS)


def test_normalised_keeps_the_direction_and_lets_zero_be() -> None:
    q = normalised(1.0, -2.0, 3.0, -4.0)
    np.testing.assert_allclose(np.array(q) * math.sqrt(30.0), [1.0, -2.0, 3.0, -4.0], rtol=4 * EPS)
    assert normalised(0.0, 0.0, 0.0, 0.0) == (0.0, 0.0, 0.0, 0.0)


def test_quaternion_of_a_matrix() -> None:
    """Back from the matrix to 4 eps, half turns about every axis among them, where one component alone is not small."""
    rng = np.random.default_rng(7)
    half_turns = [(1.0, 0.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0), (0.6, 0.0, 0.8, 0.0)]
    for q in [*half_turns, (0.0, 0.0, 0.0, 1.0), *(unit(rng) for _ in range(200))]:
        found = quaternion(matrix(q).ravel().tolist())
        assert found[3] >= 0.0
        assert abs(np.dot(found, q)) == pytest.approx(1.0, abs=4 * EPS)
        np.testing.assert_allclose(matrix(found), matrix(q), atol=8 * EPS)


@kernel
def turned(q: Quaternion4, v: Vector, angle: float) -> tuple[Vector, Matrix, Matrix, Quaternion4, Quaternion4]:
    """Put every value form into one kernel."""
    turn = normalise(q)
    return (
        rotate(turn, v),
        quaternion_matrix(turn),
        angle_matrix(angle),
        exponential(v),
        turn.conjugate @ exponential(v),
    )


@pytest.mark.parametrize("size", [0.0, 1e-9, 0.3, 20.0])
def test_values_and_numbers_give_the_same_bits(size: float) -> None:
    """Rotations of values do the arithmetic of those of numbers, as they are written and lowered."""
    rng = np.random.default_rng(7)
    q, v, angle = Quaternion4(*rng.normal(size=4).tolist()), Vector(*(size * rng.normal(size=3)).tolist()), 0.3
    outcome = written(turned)(q, v, angle)
    assert turned(q, v, angle) == outcome
    unit = normalised(q.x, q.y, q.z, q.w)
    step = exponential_numbers(v.x, v.y, v.z)
    c, s = math.cos(angle), math.sin(angle)
    expected: list[Any] = [
        rotate_numbers(*unit, v.x, v.y, v.z),
        matrix(unit).ravel(),
        [c, -s, 0.0, s, c, 0.0, 0.0, 0.0, 1.0],
        step,
        product(-unit[0], -unit[1], -unit[2], unit[3], *step),
    ]
    assert [list(numbers(each)) for each in outcome] == [list(each) for each in expected]


def test_rows_become_orthogonal_with_the_moments_that_they_had() -> None:
    rng = np.random.default_rng(3)
    rows = rng.normal(size=(5, 7))
    lowered, plain = rows.copy().ravel(), rows.copy().ravel()
    orthogonalise(Table(lowered, 0, 7), 1, 4)
    written(orthogonalise)(Table(plain, 0, 7), 1, 4)
    assert lowered.tobytes() == plain.tobytes()
    after = lowered.reshape(5, 7)
    np.testing.assert_array_equal(after[:, 0], rows[:, 0])
    np.testing.assert_array_equal(after[0], rows[0])
    np.testing.assert_allclose(after[1:, 1:].T @ after[1:, 1:], rows[1:, 1:].T @ rows[1:, 1:], atol=64 * EPS)
    products = after[1:, 1:] @ after[1:, 1:].T
    np.testing.assert_allclose(products - np.diag(np.diag(products)), 0.0, atol=64 * EPS)
