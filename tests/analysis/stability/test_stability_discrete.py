"""Devices and objects over one sample: 50 digits, the body's own integrators, PyBullet."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest
from scipy.linalg import expm

from graspfx.analysis.discrete import INTEGRATORS, device, force_response, object_step
from graspfx.analysis.stability.loop import object_matrices
from graspfx.objects import integrators
from graspfx.objects.body import INTEGRATORS as BODIES
from graspfx.objects.body import fill_body
from graspfx.objects.integrators import coefficients


def test_held_motion_to_fifty_digits() -> None:
    """R and Q over 9 decades of p T, 10 of kappa T^2, near critical damping too: 1e-12 where poles are well apart.

    R vanishes at half periods, so that its error is measured by exp(-p T/2) T.
    """
    rng = np.random.default_rng(0)
    for i in range(300):
        T = 10 ** rng.uniform(-4, 0)
        p, kappa = 10 ** rng.uniform(-6, 2.5) / T, 10 ** rng.uniform(-8, 1.5) / T**2
        if i % 5 == 0:
            kappa = p * p / 4 * (1 + 10 ** rng.uniform(-12, -1) * rng.choice([-1, 1]))
        if i % 7 == 0:
            kappa = 0.0
        R, Q = force_response(p, kappa, T)
        with mpmath.workdps(50):
            P, K, t = map(mpmath.mpf, (p, kappa, T))
            root = mpmath.sqrt(P * P / 4 - K)
            if root == 0:
                continue
            fast, slow = -P / 2 - root, -P / 2 + root
            r = mpmath.re((mpmath.exp(slow * t) - mpmath.exp(fast * t)) / (2 * root))
            areas = [mpmath.expm1(mu * t) / mu if mu else t for mu in (slow, fast)]
            q = mpmath.re((areas[0] - areas[1]) / (2 * root))
            assert abs(float(R - r)) <= 1e-12 * T * max(float(mpmath.exp(-P / 2 * t)), abs(float(r / t)))
            assert float(Q) == pytest.approx(float(q), rel=1e-12)


def test_device_against_the_matrix_exponential() -> None:
    """Transfer function at points of the circle, to 1e-9: what solving (z - A) leaves near its poles."""
    m, b, k, T = 0.15, 0.2, 33.0, 0.005
    block = np.zeros((3, 3))
    block[:2] = [[0.0, 1.0, 0.0], [-k / m, -b / m, 1.0 / m]]
    E = expm(block * T)
    numerator, denominator = device(m, b, k, T)
    for z in np.exp(1j * np.linspace(0.02, 3.1, 7)):
        expected = np.linalg.solve(z * np.eye(2) - E[:2, :2], E[:2, 2])[0]
        s = z - 1.0
        value = np.polyval(numerator[::-1], s) / np.polyval(denominator[::-1], s)
        assert value == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("name", BODIES)
def test_integrators_are_the_bodys(name: str) -> None:
    """Against the coefficients that a run uses, to 1e-14."""
    for rate in (0.0, 1e-6, 3.0, 150.0):
        p, q, decay, s = object_step(name, rate, 0.005)
        c = coefficients(BODIES[name], rate, 0.005)
        assert np.array([p, q, 1.0 - decay, s]) == pytest.approx(np.array([c.p, c.q, c.r, c.s]), rel=1e-14, abs=1e-18)


def test_pybullet_moves_as_named() -> None:
    pytest.importorskip("pybullet")
    from graspfx.objects.bullet.bullet import BulletBody

    state = np.zeros(integrators.SIZE)
    fill_body(state, dimensions=1, mass=0.1, viscosity=0.8, velocity=[0.3])
    body = BulletBody(state)
    state[integrators.FORCE] = 0.05
    body.step(0.005)
    p, q, decay, s = object_step("bullet", 8.0, 0.005)
    assert state[integrators.POSITION] == pytest.approx(float(p * 0.3 + q * 0.5), rel=1e-12)
    assert state[integrators.VELOCITY] == pytest.approx(float((1.0 - decay) * 0.3 + s * 0.5), rel=1e-12)
    body.close()


@pytest.mark.parametrize("name", INTEGRATORS)
def test_matrices_of_an_object_are_its_numbers(name: str) -> None:
    """Three axes that do not mix, turned in space: to 1e-12."""
    M, B, T = np.diag([0.1, 0.2, 3e-5]), np.diag([0.8, 0.1, 3e-4]), 0.005
    turn = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]
    whole = object_matrices(name, turn @ M @ turn.T, turn @ B @ turn.T, T)
    for i in range(3):
        p, q, decay, s = object_step(name, B[i, i] / M[i, i], T)
        mass = M[i, i]
        found = [float(turn[:, i] @ A @ turn[:, i]) for A in whole]
        assert found == pytest.approx([float(p), q / mass, 1.0 - decay, s / mass], rel=1e-12, abs=1e-15)
