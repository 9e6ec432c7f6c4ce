"""Eq. (4) for point contacts in place: against 50 digits and the projector of an SVD, ranks, engines, refusals."""

from __future__ import annotations

import sys
from collections.abc import Sequence

import mpmath as mp
import numpy as np
import pytest
from numpy.typing import NDArray

import graspfx as gx
from graspfx.compile.records import size_for
from graspfx.errors import InputError, MissingPackageError, UnknownNameError
from graspfx.grasp import direct
from graspfx.grasp.direct import PointGrasp
from tests.support.exact import DIGITS, distance, exact_force
from tests.support.optional import require

FloatArray = NDArray[np.float64]
GAINS = (30.0, 0.4, 70.0, 0.9)
LINE = np.array([-1.0, -0.4, 0.1, 0.3, 1.0])


def point_coupling(
    n: int, d: int, gains: Sequence[float] = GAINS, engine: str = "interpreted", **settings: float
) -> gx.PointCoupling:
    external, internal = gx.Impedance(*gains[:2]), gx.Impedance(*gains[2:])
    return gx.PointCoupling(external, internal, n, d, engine=engine, **settings)


def forces(law: gx.PointCoupling, points: FloatArray, e: FloatArray, de: FloatArray) -> FloatArray:
    law.points[:], law.displacement[:], law.rate[:] = points, e, de
    law.compute()
    return law.force.copy()


def worst_error(sets: Sequence[FloatArray], seed: int = 3) -> float:
    """Find the largest error of each set, relative to its largest force, at motions at random."""
    rng = np.random.default_rng(seed)
    law, worst = point_coupling(5, 3), 0.0
    kep, ked, kip, kid = GAINS
    for points in sets:
        e, de = rng.normal(size=(5, 3)) * 0.004, rng.normal(size=(5, 3)) * 0.1
        f = forces(law, points, e, de)
        parts = (exact_force(points, x, outer, inner, 1e-20)[0] for x, outer, inner in ((e, kep, kip), (de, ked, kid)))
        with mp.workdps(DIGITS):
            expected = [a + b for a, b in zip(*parts, strict=True)]
            worst = max(worst, distance(f, expected) / float(max(map(abs, expected))))
    return worst


@pytest.mark.parametrize(
    ("size", "away"), [(0.05, 0.0), (0.05, 1000.0), (1e-6, 0.0), (1e-6, 1.0), (1e-6, 1000.0), (1000.0, 0.0)]
)
def test_five_fingers_against_fifty_digits(size: float, away: float) -> None:
    """A few roundings of the largest force, whatever the distance between contacts and from the origin."""
    rng = np.random.default_rng(1)
    assert worst_error([rng.normal(size=(5, 3)) * size + away * rng.normal(size=3) for _ in range(20)]) < 1e-15


@pytest.mark.parametrize("h", [1e-1, 1e-2, 1e-4, 1e-6, 1e-9])
@pytest.mark.parametrize("away", [0.0, 1000.0])
def test_error_does_not_grow_as_contacts_come_near_a_line(h: float, away: float) -> None:
    """Condition numbers of G about 1/h: an ordinary pseudoinverse errs by eps/h, the data's last digits turned away."""
    rng = np.random.default_rng(2)
    sets = []
    for _ in range(15):
        u = rng.normal(size=3)
        offsets = h * rng.normal(size=(5, 3))
        sets.append(
            0.05 * (np.outer(rng.permutation(LINE), u / np.linalg.norm(u)) + offsets) + away * rng.normal(size=3)
        )
    assert worst_error(sets) < 2e-15
    law = point_coupling(5, 3)
    for points in sets:
        forces(law, points, points, points)
        assert law.rank == 6


@pytest.mark.parametrize("u", [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, -1.0), (1.0, 1.0, 1.0), (1.0, -2.0, 4.0)])
@pytest.mark.parametrize("away", [0.0, 1024.0])
def test_contacts_on_a_line_turn_about_it_freely(u: tuple[float, float, float], away: float) -> None:
    """Exactly on a line, coordinates in binary fractions: rank 5, and no force from turning about the line."""
    points = np.outer([-8.0, -3.0, 1.0, 2.0, 16.0], u) / 512.0 + away
    assert worst_error([points]) < 1e-15
    law = point_coupling(5, 3)
    turned = np.cross(u, np.random.default_rng(4).normal(size=(5, 3)))
    forces(law, points, turned, turned)
    assert law.rank == 5


@pytest.mark.parametrize("place", [0.0, 0.3, 1000.1])
def test_contacts_in_one_place_do_not_turn(place: float) -> None:
    points = np.full((5, 3), place)
    assert worst_error([points]) < 1e-15
    law = point_coupling(5, 3)
    forces(law, points, points, points)
    assert law.rank == 3


@pytest.mark.parametrize("d", [1, 2, 3])
@pytest.mark.parametrize("n", [1, 2, 3, 4, 7])
@pytest.mark.parametrize("gains", [GAINS, (30.0, 0.0, 70.0, 0.0), (40.0, 0.4, 40.0, 0.9)])
def test_every_number_of_fingers_and_dimensions(n: int, d: int, gains: tuple[float, ...]) -> None:
    """Against the projector of an SVD, with all contacts apart, on a line and in one place."""
    rng = np.random.default_rng(10 * n + d)
    law = point_coupling(n, d, gains)
    whole = gx.Coupling(gx.Impedance(*gains[:2]), gx.Impedance(*gains[2:]))
    scattered = rng.normal(size=(n, d)) * 0.03
    on_a_line = np.outer(rng.integers(-50, 50, size=n), np.arange(1.0, d + 1)) / 1024.0
    for points in (scattered, on_a_line, np.full((n, d), 0.25)):
        e, de = rng.normal(size=(n, d)) * 0.004, rng.normal(size=(n, d)) * 0.1
        split = gx.Grasp(points).split()
        expected = whole.force(split, e.ravel(), de.ravel()).reshape(n, d)
        f = forces(law, points, e, de)
        np.testing.assert_allclose(f, expected, rtol=0.0, atol=2e-14 * np.abs(expected).max())
        if gains[0] != gains[2]:
            assert law.rank == split.rank


@pytest.mark.parametrize("d", [1, 2, 3])
@pytest.mark.parametrize("n", [1, 5])
def test_equal_gains_are_the_conventional_method_bit_for_bit(n: int, d: int) -> None:
    rng = np.random.default_rng(5)
    e, de = rng.normal(size=(2, n, d))
    f = forces(point_coupling(n, d, (70.0, 0.4, 70.0, 0.4)), rng.normal(size=(n, d)), e, de)
    assert np.array_equal(f, 70.0 * e + 0.4 * de)


def test_tolerance_says_how_near_a_line_is_on_it() -> None:
    points = 0.05 * np.outer(LINE, [0.6, 0.0, 0.8])
    points[2, 1] = 1e-6
    across = np.array([-0.8, 0.0, 0.6])
    e = np.zeros((5, 3))
    e[2] = 1e-3 * across
    free, held = point_coupling(5, 3), point_coupling(5, 3, tolerance=1e-4)
    f, g = forces(free, points, e, 0.0 * e) @ across, forces(held, points, e, 0.0 * e) @ across
    assert (free.rank, held.rank) == (6, 5)
    np.testing.assert_allclose(f, [0.0, 0.0, 0.03, 0.0, 0.0], rtol=0.0, atol=1e-16)  # all of it turns the object
    assert g[2] == pytest.approx(70e-3 - 40e-3 * (1 / 5 + LINE[2] ** 2 / (LINE @ LINE)), rel=1e-9)


@pytest.mark.parametrize("d", [1, 2, 3])
@pytest.mark.parametrize("n", [1, 2, 3, 5])
def test_compiled_forces_are_the_interpreted_ones_but_for_rounding(n: int, d: int) -> None:
    pytest.importorskip("llvmlite")
    rng = np.random.default_rng(6)
    slow, fast = point_coupling(n, d), point_coupling(n, d, engine="compiled")
    assert (slow.engine, fast.engine) == ("interpreted", "compiled")
    for points in (rng.normal(size=(n, d)), np.ones((n, d)), np.outer(np.arange(n), np.ones(d))):
        e, de = rng.normal(size=(2, n, d))
        f = forces(slow, points, e, de)
        np.testing.assert_allclose(forces(fast, points, e, de), f, rtol=0.0, atol=1e-14 * np.abs(f).max())
        assert slow.rank == fast.rank


@pytest.mark.parametrize("bad", [np.nan, np.inf])
@pytest.mark.parametrize(("n", "d"), [(3, 2), (2, 3), (5, 3)])
def test_what_is_not_finite_gives_no_finite_force(n: int, d: int, bad: float) -> None:
    law = point_coupling(n, d)
    for what in (law.points, law.displacement, law.rate):
        for i in range(n):
            rng = np.random.default_rng(7)
            forces(law, *rng.normal(size=(3, n, d)))
            what[i, 0] = bad
            law.compute()
            assert not np.isfinite(law.force).all()


def test_the_whole_range_of_lengths_raises_nothing() -> None:
    """Interpreted division by zero and overflow would."""
    law, shape = point_coupling(3, 3), np.random.default_rng(8).normal(size=(3, 3))
    for size in (1e-300, 1e-200, 1e-150, 1e-100, 1e100):
        f = forces(law, shape * size, shape, shape)
        assert np.isfinite(f).all()


def test_views_are_one_block_that_a_kernel_takes_with_an_offset() -> None:
    rng = np.random.default_rng(9)
    law = point_coupling(4, 3)
    views = (law.points, law.displacement, law.rate, law.force)
    f = forces(law, *rng.normal(size=(3, 4, 3)))
    assert all(a is b for a, b in zip(views, (law.points, law.displacement, law.rate, law.force), strict=True))
    assert all(a.base is law.force.base for a in views)
    block = np.concatenate(
        [np.full(7, np.nan), require(law.force.base).ravel()[: size_for(PointGrasp, count=4, dimensions=3)]]
    )
    block[-12:] = 0.0
    assert direct.couple_points(PointGrasp(memoryview(block), 7)) == 0
    assert np.array_equal(block[-12:], f.ravel())


def test_refusals_say_what_to_do(monkeypatch: pytest.MonkeyPatch) -> None:
    number = gx.Impedance(30.0)
    for part in (gx.Impedance([30.0, 40.0]), gx.Impedance(30.0, np.eye(3))):
        with pytest.raises(InputError, match=r"an Impedance whose (stiffness|damping) is a number; use Coupling.force"):
            gx.PointCoupling(number, part, 2)
    with pytest.raises(InputError, match="internal: given 70"):
        gx.PointCoupling(number, 70.0, 2)  # type: ignore[arg-type]
    for n, d, tolerance, name in ((0, 3, 0.0, "fingers"), (2, 4, 0.0, "dimensions"), (2, 3, 1.0, "tolerance")):
        with pytest.raises(InputError, match=name):
            gx.PointCoupling(number, number, n, d, tolerance=tolerance)
    with pytest.raises(UnknownNameError, match="did you mean 'compiled'"):
        gx.PointCoupling(number, number, 2, engine="compild")
    monkeypatch.setitem(sys.modules, "llvmlite", None)
    monkeypatch.setattr("graspfx.grasp.point_coupling.find_spec", lambda name: None)
    assert gx.PointCoupling(number, number, 2).engine == "interpreted"
    with pytest.raises(MissingPackageError, match="engine='interpreted'"):
        gx.PointCoupling(number, number, 2, engine="compiled")
