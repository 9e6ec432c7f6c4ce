"""Named coordinates of internal forces: in the null space, independent, complete, and meaning what they say."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

import graspfx as gx
from graspfx.errors import InputError
from tests.support.grasps import polygon

MODELS = ["frictionless", "hard", "soft", "full"]


def split_of(grasp):
    return grasp.split(grasp.metric(torsion_length=0.006) if grasp.torsion_columns.any() else None)


def check(grasp):
    """Null space, independence, number, and that they carry every internal force; returns the coordinates."""
    split = split_of(grasp)
    found = split.internal_coordinates()
    B, G = found.basis, grasp.matrix
    m = len(grasp.finger_of_column)
    assert B.shape == (m, m - split.rank) and len(found.names) == len(set(found.names)) == len(found.units)
    # a column's wrench is a sum of its own terms, each rounded once
    assert (np.abs(G @ B) <= 1e-15 * (np.abs(G) @ np.abs(B) + np.abs(B).sum(axis=0))).all()
    assert found.condition < 1e3
    f = np.random.default_rng(m).normal(size=(3, m))
    internal = split.divide(f)[1]
    assert np.abs(found.force(found.of(f)) - internal).max() < 1e-11 * np.abs(internal).max() + 1e-14
    y = np.random.default_rng(m).normal(size=len(found.names))
    assert np.allclose(found.of(found.force(y)), y, rtol=1e-11, atol=1e-12)
    return found


@pytest.mark.parametrize("d", [1, 2, 3])
@pytest.mark.parametrize("n", [2, 3, 5, 9])
def test_tensions_span_the_internal_forces_of_point_contacts(d, n):
    # n - 1 on a line, 2n - 3 in the plane, 3n - 6 in space (1 for two fingers)
    found = check(gx.Grasp(0.05 * np.random.default_rng(10 * d + n).normal(size=(n, d))))
    assert len(found.names) == {1: n - 1, 2: 2 * n - 3, 3: max(3 * n - 6, 1)}[d]
    assert all(name.startswith("tension") for name in found.names) and set(found.units) == {"N"}


@pytest.mark.parametrize("seed", range(20))
def test_every_other_tension_is_a_combination_with_small_coefficients(seed):
    rng = np.random.default_rng(seed)
    n = 6
    points = rng.normal(size=(n, 3))
    found = gx.Grasp(points).split().internal_coordinates()
    for i, j in combinations(range(n), 2):
        u = (points[j] - points[i]) / np.linalg.norm(points[j] - points[i])
        f = np.zeros((n, 3))
        f[i], f[j] = u, -u
        assert np.abs(found.of(f.ravel())).max() <= 1.0 + 1e-8


def test_two_fingers_read_half_the_difference_along_their_line():
    # pushing towards one another is positive: 3 N and 5 N squeeze with 4 N and leave 2 N to the object
    grasp = gx.Grasp([[0.0, 0.0, 0.0], [0.0, 0.04, 0.0]])
    read = grasp.split().internal_coordinates(["thumb", "forefinger"]).named([0.0, 3.0, 0.0, 1.0, -5.0, 0.0])
    assert read == {"tension thumb-forefinger": pytest.approx(4.0, rel=1e-15)}


def test_three_fingers_squeeze_a_disc():
    # each pushes inwards with 1 N: two strings at 30 degrees make 2 t cos 30 = 1, t = 1/sqrt 3. The Gram matrix of the
    # unit columns is 1 on and 1/4 off the diagonal, so the condition is sqrt(1.5/0.75)
    points = polygon(3, 0.03)
    found = check(gx.Grasp(points))
    assert found.names == ("tension 1-2", "tension 1-3", "tension 2-3")
    assert np.allclose(found.of(-points.ravel() / 0.03), 1 / np.sqrt(3), rtol=1e-14)
    assert np.isclose(found.condition, np.sqrt(2), rtol=1e-13)


@pytest.mark.parametrize(("d", "a", "n"), [(1, 0, 2), (2, 0, 3), (2, 1, 4), (3, 0, 2), (3, 1, 3), (3, 1, 5), (3, 2, 6)])
def test_bendings_complete_what_tensions_leave(d, a, n):
    # contacts that span a of d dimensions: (d - a)(n - a - 1) forces across what they span
    rng = np.random.default_rng(100 * d + 10 * a + n)
    points = rng.normal(size=(n, a)) @ np.linalg.qr(rng.normal(size=(d, d)))[0][:a] + rng.normal(size=d)
    found = check(gx.Grasp(points))
    assert sum(name.startswith("bending") for name in found.names) == (d - a) * (n - a - 1)
    assert all(name.startswith(("bending", "tension")) for name in found.names)


def test_plate_bent_by_four_fingers():
    # up at two opposite corners and down at the other two, 1 N each: no tension, one bending of 1 N
    points = np.column_stack([polygon(4, 0.03), np.full(4, 0.1)])
    f = np.array([[0.0, 0.0, s] for s in (1, -1, 1, -1)])
    found = check(gx.Grasp(points))
    y = found.named(f.ravel())
    bending = [name for name in y if name.startswith("bending")]
    assert bending == ["bending 4: 1-3-2 along z"]
    assert np.isclose(y.pop(bending[0]), -1.0, rtol=1e-14) and np.abs(list(y.values())).max() < 1e-14


def test_soft_pair_twists_against_itself():
    points = np.array([[-0.02, 0.0, 0.0], [0.02, 0.0, 0.0]])
    found = check(gx.Grasp(points, -points, model="soft"))
    assert found.names == ("tension 1-2", "torsion 2 against 1") and found.units == ("N", "N m")
    # both normals point inwards: equal torsions about them are opposite moments
    assert np.allclose(found.basis[:, 1], [0, 0, 0, 1, 0, 0, 0, 1], atol=1e-15)


def test_soft_triple_holds_a_torsion_by_its_forces():
    # 1 N m about x at the finger on the x axis needs forces across the plane, the least of them 1/(sum y_i^2) y_i
    points = np.column_stack([polygon(3, 0.03), np.zeros(3)])
    found = check(gx.Grasp(points, -points, model="soft"))
    assert found.names[3:] == ("torsion 1", "torsion 2", "torsion 3")
    column = found.basis[:, 3].reshape(3, 4)
    assert np.allclose(column[:, 3], [1.0, 0.0, 0.0], atol=1e-14)  # about -x, the normal
    assert np.allclose(column[:, 2], points[:, 1] / (points[:, 1] ** 2).sum(), rtol=1e-13, atol=1e-13)


@pytest.mark.parametrize("seed", range(40))
def test_any_models_any_freedoms(seed):
    rng = np.random.default_rng(seed)
    n, d = int(rng.integers(1, 7)), int(rng.integers(1, 4))
    points, normals = rng.normal(size=(n, d)), rng.normal(size=(n, d))
    free = rng.random({1: 1, 2: 3, 3: 6}[d]) < 0.8
    check(gx.Grasp(points, normals, model=[str(x) for x in rng.choice(MODELS, size=n)], free=free))


def test_components_name_what_nothing_else_names():
    # an object that only turns: of 6 components one combination turns it, three are tensions, two have no other name
    found = check(gx.Grasp(polygon(3, 0.03), free=[False, False, True]))
    assert found.names[:3] == ("tension 1-2", "tension 1-3", "tension 2-3")
    assert [name.split()[0] for name in found.names[3:]] == ["force", "force"]
    points = polygon(3, 0.03)
    assert check(gx.Grasp(points, -points, model="frictionless")).names == ("force 3",)


def test_one_finger_has_none():
    found = gx.Grasp([[0.1, 0.2, 0.3]]).split().internal_coordinates()
    assert (found.names, found.basis.shape, found.condition) == ((), (3, 0), 1.0)
    assert found.of([1.0, 2.0, 3.0]).shape == (0,)


def test_torsion_coordinates_do_not_depend_on_the_unit_of_length():
    # a force and a torsion in m and in mm, the metric with them: the same newtons, 1000 times the torsion number
    rng = np.random.default_rng(5)
    points, normals, f = rng.normal(size=(3, 3)), rng.normal(size=(3, 3)), rng.normal(size=(3, 4))
    read = []
    for unit in (1.0, 1000.0):
        grasp = gx.Grasp(unit * points, normals, model="soft")
        found = grasp.split(grasp.metric(torsion_length=0.3 * unit)).internal_coordinates()
        y = found.of((f * [1.0, 1.0, 1.0, unit]).ravel())
        read.append(y / np.where([u == "N m" for u in found.units], unit, 1.0))
    assert np.allclose(read[0], read[1], rtol=1e-11)


def test_refuses_what_has_no_meaning():
    grasp = gx.Grasp(polygon(3, 1.0))
    with pytest.raises(InputError, match="Grasp"):
        gx.Split(grasp.matrix).internal_coordinates()
    for names in (["a", "b"], ["a", "a", "b"]):
        with pytest.raises(InputError, match="names"):
            grasp.split().internal_coordinates(names)
    with pytest.raises(InputError, match="coordinates"):
        grasp.split().internal_coordinates().force([1.0])


@pytest.mark.parametrize("h", [0.0, 1e-14, 1e-9, 1e-7, 1e-5])
def test_nearly_on_a_line(h):
    # within 1e-6 of a line the third string is no coordinate any more and a bending takes its place; farther off it is,
    # with a condition of about 1/h
    points = 0.03 * np.array([[-1.0, 0.0, 0.0], [0.03, h, 0.0], [1.0, 0.0, 0.0]])
    found = gx.Grasp(points).split().internal_coordinates()
    kinds = [name.split()[0] for name in found.names]
    assert kinds == (["tension"] * 3 if h > 1e-6 else ["tension"] * 2 + ["bending"] * 2)
    assert found.condition < (2.0 / h if h > 1e-6 else 2.0)
