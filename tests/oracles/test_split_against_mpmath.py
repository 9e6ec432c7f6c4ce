"""The split of ill-conditioned contact sets against 50 digits, built there from eq. (3) and nothing of ours."""

from __future__ import annotations

import mpmath as mp
import numpy as np
import pytest

import graspfx as gx
from tests.support.exact import exact_force

DIGITS = 50


def exact_projector(points, *, normals=None, model="hard", metric=None, tolerance=1e-6, reference=None):
    """P = M G'(G M G')^+ G on forces at 50 digits, its rank decided by lengths, for points taken as exact."""
    with mp.workdps(DIGITS):
        n, d = points.shape
        x = [[mp.mpf(float(v)) for v in row] for row in points]
        centre = [sum(row[a] for row in x) / n for a in range(d)]
        size = mp.sqrt(sum((row[a] - centre[a]) ** 2 for row in x for a in range(d)) / n)
        about = centre if reference is None else [mp.mpf(float(v)) for v in reference]
        columns, torsions = [], []
        for i in range(n):
            r = [x[i][a] - about[a] for a in range(d)]
            forces = [[mp.mpf(int(a == b)) for a in range(d)] for b in range(d)]
            if normals is not None:
                length = mp.sqrt(sum(mp.mpf(float(v)) ** 2 for v in normals[i]))
                normal = [mp.mpf(float(v)) / length for v in normals[i]]
                if model == "frictionless":
                    forces = [normal]
            for a in forces:
                if d == 2:
                    turn = [r[0] * a[1] - r[1] * a[0]]
                else:
                    turn = [r[1] * a[2] - r[2] * a[1], r[2] * a[0] - r[0] * a[2], r[0] * a[1] - r[1] * a[0]]
                columns.append(a + [t / size for t in turn])
                torsions.append(False)
            if model == "soft":
                columns.append([mp.mpf(0)] * 3 + [v / size for v in normal])
                torsions.append(True)
        G = mp.matrix(columns).T
        m = G.cols
        M = [mp.mpf(1)] * m if metric is None else [mp.mpf(float(v)) for v in metric]
        scaled = G.copy()
        for j in range(m):
            if torsions[j]:
                scaled[:, j] = G[:, j] * size
        values, vectors = mp.eigsy(scaled * scaled.T)
        kept = [k for k in range(G.rows) if values[k] > tolerance**2 * n]
        if not metric and not any(torsions):
            P = mp.zeros(m)
            for k in kept:
                v = G.T * vectors[:, k]
                P += v * v.T / values[k]
        else:
            basis = mp.matrix([[vectors[a, k] for a in range(G.rows)] for k in kept]) * G
            heavy = basis.copy()
            for j in range(m):
                heavy[:, j] = basis[:, j] * M[j]
            P = heavy.T * mp.inverse(heavy * basis.T) * basis
        return P, len(kept)


def largest_error(found, exact):
    """max |found - exact|, entry by entry."""
    with mp.workdps(DIGITS):
        return max(
            float(abs(mp.mpf(float(found[i, j])) - exact[i, j])) for i in range(exact.rows) for j in range(exact.cols)
        )


def turned_line(rng, n, h, size=0.05):
    """n contacts on a line in a random direction, offsets of h times the length across it."""
    Q = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    points = np.outer(np.linspace(-1, 1, n) + 0.1 * rng.normal(size=n), [1.0, 0.0, 0.0]) + h * rng.normal(size=(n, 3))
    return size * points @ Q.T + 0.1 * rng.normal(size=3)


def check(points, bound, rank=None, tolerance=1e-6, **more):
    expected, exact_rank = exact_projector(points, tolerance=tolerance, **more)
    split = gx.Grasp(points).split(tolerance=tolerance)
    assert split.rank == exact_rank == (rank or exact_rank)
    error = largest_error(split.external, expected)
    assert error <= bound
    return error


@pytest.mark.parametrize("n", [3, 5])
def test_collinear_contacts_have_rank_five(n):
    # rounding alone holds the points off their line, by 1e-16 of its length: below any tolerance, so rank 5
    check(turned_line(np.random.default_rng(n), n, 0.0), 2e-15, rank=5)


@pytest.mark.parametrize("h", [1e-3, 1e-4, 1e-5, 1e-7, 1e-9, 1e-12])
def test_nearly_collinear_contacts(h):
    # tolerance 1e-6: full rank down to h = 1e-5, rank 5 from 1e-7 on; with a tolerance below h full rank, and the
    # answer is good to rounding although the condition is 1/h
    points = turned_line(np.random.default_rng(2), 4, h)
    check(points, 2e-15, rank=6 if h > 5e-6 else 5)
    check(points, 2e-15, rank=6, tolerance=1e-14)


def test_pinv_with_moments_about_a_far_origin_is_not_good_enough():
    # why the contacts are centred before factoring: 10 km away numpy's pinv loses ten digits of P
    points = 0.05 * np.random.default_rng(1).normal(size=(5, 3)) + np.array([1e4, 0.0, 0.0])
    expected, _ = exact_projector(points)
    G = gx.grasp_matrix(points)
    assert largest_error(np.linalg.pinv(G) @ G, expected) > 1e-8
    check(points, 2e-15)


@pytest.mark.parametrize("away", [0.0, 1e3])
@pytest.mark.parametrize("model", ["frictionless", "soft"])
def test_other_models_and_a_metric(model, away):
    # eight contacts, weights from 0.2 to 3 and a 6 mm patch; P is oblique then: entries up to the root of their ratio
    rng = np.random.default_rng(3)
    points, normals = 0.05 * rng.normal(size=(8, 3)) + away, rng.normal(size=(8, 3))
    grasp = gx.Grasp(points, normals, model=model)
    metric = grasp.metric(torsion_length=0.006, weights=rng.uniform(0.2, 3.0, 8))
    expected, rank = exact_projector(points, normals=normals, model=model, metric=list(metric))
    split = grasp.split(metric)
    assert split.rank == rank == 6
    root = np.sqrt(metric)
    # in the metric's own coordinates L^-1 P L is an orthogonal projector, of norm 1
    with mp.workdps(DIGITS):
        own = mp.matrix(8 * (1 if model == "frictionless" else 4))
        for i in range(own.rows):
            for j in range(own.cols):
                own[i, j] = expected[i, j] * mp.mpf(float(root[j])) / mp.mpf(float(root[i]))
    assert largest_error(split.external * root / root[:, None], own) <= 1e-14


@pytest.mark.parametrize("faded", [1e-3, 1e-6, 1e-12])
def test_a_nearly_weightless_finger(faded):
    # M Q, which the stiffness is made of, stays good to rounding when a finger fades
    rng = np.random.default_rng(5)
    points = 0.05 * rng.normal(size=(3, 3))
    metric = np.repeat([1.0, 1.0, faded], 3)
    expected, _ = exact_projector(points, metric=list(metric))
    with mp.workdps(DIGITS):
        heavy = mp.matrix(9)
        for i in range(9):
            for j in range(9):
                heavy[i, j] = expected[i, j] * mp.mpf(float(metric[j]))
    assert largest_error(gx.Grasp(points).split(metric).modal_metric(), heavy) <= 1e-14


@pytest.mark.parametrize("away", [0.0, 1000.0])
@pytest.mark.parametrize("size", [0.05, 1e-6])
@pytest.mark.parametrize("h", [1.0, 1e-2, 1e-4, 1e-5, 1e-7, 1e-9, 1e-12, 0.0])
def test_forces_of_contacts_near_a_line(h, size, away):
    # on either side of the tolerance of 1e-6, and where the contacts are as near as their coordinates are rounded: then
    # a line is what they lie on. One set at a time and all at once
    law = gx.Coupling(gx.Impedance(30.0), gx.Impedance(70.0))
    rng = np.random.default_rng(5)
    points = np.array([turned_line(rng, 5, h, size) + away for _ in range(6)])
    e = rng.normal(size=points.shape)
    many = law.force(gx.Grasp(points).split(), e)
    for set_of_points, displacement, force in zip(points, e, many, strict=True):
        alone = law.force(gx.Grasp(set_of_points).split(), displacement)
        assert np.array_equal(alone, force)
        exact = np.array(exact_force(set_of_points, displacement, 30.0, 70.0, 1e-6)[0], dtype=float).reshape(5, 3)
        assert np.abs(alone.reshape(5, 3) - exact).max() <= 2e-15 * np.abs(exact).max()
