"""Eq. (4) with every kind of gain, its two forms, and the warning for a coupling that creates energy."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

import graspfx as gx
from graspfx.errors import InputError, UnknownNameError
from graspfx.grasp.impedance import ActiveCouplingWarning, loop_energy, skew_part, spread
from graspfx.grasp.split import Split

PAIR = gx.Grasp([[-0.025], [0.025]])


def triangle(d=2):
    angle = 2 * np.pi * np.arange(3) / 3
    points = 0.03 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return gx.Grasp(points if d == 2 else np.column_stack([points, [0.0, 0.005, 0.01]]))


def semidefinite(rng, *shape):
    A = rng.normal(size=shape)
    return 30.0 * A @ np.swapaxes(A, -1, -2)


def gains(rng, kind, n, d, m):
    if kind == "number":
        return float(rng.uniform(10, 100))
    if kind == "per finger":
        return rng.uniform(10, 100, n)
    return semidefinite(rng, *{"d x d": (d, d), "d x d per finger": (n, d, d), "full": (m, m)}[kind])


KINDS = ("number", "per finger", "d x d", "d x d per finger", "full")


def written_out(gain, n, d):
    """The gain as a matrix on all components, block by block."""
    if np.ndim(gain) == 0:
        return gain * np.eye(n * d)
    if np.ndim(gain) == 1:
        return np.diag(np.repeat(gain, d))
    if np.ndim(gain) == 2:
        return gain if len(gain) == n * d else np.kron(np.eye(n), gain)
    K = np.zeros((n * d, n * d))
    for i in range(n):
        K[i * d : (i + 1) * d, i * d : (i + 1) * d] = gain[i]
    return K


@pytest.mark.filterwarnings("ignore::graspfx.grasp.impedance.ActiveCouplingWarning")
@pytest.mark.parametrize("form", ["literal", "symmetric"])
@pytest.mark.parametrize("inner", KINDS)
@pytest.mark.parametrize("outer", KINDS)
@pytest.mark.parametrize("d", [2, 3])
def test_eq_4_with_every_kind_of_gain(outer, inner, form, d):
    rng = np.random.default_rng([KINDS.index(outer), KINDS.index(inner), d])
    grasp = triangle(d)
    n, m = 3, 3 * d
    kep, ked = gains(rng, outer, n, d, m), gains(rng, outer, n, d, m) / 100
    kip, kid = gains(rng, inner, n, d, m), gains(rng, inner, n, d, m) / 100
    law = gx.Coupling(gx.Impedance(kep, ked), gx.Impedance(kip, kid), form=form)
    P = np.linalg.pinv(grasp.matrix) @ grasp.matrix
    R = np.eye(m) - P

    def eq_4(A, B):
        A, B = written_out(A, n, d), written_out(B, n, d)
        return P @ A + R @ B if form == "literal" else P @ A @ P + R @ B @ R

    split = grasp.split()
    K, D = eq_4(kep, kip), eq_4(ked, kid)
    assert np.allclose(law.stiffness(split), K, rtol=0, atol=1e-11)
    assert np.allclose(law.damping(split), D, rtol=0, atol=1e-13)
    e, de = rng.normal(size=m), rng.normal(size=m)
    assert np.allclose(law.force(split, e, de), K @ e + D @ de, rtol=0, atol=1e-11)
    assert np.allclose(law.force(split, e), K @ e, rtol=0, atol=1e-11)


@pytest.mark.parametrize("form", ["literal", "symmetric"])
def test_equal_gains_are_the_conventional_method_and_never_project(form, monkeypatch):
    # K e + D e' to the last bit; the projector is out of order meanwhile
    rng = np.random.default_rng(1)
    split = gx.Grasp(rng.normal(size=(5, 3))).split()
    e, de = rng.normal(size=15), rng.normal(size=15)

    def broken(*_):
        raise AssertionError("projected")

    monkeypatch.setattr(Split, "project", broken)
    monkeypatch.setattr(Split, "external", property(broken))
    law = gx.Coupling(gx.Impedance(70.0, 0.4), gx.Impedance(70.0, 0.4), form=form)
    assert np.array_equal(law.force(split, e, de), 70.0 * e + 0.4 * de)
    assert np.array_equal(law.force(split, e), 70.0 * e)
    assert np.array_equal(law.stiffness(split), 70.0 * np.eye(15))
    k, c = rng.uniform(10, 90, 5), rng.uniform(0, 1, 5)
    law = gx.Coupling(gx.Impedance(k, c), gx.Impedance(k, c), form=form)
    assert np.array_equal(law.force(split, e, de), np.repeat(k, 3) * e + np.repeat(c, 3) * de)
    K, D = semidefinite(rng, 15, 15), semidefinite(rng, 15, 15)
    law = gx.Coupling(gx.Impedance(K, D), gx.Impedance(K, D), form=form)
    assert np.array_equal(law.force(split, e, de), K @ e + D @ de)
    K = semidefinite(rng, 3, 3)
    law = gx.Coupling(gx.Impedance(K), gx.Impedance(np.tile(K, (5, 1, 1))), form=form)
    assert np.array_equal(law.stiffness(split), np.kron(np.eye(5), K))


def test_only_the_pair_that_differs_projects():
    # equal damping: D e' exactly, and the stiffness is split
    rng = np.random.default_rng(2)
    split = triangle().split()
    e, de = rng.normal(size=6), rng.normal(size=6)
    law = gx.Coupling(gx.Impedance(30.0, 0.5), gx.Impedance(70.0, 0.5))
    assert np.array_equal(law.damping(split), 0.5 * np.eye(6))
    assert np.allclose(law.force(split, e, de), law.stiffness(split) @ e + 0.5 * de, atol=1e-13)
    law = gx.Coupling(gx.Impedance(30.0, 0.5), gx.Impedance(30.0, 0.9))
    assert np.allclose(law.force(split, e, de), 30.0 * e + law.damping(split) @ de, atol=1e-13)


def test_numbers_give_the_same_law_in_both_forms():
    rng = np.random.default_rng(3)
    split = triangle(3).split()
    outer, inner = gx.Impedance(30.0, 0.2), gx.Impedance(70.0, 0.1)
    literal, symmetric = (gx.Coupling(outer, inner, form=form) for form in ("literal", "symmetric"))
    assert np.array_equal(literal.stiffness(split), symmetric.stiffness(split))
    e, de = rng.normal(size=9), rng.normal(size=9)
    assert np.array_equal(literal.force(split, e, de), symmetric.force(split, e, de))
    # its eigenvalues are the two gains, rank and m - rank times
    values = np.linalg.eigvalsh(literal.stiffness(split))
    assert np.allclose(values, [30.0] * 6 + [70.0] * 3, atol=1e-12)


@pytest.mark.parametrize("n", [2, 3, 5])
@pytest.mark.parametrize("d", [2, 3])
def test_symmetric_squeeze_holds_without_moving_the_object(n, d):
    # every finger 2 mm inwards along its radius: 70 N/m times 2 mm on each, and a wrench of zero to rounding
    angle = 2 * np.pi * np.arange(n) / n
    radial = np.stack([np.cos(angle), np.sin(angle)] + [0 * angle] * (d - 2), axis=1)
    grasp = gx.Grasp(0.025 * radial)
    law = gx.Coupling(gx.Impedance(30.0), gx.Impedance(70.0))
    f = law.force(grasp.split(), (-0.002 * radial).ravel())
    assert np.allclose(f, (-0.14 * radial).ravel(), atol=1e-15)
    assert np.abs(grasp.matrix @ f).max() < 1e-15


def closed_loop_work(K, u, v, radius, steps=720):
    """The line integral of f = K e over the circle e = r (u cos t + v sin t), by the midpoint of each chord."""
    t = 2 * np.pi * np.arange(steps + 1) / steps
    e = radius * (np.cos(t)[:, None] * u + np.sin(t)[:, None] * v)
    middle, step = (e[1:] + e[:-1]) / 2, np.diff(e, axis=0)
    return float(np.einsum("ti,ij,tj->", step, K, middle))


def test_literal_form_with_gains_per_finger_creates_energy_and_says_how_much():
    # Kep 80|40, Kip 60|30: K = [[70, 5], [10, 35]], skew part 2.5 N/m, 2 pi (5 mm)^2 2.5 N/m = 0.39 mJ a turn
    law = gx.Coupling(gx.Impedance([80.0, 40.0]), gx.Impedance([60.0, 30.0]))
    split = PAIR.split()
    with pytest.warns(ActiveCouplingWarning, match=r"2\.5 N/m creates up to 0\.39 mJ .* 5 mm"):
        K = law.stiffness(split)
    assert np.allclose(K, [[70.0, 5.0], [10.0, 35.0]], atol=1e-13)
    assert np.isclose(skew_part(K), 2.5, rtol=1e-12)
    assert np.isclose(loop_energy(K, 0.005), 2 * np.pi * 0.005**2 * 2.5, rtol=1e-12)
    work = closed_loop_work(K, np.array([1.0, 0.0]), np.array([0.0, 1.0]), 0.005)
    assert np.isclose(abs(work), loop_energy(K, 0.005), rtol=1e-4)


def test_no_loop_does_more_work_than_the_energy_of_the_warning():
    rng = np.random.default_rng(4)
    K = rng.normal(size=(9, 9))
    worst = 0.0
    for _ in range(200):
        u, v = np.linalg.qr(rng.normal(size=(9, 2)))[0].T
        worst = max(worst, abs(closed_loop_work(K, u, v, 0.005)))
    assert 0.1 * loop_energy(K, 0.005) < worst <= loop_energy(K, 0.005)
    # reached in the plane of the largest pair of singular vectors
    U, _, V = np.linalg.svd((K - K.T) / 2)
    assert np.isclose(abs(closed_loop_work(K, V[0], U[:, 0], 0.005)), loop_energy(K, 0.005), rtol=1e-4)


def test_the_warning_comes_once():
    law = gx.Coupling(gx.Impedance([80.0, 40.0]), gx.Impedance([60.0, 30.0]))
    with pytest.warns(ActiveCouplingWarning):
        law.force(PAIR.split(), [1e-3, 0.0])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        law.force(PAIR.split(), [1e-3, 0.0])
        law.stiffness(gx.Grasp([[0.0], [1.0]]).split())


def test_the_warning_comes_again_when_its_figure_has_grown_tenfold():
    # a finger that counts by a weight w: [[70, 5], [10, 35]] at w = 1, and next to no skew part while it is far away
    law = gx.Coupling(gx.Impedance([80.0, 40.0]), gx.Impedance([60.0, 30.0]))
    with pytest.warns(ActiveCouplingWarning) as told:
        K = [law.stiffness(PAIR.split(metric=np.array([1.0, w]))) for w in (1e-6, 2e-6, 0.9, 1.0)]
    skew = [skew_part(each) for each in K]
    assert skew[1] < 10.0 * skew[0] < skew[2] < skew[3] < 10.0 * skew[2]
    assert [f"{skew[i]:.3g} N/m" in str(told[j].message) for i, j in ((0, 0), (2, 1))] == [True, True]
    assert len(told) == 2


def test_a_literal_stiffness_with_a_negative_eigenvalue_is_named():
    # Kep 1000|0, Kip 0|1: K = 1/2 [[1000, -1], [1000, 1]], lowest eigenvalue (1001 - sqrt(999^2 + 999^2))/4
    law = gx.Coupling(gx.Impedance([1000.0, 0.0]), gx.Impedance([0.0, 1.0]))
    with pytest.warns(ActiveCouplingWarning, match="eigenvalue -103 N/m"):
        law.stiffness(PAIR.split())
    assert np.isclose((1001 - 999 * np.sqrt(2)) / 4, -102.95, atol=0.01)


def test_damping_is_judged_by_its_power():
    # v'Dv: a skew part does no work and is no fault; a negative eigenvalue is
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        quiet = gx.Coupling(gx.Impedance(70.0, [8.0, 4.0]), gx.Impedance(70.0, [6.0, 3.0]))
        D = quiet.damping(PAIR.split())
    assert np.isclose(skew_part(D), 0.25, rtol=1e-12)
    loud = gx.Coupling(gx.Impedance(70.0, [10.0, 0.0]), gx.Impedance(70.0, [0.0, 0.01]))
    with pytest.warns(ActiveCouplingWarning, match="damping .* N s/m"):
        loud.damping(PAIR.split())


@pytest.mark.parametrize("kind", KINDS[1:])
@pytest.mark.parametrize("weighted", [False, True])
def test_symmetric_form_is_passive_and_silent(kind, weighted):
    rng = np.random.default_rng([KINDS.index(kind), weighted])
    grasp = triangle()
    split = grasp.split(rng.uniform(0.3, 3.0, 3) if weighted else None)
    law = gx.Coupling(
        gx.Impedance(gains(rng, kind, 3, 2, 6)), gx.Impedance(gains(rng, kind, 3, 2, 6)), form="symmetric"
    )
    K = law.stiffness(split)
    assert np.array_equal(K, K.T)
    assert np.linalg.eigvalsh(K).min() > -1e-12
    # f = [Q' Kep Q + (I - Q)' Kip (I - Q)] e
    Q, A, B = split.displacement_external, spread(law.external.stiffness, split), spread(law.internal.stiffness, split)
    R = np.eye(6) - Q
    assert np.allclose(K, Q.T @ A @ Q + R.T @ B @ R, rtol=0, atol=1e-11)
    assert loop_energy(K, 0.005) == 0.0


def test_numbers_enter_through_the_metric():
    # f = M (kip e + (kep - kip) Q e); equal gains: k M e, exactly
    rng = np.random.default_rng(6)
    grasp = triangle()
    w = rng.uniform(0.3, 3.0, 3)
    A = rng.normal(size=(6, 6))
    for metric in (w, np.repeat(w, 2), A @ A.T + np.eye(6)):
        split = grasp.split(metric)
        M = np.diag(split.metric) if split.metric.ndim == 1 else split.metric
        e, de = rng.normal(size=6), rng.normal(size=6)
        Q = split.displacement_external
        law = gx.Coupling(gx.Impedance(30.0, 0.2), gx.Impedance(70.0, 0.1))
        expected = M @ (70 * e + 0.1 * de + Q @ (-40 * e + 0.1 * de))
        assert np.allclose(law.force(split, e, de), expected, rtol=0, atol=1e-11)
        assert np.allclose(law.stiffness(split), M @ (70 * np.eye(6) - 40 * Q), rtol=0, atol=1e-11)
        equal = gx.Coupling(gx.Impedance(70.0), gx.Impedance(70.0))
        assert np.array_equal(equal.force(split, e), 70.0 * split.weigh(e))


def test_the_same_number_in_every_shape_is_the_same_gain():
    # k, k per finger, k I and k I per finger all enter as k M; a full matrix stands as it is
    rng = np.random.default_rng(7)
    A = rng.normal(size=(6, 6))
    split = triangle().split(A @ A.T + np.eye(6))
    shapes = (50.0, np.full(3, 50.0), 50.0 * np.eye(2), 50.0 * np.tile(np.eye(2), (3, 1, 1)))
    for gain in shapes:
        assert np.allclose(spread(gain, split), 50.0 * split.metric, rtol=0, atol=1e-11)
    full = semidefinite(rng, 6, 6)
    assert np.array_equal(spread(full, split), full)


def test_a_nearly_weightless_finger_gives_nearly_no_force():
    rng = np.random.default_rng(8)
    for gain in (30.0, rng.uniform(10, 50, 3), semidefinite(rng, 2, 2), semidefinite(rng, 3, 2, 2)):
        law = gx.Coupling(gx.Impedance(gain), gx.Impedance(70.0), form="symmetric")
        f = law.force(triangle().split([1.0, 1.0, 1e-12]), rng.normal(size=6))
        assert np.abs(f[4:]).max() < 1e-8
        assert np.abs(f[:4]).max() > 1.0


def test_soft_fingers_take_numbers_through_the_torsion_length():
    # squeezing torsion: 1 rad of twist at every finger against 70 N/m and a 5 mm patch, 70 (5 mm)^2 N m/rad inside
    grasp = gx.Grasp([[0.0, 0.0, 0.0], [0.05, 0.0, 0.0]], [[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]], model="soft")
    split = grasp.split(grasp.metric(torsion_length=0.005))
    law = gx.Coupling(gx.Impedance(30.0), gx.Impedance(70.0))
    e = np.zeros(8)
    e[[3, 7]] = 1.0  # about opposed normals: the fingers twist against each other
    assert np.allclose(law.force(split, e)[[3, 7]], 70 * 0.005**2, rtol=1e-12)
    e[7] = -1.0  # together: the object turns
    assert np.allclose(law.force(split, e)[[3, 7]], [30 * 0.005**2, -30 * 0.005**2], rtol=1e-12)


def test_matrices_are_kept_for_the_last_split_and_cannot_be_changed():
    law = gx.Coupling(gx.Impedance(30.0), gx.Impedance(70.0))
    split = PAIR.split()
    K = law.stiffness(split)
    assert law.stiffness(split) is K
    with pytest.raises(ValueError, match="read-only"):
        K[0, 0] = 0.0
    assert np.array_equal(law.stiffness(gx.Grasp([[0.0], [3.0]]).split()), K)


def test_bare_matrices_take_numbers_and_full_matrices():
    split = gx.Split(np.ones((1, 3)))
    full = gx.Impedance(np.diag([1.0, 2.0, 3.0]))
    law = gx.Coupling(gx.Impedance(30.0), full, form="symmetric")
    P = np.full((3, 3), 1 / 3)
    R = np.eye(3) - P
    assert np.allclose(law.stiffness(split), 30 * P + R @ np.diag([1.0, 2.0, 3.0]) @ R, atol=1e-14)
    with pytest.raises(InputError, match="has no information about fingers"):
        gx.Coupling(gx.Impedance([1.0, 2.0, 3.0]), gx.Impedance(1.0)).stiffness(split)


@pytest.mark.parametrize(
    "bad",
    [
        -1.0,
        np.nan,
        np.inf,
        "stiff",
        [],
        [1.0, -2.0],
        [[1.0, 2.0], [0.0, 1.0]],
        [[1.0, 0.0], [0.0, -1.0]],
        [np.eye(2), -np.eye(2)],
        np.ones((2, 3)),
        np.ones((1, 2, 2, 2)),
    ],
)
def test_gains_that_are_none(bad):
    with pytest.raises(InputError, match="stiffness"):
        gx.Impedance(bad)
    with pytest.raises(InputError, match="damping"):
        gx.Impedance(1.0, bad)


def test_what_does_not_fit_is_refused():
    law = gx.Coupling(gx.Impedance(30.0), gx.Impedance(70.0))
    split = PAIR.split()
    for bad in ([1.0], [[1.0, 2.0]], [np.nan, 0.0]):
        with pytest.raises(InputError, match="e: given"):
            law.force(split, bad)
        with pytest.raises(InputError, match="de: given"):
            law.force(split, [0.0, 0.0], bad)
    with pytest.raises(UnknownNameError, match="did you mean 'symmetric'"):
        gx.Coupling(gx.Impedance(1.0), gx.Impedance(1.0), form="symetric")  # type: ignore[arg-type] # misspelt
    with pytest.raises(InputError, match="external"):
        gx.Coupling(30.0, gx.Impedance(70.0))  # type: ignore[arg-type] # a number
    with pytest.raises(InputError, match="gain"):
        gx.Coupling(gx.Impedance([1.0, 2.0, 3.0]), gx.Impedance(70.0)).stiffness(split)
    # a (d, d) matrix says nothing about torsion
    soft = gx.Grasp(np.eye(3), -np.eye(3), model="soft")
    with pytest.raises(InputError, match="no moment"):
        gx.Coupling(gx.Impedance(np.eye(3)), gx.Impedance(1.0)).stiffness(soft.split(soft.metric(torsion_length=0.005)))


def test_the_input_is_not_kept():
    k = np.array([1.0, 2.0])
    impedance = gx.Impedance(k)
    k[:] = 5.0
    assert np.array_equal(impedance.stiffness, [1.0, 2.0])
    assert isinstance(gx.Impedance(3).stiffness, float)


@pytest.mark.parametrize("n", [1, 2, 3])
def test_an_object_stiffness_on_soft_fingers_has_no_unit(n: int) -> None:
    """Metres or millimetres, any reference: K_ep the same to 1e-11, P K_ep = K_ep = K_ep P', G K_ep G' = K_c."""
    rng = np.random.default_rng(n)
    points = 0.03 * rng.normal(size=(n, 3))
    normals = -points / np.linalg.norm(points, axis=1)[:, None]
    size = np.array([1.0, 1.0, 1.0, 0.03, 0.03, 0.03])
    A = rng.normal(size=(6, 6))
    K_o = 50.0 * (A @ A.T) * np.outer(size, size)
    found = []
    for unit in (1.0, 1000.0):
        for origin in np.zeros(3), np.array([0.1, 0.2, -0.3]):
            grasp = gx.Grasp(unit * points, normals, model="soft", origin=unit * origin)
            split = grasp.split(metric=grasp.metric(torsion_length=0.008 * unit))
            turns = np.array([1.0] * 3 + [unit] * 3)
            K = gx.ObjectImpedance(K_o * np.outer(turns, turns) / unit, point=np.zeros(3))
            K_ep = gx.Coupling(K, gx.Impedance(0.0)).stiffness(split)
            torsion = np.where(grasp.torsion_columns, 1.0 / unit, 1.0)
            found.append(K_ep * np.outer(torsion, torsion) * unit)  # of forces in N, moments in N m
            P, scale = split.external, np.abs(K_ep).max()
            np.testing.assert_allclose(P @ K_ep, K_ep, rtol=0.0, atol=1e-11 * scale)
            np.testing.assert_array_equal(K_ep, K_ep.T)
            if n > 1:  # two soft fingers hold all six freedoms
                felt = gx.Grasp(points, normals, model="soft").matrix
                np.testing.assert_allclose(felt @ found[-1] @ felt.T, K_o, rtol=0.0, atol=1e-9 * np.abs(K_o).max())
    for other in found[1:]:
        np.testing.assert_allclose(other, found[0], rtol=0.0, atol=1e-11 * np.abs(found[0]).max())
