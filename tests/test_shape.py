"""Boxes and spheres: what they hand to the kernel, their moments of inertia, and what they refuse."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.integrate import quad

from graspfx.errors import InputError
from graspfx.objects.proxy import BOX, SPHERE
from graspfx.objects.shape import Box, Sphere


def test_parameters() -> None:
    """A box is given by full edges and computed with half ones."""
    assert (Box((0.05,)).kind, Box((0.05,)).parameters) == (BOX, (0.025, 0.0, 0.0))
    assert Box((0.05, 0.04)).parameters == (0.025, 0.02, 0.0)
    assert Box((0.05, 0.04, 0.03)).parameters == (0.025, 0.02, 0.015)
    assert (Sphere(0.02).kind, Sphere(0.02).parameters) == (SPHERE, (0.02, 0.0, 0.0))
    assert Box([0.05, 0.04]) == Box(np.array([0.05, 0.04]))  # type: ignore[arg-type]


def test_dimensions() -> None:
    assert [Box((1.0, 1.0)).dimensions_ok(d) for d in (1, 2, 3)] == [False, True, False]
    assert [Sphere(1.0).dimensions_ok(d) for d in (0, 1, 2, 3, 4)] == [False, True, True, True, False]


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


@pytest.mark.parametrize("size", [(), (0.0,), (-1.0, 1.0), (1.0, np.nan), (1.0, np.inf), (1, 1, 1, 1), ("a",), 0.05])
def test_a_box_that_cannot_be(size: Any) -> None:
    with pytest.raises(InputError, match="size"):
        Box(size)


@pytest.mark.parametrize("radius", [0.0, -1.0, np.nan, np.inf, "a", None])
def test_a_sphere_that_cannot_be(radius: Any) -> None:
    with pytest.raises(InputError, match="radius"):
        Sphere(radius)


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
