"""Contact points of every shape against 50 digits; sides and faces that hold; balls; compiled kernels."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from mpmath import mp, mpf
from numpy.typing import NDArray

from graspfx.compile.kernel import source_function
from graspfx.compile.machine import compiled
from graspfx.compile.records import numbers
from graspfx.spatial import Vector
from graspfx.surfaces.closed_form.proxy import (
    BOX,
    CAPSULE,
    CYLINDER,
    ELLIPSOID,
    HALF_SPACE,
    PLANE,
    SPHERE,
    closest,
    closest_to_ball,
)
from graspfx.surfaces.closed_form.shape import Capsule, Cylinder, Ellipsoid, HalfSpace, Plane, Shape, Sphere
from tests.support.exact_surfaces import (
    Exact,
    Oracle,
    exact_capsule,
    exact_cylinder,
    exact_ellipsoid,
    exact_flat,
    exact_sphere,
    exact_stadium,
    norm,
)

Array = NDArray[np.float64]
TOLERANCE = 1e-15  # of the larger of size and position
NONE = (0.0, 0.0, 0.0)


def query(
    kind: int, d: int, size: tuple[float, ...], p: Any, face: int = -1, before: Any = NONE
) -> tuple[int, Array, Array, float]:
    """Face, c, n, gap of a finger at p, (3,) of which d count."""
    c = closest(kind, d, vector(size), vector(p), face, vector(before))
    return c.face, np.array(list(numbers(c.point))), np.array(list(numbers(c.normal))), c.gap


def vector(entries: Any) -> Vector:
    """Make a vector of up to three entries."""
    x, y, z = (*(float(entry) for entry in entries), 0.0, 0.0)[:3]
    return Vector(x, y, z)


EXACT: list[tuple[str, int, int, tuple[float, ...], Oracle]] = [
    ("half-space", HALF_SPACE, 3, HalfSpace((0.3, -0.2, 0.9)).parameters, exact_flat),
    ("half-plane", HALF_SPACE, 2, HalfSpace((0.3, -0.2)).parameters, exact_flat),
    ("plane", PLANE, 3, Plane((1.0, 2.0, -0.5)).parameters, exact_flat),
    ("sphere", SPHERE, 3, (0.03, 0.0, 0.0), exact_sphere),
    ("disc", SPHERE, 2, (0.03, 0.0, 0.0), exact_sphere),
    ("capsule", CAPSULE, 3, (0.01, 0.04, 0.0), exact_capsule),
    ("wire", CAPSULE, 3, (0.0005, 0.5, 0.0), exact_capsule),
    ("stadium", CAPSULE, 2, (0.01, 0.04, 0.0), exact_stadium),
    ("cylinder", CYLINDER, 3, (0.02, 0.05, 0.0), exact_cylinder),
    ("coin", CYLINDER, 3, (0.05, 0.0005, 0.0), exact_cylinder),
    ("ellipsoid", ELLIPSOID, 3, (0.05, 0.04, 0.03), exact_ellipsoid),
    ("unsorted", ELLIPSOID, 3, (0.03, 0.01, 0.07), exact_ellipsoid),
    ("lens", ELLIPSOID, 3, (0.05, 0.05, 0.00005), exact_ellipsoid),
    ("flake", ELLIPSOID, 3, (0.05, 0.00005, 0.03), exact_ellipsoid),
    ("needle", ELLIPSOID, 3, (0.00005, 0.05, 0.00005), exact_ellipsoid),
    ("nearly a sphere", ELLIPSOID, 3, (0.03, 0.03 * (1 + 1e-9), 0.03 * (1 - 1e-12)), exact_ellipsoid),
    ("ellipse", ELLIPSOID, 2, (0.05, 0.02, 0.0), exact_ellipsoid),
    ("thin ellipse", ELLIPSOID, 2, (0.00005, 0.05, 0.0), exact_ellipsoid),
]


def positions(kind: int, d: int, size: tuple[float, ...], rng: np.random.Generator) -> list[Array]:
    """All around, far off, within, and within 1e-12 ... 0.1 of the surface or of where nearest points meet."""
    e = np.array([1.0, 1.0, 1.0] if kind in (HALF_SPACE, PLANE) else (*size, 0.0, 0.0)[:3])
    if kind in (SPHERE, CAPSULE, CYLINDER):
        r, half = e[0], e[1]
        e = np.array([r + half, r, 0.0]) if d == 2 else np.array([r, r, half + r * (kind != CYLINDER)])
        if kind == SPHERE:
            e = np.full(3, r)
    found = [rng.normal(size=3) * e.max() * 10.0 ** rng.uniform(-1, 3) for _ in range(15)]
    found += [rng.normal(size=3) * e.max() for _ in range(15)]
    found += [rng.uniform(-1, 1, size=3) * e for _ in range(15)]
    for _ in range(15):
        p = rng.uniform(-1, 1, size=3) * e
        p[e == e.min()] *= 10.0 ** rng.uniform(-12, -1)
        found.append(p)
        u = rng.normal(size=3)
        _, c, n, _ = query(kind, d, size, u * e)
        found.append(c - n * e.max() * 10.0 ** rng.uniform(-12, -1) * rng.choice([-0.1, 1.0]))
    if kind == CYLINDER:  # outside the rims
        for _ in range(15):
            t = rng.uniform(0, 7)
            p = np.array([math.cos(t), math.sin(t), rng.choice([-1.0, 1.0])]) * e
            found.append(p * (1 + 10.0 ** rng.uniform(-13, -2, size=3) * [1, 1, 1]))
    for p in found:
        p[d:] = 0.0
    return found


@pytest.mark.parametrize(("kind", "d", "size", "oracle"), [row[1:] for row in EXACT], ids=[row[0] for row in EXACT])
def test_against_fifty_digits(kind: int, d: int, size: tuple[float, ...], oracle: Oracle) -> None:
    """Contact point and gap to 1e-15 of size or position, unit normals to 1e-15, at 75 or more positions a shape."""
    rng = np.random.default_rng(kind + 10 * d)
    worst = np.zeros(3)
    with mp.workdps(50):
        for p in positions(kind, d, size, rng):
            c, out = oracle([mpf(v) for v in (*size, 0.0, 0.0)[:3]], [mpf(v) for v in p.tolist()])
            height = [mpf(u) - v for u, v in zip(p.tolist(), c, strict=True)]
            inside = kind in (CYLINDER,) and math.hypot(p[0], p[1]) <= size[0] and abs(p[2]) <= size[1]
            level = -1 if inside else mp.sign(sum(u * v for u, v in zip(height, out, strict=True)))
            if kind in (SPHERE, CAPSULE):
                level = mp.sign(norm(out) - size[0])
            _, found, n, gap = query(kind, d, size, p, 0 if kind == PLANE else -1)
            scale = max(float(np.abs(p).max()), 1e-300 if kind in (HALF_SPACE, PLANE) else max(map(abs, size)))
            error = [max(abs(float(u - v)) for u, v in zip(c, found.tolist(), strict=True)) / scale]
            error.append(max(abs(float(-u / norm(out) - v)) for u, v in zip(out, n.tolist(), strict=True)))
            error.append(abs(float(level * norm(height) - mpf(gap))) / scale)
            worst = np.maximum(worst, error)
    print(f"{kind=} {d=} {size}: contact {worst[0]:.1e}, normal {worst[1]:.1e}, gap {worst[2]:.1e}")
    assert (worst < TOLERANCE).all(), worst


# Ellipsoids: where nearest points meet, and beyond -----------------------------------------------------------------


def test_ellipsoids_of_any_proportions_to_fifty_digits() -> None:
    """Axes 1 mm ... 1 m, a fifth of them nearly round, fingers near where nearest points meet and their rims."""
    rng = np.random.default_rng(12)
    worst = np.zeros(2)
    with mp.workdps(50):
        for _ in range(150):
            axes = 10.0 ** rng.uniform(-3, 0, size=3)
            if rng.random() < 0.2:
                axes[1] = axes[0] * (1 - 10.0 ** rng.uniform(-15, -1))
            k = int(np.argmin(axes))
            t = rng.normal(size=3)
            t[k] = 0.0
            p = (axes**2 - axes[k] ** 2) / axes * t / np.linalg.norm(t)
            p *= 1 + rng.choice([-1.0, 1.0]) * 10.0 ** rng.uniform(-17, 0)
            p[k] = axes[k] * 10.0 ** rng.uniform(-20, 1)
            c, out = exact_ellipsoid([mpf(e) for e in axes.tolist()], [mpf(v) for v in p.tolist()])
            _, found, n, _ = query(ELLIPSOID, 3, tuple(axes.tolist()), p)
            scale = max(axes.max(), np.abs(p).max())
            error = [max(abs(float(u - v)) for u, v in zip(c, found.tolist(), strict=True)) / scale]
            error.append(max(abs(float(-u / norm(out) - v)) for u, v in zip(out, n.tolist(), strict=True)))
            worst = np.maximum(worst, error)
    print(f"contact {worst[0]:.1e}, normal {worst[1]:.1e}")
    assert (worst < TOLERANCE).all()


@pytest.mark.parametrize("axes", [(0.05, 0.04, 0.03), (0.05, 0.03, 0.00005), (0.02, 0.001, 0.05)])
def test_on_the_middle_plane_of_an_ellipsoid_a_finger_keeps_its_side(axes: tuple[float, float, float]) -> None:
    """There c_i = e_i^2 p_i/(e_i^2 - e_3^2) along the longer semi-axes and the rest of |y| = 1 along the shortest."""
    rng = np.random.default_rng(1)
    k = int(np.argmin(axes))
    e = [mpf(v) for v in axes]
    worst, seen = 0.0, 0
    with mp.workdps(50):
        for _ in range(100):
            p = rng.uniform(-1, 1, size=3) * axes
            p[k] = rng.choice([0.0, -0.0, 1e-200, -1e-200])
            c = [mpf(0) if i == k else e[i] ** 2 * mpf(p[i]) / (e[i] ** 2 - e[k] ** 2) for i in range(3)]
            left = 1 - sum((u / v) ** 2 for u, v in zip(c, e, strict=True))
            if left < 0:
                continue
            seen += 1
            for face in (0, 1):
                c[k] = (1 - 2 * face) * e[k] * mp.sqrt(left)
                kept, found, n, gap = query(ELLIPSOID, 3, axes, p, face)
                assert kept == face
                worst = max(worst, *(abs(float(u - v)) for u, v in zip(c, found.tolist(), strict=True)))
                depth = norm([u - mpf(v) for u, v in zip(c, p.tolist(), strict=True)])
                worst = max(worst, abs(float(depth + mpf(gap))))
                assert abs(np.linalg.norm(n) - 1) < TOLERANCE
    assert seen > 20
    assert worst < TOLERANCE * max(axes)


def test_next_to_where_the_middle_plane_s_nearest_points_end() -> None:
    """The root of |y(s)| = 1 goes like a cube root at the focal ellipse's rim and 1e-140 ... 1e-3 off its plane.

    Semi-axes 1 and 1/2 have the rim at 3/4 to the last bit.
    """
    rng = np.random.default_rng(11)
    axes = (0.05, 0.04, 0.03)
    worst = 0.0
    with mp.workdps(50):
        for off in (1e-140, 1e-90, 1e-30, 1e-10, 1e-3):
            for x in (0.75, math.nextafter(0.75, 0.0), math.nextafter(0.75, 1.0)):
                c, _ = exact_ellipsoid([mpf(1), mpf(0.5), mpf(0)], [mpf(x), mpf(off), mpf(0)])
                found = query(ELLIPSOID, 2, (1.0, 0.5), (x, off, 0.0))[1]
                np.testing.assert_allclose(found, [float(v) for v in c], rtol=4e-16, atol=1e-17)
        for _ in range(40):
            t = rng.uniform(0, 7)
            rim = np.array([(e * e - 0.03**2) / e for e in axes[:2]]) * [math.cos(t), math.sin(t)]
            rim *= 1 - 10.0 ** rng.uniform(-15, -3)
            p = [*rim.tolist(), 10.0 ** rng.uniform(-140, -3)]
            c, _ = exact_ellipsoid([mpf(e) for e in axes], [mpf(v) for v in p])
            found = query(ELLIPSOID, 3, axes, p)[1]
            worst = max(worst, *(abs(float(u - v)) for u, v in zip(c, found.tolist(), strict=True)))
    assert worst < TOLERANCE * axes[0]


def test_beyond_the_middle_plane_to_fifty_digits() -> None:
    """The other local minimum, t in (-b^2, -c^2): bisection in 50 digits between its pole and the least of |y|."""
    rng = np.random.default_rng(2)
    worst, seen = np.zeros(2), 0
    with mp.workdps(50):
        for axes in ((0.05, 0.04, 0.03), (0.05, 0.03, 0.0005)):
            e = [mpf(v) for v in axes]
            apart = [(v - e[2]) * (v + e[2]) for v in e]
            for _ in range(60):
                p = rng.uniform(-1, 1, size=3) * [axes[0], axes[1], 0.02]
                q = [abs(mpf(v)) for v in p.tolist()]

                def y(s: Any, q: Exact = q, e: Exact = e, apart: Exact = apart) -> Exact:
                    return [a * u / (s + t) for a, u, t in zip(e, q, apart, strict=True)]

                def slope(s: Any, y: Any = y, apart: Exact = apart) -> Any:
                    return -sum(v * v / (s + t) for v, t in zip(y(s), apart, strict=True))

                low, high = -apart[1], mpf(0)
                for _ in range(170):
                    s = (low + high) / 2
                    low, high = (low, s) if slope(s) > 0 else (s, high)
                exists = norm(y(high)) < 1
                face = 1 if p[2] > 0 else 0
                kept, found, n, gap = query(ELLIPSOID, 3, axes, p, face)
                assert (kept == face) == exists
                if not exists:
                    assert kept == 1 - face
                    continue
                seen += 1
                low, high = high, mpf(0)
                for _ in range(170):
                    s = (low + high) / 2
                    low, high = (low, s) if norm(y(s)) > 1 else (s, high)
                c = [a * v * (-1 if u < 0 else 1) for a, v, u in zip(e, y(low), p.tolist(), strict=True)]
                depth = norm([u - mpf(v) for u, v in zip(c, p.tolist(), strict=True)])
                error = [max(abs(float(u - v)) for u, v in zip(c, found.tolist(), strict=True)) / axes[0]]
                error.append(abs(float(depth + mpf(gap))) / axes[0])
                worst = np.maximum(worst, error)
                np.testing.assert_allclose(p - found, -gap * n, atol=1e-16)
    assert seen > 25
    print(f"{seen} positions: contact {worst[0]:.1e}, gap {worst[1]:.1e}")
    assert (worst < TOLERANCE).all()


def test_an_ellipse_holds_a_finger_within_its_evolute() -> None:
    """(a x)^(2/3) + (b y)^(2/3) < (a^2 - b^2)^(2/3), its centres of curvature: there the other minimum exists."""
    rng = np.random.default_rng(3)
    a, b = 0.05, 0.01
    held = 0
    for _ in range(2000):
        x, y = rng.uniform(-1, 1, size=2) * [a, 0.24]
        share = (a * abs(x)) ** (2 / 3) + (b * abs(y)) ** (2 / 3) - (a * a - b * b) ** (2 / 3)
        for size, p in (((a, b), (x, y, 0.0)), ((b, a), (y, x, 0.0))):
            face = 1 if y > 0 else 0
            kept = query(ELLIPSOID, 2, size, p, face)[0]
            if abs(share) > 1e-9:
                assert (kept == face) == (share < 0)
            held += kept == face
    assert held > 300


# Persistence -------------------------------------------------------------------------------------------------------

THIN: list[tuple[str, int, int, tuple[float, ...], tuple[float, float], int]] = [
    ("plate", BOX, 3, (0.05, 0.04, 0.0005), (0.05, 0.04), 2),
    ("coin", CYLINDER, 3, (0.05, 0.0005), (0.034, 0.034), 2),
    ("lens", ELLIPSOID, 3, (0.05, 0.05, 0.0005), (0.03, 0.03), 2),
    ("flake", ELLIPSOID, 3, (0.05, 0.0005, 0.03), (0.03, 0.018), 1),
    ("strip", CAPSULE, 2, (0.0005, 0.05), (0.05, 0.0), 1),
    ("thin ellipse", ELLIPSOID, 2, (0.05, 0.0005), (0.045, 0.0), 1),
    ("sheet", PLANE, 3, (0.0, 0.0, 1.0), (1.0, 1.0), 2),
    ("floor", HALF_SPACE, 3, (0.0, 0.0, 1.0), (1.0, 1.0), 2),
]


@pytest.mark.parametrize(
    ("kind", "d", "size", "reach", "across"), [row[1:] for row in THIN], ids=[row[0] for row in THIN]
)
def test_a_finger_pressed_6_mm_through_a_thin_part_stays_on_its_side(
    kind: int, d: int, size: tuple[float, ...], reach: tuple[float, float], across: int
) -> None:
    """1 mm thick, 20 fingers from both sides, 6 mm deep, sliding at up to 1 m/s: 0 of 2940 samples on a wrong side."""
    rng = np.random.default_rng(4)
    wrong = ticks = 0
    lateral = [i for i in range(d) if i != across]
    for path in range(10):
        up = 1.0 if path % 2 == 0 or kind == HALF_SPACE else -1.0
        p = np.zeros(3)
        p[across] = up * 0.003
        face, c, n, gap = query(kind, d, size, p)
        for k in range(300):
            if k > 5:
                p[across] = up * (0.0005 - 0.006 * math.sin(0.05 * k) ** 2)
                step = rng.uniform(-0.005, 0.005, size=2)
                for i, (reached, by) in zip(lateral, zip(reach, step, strict=True), strict=False):
                    p[i] = np.clip(p[i] + by, -reached, reached)
            face, c, n, gap = query(kind, d, size, p, face, c)
            if k > 5:
                ticks += 1
                rim = p[across] * up > abs(c[across])  # off the rounded surface near its rim
                wrong += n[across] * up > -0.4 or (gap > 0) != rim
                np.testing.assert_allclose(p - c, -gap * n, atol=1e-16)
    assert (wrong, ticks) == (0, 10 * 294)


def test_a_cylinder_hands_over_between_mantle_and_caps_only_beyond_their_edges() -> None:
    size = (0.02, 0.05)
    # 1 mm inside the mantle, then nearer to the cap: still on the mantle; above the cap: on the cap
    face, c, n, gap = query(CYLINDER, 3, size, (0.019, 0.0, 0.0))
    assert (face, c.tolist(), n.tolist()) == (0, [0.02, 0.0, 0.0], [-1.0, 0.0, 0.0])
    face, _, _, gap = query(CYLINDER, 3, size, (0.01, 0.0, 0.0499), face, c)
    assert face == 0
    assert gap == pytest.approx(-0.01)
    face, c, n, gap = query(CYLINDER, 3, size, (0.01, 0.0, 0.0501), face, c)
    assert (face, c.tolist(), n.tolist()) == (1, [0.01, 0.0, 0.05], [0.0, 0.0, -1.0])
    # down through the whole length it stays on that cap; beyond the mantle it is outside that
    face, c, n, gap = query(CYLINDER, 3, size, (0.01, 0.005, -0.2), face, c)
    assert (face, c.tolist()) == (1, [0.01, 0.005, 0.05])
    assert gap == pytest.approx(-0.25)
    face, c, n, gap = query(CYLINDER, 3, size, (0.03, 0.0, 0.0), face, c)
    assert (face, c.tolist()) == (0, [0.02, 0.0, 0.0])
    assert gap == pytest.approx(0.01)
    assert query(CYLINDER, 3, size, (0.0, 0.01, -0.06), face, c)[0] == 2


def test_on_a_cylinder_the_kernel_is_the_exact_walk() -> None:
    """From every face: the nearest point of that face if the finger is behind it and within it, else the projection."""
    rng = np.random.default_rng(5)
    for size in ((0.02, 0.05), (0.05, 0.0005)):
        for _ in range(1000):
            p = rng.uniform(-1.5, 1.5, size=3) * [size[0], size[0], max(size[1], 0.01)]
            rho, face = math.hypot(p[0], p[1]), int(rng.integers(3))
            kept, _, n, gap = query(CYLINDER, 3, size, p, face)
            if rho > size[0] or abs(p[2]) > size[1]:
                behind = face > 0 and rho <= size[0] and p[2] * (3 - 2 * face) <= size[1]
                out = math.hypot(max(rho - size[0], 0), max(abs(p[2]) - size[1], 0))
                depth = size[1] - p[2] * (3 - 2 * face)
                assert gap == pytest.approx(-depth if behind else out, rel=1e-12)
                assert not behind or kept == face
            else:
                assert kept == face
                expected = size[0] - rho if face == 0 else size[1] - p[2] * (3 - 2 * face)
                assert gap == pytest.approx(-expected, rel=1e-12, abs=1e-17)
            assert abs(np.linalg.norm(n) - 1) < TOLERANCE


@pytest.mark.parametrize(
    ("kind", "size", "p", "before", "c"),
    [
        (CAPSULE, (0.01, 0.04), (0, 0, 0.02), (0.006, -0.008, 0.021), (0.006, -0.008, 0.02)),
        (CAPSULE, (0.01, 0.04), (0, 0, 0.04), (0.0, 0.006, 0.048), (0.0, 0.006, 0.048)),
        (CAPSULE, (0.01, 0.04), (0, 0, 0.01), (0.0, 0.0, 0.05), (0.01, 0.0, 0.01)),  # nothing known across: any
        (CYLINDER, (0.01, 0.04), (0, 0, 0.02), (0.006, -0.008, 0.021), (0.006, -0.008, 0.02)),
        (ELLIPSOID, (0.02, 0.05, 0.02), (0, 0.021, 0), (0.006, 0.03, -0.008), (0.0103923048, 0.025, -0.0138564065)),
        (ELLIPSOID, (0.02, 0.02, 0.02), (0, 0, 0), (0.0, 0.012, -0.016), (0.0, 0.012, -0.016)),
    ],
)
def test_where_many_points_are_nearest_the_finger_keeps_its_direction(
    kind: int, size: tuple[float, ...], p: tuple[float, ...], before: tuple[float, ...], c: tuple[float, ...]
) -> None:
    """On the axis; the ellipsoid's c_y = 0.05^2 0.021/(0.05^2 - 0.02^2) = 0.025, its radius there 0.02 sqrt(3)/2."""
    _, found, n, gap = query(kind, 3, size, p, 0, before)
    np.testing.assert_allclose(found, c, atol=1e-11)
    np.testing.assert_allclose(np.array(p) - found, -gap * n, atol=1e-16)
    assert gap < 0


def test_a_sheet_is_touched_from_both_sides_and_never_passed() -> None:
    for d in (1, 2, 3):
        normal = (1.0, 2.0, 3.0)[:d]
        shape = Plane(normal)
        n = np.array(normal) / np.linalg.norm(normal)
        above = shape.contact([0.01 * n])
        below = shape.contact([-0.01 * n])
        assert [*above.face, *below.face] == [0, 1]
        np.testing.assert_allclose([above.gap[0], below.gap[0]], [0.01, 0.01], rtol=1e-14)
        through = shape.contact([-2.0 * n], above.face, above.point)
        np.testing.assert_allclose(through.gap, [-2.0], rtol=1e-14)
        np.testing.assert_allclose(through.normal, [-n], rtol=1e-14)
        np.testing.assert_allclose(shape.contact([2.0 * n], below.face).normal, [n], rtol=1e-14)
        np.testing.assert_allclose(HalfSpace(normal).contact([-2.0 * n]).gap, [-2.0], rtol=1e-14)


# Continuity --------------------------------------------------------------------------------------------------------

SOLID: list[tuple[str, int, int, tuple[float, ...]]] = [
    ("box", BOX, 3, (0.025, 0.02, 0.01)),
    ("rectangle", BOX, 2, (0.025, 0.02)),
    ("capsule", CAPSULE, 3, (0.02, 0.03)),
    ("stadium", CAPSULE, 2, (0.02, 0.03)),
    ("cylinder", CYLINDER, 3, (0.03, 0.02)),
    ("ellipsoid", ELLIPSOID, 3, (0.05, 0.04, 0.03)),
    ("lens", ELLIPSOID, 3, (0.05, 0.05, 0.0005)),
    ("needle", ELLIPSOID, 3, (0.05, 0.0005, 0.0005)),
    ("ellipse", ELLIPSOID, 2, (0.05, 0.02)),
]


@pytest.mark.parametrize(("kind", "d", "size"), [row[1:] for row in SOLID], ids=[row[0] for row in SOLID])
def test_outside_the_contact_point_moves_no_faster_than_the_finger(kind: int, d: int, size: tuple[float, ...]) -> None:
    """A projection on a convex body is a contraction and the gap follows at most as fast, over rims and ends."""
    rng = np.random.default_rng(6)
    p = np.array([0.06, 0.0, 0.0])
    face, c, n, gap = query(kind, d, size, p)
    moved = 0
    for _ in range(4000):
        q = p + rng.normal(size=3) * 10.0 ** rng.uniform(-7, -2.5)
        q[d:] = 0.0
        now, new, turned, distance = query(kind, d, size, q, face, c)
        if distance <= 0 or np.abs(q).max() > 0.08:
            continue
        moved += 1
        step = float(np.linalg.norm(q - p))
        assert np.linalg.norm(new - c) <= step * (1 + 1e-12) + 1e-16
        assert abs(distance - gap) <= step * (1 + 1e-12) + 1e-16
        if min(gap, distance) > step:
            assert np.linalg.norm(turned - n) <= 2 * step / min(gap, distance) + 1e-15
        p, face, c, n, gap = q, now, new, turned, distance
    assert moved > 2000


def test_pressed_into_an_ellipsoid_the_contact_point_moves_smoothly_through_the_middle_plane() -> None:
    """Depth 0 ... 40 mm at x = 10 mm in semi-axes 50, 20 mm: |c'| stays below 1/(1 - depth curvature), no jump."""
    size, step = (0.05, 0.02), 1e-6
    face, c, _, _ = query(ELLIPSOID, 2, size, (0.01, 0.021, 0.0))
    largest = 0.0
    for k in range(42000):
        face, new, n, gap = query(ELLIPSOID, 2, size, (0.01, 0.021 - step * k, 0.0), face, c)
        assert face == 0
        u = new / [0.05, 0.02, 1.0]
        curvature = 0.05 * 0.02 / math.hypot(0.02 * u[0], 0.05 * u[1]) ** 3
        if k:
            rate = float(np.linalg.norm(new - c)) / step
            assert rate <= 1.001 * abs(n[0]) / (1 + gap * curvature) + 1e-9
            largest = max(largest, rate)
        c = new
    assert 0.05 < largest < 2.0


# Balls -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("shape", "grown"),
    [
        (Sphere(0.02), Sphere(0.025)),
        (Capsule(0.02, 0.06), Capsule(0.025, 0.06)),
        (HalfSpace((0.0, 0.6, 0.8)), None),
        (Plane((0.0, 0.6, 0.8)), None),
    ],
)
@pytest.mark.parametrize("d", [2, 3])
def test_a_ball_is_a_point_on_the_grown_shape(shape: Shape, grown: Shape | None, d: int) -> None:
    """Radius 5 mm: gap and e = p + r n - c of the ball are those of its centre on a shape 5 mm larger."""
    r, rng = 0.005, np.random.default_rng(7)
    if grown is None and d == 2:
        shape = type(shape)(shape.parameters[1:])  # type: ignore[call-arg]
    p = rng.normal(size=(200, d)) * 0.03
    ball, centre = shape.contact(p, radius=r), shape.contact(p)
    np.testing.assert_array_equal(ball.point, centre.point)
    np.testing.assert_allclose(ball.gap, centre.gap - r, atol=1e-17)
    e = p + r * ball.normal - ball.point
    np.testing.assert_allclose(e, -ball.gap[:, None] * ball.normal, atol=1e-16)
    if grown is not None:
        larger = grown.contact(p)
        np.testing.assert_allclose(ball.gap, larger.gap, atol=1e-17)
        np.testing.assert_allclose(e, p - larger.point, atol=1e-16)


def test_a_ball_that_just_touches_is_not_displaced() -> None:
    """5 mm from every kind of surface, edges and corners of a box among them: e = 0 and gap = 0 to rounding."""
    r, rng = 0.005, np.random.default_rng(8)
    for kind, size in ((BOX, (0.02, 0.03, 0.01)), (CYLINDER, (0.02, 0.03)), (ELLIPSOID, (0.02, 0.03, 0.01))):
        for _ in range(200):
            far = rng.normal(size=3) * 0.1
            face, c0, n, gap = query(kind, 3, size, far)
            if gap <= 0:
                continue
            p = c0 - r * n
            ball = closest_to_ball(kind, 3, vector(size), r, vector(p), face, vector(NONE))
            assert abs(ball.gap) < 1e-16
            e = p + r * np.array(list(numbers(ball.normal))) - np.array(list(numbers(ball.point)))
            assert np.abs(e).max() < 1e-15 * 0.1


# Kernels -----------------------------------------------------------------------------------------------------------


def everything() -> list[tuple[Any, ...]]:
    rng = np.random.default_rng(9)
    calls: list[tuple[Any, ...]] = []
    for _, kind, d, size, _ in EXACT:
        a, b, c = (*size, 0.0, 0.0)[:3]
        for p in positions(kind, d, size, rng):
            for face in (-1, 0, *((1,) if kind in (PLANE, ELLIPSOID) or (kind, d) == (CAPSULE, 2) else ())):
                calls.append((kind, d, a, b, c, 0.001, *p.tolist(), face, *rng.normal(size=3).tolist()))
    for face in (-1, 0, 1, 2):
        calls += [(CYLINDER, 3, 0.02, 0.01, 0.0, 0.0, *p, face, *NONE) for p in rng.normal(size=(100, 3)).tolist()]
        calls += [(BOX, 3, 0.02, 0.01, 0.03, 0.0, *p, face, *NONE) for p in rng.normal(size=(100, 3)).tolist()]
    return calls


def test_compiled_kernels_give_the_same_bits() -> None:
    kernel: Any = compiled(closest_to_ball)
    calls = everything()
    assert len(calls) > 3000
    for call in calls:
        assert tuple(kernel(*call)) == source_function(closest_to_ball)(*call)


def test_no_finite_position_raises_or_gives_something_that_is_not_a_number() -> None:
    """1e-320 ... 1e39 m in all directions, on axes and in planes: a unit normal always."""
    rng = np.random.default_rng(10)
    shapes: list[tuple[Shape, int]] = [
        (Sphere(0.03), 3), (Capsule(0.01, 0.05), 3), (Capsule(0.01, 0.05), 2), (Cylinder(0.02, 0.05), 3),
        (Ellipsoid((0.05, 0.04, 0.03)), 3), (Ellipsoid((0.05, 0.02)), 2), (Ellipsoid((1.0, 1e-6, 1e-6)), 3),
        (Ellipsoid((1e-6, 1e-9, 1e-6)), 3), (Ellipsoid((1e3, 2e3, 1e3)), 3), (HalfSpace((1.0, 1.0, 0.0)), 3),
    ]  # fmt: skip
    for shape, d in shapes:
        p = rng.normal(size=(600, d)) * 10.0 ** rng.uniform(-320, 39, size=(600, 1))
        p[::3] *= 10.0 ** rng.uniform(-100, 0, size=(200, d))
        p[::2] *= rng.integers(0, 2, size=(300, d))
        for face in range(-1, shape.faces(d)):
            found = shape.contact(p, np.full(600, face))
            assert np.isfinite(found.point).all()
            np.testing.assert_allclose(np.linalg.norm(found.normal, axis=1), 1.0, atol=1e-15)
            if isinstance(shape, Ellipsoid):
                on = np.linalg.norm(found.point / shape.semi_axes, axis=1)
                np.testing.assert_allclose(on, 1.0, atol=2e-15)
            assert not np.isnan(found.gap).any()
