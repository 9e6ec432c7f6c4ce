"""Damping that grows with depth: the projection against dense matrices, passivity, touching without a step, limits."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

import graspfx as gx
from graspfx.coupling.grasped import GraspedObject
from graspfx.surfaces.closed_form.shape import Box, Sphere
from tests.support.grasps import MU, finger_grasp, law, respond

KINDS = ("smooth", "stick", "rough")
GAINS = ((0.5, 2.0), (2.0, 0.5), (1.0, 1.0))


@dataclass
class State:
    """A random state: elastic force, force, rates and normals (n, d), the damping D, s and weights of the fingers."""

    kind: str
    f0: np.ndarray
    f: np.ndarray
    rate: np.ndarray
    normals: np.ndarray
    D: np.ndarray
    s: np.ndarray
    weights: np.ndarray
    b: float

    @property
    def touching(self) -> np.ndarray:
        return (self.f0 * self.normals).sum(axis=1) > 0.0

    def in_series(self) -> tuple[np.ndarray, np.ndarray]:
        """(D^-1 + C) on the coordinates of what touches, and which those are."""
        d = self.f0.shape[1]
        carried = np.repeat(self.touching, d)
        s = np.where(self.touching, self.s, 1.0)
        C = np.repeat((1.0 - s) / (s * self.weights * self.b), d)
        return (np.linalg.inv(self.D) + np.diag(C))[np.ix_(carried, carried)], carried


def random_state(rng: np.random.Generator, kind: str, matrices: bool) -> State:
    n, d = int(rng.integers(1, 6)), int(rng.integers(1, 4))
    kep, kip = [(40.0, 160.0), (160.0, 40.0), (70.0, 70.0)][rng.integers(3)]
    ked, kid = GAINS[rng.integers(3)]
    depth = float(10.0 ** rng.uniform(-3.5, -1.5)) if rng.random() < 0.8 else 0.0
    share = rng.uniform(0.3, 2.0, n).tolist() if rng.random() < 0.3 else None
    shape = (Box((0.05,) * d), Sphere(0.03))[rng.integers(2)]
    first = rng.uniform(-0.03, 0.03, (n, d))
    then, rate = first + rng.normal(size=(n, d)) * rng.choice([1e-4, 2e-3]), rng.normal(size=(n, d)) * 0.1
    results = []
    for damped in (0.0, 1.0):
        values = (kep, kip, damped * ked, damped * kid)
        kep_n, kip_n, ked_n, kid_n = (np.full(n, v) if matrices else v for v in values)
        gains = law(kep_n, kip_n, ked_n, kid_n, "symmetric")
        g = finger_grasp(n, d, gains, kind, damped * depth, shape=shape, share=share)
        respond(g, first)
        results.append(respond(g, then, rate))
    w = np.ones(n) if share is None else np.array(share)
    split = gx.Grasp(g.contact_position).split(metric=None if share is None else w, tolerance=1e-12)
    normals = g.inward()
    push = (results[0] * normals).sum(axis=1)
    s = np.clip(push / (w * kip * depth), 0.0, 1.0) if depth else (push > 0.0).astype(float)
    D = law(kep, kip, ked, kid).damping(split)
    return State(kind, results[0], results[1], rate, normals, D, s, w, max(ked, kid))


@pytest.mark.parametrize("count", [50, pytest.param(2000, marks=pytest.mark.stress)])
@pytest.mark.parametrize("matrices", [False, True])
@pytest.mark.parametrize("kind", KINDS)
def test_force_is_the_projection_with_dampers_in_series(kind: str, matrices: bool, count: int) -> None:
    """Random states: f is the least of 1/2 (f - f0 - D_s e')'D_s^-1 (f - f0 - D_s e') over the cones, passive.

    One in five has all its damping at once, D_s = D.

    By the conditions of an optimum, with D from an SVD and dense inverses: x = D_s^-1 (f - f0) - e' lies in the dual
    cone, f in the cone, and x'f = 0, each to 1e-12 of the rates and forces at hand.
    """
    rng = np.random.default_rng(KINDS.index(kind) + 3 * matrices)
    shallow = 0
    for _ in range(count):
        state = random_state(rng, kind, matrices)
        touching, f0, f = state.touching, state.f0, state.f
        assert not f[~touching].any()
        if not touching.any():
            continue
        shallow += int((state.s[touching] < 1.0).any())
        M, carried = state.in_series()
        rates, normals = state.rate[touching], state.normals[touching]
        x = (M @ (f - f0).ravel()[carried]).reshape(rates.shape) - rates
        speed, force = np.abs(rates).max(), max(np.abs(f).max(), np.abs(f0).max())
        xn, fn = (x * normals).sum(axis=1), (f[touching] * normals).sum(axis=1)
        xt = np.linalg.norm(x - xn[:, None] * normals, axis=1)
        ft = np.linalg.norm(f[touching] - fn[:, None] * normals, axis=1)
        slack = {"smooth": xn, "stick": np.minimum(xn, -xt), "rough": xn - MU * xt}[kind]
        side = {"smooth": ft, "stick": -fn, "rough": ft - MU * fn}[kind]
        assert slack.min() >= -1e-12 * speed, state
        assert max(side.max(), -fn.min()) <= 1e-12 * force, state
        work = fn * xn if kind != "rough" else (f[touching] * x).sum(axis=1)
        assert np.abs(work).max() <= 1e-12 * speed * force, state
        assert ((f - f0) * state.rate).sum() >= -1e-13 * speed * force
    assert shallow > count // 8


def damper(g: GraspedObject, position: np.ndarray, speed: float = 1e-7) -> np.ndarray:
    """D_s of a sample, column by column: forces by rates so small that no finger is clamped."""
    n, d = position.shape
    f0 = respond(g, position)
    columns = []
    for k in range(n * d):
        rate = np.zeros(n * d)
        rate[k] = speed
        columns.append((respond(g, position, rate.reshape(n, d)) - f0).ravel() / speed)
    return np.array(columns).T


def elastic(g: GraspedObject, position: np.ndarray) -> np.ndarray:
    """Give the force without damping, and leave everything else as it was."""
    before = g.block.copy()
    g.state.damped = False
    f0 = respond(g, position)
    g.block[:] = before
    return f0


def squeezed(depths: Any, out: np.ndarray, radius: float = 0.03) -> np.ndarray:
    return np.asarray(out * (radius - np.asarray(depths))[:, None])


def directions(rng: np.random.Generator, n: int, d: int) -> np.ndarray:
    """Unit vectors around a ball, far from one another and from any plane."""
    u = rng.normal(size=(n, d)) * 0.2
    u[:, :2] += np.stack([np.cos(2 * np.pi * np.arange(n) / n), np.sin(2 * np.pi * np.arange(n) / n)], axis=1)
    return np.asarray(u / np.linalg.norm(u, axis=1)[:, None])


def test_the_damping_of_the_sample_lies_between_its_share_and_all_of_it() -> None:
    """15 sticking grasps: s_min D <= D_s <= D, and D_s is (D^-1 + C)^-1 to 1e-7 of it."""
    rng = np.random.default_rng(5)
    for k in range(15):
        n, d = int(rng.integers(2, 5)), int(rng.integers(2, 4))
        ked, kid = GAINS[k % 3]
        # internal forces alone would need a balanced squeeze: equal stiffness gives each finger its own depth
        gains = law(100.0, 100.0, ked, kid)
        depths = rng.uniform(1e-4, 2e-3, n)
        p = squeezed(depths, directions(rng, n, d))
        D, D_s = (damper(finger_grasp(n, d, gains, "stick", x, shape=Sphere(0.03)), p) for x in (0.0, 1.5e-3))
        s = np.minimum(1.0, depths / 1.5e-3)
        C = np.repeat((1.0 - s) / (s * max(ked, kid)), d)
        np.testing.assert_allclose(D_s, np.linalg.inv(np.linalg.inv(D) + np.diag(C)), rtol=0.0, atol=1e-7)
        for less, more in ((s.min() * D, D_s), (D_s, D)):
            gap = more - less
            assert np.linalg.eigvalsh((gap + gap.T) / 2)[0] >= -1e-7


def touches(rng: np.random.Generator, kind: str, depth: float) -> tuple[float, float, float, float]:
    """Measure what a touch adds, of |D||e'|: of this force, of (26)'s, of scaled rows and columns; and their power.

    All but the last finger press, that one touches by 1e-12 m; where no force is clamped the formulas are the answer.
    """
    n, d = int(rng.integers(2, 6)), int(rng.integers(2, 4))
    out = directions(rng, n, d)
    ked, kid = GAINS[rng.integers(2)]
    gains = law(100.0, 100.0, ked, kid)
    depths = rng.uniform(1e-4, 2e-3, n)
    rate = rng.normal(size=(n, d)) * 1e-6
    results = []
    for last in (1e-12, -1e-12):
        depths[-1] = last
        p = squeezed(depths, out)
        each = []
        for x in (depth, 0.0):
            g = finger_grasp(n, d, gains, kind, x, shape=Sphere(0.03))
            f0 = respond(g, p)
            each.append((respond(g, p, rate) - f0).ravel())
        results.append(each)
    D = gains.damping(gx.Grasp(g.contact_position).split())
    scale = np.linalg.norm(D, 2) * np.linalg.norm(rate)
    ours, whole = (float(np.linalg.norm(a - b) / scale) for a, b in zip(*results, strict=True))
    # the same touch with S^(1/2) D S^(1/2): the last finger's rows go to nothing, the others keep D as if it carried
    s = np.repeat(np.append(np.minimum(1.0, depths[:-1] / depth), 0.0), d)
    rest = s > 0.0
    before = np.linalg.inv(np.linalg.inv(D)[np.ix_(rest, rest)])
    root = np.sqrt(s)[:, None] * D * np.sqrt(s)
    gone = np.sqrt(s[rest])[:, None] * before * np.sqrt(s[rest])
    scaled = float(np.linalg.norm((root[np.ix_(rest, rest)] - gone) @ rate.ravel()[rest])) / scale
    rows = np.linalg.eigvalsh(s[:, None] * D + (s[:, None] * D).T)[0] / np.linalg.norm(D, 2)
    return ours, whole, float(scaled), float(rows)


@pytest.mark.parametrize("kind", ["stick", "rough"])
def test_a_touch_makes_no_step(kind: str) -> None:
    """25 touches of 1e-12 m: 1e-8 of |D||e'| and less, and why not otherwise.

    With all damping at once a touch adds up to |D||e'|. Rows and columns times sqrt(s) would leave a step of 0.2 for
    the fingers that press already; rows alone have a symmetric part with a negative eigenvalue: they create energy.
    """
    rng = np.random.default_rng(6 + KINDS.index(kind))
    ours, whole, scaled, rows = np.array([touches(rng, kind, 1e-3) for _ in range(25)]).T
    assert ours.max() < 1e-8
    assert whole.max() > 0.5
    assert scaled.max() > 0.1
    assert rows.min() < -0.02


@pytest.mark.parametrize("kind", KINDS)
def test_equal_gains_have_their_share_of_the_damping(kind: str) -> None:
    """Each finger by itself: f = f0 + s b e' along the normal (and across it if it holds), to the last digits."""
    rng = np.random.default_rng(8)
    for d in (1, 2, 3):
        out = np.array([[1.0], [-1.0]]) if d == 1 else directions(rng, 3, d)
        depths = rng.uniform(1e-4, 2e-3, len(out))
        p = squeezed(depths, out, 0.025 if d == 1 else 0.03)
        rate = 1e-3 * rng.normal(size=p.shape)
        shape = Box((0.05,)) if d == 1 else Sphere(0.03)
        g = finger_grasp(len(out), d, law(100.0, 100.0, 0.8, 0.8), kind, 1e-3, shape=shape)
        f0, f = respond(g, p), respond(g, p, rate)
        share = np.minimum(1.0, depths / 1e-3)[:, None]
        moved = rate if kind != "smooth" else (rate * out).sum(axis=1)[:, None] * out
        np.testing.assert_allclose(f - f0, 0.8 * share * moved, rtol=0.0, atol=1e-15)


def test_a_lone_finger_at_full_depth_has_the_damping_of_equation_26() -> None:
    """2 ked kid/(ked + kid) from the depth on where f0 = kip delta; before it 1/(1/that + (1 - s)/(s kid))."""
    ked, kid, kep, kip, depth = 0.3, 1.1, 40.0, 160.0, 1e-3
    lone, felt = 2 * ked * kid / (ked + kid), 2 * kep * kip / (kep + kip)
    g = finger_grasp(2, 1, law(kep, kip, ked, kid), "smooth", depth)
    for deep, s in ((0.005, 1.0), (kip * depth / felt, 1.0), (0.001, felt * 0.001 / (kip * depth))):
        f = respond(g, [[-0.025 + deep], [0.1]], [[0.02], [0.0]])
        expected = 1.0 / (1.0 / lone + (1.0 - s) / (s * kid)) if s < 1.0 else lone
        assert f[0, 0] == pytest.approx(felt * deep + expected * 0.02, rel=1e-13)


@pytest.mark.parametrize("matrices", [False, True])
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(("ked", "kid"), [(0.0, 2.0), (2.0, 0.0)])
def test_a_singular_damping_has_its_limit(ked: float, kid: float, kind: str, matrices: bool) -> None:
    """One damping zero: R (I + R C R)^-1 R with R R = D, to 1e-5 of it; passive in 10 random states."""
    rng = np.random.default_rng(9)
    out = directions(rng, 3, 2)
    depths = np.array([2e-4, 5e-4, 2e-3])
    values = [np.full(3, v) if matrices else v for v in (100.0, 100.0, ked, kid)]
    p = squeezed(depths, out)
    D_s = damper(finger_grasp(3, 2, law(*values), kind, 1e-3, shape=Sphere(0.03)), p)
    D = law(100.0, 100.0, ked, kid).damping(gx.Grasp(out * 0.03).split())
    values_, vectors = np.linalg.eigh(D)
    R = (vectors * np.sqrt(np.maximum(values_, 0.0))) @ vectors.T
    s = np.minimum(1.0, depths / 1e-3)
    C = np.diag(np.repeat((1.0 - s) / (2.0 * s), 2))
    expected = R @ np.linalg.inv(np.eye(6) + R @ C @ R) @ R
    if kind == "smooth":  # tangents carry nothing: of D_s the forces along the normals, the least of the squares
        N = np.zeros((6, 3))
        N[np.arange(6), np.arange(6) // 2] = -out.ravel()
        T = np.linalg.qr(N, mode="complete")[0][:, 3:]
        expected = expected - expected @ T @ np.linalg.pinv(T.T @ expected @ T, rcond=1e-9) @ T.T @ expected
    np.testing.assert_allclose(D_s, expected, rtol=0.0, atol=2e-5)
    g = finger_grasp(3, 2, law(*values), kind, 1e-3, shape=Sphere(0.03))
    for _ in range(10):
        q, rate = p + rng.normal(size=p.shape) * 5e-4, rng.normal(size=p.shape) * 0.1
        f0 = elastic(g, q)
        assert ((respond(g, q, rate) - f0) * rate).sum() > -1e-9
