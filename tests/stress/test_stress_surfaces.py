"""Contact with shapes and meshes, 1 um to 1 km: 50 digits, the nearest triangle, and the same bits in other units."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from mpmath import mp, mpf

from graspfx.surfaces.closed_form import proxy, shape
from graspfx.surfaces.triangles.mesh import make_mesh, new_fingers
from tests.support import exact_surfaces as exact
from tests.support.brute_force import brute_force
from tests.support.families import efforts, family
from tests.support.meshes import SHAPES
from tests.support.scatter import decades

NEAREST = family("shapes: contact point, normal, gap", "50 digits, of the larger of size and distance")
UNITS = family("shapes: other units", "the same bits")
MESHES = family(
    "meshes: gap of a new finger", "the nearest of all triangles in long double, of the larger of size and distance"
)
PATHS = family("meshes: other units, along a path", "the same bits")

ORACLES = {
    proxy.SPHERE: exact.exact_sphere,
    proxy.CAPSULE: exact.exact_capsule,
    proxy.CYLINDER: exact.exact_cylinder,
    proxy.ELLIPSOID: exact.exact_ellipsoid,
    proxy.HALF_SPACE: exact.exact_flat,
}


def random_shape(rng: np.random.Generator) -> shape.Shape:
    """In space, 1 um to 1 km, up to a thousand times longer than thick."""
    a, b, c = decades(rng, 1e-6, 1e3) * np.exp(rng.uniform(np.log(1e-3), 0.0, 3))
    kind = int(rng.integers(5))
    if kind == 0:
        return shape.Sphere(a)
    if kind == 1:
        return shape.HalfSpace(tuple(rng.normal(size=3)))
    if kind == 2:
        return shape.Ellipsoid((a, b, c))
    return (shape.Capsule, shape.Cylinder)[kind - 3](a, b)


@efforts(short=60, full=1500)
def test_shapes_against_fifty_digits(cases: int) -> None:
    rng = np.random.default_rng(41)
    for case in range(cases):
        made = random_shape(rng)
        reach = max(made.parameters)
        p = reach * rng.normal(size=3) * decades(rng, 1e-3, 1e2)
        found = made.contact(p[None])
        with mp.workdps(50):
            c, u = ORACLES[made.kind]([mpf(v) for v in made.parameters], [mpf(v) for v in p.tolist()])
            length = exact.norm(u)
            point = [float(mpf(a) - b) for a, b in zip(found.point[0].tolist(), c, strict=True)]
            gap = exact.norm([mpf(a) - b for a, b in zip(p.tolist(), c, strict=True)])
            normal = [float(b / length) for b in u]
        scale = max(reach if made.kind != proxy.HALF_SPACE else 0.0, float(np.abs(p).max()))
        label = f"case {case}: {made}, p = {p / reach} of its size"
        NEAREST.check(float(np.abs(point).max()) / scale, 1e-15, label)
        NEAREST.check(abs(abs(float(found.gap[0])) - float(gap)) / scale, 1e-15, label)
        # a normal turns as fast as the curvature says: 1e3 for what is a thousand times longer than thick
        sideways = float(np.linalg.norm(np.cross(found.normal[0], normal)))
        thin = min(v for v in made.parameters if v > 0.0) if made.kind != proxy.HALF_SPACE else 1.0
        NEAREST.check(sideways, 1e-15 * max(1.0, scale / thin) ** 2, label)


@efforts(short=100, full=8000)
def test_shapes_in_other_units(cases: int) -> None:
    rng = np.random.default_rng(42)
    for case in range(cases):
        d, kind = 3, int(rng.integers(7))
        sizes = tuple(decades(rng, 1e-3, 1e-1) for _ in range(3))
        if kind in (proxy.HALF_SPACE, proxy.PLANE):
            sizes = shape.HalfSpace(tuple(rng.normal(size=3))).normal
        p, before = 0.1 * rng.normal(size=3), 0.1 * rng.normal(size=3)
        radius, unit = 0.01 * float(rng.random() < 0.5), 2.0 ** int(rng.integers(-15, 15))
        closest: Any = proxy.closest_to_ball
        here = closest(kind, d, *sizes, radius, *p, -1, *before)
        other = sizes if kind in (proxy.HALF_SPACE, proxy.PLANE) else tuple(unit * size for size in sizes)
        there = closest(kind, d, *other, unit * radius, *(unit * p), -1, *(unit * before))
        scaled = np.array(here) * [1.0, unit, unit, unit, 1.0, 1.0, 1.0, unit]
        UNITS.check(
            0.0 if np.array_equal(scaled, there) else 1.0, 0.0, f"case {case}: kind {kind}, {sizes}, p {p}, {unit}"
        )


@pytest.mark.parametrize("name", sorted(SHAPES))
@efforts(short=2, full=60)
def test_meshes_at_every_size(name: str, cases: int) -> None:
    rng = np.random.default_rng([43, len(name)])
    v, f = SHAPES[name]()
    size = float(np.ptp(v, axis=0).max())
    small = make_mesh(v, f)
    for case in range(cases):
        unit, away = 2.0 ** int(rng.integers(-16, 14)), 1e3 * rng.normal(size=3) * (case % 3 == 2)
        made = make_mesh(unit * v + away, f)
        label = f"{name}, case {case}: {unit * size:.1e} m, {np.linalg.norm(away):.1e} m away"
        p = v.mean(axis=0) + size * rng.normal(size=(3, 3)) * 10.0 ** rng.uniform(-2, 1)
        state, other, start = new_fingers(3), new_fingers(3), made.contact(unit * p + away)
        for i in range(3):
            nearest = float(brute_force(made.vertices, made.faces, unit * p[i] + away)[1])
            scale = max(unit * size, nearest, float(np.abs(unit * p[i] + away).max()))
            MESHES.check(abs(abs(float(start.gap[i])) - nearest) / scale, 1e-15, label)
        if away.any():
            continue
        for _ in range(20):  # a path through the surface and out again
            p = p + 0.05 * size * rng.normal(size=p.shape)
            here, there = small.contact(p, state), made.contact(unit * p, other)
            same = np.array_equal(unit * here.point, there.point) and np.array_equal(here.normal, there.normal)
            PATHS.check(0.0 if same and np.array_equal(unit * here.gap, there.gap) else 1.0, 0.0, label)
