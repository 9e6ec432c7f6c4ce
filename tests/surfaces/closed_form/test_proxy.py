"""Contact points against exact arithmetic, dense sampling and the rule stated another way; thin plates; corners."""

from __future__ import annotations

import math
from collections.abc import Sequence
from fractions import Fraction

import numpy as np
import pytest
from numpy.typing import NDArray

from graspfx.compile.records import numbers
from graspfx.spatial import ZERO, Vector
from graspfx.surfaces.closed_form.proxy import BOX, SPHERE, closest

Array = NDArray[np.float64]
HALF = (0.025, 0.02, 0.01)


def contact(
    p: Array, face: int = -1, half: tuple[float, ...] = HALF, kind: int = BOX, before: Array | None = None
) -> tuple[int, Array, Array, float]:
    """The kernel for a point of d coordinates: face, c, n, gap."""
    d = len(p)
    last = np.zeros(3) if before is None else before
    found = closest(kind, d, vector(half), vector(p.tolist()), face, vector(last.tolist()))
    point, normal = ([*numbers(v)][:d] for v in (found.point, found.normal))
    return found.face, np.array(point), np.array(normal), found.gap


def vector(entries: Sequence[float]) -> Vector:
    """Make a vector of up to three entries."""
    x, y, z = (*entries, 0.0, 0.0)[:3]
    return Vector(x, y, z)


def walk(p: Array, face: int, half: tuple[float, ...]) -> tuple[list[Fraction], Fraction]:
    """The rule in words: stay on the face; beyond its edge go over to the neighbour if that is strictly nearer.

    In exact arithmetic: the contact point and its squared distance.
    """
    d = len(p)
    x, h = [Fraction(v) for v in p.tolist()], [Fraction(v) for v in half[:d]]

    def on_face(f: int) -> tuple[list[Fraction], Fraction]:
        c = [min(max(x[i], -h[i]), h[i]) for i in range(d)]
        c[f // 2] = h[f // 2] if f % 2 == 0 else -h[f // 2]
        return c, sum(((x[i] - c[i]) ** 2 for i in range(d)), Fraction(0))

    c, square = on_face(face)
    for _ in range(20):
        near = []
        for i in range(d):
            if i != face // 2 and abs(x[i]) > h[i]:
                f = 2 * i if x[i] > 0 else 2 * i + 1
                near.append((on_face(f)[1], f))
        if not near or min(near)[0] >= square:
            return c, square
        face = min(near)[1]
        c, square = on_face(face)
    raise AssertionError("the walk did not end")


@pytest.mark.parametrize("d", [1, 2, 3])
def test_outside_it_is_the_nearest_point_exactly(d: int) -> None:
    """Optimality of a projection on a box, checked with rational numbers: where c is not clamped it is p itself."""
    rng = np.random.default_rng(d)
    seen = 0
    for _ in range(1000):
        p = rng.normal(size=d) * 0.03
        if (np.abs(p) <= HALF[:d]).all():
            continue
        seen += 1
        face, c, n, gap = contact(p)
        for x, h, q in zip(p.tolist(), HALF, c.tolist(), strict=False):
            assert q == (x if abs(x) <= h else math.copysign(h, x))
        square = sum((Fraction(x) - Fraction(q)) ** 2 for x, q in zip(p.tolist(), c.tolist(), strict=True))
        assert gap == pytest.approx(math.sqrt(square), rel=1e-15)
        np.testing.assert_allclose(c - p, gap * n, atol=1e-17)
        assert np.linalg.norm(n) == pytest.approx(1.0, abs=1e-15)
        excess = np.abs(p) - HALF[:d]
        assert excess[face // 2] == excess.max()
        assert p[face // 2] * (1 - 2 * (face % 2)) > 0
    assert seen > 300


@pytest.mark.parametrize("d", [1, 2, 3])
def test_inside_a_new_finger_takes_the_face_with_the_largest_signed_excess(d: int) -> None:
    rng = np.random.default_rng(20 + d)
    h = np.array(HALF[:d])
    for p in rng.uniform(-1, 1, size=(300, d)) * h:
        face, c, n, gap = contact(p)
        depths = np.stack([h - p, h + p], axis=1).ravel()  # +x, -x, +y, ...
        assert face == depths.argmin()
        assert gap == pytest.approx(-depths.min(), rel=1e-15)
        np.testing.assert_allclose(p - c, -gap * n, atol=1e-17)
        assert n[face // 2] == 2 * (face % 2) - 1


@pytest.mark.parametrize("d", [1, 2, 3])
@pytest.mark.parametrize("half", [HALF, (0.02, 0.02, 0.0005), (0.0005, 0.0005, 0.02)])
def test_along_any_path_it_is_the_walk_over_edges(d: int, half: tuple[float, ...]) -> None:
    """From every face, for points all around, in and out: the contact point of the walk, in one step."""
    rng = np.random.default_rng(30 + d)
    for _ in range(700):
        p = rng.uniform(-2, 2, size=d) * np.maximum(half[:d], 0.005)
        face = int(rng.integers(2 * d))
        c, square = walk(p, face, half)
        _, found, n, gap = contact(p, face, half)
        assert [Fraction(v) for v in found.tolist()] == c
        assert abs(gap) == pytest.approx(math.sqrt(square), rel=1e-15)
        np.testing.assert_allclose(p - found, -gap * n, atol=1e-17)


def test_a_finger_pressed_deep_leaves_over_the_edge() -> None:
    """6 mm deep in the top of a 1 mm plate and slid past the side: free, at the distance to the side, then below."""
    half = (0.05, 0.04, 0.0005)
    face, _, n, gap = contact(np.array([0.0499, 0.0, -0.0055]), 4, half)
    assert (face, n.tolist()) == (4, [0, 0, -1])
    assert gap == pytest.approx(-0.006, rel=1e-14)
    face, c, _, gap = contact(np.array([0.0501, 0.0, -0.0055]), face, half)
    assert gap == pytest.approx(math.hypot(0.0001, 0.005), rel=1e-12)
    np.testing.assert_array_equal(c, [0.05, 0.0, -0.0005])
    face, _, n, gap = contact(np.array([0.0499, 0.0, -0.0055]), face, half)
    assert (face, n.tolist()) == (5, [0, 0, 1])
    assert gap == pytest.approx(0.005, rel=1e-14)


def test_a_finger_enters_where_it_came_from() -> None:
    """Outside near an edge, 5 mm beyond +x and 1 mm beyond +y, then 1 mm inside both: on +x."""
    face = contact(np.array([0.030, 0.021]))[0]
    face, c, _, gap = contact(np.array([0.024, 0.019]), face)
    assert (face, c.tolist()) == (0, [0.025, 0.019])
    assert gap == pytest.approx(-0.001, rel=1e-13)


@pytest.mark.parametrize("kind", [BOX, SPHERE])
def test_on_a_line_a_finger_that_goes_right_through_stays_on_its_side(kind: int) -> None:
    """40 mm beyond the far side of a 50 mm interval: 90 mm deep; a sphere is the same interval."""
    for side, face in ((1.0, 0), (-1.0, 1)):
        f = contact(np.array([side * 0.03]), -1, (0.025,), kind)[0]
        assert f == face
        f, c, n, gap = contact(np.array([-side * 0.065]), f, (0.025,), kind)
        assert (f, c[0], n[0]) == (face, side * 0.025, -side)
        assert gap == pytest.approx(-0.09, rel=1e-15)


@pytest.mark.parametrize("d", [2, 3])
def test_the_centre_of_a_sphere_has_the_direction_from_before(d: int) -> None:
    before = np.array([0.0, -0.02, 0.0])[:d]
    for p in (np.zeros(d), np.full(d, 1e-200)):
        _, c, n, gap = contact(p, 0, (0.02,), SPHERE, before)
        np.testing.assert_allclose(c, before, rtol=1e-15)
        np.testing.assert_allclose(n, [0.0, 1.0, 0.0][:d], rtol=1e-15)
        assert gap == -0.02
    _, c, n, _ = contact(np.zeros(d), -1, (0.02,), SPHERE)  # never touched: any direction, but a direction
    assert np.linalg.norm(n) == 1.0
    np.testing.assert_array_equal(c, -0.02 * n)


def test_what_the_dimensions_do_not_have_does_not_matter() -> None:
    for kind in (BOX, SPHERE):
        plane = closest(kind, 2, Vector(0.02, 0.02, 0.0), Vector(0.03, 0.01, 0.0), -1, ZERO)
        other = closest(kind, 2, Vector(0.02, 0.02, 0.0), Vector(0.03, 0.01, 9.0), -1, Vector(0.0, 0.0, 9.0))
        assert other == plane
        line = closest(kind, 1, Vector(0.02, 0.0, 0.0), Vector(0.03, 0.0, 0.0), -1, ZERO)
        assert closest(kind, 1, Vector(0.02, 0.0, 0.0), Vector(0.03, 9.0, 9.0), -1, Vector(0.0, 9.0, 9.0)) == line


def test_edges_and_corners_of_vanishing_distance() -> None:
    """1e-200 m outside a corner: a unit normal all the same."""
    half = (1e-250, 1e-250, 1e-250)
    for p in ([1e-200, 1e-200, 1e-200], [1e-200, -1e-200, 0.0]):
        _, _, n, gap = contact(np.array(p), -1, half)
        assert np.linalg.norm(n) == pytest.approx(1.0)
        assert gap >= 0.0
