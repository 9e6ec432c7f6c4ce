"""Touching and letting go: the paper's two-finger rule, n fingers against every subset, sticking, friction cones."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

import graspfx as gx
from graspfx.errors import InputError
from graspfx.grasp.unilateral_force import Touch
from tests.support.families import efforts


def every_subset(K: np.ndarray, e: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """The friction-free answer by trying every set of touching fingers."""
    n, d = normals.shape
    N = np.zeros((n * d, n))
    for i in range(n):
        N[i * d : (i + 1) * d, i] = normals[i]
    A, g = N.T @ np.linalg.inv(K) @ N, N.T @ e  # minimise 1/2 l'A l - l'g over l >= 0
    best = None
    for k in range(n + 1):
        for subset in itertools.combinations(range(n), k):
            s = list(subset)
            force = np.zeros(n)
            if s:
                force[s] = np.linalg.solve(A[np.ix_(s, s)], g[s])
            if (force >= -1e-12).all() and (A @ force - g >= -1e-12).all():
                best = force
    assert best is not None
    return N @ best


KEP, KIP = 40.0, 160.0
ALONE = 2 * KEP * KIP / (KEP + KIP)


def pair_stiffness(kep: float = KEP, kip: float = KIP) -> np.ndarray:
    """K of two fingers on a line, from eqs. (10)-(12)."""
    return 0.5 * np.array([[kep + kip, kep - kip], [kep - kip, kep + kip]])


def random_stiffness(rng: np.random.Generator, n: int, d: int, kep: float, kip: float) -> np.ndarray:
    """kep P + kip (I - P) with P from numpy's pseudoinverse of a hand-made G."""
    r = rng.normal(size=(n, d)) * 0.03
    rows = [np.tile(np.eye(d)[a], n) for a in range(d)]
    if d == 2:
        rows.append(np.stack([-r[:, 1], r[:, 0]], axis=1).ravel())
    if d == 3:
        rows += [np.cross(np.eye(3)[a], r).ravel() for a in range(3)]
    P = np.linalg.pinv(np.array(rows)) @ np.array(rows)
    return kep * P + kip * (np.eye(n * d) - P)


def random_normals(rng: np.random.Generator, n: int, d: int) -> np.ndarray:
    v = rng.normal(size=(n, d))
    return v / np.linalg.norm(v, axis=1, keepdims=True)


def test_two_fingers_follow_equations_24_to_26() -> None:
    """2000 random pairs: both push while (11)-(12) say so, else the nearer one alone with 2 kep kip/(kep + kip)."""
    rng = np.random.default_rng(0)
    normals = np.array([[1.0], [-1.0]])
    for _ in range(2000):
        e = rng.normal(size=2) * 0.01
        both = pair_stiffness() @ e
        pushes = both * normals[:, 0]
        expected = both
        if (pushes < 0.0).any():
            expected = np.zeros(2)
            nearer = int(np.argmax(e * normals[:, 0]))
            if e[nearer] * normals[nearer, 0] > 0.0:
                expected[nearer] = ALONE * e[nearer]
        touch = gx.unilateral_force(pair_stiffness(), e, normals)
        np.testing.assert_allclose(touch.force, expected, rtol=1e-14, atol=1e-16)
        assert touch.residual < 1e-14  # of forces up to 5 N


def test_contact_point_of_equation_25() -> None:
    """Where finger i ceases to touch is x_ci of (25) to 1e-14 of the distances at hand: found by bisection."""
    x, xj = 0.0, 0.003  # finger j pushes from the left, in by 3 mm; normals +1 and -1
    x_ci = (KIP - KEP) / (KEP + KIP) * xj + 2 * KEP / (KEP + KIP) * x  # eq. (25)
    normals = np.array([[1.0], [-1.0]])
    inside, outside = x_ci - 0.001, x_ci + 0.001
    while (middle := 0.5 * (inside + outside)) not in (inside, outside):
        touch = gx.unilateral_force(pair_stiffness(), [xj - x, middle - x], normals)
        inside, outside = (middle, outside) if touch.status[1] == "slide" else (inside, middle)
        assert touch.status[0] == "slide"
    assert outside == pytest.approx(x_ci, abs=1e-14 * xj)
    touch = gx.unilateral_force(pair_stiffness(), [xj - x, outside - x], normals)
    assert touch.force[0] == pytest.approx(ALONE * (xj - x), rel=1e-14)


@pytest.mark.parametrize("n", [2, 3, 5, 20])
def test_lone_finger_among_n_on_a_line(n: int) -> None:
    """One of n fingers on a line pushes with n kep kip/((n - 1) kep + kip)."""
    K = KIP * np.eye(n) + (KEP - KIP) / n
    e = np.full(n, -1.0)
    e[0] = 0.001
    touch = gx.unilateral_force(K, e, np.ones((n, 1)))
    assert touch.force[0] == pytest.approx(n * KEP * KIP / ((n - 1) * KEP + KIP) * 0.001, rel=1e-13)
    assert touch.force[1:].tolist() == [0.0] * (n - 1)


@pytest.mark.parametrize("d", [1, 2, 3])
@pytest.mark.parametrize("n", [1, 2, 3, 4, 5])
def test_agrees_with_every_subset(n: int, d: int) -> None:
    rng = np.random.default_rng(10 * n + d)
    for _ in range(40):
        kep, kip = 10 ** rng.uniform(0, 3, 2)
        K, normals = random_stiffness(rng, n, d, kep, kip), random_normals(rng, n, d)
        e = rng.normal(size=n * d) * 0.01
        touch = gx.unilateral_force(K, e, normals)
        expected = every_subset(K, e, normals)
        np.testing.assert_allclose(touch.force, expected, atol=1e-10 * max(kep, kip) * 0.01)
        assert touch.residual <= 1e-11 * max(kep, kip) * 0.01


def test_matrix_that_is_not_symmetric() -> None:
    """A literal law's K: the complementarity problem still has one answer, found among the subsets."""
    rng = np.random.default_rng(3)
    for _ in range(50):
        skew = rng.normal(size=(4, 4))
        K = 50 * np.eye(4) + 5 * (skew - skew.T)
        e, normals = rng.normal(size=4) * 0.01, random_normals(rng, 4, 1)
        touch = gx.unilateral_force(K, e, normals)
        sign = normals[:, 0]
        f, s = touch.force * sign, np.linalg.solve(K, touch.force) * sign - e * sign
        assert (f >= 0.0).all() and (s > -1e-14).all() and abs(f @ s) < 1e-16


def test_singular_stiffness() -> None:
    """kip = 0: the fingers share the external force only, so a lone finger feels nothing."""
    K = 0.5 * KEP * np.ones((2, 2))
    normals = np.array([[1.0], [-1.0]])
    assert gx.unilateral_force(K, [0.001, 0.002], normals).force.tolist() == [0.0, 0.0]
    both = gx.unilateral_force(K, [0.001, 0.001], np.array([[1.0], [1.0]]))
    np.testing.assert_allclose(both.force, [KEP * 0.001] * 2, rtol=1e-14)


def test_sticking_finger_is_released_whole() -> None:
    """Friction 0 drops the tangents at once, "stick" keeps them until the normal force would pull."""
    K = np.eye(4) * 50.0
    normals = np.array([[1.0, 0.0], [-1.0, 0.0]])
    e = np.array([0.001, 0.002, 0.004, 0.002])
    stick = gx.unilateral_force(K, e, normals, friction="stick")
    slip = gx.unilateral_force(K, e, normals)
    np.testing.assert_allclose(stick.force, [0.05, 0.1, 0.0, 0.0], atol=1e-16)
    np.testing.assert_allclose(slip.force, [0.05, 0.0, 0.0, 0.0], atol=1e-16)
    assert stick.status == ("stick", "free")
    assert slip.status == ("slide", "free")


def test_lone_sticking_finger_is_isotropic() -> None:
    """Two opposed fingers, rotation locked, one free: 2 kep kip/(kep + kip) along the normal and along the tangent."""
    P = 0.5 * np.tile(np.eye(2), (2, 2))
    K = KEP * P + KIP * (np.eye(4) - P)
    normals = np.array([[1.0, 0.0], [-1.0, 0.0]])
    touch = gx.unilateral_force(K, [0.001, 0.0007, 0.02, 0.0], normals, friction="stick")
    np.testing.assert_allclose(touch.force, [ALONE * 0.001, ALONE * 0.0007, 0.0, 0.0], rtol=1e-13, atol=1e-17)


def test_coefficient_says_who_slides() -> None:
    """Three uncoupled fingers of 50 N/m, mu = 0.5: the trial force inside, outside and behind the cone (Coulomb)."""
    normals = np.array([[1.0, 0.0], [0.0, -1.0], [-1.0, 0.0]])
    e = np.array([0.004, 0.001, 0.004, -0.004, 0.001, 0.003])
    touch = gx.unilateral_force(np.eye(6) * 50.0, e, normals, friction=0.5)
    np.testing.assert_allclose(touch.force, [0.2, 0.05, 0.1, -0.2, 0.0, 0.0], rtol=1e-14, atol=1e-17)
    assert touch.status == ("stick", "slide", "free")
    assert touch.law == "coulomb"
    assert touch.residual < 1e-16
    each = gx.unilateral_force(np.eye(6) * 50.0, e, normals, friction=[0.0, 2.0, 0.5])
    np.testing.assert_allclose(each.force, [0.2, 0.0, 0.2, -0.2, 0.0, 0.0], rtol=1e-14, atol=1e-17)
    assert each.status == ("slide", "stick", "free")


def test_coefficient_of_zero_is_no_friction() -> None:
    """0, None and a zero per finger: the same digits; a tiny one differs by its own size, and the law is named."""
    rng = np.random.default_rng(21)
    for _ in range(20):
        K, normals, e = random_stiffness(rng, 4, 3, KEP, KIP), random_normals(rng, 4, 3), rng.normal(size=12) * 0.01
        without = gx.unilateral_force(K, e, normals)
        for friction in (0, 0.0, [0.0] * 4):
            assert gx.unilateral_force(K, e, normals, friction).force.tolist() == without.force.tolist()
        assert without.law == "frictionless"
        tiny = gx.unilateral_force(K, e, normals, 1e-12)
        np.testing.assert_allclose(tiny.force, without.force, rtol=0.0, atol=1e-10)
        assert gx.unilateral_force(K, e, normals, "stick").law == "stick"


def test_squeezed_pair_slips_at_the_coefficient() -> None:
    """Two opposed fingers push by f_n and are dragged together along the face: 2 mu f_n is all they hold.

    Rotation locked, 2 mm in: f_n = kip 2 mm = 0.32 N. Stuck they pull with kep per finger, so they slip once
    kep x = mu f_n, at x = 4.8 mm for mu = 0.6.
    """
    P = 0.5 * np.tile(np.eye(2), (2, 2))
    K = KEP * P + KIP * (np.eye(4) - P)
    normals = np.array([[1.0, 0.0], [-1.0, 0.0]])
    for x, expected, status in ((0.0047, KEP * 0.0047, "stick"), (0.0049, 0.192, "slide"), (0.02, 0.192, "slide")):
        touch = gx.unilateral_force(K, [0.002, x, -0.002, x], normals, friction=0.6)
        np.testing.assert_allclose(touch.force, [0.32, expected, -0.32, expected], rtol=1e-13)
        assert touch.status == (status, status)


@pytest.mark.parametrize("ratio", [0.01, 4.0, 1000.0])
def test_friction_cones_of_a_full_stiffness(ratio: float) -> None:
    """Random pushes, some literal laws' K among them: in the cones, f = K (e + s), and slipping only dissipates."""
    rng = np.random.default_rng(22)
    for k in range(15):
        n, d = int(rng.integers(1, 6)), int(rng.integers(2, 4))
        kep, kip = 100.0 / np.sqrt(ratio), 100.0 * np.sqrt(ratio)
        K, normals, e = random_stiffness(rng, n, d, kep, kip), random_normals(rng, n, d), rng.normal(size=n * d) * 0.01
        if k % 3 == 0:
            skew = rng.normal(size=K.shape)
            K += 0.1 * min(kep, kip) * (skew - skew.T)
        touch = gx.unilateral_force(K, e, normals, friction=0.5)
        size = max(kep, kip) * float(np.abs(e).max())
        f = touch.force.reshape(n, d)
        along = (f * normals).sum(axis=1)
        across = np.linalg.norm(f - along[:, None] * normals, axis=1)
        assert touch.law in ("coulomb", "associated")
        assert touch.residual <= 1e-13 * size
        assert (along >= 0.0).all() and (across <= 0.5 * along + 1e-15 * size).all()
        s = (np.linalg.solve(K, touch.force) - e).reshape(n, d)
        worst = 1e-13 * size * 0.01 * max(ratio, 1.0 / ratio)
        assert ((f * s).sum(axis=1) <= worst).all()
        for i, status in enumerate(touch.status):
            if status == "stick":
                assert np.abs(s[i]).max() <= 1e-12 * max(ratio, 1.0 / ratio) * 0.01


def test_singular_stiffness_with_friction() -> None:
    """kep = 0 for three fingers in space: still an answer, in the cones, with the residual it admits to."""
    rng = np.random.default_rng(23)
    K, normals = random_stiffness(rng, 3, 3, 0.0, KIP), random_normals(rng, 3, 3)
    touch = gx.unilateral_force(K, rng.normal(size=9) * 0.01, normals, friction=0.5)
    f = touch.force.reshape(3, 3)
    along = (f * normals).sum(axis=1)
    assert (np.linalg.norm(f - along[:, None] * normals, axis=1) <= 0.5 * along + 1e-15).all()
    assert touch.residual <= 1e-4 * KIP * 0.01


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ((np.eye(2), [0.0, 0.0], [[1.0], [0.0]]), r"normals\[1\]: given \[0.0\], expected a direction"),
        ((np.eye(3), [0.0, 0.0], [[1.0], [1.0]]), r"\(2, 2\)"),
        ((np.eye(2), [0.0, np.nan], [[1.0], [1.0]]), "finite"),
        ((-np.eye(2), [0.0, 0.0], [[1.0], [1.0]]), "semidefinite; its smallest eigenvalue is -1 N/m"),
        ((np.eye(2), [0.0, 0.0], [[1.0], [1.0]], -0.5), "coefficient >= 0"),
        ((np.eye(2), [0.0, 0.0], [[1.0], [1.0]], np.nan), "coefficient"),
        ((np.eye(2), [0.0, 0.0], [[1.0], [1.0]], [0.5, 0.5, 0.5]), "one or 2"),
        ((np.eye(2), [0.0, 0.0], [[1.0], [1.0]], "slip"), "'stick', or a coefficient"),
    ],
)
def test_bad_input_says_what_is_wrong(arguments: tuple[object, ...], says: str) -> None:
    with pytest.raises(InputError, match=says):
        gx.unilateral_force(*arguments)  # type: ignore[arg-type]


def stack(levels: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """W = H M^-1 H' and -H v of so many boxes on one another, four contacts each, the third of three axes upwards."""
    rows = []
    for k in range(levels):
        for x, y in ((-0.05, -0.05), (-0.05, 0.05), (0.05, -0.05), (0.05, 0.05)):
            for axis in np.eye(3):
                row = np.zeros((levels, 6))
                row[k] = [*axis, *np.cross([x, y, -0.025], axis)]
                if k:
                    row[k - 1] = [*-axis, *-np.cross([x, y, 0.025], axis)]
                rows.append(row.ravel())
    H = np.array(rows)
    inertia = np.array([0.0125, 0.0125, 0.02]) / 12.0
    velocity = 0.02 * rng.normal(size=(levels, 6)) + np.array([0.005, 0.0, -0.05, 0.0, 0.0, 0.0])
    return H / np.tile([1.0, 1.0, 1.0, *inertia], levels) @ H.T, -H @ velocity.ravel()


@pytest.mark.parametrize("mu", [None, 0.5])
@efforts(short=4, full=12)
def test_stacks_of_boxes_are_solved_or_refused(cases: int, mu: float | None) -> None:
    """K = (W + d I)^-1 of singular W, four contacts a box, d down to 1e-12 of the largest eigenvalue.

    f and s = W f - e are checked by themselves: f on the cone where the law's return map puts f - s / |W|, to 1e-5 of
    the largest force for d as small as 1e-10, or the error says which eigenvalues are too far apart.
    """
    refused = {}
    for k, delta in enumerate((1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10, 1e-13)):
        W, e = stack(cases, np.random.default_rng(k))
        W += delta * np.linalg.eigvalsh(W)[-1] * np.eye(len(W))
        K = np.linalg.inv(W)
        try:
            touch = gx.unilateral_force(0.5 * (K + K.T), e, np.tile([0.0, 0.0, 1.0], (4 * cases, 1)), mu)
        except InputError as error:
            refused[delta] = str(error)
            continue
        f = touch.force.reshape(-1, 3)
        t = f - (W @ touch.force - e).reshape(-1, 3) / np.abs(np.diag(W)).max()
        sideways, up = np.linalg.norm(t[:, :2], axis=1), np.maximum(t[:, 2], 0.0)
        if touch.law == "associated":  # the nearest point of the cone
            inside, edge = sideways <= 0.5 * t[:, 2], np.maximum((t[:, 2] + 0.5 * sideways) / 1.25, 0.0)
            up = np.where(inside, t[:, 2], edge)
        share = np.minimum(1.0, (mu or 0.0) * up / np.maximum(sideways, 1e-300))
        assert np.abs(np.column_stack([share[:, None] * t[:, :2], up]) - f).max() <= 1e-5 * np.abs(f).max()
    assert refused and max(refused) < 1e-9 and all("its eigenvalues are" in text for text in refused.values())


def test_the_card_says_which_law_holds() -> None:
    """Where Coulomb's law was asked for and another one holds, the repr says so."""
    touch = Touch(np.array([0.1, 0.2]), ("slide",), 1e-17, "associated")
    assert "associated: no solution of Coulomb's law was found" in repr(touch)
    assert "Coulomb's" in repr(gx.unilateral_force(np.eye(2), [0.1, 0.0], [[1.0, 0.0]], friction=0.5))
