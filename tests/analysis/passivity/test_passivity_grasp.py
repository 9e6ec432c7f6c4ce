"""Which gains of a grasp are passive: limits against the leak matrix, single objects, and energies of fingers."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.optimize

import graspfx as gx
from graspfx.analysis import passivity
from graspfx.errors import InputError, UnknownNameError

T = 0.005
NO_OBJECT = np.zeros((0, 4))


def split_stiffness(G: np.ndarray, kep: float, kip: float) -> np.ndarray:
    P = np.linalg.pinv(G) @ G
    return kep * P + kip * (np.eye(len(P)) - P)


def random_grasp(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """A grasp matrix of three to five fingers in the plane or in space, and a viscosity of its object."""
    rng = np.random.default_rng(seed)
    d = 2 + seed % 2
    points = rng.normal(scale=0.03, size=(int(rng.integers(3, 6)), d))
    root = rng.normal(size=(3 * (d - 1),) * 2) * np.repeat([1.0, 0.02], [d, 2 * d - 3])[:, None]
    return gx.grasp_matrix(points), root @ root.T


def largest(holds) -> float:
    """The gain up to which a display is passive, by bisection to 1e-6 N/m."""
    low, high = 0.0, 1000.0
    for _ in range(30):
        k = (low + high) / 2
        low, high = (k, high) if holds(k) else (low, k)
    return low


def test_the_papers_two_fingers():
    """80 N/m to squeeze, as against a wall; two fingers share 0.8 N s/m: 400 (0.2)(0.4)/0.6 = 53.3 N/m to move."""
    found = passivity.coupling_limits([[1.0, 1.0]], 0.2, T, 0.8)
    assert found.internal == pytest.approx(80.0)
    assert found.external == pytest.approx(160.0 / 3)
    assert passivity.external_limit(0.2, T, 0.4) == pytest.approx(160.0 / 3)
    assert passivity.external_limit(0.2, T, np.inf) == pytest.approx(passivity.wall_limit(0.2, T))
    assert passivity.external_limit(0.2, T, 0.0) == passivity.external_limit(0.0, T, 0.0) == 0.0


@pytest.mark.parametrize("mass", [0.01, 1.0, 100.0])
def test_the_external_limit_holds_for_every_mass_and_is_reached_by_heavy_ones(mass):
    def passive(k):
        return passivity.damping_margin(passivity.grasp_display([[k]], [[1.0]], mass, 0.4, T), 0.2, T) >= 0.0

    limit, found = passivity.external_limit(0.2, T, 0.4), largest(passive)
    # what is left over falls as the object's rate b/m: 6e-4 N/m at 10 kg
    assert limit <= found + 1e-6
    if mass >= 1.0:
        assert found - limit <= 0.01 / mass + 1e-6


@pytest.mark.parametrize("seed", range(8))
def test_limits_are_where_the_leak_matrix_stops_being_covered(seed):
    G, viscosity = random_grasp(seed)
    damping = {"external_damping": 0.02, "internal_damping": 0.03} if seed % 3 else {}
    found = passivity.coupling_limits(G, 0.2, T, viscosity, **damping)
    D = split_stiffness(G, damping.get("external_damping", 0.0), damping.get("internal_damping", 0.0))
    assert len(found.modal_viscosity) == len(G)
    for kep, kip in ((found.external, found.internal), (0.0, found.internal), (found.external, 0.0)):
        if kep == 0.0 and damping:
            continue  # ked alone may leak more than a weak mode covers
        for factor, sign in ((1 - 1e-5, 1.0), (1 + 1e-5, -1.0)):
            K = split_stiffness(G, factor * kep, factor * kip)
            # rotations in units of the contacts' size, so that the eigenvalue is no smaller than its question
            S = np.diag(1 / np.linalg.norm(G, axis=1))
            margin = passivity.leak_margin(K, S @ G, 0.2, S @ viscosity @ S, T, coupling_damping=D)
            if found.external > 0.0 or sign < 0.0:
                assert sign * margin > -1e-15


@pytest.mark.parametrize("seed", range(6))
def test_what_the_leak_matrix_covers_is_passive_for_every_object(seed):
    """Full matrices, unequal devices: B is made to cover the leak exactly; objects of six masses feel passive."""
    rng = np.random.default_rng(seed)
    m, w = 4, 2
    G, root = rng.normal(size=(w, m)), rng.normal(size=(m, m))
    K = 10.0 * root @ root.T
    D = 0.01 * root.T @ root if seed % 2 else np.zeros((m, m))
    leak = passivity.leak_matrix(K, G, T, damping=D)
    # splitting |D x - G'D q|^2 <= (1 + c)|D x|^2 + (1 + 1/c)|D q|^2 gives dampings that cover it and no more
    c = rng.uniform(0.5, 2.0)
    Bd, Bo = (1 + c) * leak[:m, :m], (1 + 1 / c) * leak[m:, m:]
    assert passivity.leak_margin(K, G, Bd, Bo, T, coupling_damping=D) == pytest.approx(0.0, abs=1e-12)
    for mass in (0.003, 0.03, 0.3, 3.0, 30.0, 300.0):
        H = passivity.grasp_display(K, G, np.diag([mass, 2 * mass]), Bo, T, damping=D)
        assert passivity.damping_margin(H, Bd, T) >= -1e-9


def test_without_an_object_the_leak_is_a_walls():
    K = np.diag([80.0, 40.0, 20.0, 10.0])
    assert passivity.leak_margin(K, NO_OBJECT, 0.2, 0.0, T) == pytest.approx(0.0, abs=1e-15)
    assert passivity.leak_matrix(K, NO_OBJECT, T, damping=-0.01 * np.eye(4))[0, 0] == pytest.approx(0.21)
    assert passivity.required_damping(passivity.grasp_display(K, NO_OBJECT, 1.0, 1.0, T), T) == pytest.approx(0.2)
    assert passivity.coupling_limits(NO_OBJECT, 0.2, T, 1.0).external == np.inf
    assert passivity.coupling_limits([[1.0]], 0.2, T, 1.0).internal == np.inf


@pytest.mark.parametrize("integrator", ["explicit", "semi-implicit", "exact"])
@pytest.mark.parametrize("damping", [None, 0.05])
def test_the_display_of_one_object_is_the_feedback_of_its_transfer_function(integrator, damping):
    """H = k (1 - g k P/(1 + g k P)), g = 2 fingers, P from force to position by hand for each integrator."""
    k, m, b, z = 40.0, 0.1, 0.8, np.exp(0.7j)
    E = np.exp(-b * T / m)
    P = {
        "explicit": T**2 / m / ((z - 1) * (z - 1 + b * T / m)),
        "semi-implicit": T**2 / m * z / ((z - 1) * (z - 1 + b * T / m)),
        "exact": (T - (1 - E) * m / b) / b / (z - 1) + (1 - E) / b * m / b * (1 - E) / ((z - 1) * (z - E)),
    }[integrator]
    gain = k + (damping or 0.0) * (1 - 1 / z) / T
    D = None if damping is None else damping * np.eye(2)
    A, B, C, feed = passivity.grasp_display(
        k * np.eye(2), [[1.0, 1.0]], m, b, T, damping=D, integrator=integrator
    )  # fmt: skip
    H = C @ np.linalg.solve(z * np.eye(len(A)) - A, B) + feed
    np.testing.assert_allclose(H @ [1.0, 1.0], np.full(2, gain / (1 + 2 * gain * P)), rtol=1e-9)
    np.testing.assert_allclose(H @ [1.0, -1.0], [gain, -gain], rtol=1e-12)  # squeezing moves nothing


def test_an_explicit_object_gives_energy_that_an_exact_one_does_not():
    """The paper's system: explicit steps cost stiffness, 38.8 N/m of the 53.3 that hold for every exact object."""
    K = split_stiffness(np.array([[1.0, 1.0]]), 42.0, 78.0)

    def margin(integrator):
        return passivity.damping_margin(
            passivity.grasp_display(K, [[1.0, 1.0]], 0.1, 0.8, T, integrator=integrator), 0.2, T
        )

    assert margin("explicit") < -0.03
    assert margin("exact") == pytest.approx(0.005, rel=1e-9)  # the squeeze's: 0.2 - 78 T/2


def test_an_asymmetric_stiffness_feeds_slow_circles_unless_the_object_gives_way_to_them():
    """H(1) = (I - P) Kip (I - G'(G Kep G')^-1 G Kep) behind a free object, symmetric for Kep in proportion to Kip."""
    G = np.array([[1.0, 1.0, 1.0]])
    P = np.linalg.pinv(G) @ G
    Kep = np.diag([80.0, 40.0, 40.0])

    def literal(Kip):
        return P @ Kep + (np.eye(3) - P) @ Kip

    with pytest.raises(InputError, match="symmetric"):
        passivity.leak_matrix(literal(0.75 * Kep), G, T)
    standing = passivity.grasp_display(literal(0.75 * Kep), np.zeros((0, 3)), 0.1, 0.8, T)
    assert passivity.required_damping(standing, T) == np.inf
    for Kip, enough in ((0.75 * Kep, True), (np.diag([60.0, 90.0, 30.0]), False)):
        free = passivity.grasp_display(literal(Kip), G, 0.1, 0.8, T)
        assert bool(np.isfinite(passivity.required_damping(free, T))) is enough


@pytest.mark.parametrize("seed", range(4))
def test_fingers_that_touch_and_let_go_leak_no_more(seed):
    """V_{k+1} - V_k - f_k'De <= 1/2 De'K De for forces that only push, V = 1/2 f'K^-1 f, over 200 random steps."""
    rng = np.random.default_rng(seed)
    normals = rng.normal(size=(3, 2))
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    K = split_stiffness(gx.grasp_matrix(0.03 * -normals), 40.0, 160.0)
    e = rng.normal(scale=2e-3, size=(200, 6)).cumsum(axis=0) / 3
    f = np.array([gx.unilateral_force(K, x, normals).force for x in e])
    V = 0.5 * (f * np.linalg.solve(K, f.T).T).sum(axis=1)
    D = np.diff(e, axis=0)
    created = np.diff(V) - (f[:-1] * D).sum(axis=1)
    assert (created <= 0.5 * ((D @ K) * D).sum(axis=1) + 1e-15).all()
    assert (f == 0.0).any() and (f != 0.0).any()  # both happened


def test_what_does_not_fit_is_refused():
    with pytest.raises(UnknownNameError):
        passivity.grasp_display([[1.0]], [[1.0]], 0.1, 0.8, T, integrator="exakt")  # type: ignore[arg-type] # misspelt
    for call in (
        lambda: passivity.grasp_display([[1.0]], [[1.0]], 0.0, 0.8, T),
        lambda: passivity.grasp_display(np.eye(2), [[1.0]], 0.1, 0.8, T),
        lambda: passivity.leak_matrix(-np.eye(1), [[1.0]], T),
        lambda: passivity.leak_matrix(np.eye(1), [1.0], T),
        lambda: passivity.leak_margin(np.eye(1), [[1.0]], [0.1, 0.2], 0.1, T),
        lambda: passivity.coupling_limits([[1.0]], -0.1, T, 0.8),
        lambda: passivity.coupling_limits([[1.0]], 0.1, 0.0, 0.8),
        lambda: passivity.external_limit(0.2, T, -1.0),
        lambda: passivity.external_limit(0.2, T, 1.0, coupling_damping=np.nan),
    ):
        with pytest.raises(InputError):
            call()


def test_the_series_of_two_dampings_is_what_an_operator_can_use():
    """min over the share s of a stretch of 1 m that the object takes: b (1 - s)^2 + B s^2 = b B/(b + B)."""
    found = scipy.optimize.minimize_scalar(lambda s: 0.2 * (1 - s) ** 2 + 0.7 * s**2)
    assert passivity.external_limit(0.2, T, 0.7) * T / 2 == pytest.approx(found.fun, rel=1e-9)
