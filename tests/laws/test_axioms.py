"""The laws of the split, for every contact model, in the line, the plane and space, with and without a metric."""

from __future__ import annotations

import numpy as np
import pytest

import graspfx as gx

MODELS = ("frictionless", "hard", "soft", "full")
CASES = [(d, model, seed) for d in (1, 2, 3) for model in (*MODELS, "mixed") for seed in range(3)]
ROUNDING = 2e-14


def make(d, model, seed, **more):
    """A random grasp of 2 to 6 contacts within a few centimetres, and a metric with weights and a 5 mm patch."""
    rng = np.random.default_rng([d, len(model), seed])
    n = int(rng.integers(2, 7))
    names = [str(rng.choice(MODELS)) for _ in range(n)] if model == "mixed" else model
    grasp = gx.Grasp(0.04 * rng.normal(size=(n, d)), rng.normal(size=(n, d)), model=names, **more)
    metric = grasp.metric(torsion_length=0.005, weights=rng.uniform(0.3, 3.0, n))
    return rng, grasp, metric


def own_units(P, metric):
    """P in the metric's own coordinates, L^-1 P L, where entries with newton and newton metre compare."""
    root = np.sqrt(metric)
    return P * root / root[:, None]


@pytest.mark.parametrize(("d", "model", "seed"), CASES)
def test_projector_laws(d, model, seed):
    # P = P^2, symmetric in the metric's coordinates, G (I - P) = 0, trace P = rank P = rank G
    rng, grasp, metric = make(d, model, seed)
    split = grasp.split(metric)
    P = own_units(split.external, metric)
    assert np.abs(P @ P - P).max() < ROUNDING
    assert np.abs(P - P.T).max() < ROUNDING
    assert np.abs(grasp.matrix * np.sqrt(metric) @ (np.eye(len(P)) - P)).max() < ROUNDING
    assert abs(np.trace(P) - split.rank) < ROUNDING
    assert split.rank == np.linalg.matrix_rank(grasp.matrix)
    f = rng.normal(size=len(P))
    external, internal = split.divide(f)
    assert np.allclose(external + internal, f, rtol=0, atol=1e-13)
    assert np.allclose(grasp.matrix @ external, grasp.matrix @ f, rtol=0, atol=1e-12)


@pytest.mark.parametrize(("d", "model", "seed"), CASES)
def test_metric_laws(d, model, seed):
    # Q = G'(G M G')^+ G M on displacements: M Q and M (I - Q) symmetric PSD, G M (I - Q) = 0, P = M Q M^-1
    _, grasp, metric = make(d, model, seed)
    split = grasp.split(metric)
    Q, M, G = split.displacement_external, np.diag(metric), grasp.matrix
    for part in (M @ Q, M - M @ Q):
        assert np.abs(part - part.T).max() < ROUNDING
        assert np.linalg.eigvalsh((part + part.T) / 2).min() > -ROUNDING
    assert np.abs(G @ (M - M @ Q)).max() < ROUNDING
    assert np.allclose(split.external, M @ Q @ np.linalg.inv(M), rtol=1e-12, atol=1e-12)
    assert np.allclose(split.modal_metric(), M @ Q, rtol=0, atol=ROUNDING)
    # the definition itself; pinv cuts the ranks that two contacts lack
    direct = G.T @ np.linalg.pinv(G @ M @ G.T, rcond=1e-11) @ G @ M
    assert np.abs(own_units(direct.T, metric) - own_units(Q.T, metric)).max() < 1e-9


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("seed", range(4))
def test_identity_metric_is_eq_3(d, seed):
    # P = P' = Q = G^+ G, and any positive multiple of I is the same metric
    _, grasp, _ = make(d, "hard", seed)
    P = grasp.split().external
    G = grasp.matrix
    assert np.array_equal(P, P.T)
    assert np.abs(P - np.linalg.pinv(G) @ G).max() < 1e-13
    assert np.array_equal(P, grasp.split().displacement_external)
    for metric in (np.ones(len(P)), np.eye(len(P)), 7.0 * np.ones(len(P)), np.full(grasp.fingers, 3.0)):
        assert np.abs(grasp.split(metric).external - P).max() < 2e-14


@pytest.mark.parametrize(("d", "model", "seed"), CASES)
def test_power_of_contact_forces_is_the_object_power(d, model, seed):
    # e'G'v: contacts that move with the object, x' = G'v, receive no power from internal forces
    rng, grasp, metric = make(d, model, seed)
    f, v = rng.normal(size=len(metric)), rng.normal(size=len(grasp.matrix))
    external, internal = grasp.split(metric).divide(f)
    rate = grasp.matrix.T @ v
    assert abs(external @ rate - (grasp.matrix @ f) @ v) < 1e-12
    assert abs(internal @ rate) < 1e-12


@pytest.mark.parametrize(("d", "model", "seed"), CASES)
def test_reference_point_changes_nothing(d, model, seed):
    # moments about any origin, 1 km away too: bit for bit the same, since the origin never enters
    _, grasp, metric = make(d, model, seed)
    _, other, _ = make(d, model, seed, origin=np.linspace(1e3, -2e3, d))
    assert np.array_equal(grasp.split(metric).external, other.split(metric).external)


@pytest.mark.parametrize("model", ["hard", "soft", "full"])
@pytest.mark.parametrize("seed", range(4))
def test_unit_of_length_changes_nothing(model, seed):
    # the same contacts in mm, torsion length too: forces in N and moments in N mm
    rng, grasp, _ = make(3, model, seed)
    normals = grasp.contacts.normals
    small, large = (gx.Grasp(u * grasp.points, normals, model=model) for u in (1.0, 1000.0))
    a, b = (g.split(g.metric(torsion_length=0.004 * u)) for g, u in ((small, 1.0), (large, 1000.0)))
    unit = np.where(grasp.torsion_columns, 1000.0, 1.0)
    f = rng.normal(size=len(unit))
    assert np.allclose(a.divide(f)[0] * unit, b.divide(f * unit)[0], rtol=1e-11, atol=1e-12)
    assert a.rank == b.rank
    assert np.isclose(a.condition, b.condition, rtol=1e-9)


def test_unit_of_length_changes_no_force_of_the_law():
    # eq. (4) of 100 random sets of soft fingers of unequal weight, in m and N m and in mm and N mm: 4e-15 was found
    rng = np.random.default_rng(6)
    for _ in range(100):
        n, rho = int(rng.integers(2, 6)), rng.uniform(0.003, 0.01)  # [m]
        points, normals = rng.normal(size=(n, 3)) * 0.03, rng.normal(size=(n, 3))
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        weights, e, rate = rng.uniform(0.3, 3.0, n), rng.normal(size=4 * n) * 0.002, rng.normal(size=4 * n) * 0.05
        kep, kip, ked, kid = [*rng.uniform(20.0, 1000.0, 2), *rng.uniform(0.0, 2.0, 2)]
        forces = []
        for u in (1.0, 1000.0):
            grasp = gx.Grasp(u * points, normals, model="soft")
            unit = np.where(grasp.torsion_columns, 1.0 / 0.006, u)  # turns are of the size of shifts over 6 mm
            law = gx.Coupling(gx.Impedance(kep / u, ked / u), gx.Impedance(kip / u, kid / u))
            split = grasp.split(grasp.metric(weights=weights, torsion_length=rho * u))
            forces.append(law.force(split, e * unit, rate * unit) / np.where(grasp.torsion_columns, u, 1.0))
        for kind in (grasp.torsion_columns, ~grasp.torsion_columns):
            a, b = forces[0][kind], forces[1][kind]
            assert np.abs(a - b).max() < 1e-12 * np.abs(a).max()


@pytest.mark.parametrize("seed", range(4))
def test_given_frames_turn_the_components_only(seed):
    # components along each contact's own axes: P becomes F'P F
    rng, grasp, _ = make(3, "hard", seed)
    frames = np.array([np.linalg.qr(rng.normal(size=(3, 3)))[0] for _ in range(grasp.fingers)])
    F = np.zeros((3 * grasp.fingers,) * 2)
    for i, frame in enumerate(frames):
        F[3 * i : 3 * i + 3, 3 * i : 3 * i + 3] = frame
    own = gx.Grasp(grasp.points, frames=frames).split().external
    assert np.abs(own - F.T @ grasp.split().external @ F).max() < 1e-14


@pytest.mark.parametrize("seed", range(6))
def test_projector_depends_on_the_row_space_only(seed):
    # T G for an invertible T: the same P to rounding times the condition of T
    rng, grasp, _ = make(3, "hard", seed)
    G = grasp.matrix
    T = rng.normal(size=(6, 6))
    P = gx.Split(G).external
    assert np.abs(gx.Split(T @ G).external - P).max() < 1e-15 * np.linalg.cond(T @ G) * 100
    assert np.abs(grasp.split().external - P).max() < 1e-13


@pytest.mark.parametrize(("d", "model", "seed"), CASES)
def test_internal_basis_spans_the_forces_without_a_wrench(d, model, seed):
    # orthonormal, G N = 0, and it holds every internal force
    rng, grasp, metric = make(d, model, seed)
    split = grasp.split(metric)
    N = split.internal_basis
    assert N.shape == (len(metric), len(metric) - split.rank)
    assert np.abs(N.T @ N - np.eye(N.shape[1])).max(initial=0.0) < ROUNDING
    assert np.abs(grasp.matrix @ N).max(initial=0.0) < ROUNDING
    internal = split.divide(rng.normal(size=len(metric)))[1]
    assert np.abs(internal - N @ (N.T @ internal)).max() < 1e-12


@pytest.mark.parametrize("seed", range(8))
def test_laws_with_locked_freedoms(seed):
    # any mask: P is the projector on the row space of the rows that are left, with moments about the given origin
    rng = np.random.default_rng(seed)
    free = rng.random(6) < 0.5
    points, origin = 0.05 * rng.normal(size=(4, 3)), 0.05 * rng.normal(size=3)
    grasp = gx.Grasp(points, free=free, origin=origin)
    G = grasp.matrix
    expected = np.linalg.pinv(G) @ G if len(G) else np.zeros((12, 12))
    assert np.abs(grasp.split().external - expected).max() < 1e-13
    assert grasp.split().rank == free.sum()
