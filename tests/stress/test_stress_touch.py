"""Forces that only push, over ratios of gains, friction, up to 100 fingers: the law itself, and active sets exactly."""

from __future__ import annotations

import mpmath as mp
import numpy as np

import graspfx as gx
from tests.support.exact import DIGITS, distance
from tests.support.families import efforts, family
from tests.support.scatter import decades, rotation

EPS = np.finfo(float).eps

SETS = family("touch: active set", "50 digits, of the largest entry of K e")
LAW = family("touch: violation of the law", "cones, complementarity, slip; of the largest entry of K e")
TURNED = family("touch: in another frame, order and unit", "the same numbers, of the largest entry of K e")


def grip(rng: np.random.Generator, n: int, d: int, ratio: float):
    """Points, normals, K for gains of that ratio, K^-1 for any vector, and a displacement that mostly pushes."""
    points = 0.05 * rng.normal(size=(n, d))
    normals = -points / np.linalg.norm(points, axis=1, keepdims=True) + 0.3 * rng.normal(size=(n, d))
    middle = decades(rng, 1e-2, 1e4)
    ke, ki = middle * np.sqrt(ratio), middle / np.sqrt(ratio)
    if rng.random() < 0.5:
        ke, ki = ki, ke
    split = gx.Grasp(points).split()
    K = gx.Coupling(external=gx.Impedance(ke), internal=gx.Impedance(ki)).stiffness(split)
    e = decades(rng, 1e-7, 1e-1) * (normals * rng.normal(0.5, 1.0, size=(n, 1)) + 0.7 * rng.normal(size=(n, d)))

    def loosen(f: np.ndarray) -> np.ndarray:
        external = split.project(f)
        return external / ke + (f - external) / ki

    return points, normals / np.linalg.norm(normals, axis=1, keepdims=True), K, loosen, e.ravel()


@efforts(short=50, full=300)
def test_active_sets_against_fifty_digits(cases: int) -> None:
    # f = N lambda; where lambda > 0 the slip along the normal is zero, elsewhere it points outwards: one solution
    rng = np.random.default_rng(11)
    for case in range(cases):
        d, n, ratio = int(rng.integers(1, 4)), int(rng.integers(1, 7)), decades(rng, 1.0, 1e6)
        _, normals, K, _, e = grip(rng, n, d, ratio)
        label = f"case {case}: {n} fingers in {d}-D, ratio {ratio:.1e}"
        touch = gx.unilateral_force(K, e, normals)
        pushing = [i for i, status in enumerate(touch.status) if status != "free"]
        scale = float(np.abs(K @ e).max())
        with mp.workdps(DIGITS):
            loose = mp.inverse(mp.matrix(K.tolist()))
            N = mp.zeros(n * d, n)
            for i in range(n):
                length = mp.sqrt(mp.fsum(mp.mpf(v) ** 2 for v in normals[i].tolist()))
                for a in range(d):
                    N[i * d + a, i] = mp.mpf(float(normals[i, a])) / length
            A, b = N.T * loose * N, N.T * mp.matrix(e.tolist())
            lam = mp.zeros(n, 1)
            if pushing:
                inner = mp.matrix([[A[i, j] for j in pushing] for i in pushing])
                found = mp.lu_solve(inner, mp.matrix([b[i] for i in pushing]))
                for i, value in zip(pushing, found, strict=True):
                    lam[i] = value
            slack = A * lam - b  # s along each normal, which is zero or outwards
            wrong = max(
                [float(-lam[i]) / scale for i in pushing]
                + [float(-slack[i]) * min(np.diag(K)) / scale for i in range(n) if i not in pushing],
                default=0.0,
            )
            error = distance(touch.force, list(N * lam)) / scale
        SETS.check(max(error, wrong), 10.0 * EPS * ratio, label)


def violation(touch, normals, loosen, e, mu, kept) -> float:
    """How far a force is from the law that it says it fulfils, as a displacement over `kept`."""
    n, d = normals.shape
    f, s = touch.force.reshape(n, d), (loosen(touch.force) - e).reshape(n, d)
    worst = 0.0
    for i in range(n):
        fn, sn = f[i] @ normals[i], s[i] @ normals[i]
        ft, st = f[i] - fn * normals[i], s[i] - sn * normals[i]
        tangent, slip = np.linalg.norm(ft), np.linalg.norm(st)
        if touch.status[i] == "free":
            cone = mu[i] * slip if touch.law == "associated" else 0.0
            assert not f[i].any()
            worst = max(worst, cone - sn if touch.law == "associated" else -sn)
        elif touch.status[i] == "stick":
            worst = max(worst, abs(sn), slip)
        elif mu[i] > 0.0:
            lift = mu[i] * slip if touch.law == "associated" else 0.0
            worst = max(worst, abs(sn - lift), np.linalg.norm(st + slip * ft / tangent) if tangent else slip)
        else:
            worst = max(worst, abs(sn))
        assert fn >= 0.0
        assert tangent <= mu[i] * fn * (1.0 + 1e-9) + kept[1]
    return worst


@efforts(short=8, full=300)
def test_the_law_with_and_without_friction(cases: int) -> None:
    rng = np.random.default_rng(12)
    for case in range(cases):
        d, n = int(rng.integers(2, 4)), round(decades(rng, 1.0, 100.0 if case % 20 == 0 else 12.0))
        ratio = decades(rng, 1.0, 1e6)
        _, normals, K, loosen, e = grip(rng, n, d, ratio)
        mu = rng.uniform(0.0, 1.5, n) if rng.random() < 0.7 else np.zeros(n)
        touch = gx.unilateral_force(K, e, normals, mu.tolist() if mu.any() else None)
        scale = float(np.abs(K @ e).max())
        label = f"case {case}: {n} fingers in {d}-D, ratio {ratio:.1e}, mu up to {mu.max():.2f}, {touch.law}"
        assert np.isfinite(touch.force).all()
        soft = float(np.abs(K).max())
        size = scale / soft + np.abs(e).max()
        LAW.check(violation(touch, normals, loosen, e, mu, (size, 1e-12 * scale)) / size, 100.0 * EPS * ratio, label)


@efforts(short=10, full=200)
def test_frame_order_and_unit(cases: int) -> None:
    rng = np.random.default_rng(13)
    for case in range(cases):
        d, n, ratio = int(rng.integers(2, 4)), int(rng.integers(1, 10)), decades(rng, 1.0, 1e4)
        _, normals, K, _, e = grip(rng, n, d, ratio)
        given = None if rng.random() < 0.5 else float(rng.uniform(0.1, 0.4))
        touch = gx.unilateral_force(K, e, normals, given)
        scale = float(np.abs(K @ e).max())
        order, turn = rng.permutation(n), rotation(rng, d)
        T = np.kron(np.eye(n)[order], turn)
        unit, weight = 2.0**10, 2.0**-10  # lengths and forces in other units, exactly
        again = gx.unilateral_force((weight / unit) * T @ K @ T.T, unit * T @ e, normals[order] @ turn.T, given)
        back = T.T @ again.force / weight
        label = f"case {case}: {n} fingers in {d}-D, ratio {ratio:.1e}, friction {given}"
        if touch.law == again.law:
            TURNED.check(float(np.abs(back - touch.force).max()) / scale, 20.0 * EPS * ratio, label)
