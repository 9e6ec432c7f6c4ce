"""Moment arms about the centroid against exact rational arithmetic."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

from graspfx.grasp.matrix import add, centred_arms, multiply, two_product, two_sum


def exact_fields(points, axes):
    """u_k x (c_i - c) in rational arithmetic."""
    p = [[Fraction(float(x)) for x in row] for row in points]
    n = len(p)
    c = [sum(row[a] for row in p) / n for a in range(3)]
    out = []
    for u in ([Fraction(float(x)) for x in row] for row in axes):
        for row in p:
            r = [row[a] - c[a] for a in range(3)]
            out.append([u[1] * r[2] - u[2] * r[1], u[2] * r[0] - u[0] * r[2], u[0] * r[1] - u[1] * r[0]])
    return np.array(out, dtype=object).reshape(len(axes), n, 3)


@pytest.mark.parametrize("h", [1.0, 1e-4, 1e-8, 1e-12])
@pytest.mark.parametrize("away", [0.0, 1000.0])
def test_every_rotation_is_accurate_relative_to_its_own_arm(h, away):
    # a line along (1, 1, 1)/sqrt(3), offsets h across it: ordinary products lose eps/h, here a few roundings remain
    rng = np.random.default_rng(4)
    points = 0.05 * np.outer([-1.0, -0.4, 0.3, 1.1], [1.0, 1.0, 1.0]) + 0.05 * h * rng.normal(size=(4, 3)) + away
    axes, fields, _ = centred_arms(points, principal=True)
    assert np.allclose(axes @ axes.T, np.eye(3), atol=1e-15)
    expected = exact_fields(points, axes)
    for k in range(3):
        error = np.array([[float(Fraction(float(x)) - y) for x, y in zip(*rows, strict=True)]
                          for rows in zip(fields[k], expected[k], strict=True)])  # fmt: skip
        assert np.abs(error).max() <= 4e-16 * np.abs(fields[k]).max()


def test_plane_and_offset_of_the_centroid():
    # a triangle with centroid (1, 1/3) seen from its first corner: fields are the arms turned by 90 degrees
    axes, fields, offset = centred_arms(np.array([[5.0, 7.0], [8.0, 7.0], [5.0, 8.0]]), principal=False)
    assert axes.tolist() == [[1.0]]
    assert np.allclose(offset, [1.0, 1 / 3], atol=1e-16)
    assert np.allclose(fields[0], [[1 / 3, -1.0], [1 / 3, 2.0], [-2 / 3, -1.0]], atol=2e-16)


@pytest.mark.parametrize("n", [1, 2])
def test_one_and_two_contacts_have_three_axes(n):
    axes, fields, _ = centred_arms(np.arange(3.0 * n).reshape(n, 3), principal=True)
    assert axes.shape == (3, 3)
    assert fields.shape == (3, n, 3)
    assert np.allclose(axes @ axes.T, np.eye(3), atol=1e-15)


def test_pairs_keep_what_rounding_drops():
    # 1 + 2^-60 and (1 + 2^-30)^2 do not fit into one double; the pair holds them exactly
    tiny = np.array([2.0**-60])
    high, low = two_sum(np.array([1.0]), tiny)
    assert (high.item(), low.item()) == (1.0, 2.0**-60)
    high, low = two_product(np.array([1.0 + 2.0**-30]), np.array([1.0 + 2.0**-30]))
    assert Fraction(float(high[0])) + Fraction(float(low[0])) == Fraction(2**30 + 1, 2**30) ** 2
    high, low = add((np.array([1.0]), tiny), (np.array([-1.0]), tiny))
    assert (high.item(), low.item()) == (2.0**-59, 0.0)
    high, low = multiply(np.array([3.0]), (np.array([1.0]), tiny))
    assert (high.item(), low.item()) == (3.0, 3 * 2.0**-60)
