"""The virtual linkage: a split of its own where contacts carry moments, the same one where they do not."""

from __future__ import annotations

import numpy as np
import pytest

import graspfx as gx
from graspfx.errors import InputError


def random_grasp(seed, d, n, model="hard"):
    rng = np.random.default_rng(seed)
    return gx.Grasp(0.05 * rng.normal(size=(n, d)) + 0.1, rng.normal(size=(n, d)), model=model)


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("n", [2, 3, 6])
@pytest.mark.parametrize("model", ["hard", "frictionless"])
def test_without_moments_it_is_the_split(d, n, model):
    grasp = random_grasp(n, d, n, model)
    linkage, split = grasp.virtual_linkage(), grasp.split()
    assert linkage.rank == split.rank
    assert np.abs(linkage.external - split.external).max() < 1e-12
    assert np.array_equal(linkage.internal, np.eye(split.components) - linkage.external)


def test_tensions_of_three_fingers_by_hand():
    # Williams and Khatib's triangle: f = E t, E with columns u_12, u_13, u_23; t read from E^+ f
    grasp = random_grasp(1, 3, 3)
    p = grasp.points

    def u(i, j):
        return (p[j] - p[i]) / np.linalg.norm(p[j] - p[i])

    o = np.zeros(3)
    E = np.column_stack([np.r_[u(0, 1), u(1, 0), o], np.r_[u(0, 2), o, u(2, 0)], np.r_[o, u(1, 2), u(2, 1)]])
    f = np.random.default_rng(2).normal(size=9)
    found = grasp.virtual_linkage().coordinates
    assert np.abs(found.basis - E).max() < 1e-15
    assert np.allclose(found.of(f), np.linalg.lstsq(E, f, rcond=None)[0], rtol=1e-12)


@pytest.mark.parametrize("model", ["soft", "full"])
@pytest.mark.parametrize("n", [2, 3, 5])
def test_laws(model, n):
    grasp = random_grasp(n, 3, n, model)
    linkage, G = grasp.virtual_linkage(), grasp.matrix
    P = linkage.external
    scale = np.abs(P).max()
    assert np.abs(P @ P - P).max() < 1e-12 * scale**2
    assert np.abs(G @ P - G).max() < 1e-12 * scale and np.isclose(np.trace(P), linkage.rank, rtol=1e-12)
    f = np.random.default_rng(n).normal(size=(4, linkage.components))
    external, internal = linkage.divide(f)
    assert np.allclose(external, f @ P.T, rtol=1e-12, atol=1e-12 * scale) and np.array_equal(internal, f - external)
    y = linkage.coordinates.of(f)
    assert np.allclose(linkage.coordinates.force(y), internal, rtol=1e-10, atol=1e-11 * scale)


def test_joint_torques_are_the_moments_themselves():
    # three full contacts: forces alone make every wrench, so a moment is internal as it stands
    grasp = random_grasp(3, 3, 3, "full")
    f = np.random.default_rng(4).normal(size=18)
    linkage = grasp.virtual_linkage()
    read = linkage.coordinates.of(f)
    assert np.allclose(read[3:], f[grasp.torsion_columns], rtol=1e-11)
    assert np.abs(linkage.divide(f)[0][grasp.torsion_columns]).max() < 1e-14


def test_only_what_forces_cannot_do_is_left_to_moments():
    # two soft fingers: forces make five wrenches; a moment of 1 N m about their line, at one of them, is shared by both
    # torsions, which point in opposite directions: external +-1/2 each, internal the rest
    points = np.array([[-0.02, 0.0, 0.0], [0.02, 0.0, 0.0]])
    linkage = gx.Grasp(points, -points, model="soft").virtual_linkage()
    external, internal = linkage.divide([0, 0, 0, 1.0, 0, 0, 0, 0])
    assert linkage.rank == 6
    assert np.allclose(external, [0, 0, 0, 0.5, 0, 0, 0, -0.5], atol=1e-15)
    assert np.allclose(internal, [0, 0, 0, 0.5, 0, 0, 0, 0.5], atol=1e-15)


@pytest.mark.parametrize(("model", "n"), [("soft", 2), ("soft", 4), ("full", 3)])
def test_limit_of_the_split_with_a_short_torsion_length(model, n):
    # the distance falls with the square of the length: by 100 for each tenth
    grasp = random_grasp(7, 3, n, model)
    P = grasp.virtual_linkage().external
    units = np.where(grasp.torsion_columns, 0.05, 1.0)

    def distance(length):
        difference = grasp.split(grasp.metric(torsion_length=length)).external - P
        return np.abs(difference * units / units[:, None]).max()

    assert distance(1e-3) > 1e-7
    assert np.isclose(distance(1e-4) / distance(1e-5), 100.0, rtol=0.02)


def test_unit_of_length_does_not_matter():
    rng = np.random.default_rng(8)
    points, normals, f = rng.normal(size=(4, 3)), rng.normal(size=(4, 3)), rng.normal(size=(4, 4))
    unit = np.array([1.0, 1.0, 1.0, 1000.0])
    metres = gx.Grasp(points, normals, model="soft").virtual_linkage().divide(f.ravel())[0]
    millimetres = gx.Grasp(1000.0 * points, normals, model="soft").virtual_linkage().divide((f * unit).ravel())[0]
    assert np.allclose(millimetres.reshape(4, 4) / unit, metres.reshape(4, 4), rtol=1e-11, atol=1e-12)


def test_actuators_may_be_chosen():
    # four fingers in the plane have five actuators: here a ring and one diagonal, in that order
    grasp = random_grasp(9, 2, 4)
    pairs = [(0, 1), (1, 2), (2, 3), (3, 0), (0, 2)]
    linkage = grasp.virtual_linkage(pairs)
    names = linkage.internal_coordinates(["a", "b", "c", "d"]).names
    assert names == ("tension a-b", "tension b-c", "tension c-d", "tension d-a", "tension a-c")
    assert np.abs(linkage.external - grasp.virtual_linkage().external).max() == 0.0
    with pytest.raises(InputError, match="5 pairs"):
        _ = grasp.virtual_linkage(pairs[:4]).coordinates
    with pytest.raises(InputError, match="only 5 are independent"):
        _ = grasp.virtual_linkage([*pairs, (1, 3)]).coordinates
    with pytest.raises(InputError, match="two different finger indices"):
        _ = grasp.virtual_linkage([(0, 4)]).coordinates


def test_fingers_in_one_plane_bend_what_actuators_cannot_hold():
    square = np.array([[1.0, 0, 0], [0, 1.0, 0], [-1.0, 0, 0], [0, -1.0, 0]])
    names = gx.Grasp(square).virtual_linkage().coordinates.names
    assert [name.split()[0] for name in names] == ["tension"] * 5 + ["bending"]


def test_refuses_what_does_not_fit():
    linkage = random_grasp(0, 3, 3).virtual_linkage()
    with pytest.raises(InputError, match="force"):
        linkage.divide([1.0, 2.0])
    with pytest.raises(InputError, match="tolerance"):
        random_grasp(0, 3, 3).virtual_linkage(tolerance=1.0)
