"""Shapes: what they hand to the kernel, their moments of inertia, and what they refuse."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy.integrate import quad

from graspfx.errors import InputError
from graspfx.surfaces.closed_form.proxy import BOX, CAPSULE, CYLINDER, ELLIPSOID, HALF_SPACE, PLANE, SPHERE
from graspfx.surfaces.closed_form.shape import Box, Capsule, Cylinder, Ellipsoid, HalfSpace, Plane, Shape, Sphere


def test_parameters() -> None:
    """A box is given by full edges and computed with half ones."""
    assert (Box((0.05,)).kind, Box((0.05,)).parameters) == (BOX, (0.025, 0.0, 0.0))
    assert Box((0.05, 0.04)).parameters == (0.025, 0.02, 0.0)
    assert Box((0.05, 0.04, 0.03)).parameters == (0.025, 0.02, 0.015)
    assert (Sphere(0.02).kind, Sphere(0.02).parameters) == (SPHERE, (0.02, 0.0, 0.0))
    assert Box([0.05, 0.04]) == Box(np.array([0.05, 0.04]))  # type: ignore[arg-type]


def test_parameters_of_the_other_shapes() -> None:
    """Half lengths, semi-axes, unit normals however long the given one is."""
    assert (Capsule(0.01, 0.06).kind, Capsule(0.01, 0.06).parameters) == (CAPSULE, (0.01, 0.03, 0.0))
    assert (Cylinder(0.01, 0.06).kind, Cylinder(0.01, 0.06).parameters) == (CYLINDER, (0.01, 0.03, 0.0))
    assert (Ellipsoid((0.3, 0.2)).kind, Ellipsoid((0.3, 0.2)).parameters) == (ELLIPSOID, (0.3, 0.2, 0.0))
    assert (HalfSpace((3.0, 4.0)).kind, Plane((3.0, 4.0)).kind) == (HALF_SPACE, PLANE)
    for normal in ((3.0, 4.0), (3e-300, 4e-300), (3e307, 4e307)):
        np.testing.assert_allclose(Plane(normal).parameters, (0.6, 0.8, 0.0), rtol=2e-16)


@pytest.mark.parametrize(
    ("shape", "exists", "faces"),
    [
        (Box((1.0, 1.0)), (2,), (4,)),
        (Sphere(1.0), (1, 2, 3), (2, 1, 1)),
        (HalfSpace((0.0, 1.0)), (2,), (1,)),
        (Plane((0.0, 0.0, 1.0)), (3,), (2,)),
        (Capsule(1.0, 1.0), (2, 3), (2, 1)),
        (Cylinder(1.0, 1.0), (3,), (3,)),
        (Ellipsoid((1.0, 2.0)), (2,), (2,)),
    ],
)
def test_dimensions_and_faces(shape: Shape, exists: tuple[int, ...], faces: tuple[int, ...]) -> None:
    assert tuple(d for d in range(5) if shape.dimensions_ok(d)) == exists
    assert tuple(shape.faces(d) for d in exists) == faces


def test_inertia_of_boxes_by_integration() -> None:
    """integral of x^2 dm over an edge a is m a^2/12; a 50 mm, 0.1 kg cube has 4.1667e-5 kg m^2."""
    a, b, c, m = 0.05, 0.03, 0.02, 0.1
    xx, yy, zz = (quad(lambda s, e=e: m * s * s / e, -e / 2, e / 2)[0] for e in (a, b, c))
    np.testing.assert_allclose(Box((a, b, c)).inertia(m, 3), [yy + zz, zz + xx, xx + yy], rtol=1e-14)
    np.testing.assert_allclose(Box((a, b)).inertia(m, 2), [0.0, 0.0, xx + yy], rtol=1e-14)
    np.testing.assert_allclose(Box((0.05, 0.05)).inertia(0.1, 2)[2], 4.1666666666666667e-5, rtol=1e-14)
    assert not Box((a,)).inertia(m, 1).any()


def test_inertia_of_spheres_by_integration() -> None:
    """Shells: a sphere's moment is 2/3 of the integral of r^2 dm, a disc's all of it."""
    r, m = 0.03, 0.2
    ball = quad(lambda s: 2 / 3 * s * s * m * 3 * s * s / r**3, 0, r)[0]
    disc = quad(lambda s: s * s * m * 2 * s / r**2, 0, r)[0]
    np.testing.assert_allclose(Sphere(r).inertia(m, 3), np.full(3, ball), rtol=1e-13)
    np.testing.assert_allclose(Sphere(r).inertia(m, 2), [0.0, 0.0, disc], rtol=1e-13)
    assert not Sphere(r).inertia(m, 1).any()


def turned(width: Callable[[float], float], half: float) -> tuple[float, float]:
    """Moments over the mass of a solid turned about z, radius width(z) over |z| <= half: across z, about z.

    Discs: integral of w^4/4 + z^2 w^2, and of w^4/2, over that of w^2.
    """
    mass, across, along = (
        2.0 * quad(f, 0.0, half, epsabs=0.0, epsrel=1e-13, limit=200)[0]
        for f in (
            lambda z: width(z) ** 2,
            lambda z: width(z) ** 4 / 4.0 + (z * width(z)) ** 2,
            lambda z: width(z) ** 4 / 2.0,
        )
    )
    return across / mass, along / mass


def flat(width: Callable[[float], float], half: float) -> float:
    """Moment over the mass of a plate |y| <= width(x) over |x| <= half: integral of 2 w (x^2 + w^2/3)."""
    mass, moment = (
        quad(f, 0.0, half, epsabs=0.0, epsrel=1e-12, limit=200)[0]
        for f in (lambda x: width(x), lambda x: width(x) * (x * x + width(x) ** 2 / 3.0))
    )
    return moment / mass


@pytest.mark.parametrize(("r", "L"), [(0.01, 0.06), (0.05, 0.002), (0.03, 0.03)])
def test_inertia_of_bars_by_integration(r: float, L: float) -> None:
    def rounded(x: float) -> float:
        return math.sqrt(max(r * r - max(x - L / 2, 0.0) ** 2, 0.0))

    m = 0.2
    across, along = turned(rounded, L / 2 + r)
    np.testing.assert_allclose(Capsule(r, L).inertia(m, 3), np.array([across, across, along]) * m, rtol=1e-9)
    np.testing.assert_allclose(Capsule(r, L).inertia(m, 2), [0.0, 0.0, flat(rounded, L / 2 + r) * m], rtol=1e-9)
    across, along = turned(lambda z: r, L / 2)
    np.testing.assert_allclose(Cylinder(r, L).inertia(m, 3), np.array([across, across, along]) * m, rtol=1e-13)


def test_inertia_of_ellipsoids_by_integration() -> None:
    """integral of x^2 dm by slices across each axis, of area proportional to 1 - (x/e)^2; an ellipse as a plate."""
    m, axes = 0.3, (0.05, 0.02, 0.03)
    xx, yy, zz = (quad(lambda s, e=e: 0.75 * m / e * s * s * (1 - (s / e) ** 2), -e, e)[0] for e in axes)
    np.testing.assert_allclose(Ellipsoid(axes).inertia(m, 3), [yy + zz, zz + xx, xx + yy], rtol=1e-13)
    np.testing.assert_allclose(Ellipsoid((0.03, 0.03, 0.03)).inertia(m, 3), Sphere(0.03).inertia(m, 3), rtol=1e-14)
    moment = flat(lambda x: 0.02 * math.sqrt(1 - (x / 0.05) ** 2), 0.05)
    np.testing.assert_allclose(Ellipsoid((0.05, 0.02)).inertia(m, 2), [0.0, 0.0, moment * m], rtol=1e-9)


@pytest.mark.parametrize("shape", [HalfSpace((0.0, 1.0)), Plane((0.0, 1.0))])
def test_a_shape_without_end_has_no_inertia(shape: Shape) -> None:
    assert shape.endless
    with pytest.raises(InputError, match="bounded shape"):
        shape.inertia(1.0, 2)


def test_contact_of_several_fingers() -> None:
    """A finger 5 mm outside +x and one 3 mm inside -y of a 50 mm square."""
    found = Box((0.05, 0.05)).contact([[0.03, 0.01], [0.002, -0.022]])
    np.testing.assert_array_equal(found.face, [0, 3])
    np.testing.assert_allclose(found.point, [[0.025, 0.01], [0.002, -0.025]], atol=1e-18)
    np.testing.assert_array_equal(found.normal, [[-1, 0], [0, 1]])
    np.testing.assert_allclose(found.gap, [0.005, -0.003], atol=1e-17)


def test_contact_remembers_the_face_that_it_is_given() -> None:
    """49 mm behind +x, 1 mm before -x: still on +x."""
    box = Box((0.05, 0.05))
    assert box.contact([[-0.024, 0.0]]).face == [1]
    held = box.contact([[-0.024, 0.0]], faces=[0])
    np.testing.assert_allclose(held.point, [[0.025, 0.0]], atol=0)
    np.testing.assert_allclose(held.gap, [-0.049], rtol=1e-15)


def test_contact_at_the_centre_of_a_sphere_keeps_its_direction() -> None:
    found = Sphere(0.02).contact([[0.0, 0.0, 0.0]], previous=[[0.0, 0.012, 0.016]])
    np.testing.assert_allclose(found.point, [[0.0, 0.012, 0.016]], rtol=1e-15)
    np.testing.assert_allclose(found.normal, [[0.0, -0.6, -0.8]], atol=1e-15)


@pytest.mark.parametrize(
    ("kind", "given", "name"),
    [
        *((Box, (size,), "size") for size in ((), (0.0,), (-1.0, 1.0), (1.0, np.nan), (1.0, np.inf), (1, 1, 1, 1))),
        *((Box, (size,), "size") for size in (("a",), 0.05)),
        *((Sphere, (radius,), "radius") for radius in (0.0, -1.0, np.nan, np.inf, "a", None)),
        (Capsule, (0.0, 1.0), "radius"),
        (Capsule, (1.0, -1.0), "length"),
        (Cylinder, (math.nan, 1.0), "radius"),
        (Cylinder, (1.0, "long"), "length"),
        (Ellipsoid, ((1.0,),), "semi_axes"),
        (Ellipsoid, ((1.0, 0.0),), "semi_axes"),
        (Ellipsoid, ((1.0, 1e-7),), "semi_axes"),
        (Ellipsoid, (1.0,), "semi_axes"),
        (HalfSpace, ((0.0, 0.0),), "normal"),
        (HalfSpace, ((),), "normal"),
        (Plane, ((1.0, math.inf),), "normal"),
        (Plane, ((1.0, 0.0, 0.0, 0.0),), "normal"),
        (Plane, ("up",), "normal"),
    ],
)
def test_shapes_that_cannot_be(kind: Any, given: tuple[Any, ...], name: str) -> None:
    with pytest.raises(InputError, match=name):
        kind(*given)


def test_contacts_that_cannot_be() -> None:
    box = Box((0.05, 0.05))
    with pytest.raises(InputError, match="dimensions"):
        box.contact([[0.0, 0.0, 0.0]])
    with pytest.raises(InputError, match="dimensions"):
        box.inertia(0.1, 3)
    with pytest.raises(InputError, match="points"):
        box.contact([[np.nan, 0.0]])
    with pytest.raises(InputError, match="points"):
        box.contact([0.0, 0.0])
    with pytest.raises(InputError, match="faces"):
        box.contact([[0.0, 0.0]], faces=[4])
    with pytest.raises(InputError, match="previous"):
        box.contact([[0.0, 0.0]], previous=[[0.0, 0.0, 0.0]])
    with pytest.raises(InputError, match="radius"):
        box.contact([[0.0, 0.0]], radius=-1.0)
    with pytest.raises(InputError, match="faces"):
        Cylinder(1.0, 1.0).contact([[0.0, 0.0, 0.0]], faces=[3])
    with pytest.raises(InputError, match="dimensions"):
        Cylinder(1.0, 1.0).contact([[0.0, 0.0]])
