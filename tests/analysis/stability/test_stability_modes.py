"""Grasps of n fingers: their modes against the whole loop, squeezing, pushing."""

from __future__ import annotations

import numpy as np
import pytest

import graspfx as gx
from graspfx.analysis.grasp_stiffness import preloaded, pushing
from graspfx.analysis.linearisation import Linearisation
from graspfx.analysis.stability import INTEGRATORS, loop_matrix, spectral_radius
from graspfx.analysis.stability.modes import modes
from graspfx.errors import InputError
from tests.support.sampled_loops import held_device

T = 0.005


def random_grasp(seed: int) -> dict[str, object]:
    """A random grasp of equal devices, every integrator, with and without damping, springs and delays."""
    rng = np.random.default_rng(seed)
    m, r = int(rng.integers(3, 9)), int(rng.integers(1, 4))
    G, A, C = rng.normal(size=(r, m)), rng.normal(size=(r, r)), rng.normal(size=(r, r))
    inertia = 0.05 * A @ A.T + 0.02 * np.eye(r)
    P = np.linalg.pinv(G) @ G
    kep, kip = rng.uniform(5.0, 80.0, 2)
    ked, kid = rng.uniform(0.0, 0.1, 2) * (seed % 3 > 0)
    kind = INTEGRATORS[seed % 5]
    return {
        "period": T,
        "mass": rng.uniform(0.05, 0.4),
        "friction": rng.uniform(0.1, 1.0),
        "G": G,
        "inertia": inertia,
        "viscosity": rng.uniform(4.0, 15.0) * inertia if seed % 2 else C @ C.T + 0.1 * np.eye(r),
        "stiffness": kep * P + kip * (np.eye(m) - P),
        "damping": ked * P + kid * (np.eye(m) - P),
        "hand_stiffness": 33.0 * (seed % 4 > 0),
        "hand_damping": 0.3 * (seed % 6 == 0),
        "delay": int(seed % 7 == 0),
        "object_delay": 0 if kind == "implicit" else int(seed % 11 == 0),
        "integrator": kind,
    }


@pytest.mark.parametrize("seed", range(40))
def test_modes_are_the_whole_loop(seed: int) -> None:
    """To 1e-12, where the object's matrices commute (r scalar modes) and where not (one block)."""
    given = random_grasp(seed)
    linear = Linearisation(**given)  # type: ignore[arg-type]
    found = modes(linear)
    m, r = linear.coordinates
    assert sum(mode.count for mode in found if mode.kind == "internal") == m - r
    assert sum(mode.count for mode in found if mode.kind != "internal") == r
    assert [mode.kind for mode in found if mode.kind != "internal"] == (
        ["external"] * r if seed % 2 or r == 1 else ["coupled"]
    )
    assert max(mode.spectral_radius for mode in found) == pytest.approx(spectral_radius(linear), abs=1e-12)
    for mode in found:
        assert mode.motions.T @ mode.motions == pytest.approx(np.eye(mode.count), abs=1e-12)
        external = np.linalg.norm(linear.G @ mode.motions) > 1e-9
        assert external == (mode.kind != "internal")


@pytest.mark.parametrize("seed", range(1, 40, 4))
def test_object_mass_of_a_mode(seed: int) -> None:
    """M_i are the eigenvalues of (G G')^-1/2 M_o (G G')^-1/2; n fingers on an axis share m_v as m_v/n."""
    linear = Linearisation(**random_grasp(seed))  # type: ignore[arg-type]
    G = linear.G
    values, vectors = np.linalg.eigh(G @ G.T)
    root = vectors @ np.diag(values**-0.5) @ vectors.T
    expected = np.linalg.eigvalsh(root @ linear.inertia @ root)
    found = sorted(float(mode.object_mass) for mode in modes(linear) if mode.kind == "external")
    assert found == pytest.approx(expected, rel=1e-10)
    n = seed % 5 + 2
    P = np.full((n, n), 1.0 / n)
    line = Linearisation(period=T, mass=0.1, friction=0.2, G=np.ones((1, n)), inertia=0.1, viscosity=0.8,
                         stiffness=30 * P + 70 * (np.eye(n) - P), hand_stiffness=33.0)  # fmt: skip
    inner, outer = modes(line)
    assert (outer.object_mass, outer.object_viscosity) == pytest.approx((0.1 / n, 0.8 / n))
    assert outer.limits is not None and inner.limits is not None
    assert outer.limits.limit == pytest.approx(
        gx.stability.external_limit(0.1, 0.2, T, 0.1, 0.8, fingers=n, spring=33.0), rel=1e-9
    )
    assert inner.limits.limit == pytest.approx(gx.stability.wall_limit(0.1, 0.2, T, spring=33.0), rel=1e-12)
    assert (inner.count, inner.stiffness, outer.stiffness) == pytest.approx((n - 1, 70.0, 30.0))


@pytest.mark.parametrize("seed", range(5))
def test_devices_of_different_mass_with_the_metric_of_their_masses(seed: int) -> None:
    """Friction, springs and gains proportional to the masses: f = M (kep Q + kip (I - Q)) e separates too."""
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(4, 2)) * 0.03
    share = rng.uniform(0.5, 2.0, 4)
    share /= share.mean()
    grasp = gx.Grasp(points)
    law = gx.Coupling(gx.Impedance(30.0, 0.02), gx.Impedance(70.0, 0.05))
    split = grasp.split(metric=share)
    wide = np.repeat(share, 2)
    linear = Linearisation(
        period=T, mass=0.15 * wide, friction=0.2 * wide, G=grasp.matrix, inertia=[0.1, 0.1, 5e-5],
        viscosity=[0.8, 0.8, 4e-4], stiffness=law.stiffness(split), damping=law.damping(split),
        hand_stiffness=33.0 * wide, integrator="exact",
    )  # fmt: skip
    found = modes(linear)
    assert [mode.stiffness for mode in found if mode.kind == "internal"] == pytest.approx([70.0])
    assert max(mode.spectral_radius for mode in found) == pytest.approx(spectral_radius(linear), abs=1e-12)
    with pytest.raises(InputError, match="friction"):
        modes(linear.with_changes(friction=0.2))


def test_whole_loop_of_unequal_devices() -> None:
    """Two fingers on a line, masses 1:3, against their 8 equations written one by one."""
    m, b, k_h, M, B = (0.05, 0.15), (0.2, 0.1), (33.0, 0.0), 0.1, 0.8
    K = np.array([[50.0, -20.0], [-20.0, 50.0]])
    linear = Linearisation(period=T, mass=m, friction=b, G=[[1.0, 1.0]], inertia=M, viscosity=B, stiffness=K,
                           hand_stiffness=np.diag(k_h), delay=[0, 1], integrator="semi-implicit")  # fmt: skip
    x1, v1, x2, v2, q, w, late = np.eye(7)
    f1, f2 = (row[0] * (x1 - q) + row[1] * (x2 - q) for row in K)
    A1, h1 = held_device(m[0], b[0], k_h[0], T)
    A2, h2 = held_device(m[1], b[1], k_h[1], T)
    new = w + T / M * (f1 + f2 - B * w)
    rows = [*(A1 @ [x1, v1] - np.outer(h1, f1)), *(A2 @ [x2, v2] - np.outer(h2, late)), q + T * new, new, f2]
    expected = np.abs(np.linalg.eigvals(np.array(rows))).max()
    assert spectral_radius(linear) == pytest.approx(float(expected), abs=1e-12)


def test_drift_is_left_out() -> None:
    """Without the operator's springs everything can be pushed away together, at z = 1."""
    P = np.full((2, 2), 0.5)
    free = Linearisation(period=T, mass=0.15, friction=0.2, G=[[1.0, 1.0]], inertia=0.1, viscosity=0.8,
                         stiffness=30.0 * P + 70.0 * (np.eye(2) - P), damping=0.01)  # fmt: skip
    assert spectral_radius(free, drift=True) == pytest.approx(1.0, abs=1e-12)
    inside = spectral_radius(free)
    values = np.sort(np.abs(np.linalg.eigvals(loop_matrix(free))))
    assert inside == pytest.approx(float(values[-2]), abs=1e-9)
    assert inside < 1.0 - 1e-4


def test_squeezing_lowers_the_stiffness_of_a_rotation() -> None:
    """k_rot = 2 kep r^2 [(1 - d/r)^2 + (kip/kep)(d/r)(1 - d/r)]: -20 % for equal gains at 5 mm of 25."""
    for kep, kip, r, d in ((50.0, 50.0, 0.025, 0.005), (30.0, 70.0, 0.025, 0.008), (80.0, 20.0, 0.04, -0.01)):
        c, e = np.array([[-r, 0.0], [r, 0.0]]), np.array([[d, 0.0], [-d, 0.0]])
        P = gx.Grasp(c).split().external
        K = kep * P + kip * (np.eye(4) - P)
        made = preloaded(c, e, (K @ e.ravel()).reshape(2, 2))
        J = np.hstack([np.eye(4), -made.G_displacement.T])
        whole = J.T @ K @ J + made.preload
        assert whole == pytest.approx(whole.T, abs=1e-12)  # a potential: the wrench at rest is zero
        expected = 2 * kep * r**2 * ((1 - d / r) ** 2 + kip / kep * d / r * (1 - d / r))
        assert whole[6, 6] == pytest.approx(expected, rel=1e-12)
    linear = Linearisation(
        period=T, mass=0.15, friction=0.2, G=made.G, G_displacement=made.G_displacement, inertia=[0.1, 0.1, 4e-5],
        viscosity=[0.8, 0.8, 4e-4], stiffness=K, preload=made.preload, hand_stiffness=33.0,
    )  # fmt: skip
    with pytest.raises(InputError, match="preload"):
        modes(linear)


@pytest.mark.parametrize("reaction", ["fingertip", "contact"])
@pytest.mark.parametrize("d", [2, 3])
def test_preload_against_finite_differences(d: int, reaction: str) -> None:
    """Forces and moments of random, unbalanced grasps that move a little: central differences, 1e-6 of the largest."""
    from scipy.spatial.transform import Rotation

    rng = np.random.default_rng(d)
    n = 3
    c, e, centre = rng.normal(size=(n, d)) * 0.03, rng.normal(size=(n, d)) * 0.004, rng.normal(size=d) * 0.01
    A = rng.normal(size=(n * d, n * d))
    K = A @ A.T * 10.0
    f = (K @ e.ravel()).reshape(n, d)
    made = preloaded(c, e, f, centre=centre, reaction=reaction)
    w = len(made.G)
    rows = [0, 1, 5] if d == 2 else list(range(6))

    def wide(a: np.ndarray) -> np.ndarray:
        return np.pad(a, ((0, 0), (0, 3 - d)))

    def forces(x: np.ndarray, q: np.ndarray) -> np.ndarray:
        """Minus the forces on devices and object."""
        full = np.zeros(6)
        full[rows] = q
        turn = Rotation.from_rotvec(full[3:]).as_matrix()
        o = np.pad(centre, (0, 3 - d)) + full[:3]
        p = wide(c + e + x.reshape(n, d))
        local = (p - o) @ turn - wide(c - centre)
        contact = wide((K @ local[:, :d].ravel()).reshape(n, d)) @ turn.T
        arm = p - o if reaction == "fingertip" else wide(c - centre) @ turn.T
        wrench = np.concatenate([contact.sum(axis=0), np.cross(arm, contact).sum(axis=0)])[rows]
        return np.concatenate([contact[:, :d].ravel(), -wrench])

    h = 1e-6
    size = n * d + w
    numeric = np.empty((size, size))
    for j, u in enumerate(np.eye(size) * h):
        numeric[:, j] = (forces(u[: n * d], u[n * d :]) - forces(-u[: n * d], -u[n * d :])) / (2 * h)
    J = np.hstack([np.eye(n * d), -made.G_displacement.T])
    found = np.vstack([K @ J, -made.G @ K @ J]) + made.preload
    assert np.abs(found - numeric).max() < 1e-6 * np.abs(numeric).max()


def test_pushing() -> None:
    """Two fingers on a line: each alone sees 2 kep kip/(kep + kip) and the whole object (eq. 26)."""
    P = np.full((2, 2), 0.5)
    kep, kip = 38.8, 79.9
    grasp = Linearisation(period=T, mass=0.05, friction=0.19906, G=[[1.0, 1.0]], inertia=0.1, viscosity=0.8,
                          stiffness=kep * P + kip * (np.eye(2) - P), damping=0.02 * P + 0.05 * (np.eye(2) - P),
                          hand_stiffness=33.0, integrator="explicit")  # fmt: skip
    undamped = grasp.with_changes(damping=0.0)
    pushes = list(pushing(undamped, [0, 1]))
    assert [touching for touching, _ in pushes] == [(0,), (1,)]
    for _, alone in pushes:
        assert alone.stiffness[0, 0] == pytest.approx(2 * kep * kip / (kep + kip))
        assert spectral_radius(alone) > 1.0 > spectral_radius(undamped)
    assert next(pushing(grasp, [0, 1]))[1].damping[0, 0] == pytest.approx(2 * 0.02 * 0.05 / 0.07)


def test_pushing_with_some_of_five_in_space() -> None:
    """30 sets; a set's stiffness is the inverse of its block of the compliance; frictionless tangents stay released."""
    rng = np.random.default_rng(2)
    points = rng.normal(size=(5, 3))
    grasp = gx.Grasp(points)
    K = gx.Coupling(gx.Impedance(30.0), gx.Impedance(70.0)).stiffness(grasp.split())
    linear = Linearisation(period=T, mass=0.15, friction=0.2, G=grasp.matrix, inertia=np.full(6, 0.1), viscosity=0.8,
                           stiffness=K, hand_stiffness=33.0)  # fmt: skip
    fingers = np.repeat(np.arange(5), 3)
    sets = dict(pushing(linear, fingers))
    assert len(sets) == 2**5 - 2
    kept = np.isin(fingers, (1, 3, 4))
    assert sets[1, 3, 4].stiffness == pytest.approx(np.linalg.inv(np.linalg.inv(K)[np.ix_(kept, kept)]), rel=1e-9)
    assert spectral_radius(sets[(0,)]) < 1.0  # one point cannot hold a rotation: drift, which is left out
    tangents = np.tile([False, True, True], 5)
    smooth = dict(pushing(linear, fingers, released=tangents))
    assert len(smooth) == 2**5 - 1
    assert smooth[0, 1, 2, 3, 4].stiffness.shape == (5, 5)


@pytest.mark.parametrize(
    ("change", "name"),
    [({"mass": [0.1, 0.1, 0.1]}, "mass"), ({"stiffness": np.eye(3)}, "stiffness"), ({"inertia": -1.0}, "inertia"),
     ({"delay": [0, 1, 2]}, "delay"), ({"delay": 0.5}, "delay"), ({"G": [1.0, 1.0]}, "G"),
     ({"preload": np.eye(2)}, "preload"),
     ({"integrator": "implicit", "object_delay": 1}, "object_delay")],
)  # fmt: skip
def test_linearisations_that_cannot_be(change: dict[str, object], name: str) -> None:
    given = {"period": T, "mass": 0.1, "friction": 0.2, "G": [[1.0, 1.0]], "inertia": 0.1, "viscosity": 0.8,
             "stiffness": 30.0}  # fmt: skip
    with pytest.raises(InputError, match=rf"^{name}: given"):
        Linearisation(**(given | change))  # type: ignore[arg-type]


def test_what_can_be_linearised() -> None:
    class Something:
        def linearise(self) -> Linearisation:
            return Linearisation(
                period=T, mass=0.1, friction=0.2, G=[[1.0]], inertia=0.1, viscosity=0.8, stiffness=30.0
            )

    assert gx.stability.spectral_radius(Something()) == spectral_radius(Something().linearise())
    assert [mode.kind for mode in gx.stability.modes(Something())] == ["external"]
    kinds = [mode.kind for mode in gx.stability.modes("reference-1dof")]
    assert kinds == [mode.kind for mode in gx.stability.modes(gx.load("reference-1dof"))] == ["internal", "external"]
    with pytest.raises(InputError, match="expected a Linearisation, a scene, or the name or path of one"):
        gx.stability.spectral_radius(3)  # type: ignore[arg-type]
