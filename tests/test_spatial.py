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
    Quaternion,
    Vector,
    angle_matrix,
    exponential,
    normalise,
    orthogonalise,
    quaternion,
    quaternion_matrix,
    rotate,
)

EPS = np.finfo(float).eps


def unit(rng: np.random.Generator) -> Quaternion:
    q = rng.normal(size=4)
    return Quaternion(*(q / np.linalg.norm(q)).tolist())


def entries(value: Any) -> NDArray[np.float64]:
    return np.array(list(numbers(value)))


def matrix(q: Quaternion) -> NDArray[np.float64]:
    return entries(quaternion_matrix(q)).reshape(3, 3)


@pytest.mark.parametrize("seed", range(20))
def test_group_laws(seed: int) -> None:
    rng = np.random.default_rng(seed)
    a, b, c = unit(rng), unit(rng), unit(rng)
    one = Quaternion(0.0, 0.0, 0.0, 1.0)
    assert a @ one == a
    assert one @ a == a
    np.testing.assert_allclose(entries(a @ a.conjugate), entries(one), atol=4 * EPS)
    np.testing.assert_allclose(entries((a @ b) @ c), entries(a @ (b @ c)), atol=4 * EPS)


@pytest.mark.parametrize("seed", range(20))
def test_quaternion_matrix_and_rotation_are_one_map(seed: int) -> None:
    rng = np.random.default_rng(seed)
    a, b, v = unit(rng), unit(rng), rng.normal(size=3)
    R, u = matrix(a), Vector(*v.tolist())
    np.testing.assert_allclose(R, Rotation.from_quat(entries(a)).as_matrix(), atol=4 * EPS)
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=8 * EPS)
    np.testing.assert_allclose(entries(rotate(a, u)), R @ v, atol=8 * EPS)
    np.testing.assert_allclose(entries(rotate(a.conjugate, u)), R.T @ v, atol=8 * EPS)
    np.testing.assert_allclose(matrix(a @ b), R @ matrix(b), atol=8 * EPS)


@pytest.mark.parametrize("angle", [0.0, 1e-300, 1e-160, 1e-12, 1e-6, 9.9e-5, 1.01e-4, 0.01, 1.0, math.pi, 6.0, 40.0])
def test_exponential_is_exact_to_rounding_at_every_angle(angle: float) -> None:
    """Each entry within 4 eps of 50 digits, relative to itself; the scalar part, zero at pi, absolutely."""
    axis = np.array([0.48, -0.6, 0.64])
    x, y, z, w = numbers(exponential(Vector(*(angle * axis).tolist())))
    with mpmath.workdps(50):
        vector = [mpmath.mpf(float(angle * u)) for u in axis]
        exact = mpmath.sqrt(sum(u * u for u in vector))
        s = mpmath.sin(exact / 2) / exact if angle else mpmath.mpf("0.5")
        for got, u in zip((x, y, z), vector, strict=True):
            assert abs(got - u * s) <= 4 * EPS * max(abs(u * s), EPS * angle) * (1 + angle)
        assert abs(w - mpmath.cos(exact / 2)) <= 4 * EPS * (1 + angle)


def test_turns_about_one_axis_add() -> None:
    """exp(0.3 u) exp(0.4 u) = exp(0.7 u)."""
    u = Vector(2.0 / 3.0, -1.0 / 3.0, 2.0 / 3.0)
    both = exponential(0.3 * u) @ exponential(0.4 * u)
    np.testing.assert_allclose(entries(both), entries(exponential(0.7 * u)), atol=2 * EPS)


def test_plane_rotation_is_the_one_about_z() -> None:
    for angle in (-7.0, -1e-9, 0.0, 0.3, 100.0):
        R = np.array(list(numbers(angle_matrix(angle)))).reshape(3, 3)
        np.testing.assert_allclose(R, matrix(exponential(Vector(0.0, 0.0, angle))), atol=8 * EPS)


def test_a_unit_quaternion_keeps_the_direction_and_lets_zero_be() -> None:
    q = normalise(Quaternion(1.0, -2.0, 3.0, -4.0))
    np.testing.assert_allclose(entries(q) * math.sqrt(30.0), [1.0, -2.0, 3.0, -4.0], rtol=4 * EPS)
    zero = Quaternion(0.0, 0.0, 0.0, 0.0)
    assert normalise(zero) == zero


def test_quaternion_of_a_matrix() -> None:
    """Back from the matrix to 4 eps, half turns about every axis among them, where one component alone is not small."""
    rng = np.random.default_rng(7)
    half_turns = [(1.0, 0.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0), (0.6, 0.0, 0.8, 0.0)]
    fixed = [Quaternion(*q) for q in (*half_turns, (0.0, 0.0, 0.0, 1.0))]
    for q in [*fixed, *(unit(rng) for _ in range(200))]:
        back = quaternion(matrix(q).ravel().tolist())
        assert back.w >= 0.0
        assert abs(np.dot(entries(back), entries(q))) == pytest.approx(1.0, abs=4 * EPS)
        np.testing.assert_allclose(matrix(back), matrix(q), atol=8 * EPS)


@kernel
def turned(q: Quaternion, v: Vector, angle: float) -> tuple[Vector, Matrix, Matrix, Quaternion, Quaternion]:
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
def test_rotations_lowered_give_the_same_bits(size: float) -> None:
    rng = np.random.default_rng(7)
    q, v, angle = Quaternion(*rng.normal(size=4).tolist()), Vector(*(size * rng.normal(size=3)).tolist()), 0.3
    outcome = written(turned)(q, v, angle)
    assert turned(q, v, angle) == outcome
    R = Rotation.from_quat(entries(q))
    np.testing.assert_allclose(entries(outcome[0]), R.apply(entries(v)), atol=8 * EPS * (1.0 + size))
    turn = R.inv() * Rotation.from_rotvec(entries(v))
    np.testing.assert_allclose(matrix(outcome[4]), turn.as_matrix(), atol=16 * EPS * (1.0 + size))


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
