"""The least coefficient of friction: closed forms, and cone programmes of clarabel on both sides of it."""

from __future__ import annotations

import math

import clarabel
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import sparse

import graspfx as gx
from graspfx.errors import InputError
from tests.support.grasps import polygon

FloatArray = NDArray[np.float64]


def in_space(n: int, R: float) -> FloatArray:
    return np.pad(polygon(n, R), ((0, 0), (0, 1)))


def test_two_fingers_in_the_plane_need_the_slope_of_their_line() -> None:
    """Nguyen's rule: the line between them inside both cones, tan of its angle to the normals."""
    for slope in (0.1, 0.7, 3.0):
        grasp = gx.Grasp([[1.0, 0.0], [-1.0, 2.0 * slope]], [[-1.0, 0.0], [1.0, 0.0]])
        assert gx.least_friction(grasp) == pytest.approx(slope, abs=1e-9)


def test_normals_that_meet_close_with_any_friction() -> None:
    """Three on a circle, infimum 0; two in space never: they turn the object about their line."""
    points = in_space(3, 0.03)
    assert gx.least_friction(gx.Grasp(points, -points)) == 0.0
    assert gx.least_friction(gx.Grasp(points[:2], -points[:2])) == math.inf


@pytest.mark.parametrize("n", [3, 4, 5])
def test_a_weight_between_fingers_takes_its_share_of_their_push(n: int) -> None:
    """W against n L of normal forces all around it: mu = W / (n L); with a bound that grows it goes to zero."""
    points = in_space(n, 0.03)
    grasp = gx.Grasp(points, -points)
    w = [0.0, 0.0, 1.2, 0.0, 0.0, 0.0]
    for L in (0.5, 2.0):
        assert gx.least_friction(grasp, w, normal_force=L) == pytest.approx(1.2 / (n * L), abs=1e-9)
    assert gx.least_friction(gx.Grasp(points[:1], -points[:1]), w, normal_force=1.0) == math.inf


def slack(points: FloatArray, normals: FloatArray, w: FloatArray, L: float, mu: float) -> float:
    """Least s with G f = w, |f_t| <= mu f_n + s and f_n <= L + s, by clarabel."""
    n = len(points)
    size = 3 * n + 1
    rows, bounds = [np.c_[gx.grasp_matrix(points), np.zeros(6)]], [w]
    cones = [clarabel.ZeroConeT(6), clarabel.NonnegativeConeT(n)]
    caps = np.zeros((n, size))
    caps[:, -1] = -1.0
    for i in range(n):
        caps[i, 3 * i : 3 * i + 3] = normals[i]
    rows.append(caps)
    bounds.append(np.full(n, L))
    for i in range(n):
        cone = np.zeros((4, size))
        cone[0, 3 * i : 3 * i + 3], cone[0, -1] = -mu * normals[i], -1.0
        cone[1:, 3 * i : 3 * i + 3] = np.outer(normals[i], normals[i]) - np.eye(3)
        rows.append(cone)
        bounds.append(np.zeros(4))
        cones.append(clarabel.SecondOrderConeT(4))
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-12
    cost = np.eye(size)[-1]
    matrix = sparse.csc_matrix(np.vstack(rows))
    solver = clarabel.DefaultSolver(
        sparse.csc_matrix((size, size)), cost, matrix, np.concatenate(bounds), cones, settings
    )
    return float(solver.solve().x[-1])


@pytest.mark.parametrize("seed", range(4))
def test_clarabel_holds_the_wrench_above_it_and_not_below(seed: int) -> None:
    """1e-7 of the coefficient above and below it."""
    rng = np.random.default_rng(seed)
    n = 3 + seed % 3
    points = rng.normal(size=(n, 3))
    points /= np.linalg.norm(points, axis=1)[:, None]
    w = 0.3 * rng.normal(size=6)
    mu = gx.least_friction(gx.Grasp(points, -points), w, normal_force=1.5)
    if math.isinf(mu):
        assert slack(points, -points, w, 1.5, 1e4) > 1e-6
        return
    assert slack(points, -points, w, 1.5, mu * (1.0 + 1e-7)) < 0.0 < slack(points, -points, w, 1.5, mu * (1.0 - 1e-7))


def test_closure_begins_there() -> None:
    """`force_closure` on both sides of it, five fingers on a ball whose normals leave the centre to one side."""
    rng = np.random.default_rng(7)
    points = rng.normal(size=(5, 3)) + np.array([0.0, 0.0, 0.9])
    points /= np.linalg.norm(points, axis=1)[:, None]
    grasp = gx.Grasp(points, -points)
    mu = gx.least_friction(grasp)
    assert 0.01 < mu < 10.0
    assert grasp.force_closure(mu * (1.0 + 1e-4)) and not grasp.force_closure(mu * (1.0 - 1e-4))


def test_faults_are_told_by_their_argument() -> None:
    points = in_space(3, 0.03)
    for arguments, name in (
        ((gx.Grasp(points),), "normals"),
        ((gx.Grasp(points, -points, model="soft"),), "model"),
        ((gx.Grasp(points, -points), [1.0]), "wrench"),
        ((gx.Grasp(points, -points), np.ones(6)), "normal_force"),
    ):
        with pytest.raises(InputError, match=name):
            gx.least_friction(*arguments)
