"""Factors of symmetric matrices: products of factors are the matrix to rounding, of either sign and any rank."""

from __future__ import annotations

import numpy as np
import pytest

from graspfx.compile.records import Floats, Table
from graspfx.cones.factors import (
    eliminate_rows,
    factor_definite,
    factor_signed,
    invert_part,
    lower,
    solve_factored,
    take_square,
)


def table(M: np.ndarray) -> Table:
    return Table(np.ascontiguousarray(M).ravel().copy(), 0, M.shape[1])


@pytest.mark.parametrize("rank", [0, 1, 4, 9])
def test_definite_of_any_rank(rank: int) -> None:
    rng = np.random.default_rng(rank)
    for _ in range(50):
        B = rng.normal(size=(9, rank)) * 10.0 ** rng.uniform(-3.0, 3.0, rank)
        M = B @ B.T
        L = table(M)
        factor_definite(L, 9)
        A = L.array(9)
        assert not np.triu(A, 1).any()
        np.testing.assert_allclose(A @ A.T, M, rtol=0.0, atol=2e-14 * max(np.abs(M).max(), 1e-300))


def test_systems_of_a_definite_matrix() -> None:
    rng = np.random.default_rng(1)
    B = rng.normal(size=(6, 8))
    M, b = B @ B.T, rng.normal(size=6)
    L = table(M)
    factor_definite(L, 6)
    x, y = Floats(b.copy()), Floats(b.copy())
    solve_factored(L, x, 6)
    lower(L, y, 6)
    np.testing.assert_allclose(np.asarray(x.buffer), np.linalg.solve(M, b), rtol=1e-11)
    np.testing.assert_allclose(np.asarray(y.buffer), np.linalg.solve(L.array(6), b), rtol=1e-12)


@pytest.mark.parametrize("rank", [0, 1, 4, 6])
def test_inverse_of_any_rank(rank: int) -> None:
    """M X M = M, with as many rows of X as the rank; columns that are none but for rounding do not count."""
    rng = np.random.default_rng(rank)
    for k in range(50):
        B = rng.normal(size=(6, rank))
        B[k % 6] *= 1e-9
        M = B @ B.T
        X = table(M)
        invert_part(X, Floats(np.zeros(6)), 6, 1e-12)
        found = X.array(6)
        np.testing.assert_allclose(M @ found @ M, M, rtol=0.0, atol=1e-11 * max(np.abs(M).max(), 1.0))
        assert np.count_nonzero(found.any(axis=0)) <= rank


@pytest.mark.parametrize("rest", [0.0, 1e-3, 2.0])
def test_squares_taken_off_an_inverse(rest: float) -> None:
    """A'A = (I + T'T / rest)^-1, for a rest of zero the projector beside T; the same row twice is no new one."""
    rng = np.random.default_rng(3)
    for count in (1, 3, 8):
        T = rng.normal(size=(count, 6))
        T[1:3] = T[0] * np.array([[1.0], [-2.0]])[: count - 1]
        A = table(np.eye(6))
        for t in T:
            take_square(A, Floats(t.copy()), Floats(np.zeros(6)), rest, 6)
        found = A.array(6).T @ A.array(6)
        expected = np.linalg.inv(np.eye(6) + T.T @ T / rest) if rest else np.eye(6) - np.linalg.pinv(T, rcond=1e-10) @ T
        np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-11 if rest == 1e-3 else 1e-14)


@pytest.mark.parametrize("kind", ["full", "no diagonal", "low rank", "nothing", "graded"])
def test_signed_of_any_sign(kind: str) -> None:
    """M = sum of h l l', with as many minus signs as M has eigenvalues below zero."""
    rng = np.random.default_rng(len(kind))
    for _ in range(100):
        size = int(rng.integers(1, 16))
        M = rng.normal(size=(size, size))
        if kind == "low rank":
            B = rng.normal(size=(size, 2))
            M = B @ np.diag([1.0, -2.0]) @ B.T
        if kind == "graded":
            M *= np.outer(s := 10.0 ** rng.uniform(-4.0, 4.0, size), s)
        if kind == "nothing":
            M *= 0.0
        M = M + M.T
        if kind == "no diagonal":
            np.fill_diagonal(M, 0.0)
        columns, signs = table(np.zeros((size, size))), Floats(np.zeros(size))
        factor_signed(table(M), size, columns, signs)
        L, h = columns.array(size), np.asarray(signs.buffer)
        assert np.isin(h, (-1.0, 1.0)).all()
        np.testing.assert_allclose(L @ np.diag(h) @ L.T, M, rtol=0.0, atol=5e-14 * max(np.abs(M).max(), 1e-300))
        if kind in ("full", "no diagonal"):
            assert (h < 0.0).sum() == (np.linalg.eigvalsh(M) < 0.0).sum() or size == 1


def test_many_right_sides() -> None:
    rng = np.random.default_rng(3)
    for _ in range(50):
        A, B = rng.normal(size=(7, 7)), rng.normal(size=(7, 4))
        X = table(B)
        assert eliminate_rows(table(A), X, 7, 4)
        np.testing.assert_allclose(A @ X.array(7), B, atol=1e-11)
    assert not eliminate_rows(table(np.zeros((2, 2))), table(np.ones((2, 1))), 2, 1)
