"""Singular values of grasps whose closed forms are known, their units, and the ellipsoid against sampled forces."""

from __future__ import annotations

import numpy as np
import pytest

import graspfx as gx
from graspfx.errors import InputError
from tests.support.grasps import polygon

CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
SOLIDS = {
    "tetrahedron": CORNERS[CORNERS.prod(axis=1) > 0],
    "octahedron": np.vstack([np.eye(3), -np.eye(3)]),
    "cube": CORNERS,
}


@pytest.mark.parametrize("n", [3, 4, 7])
def test_regular_polygon_is_isotropic(n):
    # moments in units of R make all three singular values sqrt n: isotropy 1, volume n^(3/2)
    found = gx.Grasp(polygon(n, 0.04) + 0.3).measures()
    assert np.allclose(found.singular_values, np.sqrt(n), rtol=1e-13)
    assert np.isclose(found.isotropy, 1.0, rtol=1e-13) and np.isclose(found.volume, n**1.5, rtol=1e-13)
    assert np.isclose(found.length, 0.04, rtol=1e-13)


@pytest.mark.parametrize("solid", SOLIDS)
def test_regular_solids(solid):
    # {sqrt n three times, sqrt(2n/3) three times}: isotropy sqrt(2/3), volume n^3 (2/3)^(3/2)
    points = SOLIDS[solid]
    n = len(points)
    found = gx.Grasp(0.03 * points).measures()
    assert np.allclose(found.singular_values, np.sqrt(n) * np.repeat([1.0, np.sqrt(2 / 3)], 3), rtol=1e-13)
    assert np.isclose(found.isotropy, np.sqrt(2 / 3), rtol=1e-13)
    assert np.isclose(found.volume, n**3 * (2 / 3) ** 1.5, rtol=1e-12)
    assert np.isclose(found.minimum, np.sqrt(2 * n / 3), rtol=1e-13)


def test_two_hard_fingers_cannot_turn_the_object_about_their_line():
    # sqrt 2 five times and an exact zero, whose direction is the moment about the line
    points = np.random.default_rng(0).normal(size=(2, 3))
    found = gx.Grasp(points).measures()
    u = (points[1] - points[0]) / np.linalg.norm(points[1] - points[0])
    assert np.allclose(found.singular_values[:5], np.sqrt(2), rtol=1e-13)
    assert (found.singular_values[5], found.isotropy, found.volume, found.minimum) == (0.0, 0.0, 0.0, 0.0)
    assert np.isclose(abs(found.directions[3:, 5] @ u), 1.0, rtol=1e-13)


def test_two_soft_fingers_turn_it_by_their_torsion():
    # torsion l against arms R: the smallest singular value is sqrt 2 l/R, so the isotropy is l/R
    points = np.array([[-0.02, 0.0, 0.0], [0.02, 0.0, 0.0]])
    grasp = gx.Grasp(points, -points, model="soft")
    assert np.isclose(grasp.measures(torsion_length=0.005).isotropy, 0.25, rtol=1e-13)
    assert np.isclose(grasp.measures().isotropy, 1.0, rtol=1e-13)


def test_line_has_one_singular_value():
    found = gx.Grasp([[0.0], [1.0], [2.0]]).measures()
    assert np.allclose(found.singular_values, [np.sqrt(3)], rtol=1e-15)
    assert found.isotropy == 1.0


def test_locked_object_has_none():
    found = gx.Grasp(polygon(3, 1.0), free=[False] * 3).measures()
    assert (len(found.singular_values), found.isotropy, found.minimum, found.volume) == (0, 0.0, 0.0, 1.0)


def test_knob_is_measured_about_its_own_axis():
    # only the rotation is free: sigma = sqrt(sum |c_i - o|^2)/L, not that about the contacts' centroid
    points = polygon(4, 0.02) + np.array([0.01, 0.0])
    found = gx.Grasp(points, free=[False, False, True]).measures(length=0.02)
    assert np.isclose(found.minimum, np.sqrt((points**2).sum()) / 0.02, rtol=1e-13)


def test_values_belong_to_the_definition():
    # against the eigenvalues of G_s G_s', G about the point given and scaled by hand
    rng = np.random.default_rng(1)
    points, normals, about = rng.normal(size=(4, 3)), rng.normal(size=(4, 3)), rng.normal(size=3)
    grasp = gx.Grasp(points, normals, model=["hard", "soft", "full", "frictionless"], origin=about)
    G = grasp.matrix * np.where(grasp.torsion_columns, 0.1, 1.0)
    G[3:] /= 0.7
    found = grasp.measures(length=0.7, about=about, torsion_length=0.1)
    assert np.allclose(found.singular_values**2, np.linalg.eigvalsh(G @ G.T)[::-1], rtol=1e-11)
    assert np.isclose(found.volume, np.sqrt(np.linalg.det(G @ G.T)), rtol=1e-11)


def test_ellipsoid_against_sampled_forces():
    # |f| <= 1 makes w with sum (d_k.w/sigma_k)^2 <= 1, and comes near to it: 20 000 forces in 6 dimensions
    rng = np.random.default_rng(2)
    grasp = gx.Grasp(polygon(3, 0.05))
    found = grasp.measures()
    f = rng.normal(size=(20000, 6))
    f /= np.linalg.norm(f, axis=1)[:, None]
    w = f @ grasp.matrix.T / np.array([1.0, 1.0, 0.05])
    levels = ((w @ found.directions / found.singular_values) ** 2).sum(axis=1)
    assert levels.max() <= 1.0 + 1e-12 and levels.max() > 0.99


def test_measures_do_not_depend_on_the_unit_or_the_frame():
    rng = np.random.default_rng(3)
    points = rng.normal(size=(4, 3))
    Q = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    there = gx.Grasp(points).measures()
    here = gx.Grasp(1000.0 * (points @ Q.T + 5.0), origin=rng.normal(size=3)).measures()
    assert np.allclose(here.singular_values, there.singular_values, rtol=1e-12)


def test_refuses_lengths_that_are_none():
    grasp = gx.Grasp(polygon(3, 1.0))
    for length in (0.0, -1.0, np.nan, np.inf):
        with pytest.raises(InputError, match="length"):
            grasp.measures(length=length)
    with pytest.raises(InputError, match="all contacts coincide"):
        gx.Grasp(np.zeros((2, 3))).measures()
    with pytest.raises(InputError, match="about"):
        grasp.measures(about=[0.0, 0.0, 0.0])
