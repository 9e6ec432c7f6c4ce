"""Cut cones with a compliance in series with each finger: limits and damping by depth together."""

from __future__ import annotations

import numpy as np

from graspfx.cones.friction import ASSOCIATED, friction_force
from graspfx.cones.problem import ConeContact, Gains, ModePart, Unknown, problem_size, set_up


def nearest(x: np.ndarray, mu: float, limit: float) -> np.ndarray:
    """Give the point of the cone |x_t| <= mu x_n, cut off at a length, that is nearest to x, the normal first."""
    tangent = float(np.linalg.norm(x[1:]))
    p = np.zeros_like(x)
    if tangent <= mu * x[0]:
        p = x.copy()
    elif x[0] + mu * tangent > 0.0:
        p[0] = (x[0] + mu * tangent) / (1.0 + mu * mu)
        p[1:] = mu * p[0] * x[1:] / tangent
    return p * min(1.0, limit / max(float(np.linalg.norm(p)), 1e-300))


def test_the_force_is_the_nearest_one_in_the_cut_cones_with_compliances_in_series() -> None:
    """300 problems: f_i is nearest to f_i + x_i, x = e - (K^-1 + C)(f - f0) by numpy, to 1e-12."""
    rng = np.random.default_rng(0)
    cuts = 0
    for k in range(300):
        n, d = int(rng.integers(1, 6)), int(rng.integers(1, 4))
        m, mu = n * d, float(rng.choice([0.3, 0.6, 1.2]))
        external, internal = [(0.5, 2.0), (2.0, 0.5), (1.0, 1.0)][k % 3]
        count = int(rng.integers(1, min(6, m) + 1))
        Q = np.linalg.qr(rng.normal(size=(m, count)))[0]
        w, e = rng.uniform(0.4, 2.0, n), rng.normal(size=m) * 0.3
        C = np.where(rng.random(n) < 0.5, 0.0, 10.0 ** rng.uniform(-2.0, 2.0, n))
        limits = rng.uniform(0.1, 1.0, n)
        f0 = np.zeros((n, d))
        f0[:, 0] = rng.uniform(0.0, 1.0, n)
        if d > 1:
            side = rng.normal(size=(n, d - 1))
            f0[:, 1:] = side * (rng.random(n) * mu * f0[:, 0] / np.linalg.norm(side, axis=1))[:, None]
        f0 *= np.minimum(1.0, 0.99 * limits / np.linalg.norm(f0, axis=1))[:, None]
        problem = set_up(memoryview(np.zeros(problem_size(n))), 0, n)
        problem.limited = problem.compliant = True
        problem.modes = count
        contacts = problem.contacts
        contacts.array(ConeContact.weight)[:], contacts.array(ConeContact.coefficient)[:] = w, mu
        contacts.array(ConeContact.limit)[:], contacts.array(ConeContact.compliance)[:] = limits, C
        contacts.array(ConeContact.displacement)[:, :d] = e.reshape(n, d)
        contacts.array(ConeContact.base_force)[:, :d] = f0
        problem.unknowns.array(Unknown.share)[:count] = 1.0
        for i in range(n):
            contacts[i].modes.array(ModePart.motion)[:count, :d] = Q[i * d : i * d + d].T
        assert friction_force(problem, d, Gains(external, internal), False, 0).law == ASSOCIATED
        f = contacts.array(ConeContact.force)[:, :d].ravel()
        root = np.sqrt(np.repeat(w, d))
        K = root[:, None] * (internal * np.eye(m) + (external - internal) * Q @ Q.T) * root
        x = e - (np.linalg.inv(K) + np.diag(np.repeat(C / w, d))) @ (f - f0.ravel())
        for i in range(n):
            own = slice(i * d, i * d + d)
            expected = nearest(f[own] + x[own], mu, limits[i])
            np.testing.assert_allclose(f[own], expected, rtol=0.0, atol=1e-12 * (1.0 + np.abs(x[own]).max()))
            cuts += bool(np.linalg.norm(f[own]) > 0.999999 * limits[i])
    assert cuts > 100
