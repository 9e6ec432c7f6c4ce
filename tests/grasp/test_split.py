"""The split's closed forms, its rank in metres, its metric, and what it refuses."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

import graspfx as gx
from graspfx.errors import InputError
from graspfx.grasp.split import UnitDependentSplitWarning
from tests.support.grasps import polygon


@pytest.mark.parametrize(("d", "rank"), [(1, 1), (2, 3), (3, 5)])
def test_two_fingers_squeeze_along_the_line_between_them(d, rank):
    # P_int = 1/2 [uu' -uu'; -uu' uu']; rank 1, 3, 5
    c = np.random.default_rng(d).normal(size=(2, d))
    u = (c[1] - c[0]) / np.linalg.norm(c[1] - c[0])
    split = gx.Grasp(c).split()
    assert split.rank == rank
    assert np.abs(split.internal - np.kron([[0.5, -0.5], [-0.5, 0.5]], np.outer(u, u))).max() < 1e-15


def test_one_finger_has_no_internal_force():
    # a single hard contact pushes the object, whatever it does; its turns about the contact are free of it
    for d in (1, 2, 3):
        split = gx.Grasp(np.full((1, d), 0.3)).split()
        assert (split.rank, split.condition) == (d, 1.0)
        assert np.allclose(split.external, np.eye(d), atol=1e-16)


def test_locked_object_makes_everything_internal():
    split = gx.Grasp(polygon(3, 0.03), free=[False] * 3).split()
    assert (split.rank, split.condition) == (0, 1.0)
    assert np.array_equal(split.internal, np.eye(6))
    assert split.internal_basis.shape == (6, 6)


def test_locked_rotation_leaves_the_mean():
    split = gx.Grasp(polygon(3, 0.03), free=[True, True, False]).split()
    assert np.allclose(split.external, np.kron(np.full((3, 3), 1 / 3), np.eye(2)), atol=1e-15)


def test_knob_turns_about_its_own_axis():
    # rotation only, contacts on a circle of R = 20 mm whose centre is s off the axis: P = q q', q along z x c. Moments
    # about the centroid instead would give another projector, at the distance s / sqrt(R^2 + s^2) = 0.42
    R, n = 0.02, 4
    s = 0.42 / np.sqrt(1 - 0.42**2) * R
    points = polygon(n, R) + np.array([s, 0.0])
    q = np.stack([-points[:, 1], points[:, 0]], axis=1).ravel()
    P = gx.Grasp(points, free=[False, False, True]).split().external
    assert np.abs(P - np.outer(q, q) / (q @ q)).max() < 1e-15
    centred = gx.Grasp(points - points.mean(axis=0), free=[False, False, True]).split().external
    assert np.isclose(np.linalg.norm(P - centred, 2), 0.42, rtol=1e-12)


def test_centring_and_scaling_condition_the_factor():
    # tetrahedron, R = 40 mm: singular values 1 and R sqrt(2/3), so G has the condition 30.6; in units of R it is 1.22
    corners = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]]) / np.sqrt(3)
    points = 0.04 * corners
    assert np.isclose(np.linalg.cond(gx.grasp_matrix(points)), np.sqrt(1.5) / 0.04, rtol=1e-12)
    assert np.isclose(gx.Grasp(points + 5.0).split().condition, np.sqrt(1.5), rtol=1e-12)
    assert np.linalg.cond(gx.grasp_matrix(points + 5.0)) > 2000


@pytest.mark.parametrize("size", [1e-6, 0.05, 50.0])
@pytest.mark.parametrize("away", [0.0, 1000.0])
def test_rank_is_decided_by_a_length(size, away):
    # three contacts at -1, 0, 1 with the middle one h off the line: rms arm h sqrt(2)/3, rms radius sqrt(2/3) and
    # threshold tolerance times that, at every size and place
    R, arm = np.sqrt(2 / 3), np.sqrt(2) / 3
    tolerance = 1e-3
    for factor, rank in ((0.98, 5), (1.02, 6)):
        h = factor * tolerance * R / arm
        points = size * np.array([[-1.0, 0.0, 0.0], [0.0, h, 0.0], [1.0, 0.0, 0.0]]) + away
        assert gx.Grasp(points).split(tolerance=tolerance).rank == rank


def test_a_third_finger_beside_the_line_of_two_changes_the_share():
    # 1e-14 m off the line the middle finger's sideways push is wholly external, if rank is decided by rounding;
    # decided by length it is 1/3, as on the line
    for h, tolerance, share in ((1e-14, 0.0, 1.0), (1e-14, 1e-6, 1 / 3), (0.0, 0.0, 1 / 3)):
        points = [[-0.03, 0.0, 0.0], [0.0, h, 0.0], [0.03, 0.0, 0.0]]
        assert np.isclose(gx.Grasp(points).split(tolerance=tolerance).external[5, 5], share, rtol=1e-12)


def three_soft_fingers(R, unit):
    points = unit * np.column_stack([polygon(3, R), np.zeros(3)])
    return gx.Grasp(points, -points, model="soft")


def test_soft_fingers_need_a_torsion_length():
    # three soft fingers on a circle: a push out of its plane is external by 1/3 + 2/3 R^2/(R^2 + l^2), l the torsion
    # length. The same in m and in mm with l = 6 mm; without a metric l is 1 m or 1 mm, and so are the answers
    R, length = 0.03, 0.006

    def share(patch):
        return 1 / 3 + 2 / 3 * R**2 / (R**2 + patch**2)

    for unit in (1.0, 1000.0):
        grasp = three_soft_fingers(R, unit)
        split = grasp.split(grasp.metric(torsion_length=length * unit))
        assert np.isclose(split.external[2, 2], share(length), rtol=1e-13)
        with pytest.warns(UnitDependentSplitWarning, match="torsion_length"):
            bare = grasp.split()
        assert np.isclose(bare.external[2, 2], share(1.0 / unit), rtol=1e-12)
        with pytest.warns(UnitDependentSplitWarning):
            grasp.split([1.0, 1.0, 2.0])
    assert share(0.001) / share(1.0) > 2.9


def test_no_warning_where_the_torsion_length_does_not_matter():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        gx.Grasp(np.eye(3), -np.eye(3), model="soft", free=[True] * 3 + [False] * 3).split()
        gx.Grasp(np.eye(2), -np.eye(2), model="soft").split()


def test_weights_shift_the_share_to_the_heavy_finger():
    # on the line with weights w: x = sum(w e)/sum(w), so Q has rows w/sum(w) and P = Q' on forces
    w = np.array([1.0, 2.0, 5.0])
    split = gx.Grasp([[0.0], [1.0], [2.0]]).split(metric=w)
    assert np.allclose(split.displacement_external, np.tile(w / 8, (3, 1)), atol=1e-15)
    assert np.allclose(split.external, np.tile(w / 8, (3, 1)).T, atol=1e-15)
    assert split.metric.tolist() == w.tolist()


def test_weights_per_finger_diagonal_and_matrix_agree():
    rng = np.random.default_rng(2)
    grasp = gx.Grasp(rng.normal(size=(4, 3)))
    w = rng.uniform(0.5, 2.0, 4)
    a, b, c = (grasp.split(M) for M in (w, np.repeat(w, 3), np.diag(np.repeat(w, 3))))
    assert np.array_equal(a.external, b.external)
    assert np.allclose(a.external, c.external, atol=1e-14)
    assert np.allclose(a.modal_metric(), c.modal_metric(), atol=1e-14)


def test_full_metric_by_its_formula():
    # Q = G'(G M G')^-1 G M for a dense M, P = M Q M^-1
    rng = np.random.default_rng(3)
    A = rng.normal(size=(12, 12))
    M = A @ A.T + np.eye(12)
    grasp = gx.Grasp(rng.normal(size=(4, 3)))
    G = grasp.matrix
    Q = G.T @ np.linalg.solve(G @ M @ G.T, G @ M)
    for split in (grasp.split(M), gx.Split(G, metric=M)):
        assert np.allclose(split.displacement_external, Q, atol=1e-12)
        assert np.allclose(split.external, M @ Q @ np.linalg.inv(M), atol=1e-11)
        assert np.allclose(split.modal_metric(), M @ Q, atol=1e-12)


def test_bare_matrix_has_a_relative_tolerance():
    # singular values 1 and 1e-4
    G = np.array([[1.0, 0.0, 0.0], [0.0, 1e-4, 0.0]])
    assert gx.Split(G).rank == 2
    assert gx.Split(G, tolerance=1e-3).rank == 1
    assert np.isclose(gx.Split(G).condition, 1e4)
    assert gx.Split(1e-9 * G).rank == 2
    assert gx.Split(np.zeros((2, 3))).rank == 0
    assert gx.Split(np.zeros((0, 3))).internal_basis.shape == (3, 3)


def test_divide_takes_many_forces_at_once():
    rng = np.random.default_rng(0)
    split = gx.Grasp(rng.normal(size=(3, 3))).split()
    forces = rng.normal(size=(10, 9))
    external, internal = split.divide(forces)
    assert np.allclose(external, forces @ split.external.T, atol=1e-15)
    assert np.array_equal(internal, forces - external)


@pytest.mark.parametrize(
    ("metric", "words"),
    [
        (np.ones(5), "3 weights"),
        (-np.ones(6), "positive"),
        ([1.0, 0.0, 1.0], "weight of zero"),
        (np.full(6, np.nan), "finite"),
        (np.triu(np.ones((6, 6))), "symmetric"),
        (np.ones((6, 6)), "positive definite"),
        (np.diag([1.0, 1, 1, 1, 1, -1e-3]), "positive definite"),
    ],
)
def test_metrics_that_are_none(metric, words):
    with pytest.raises(InputError, match=words):
        gx.Grasp(polygon(3, 0.03)).split(metric)


def test_arguments_that_do_not_fit():
    split = gx.Grasp(polygon(3, 0.03)).split()
    for bad in (np.ones(5), np.full(6, np.inf), 1.0):
        with pytest.raises(InputError, match="force"):
            split.divide(bad)
    for bad in (-1e-6, 1.0, np.nan):
        with pytest.raises(InputError, match="tolerance"):
            gx.Split(np.ones((1, 3)), tolerance=bad)
    for matrix in (np.ones(3), [[np.nan, 1.0]], np.ones((2, 0))):
        with pytest.raises(InputError, match="G"):
            gx.Split(matrix)
    with pytest.raises(InputError, match="metric"):
        gx.Split(np.ones((1, 3)), metric=np.ones(2))
