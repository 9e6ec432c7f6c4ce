"""The paper's 1-DOF system: a whole run against matrix exponentials written from its equations (5)-(19)."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm

import graspfx as gx

T, M, B, HAND, M_V, B_V = 0.005, 0.15, 0.2, 33.0, 0.1, 0.8
START = (0.002, -0.001)
SAMPLES = 2000


def held(A: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """x' = A x + b u with u held over T: x+ = Ad x + bd u."""
    block = np.zeros((3, 3))
    block[:2, :2], block[:2, 2] = A, b
    E = expm(block * T)
    return E[:2, :2], E[:2, 2]


def trajectory(kep: float, kip: float) -> tuple[np.ndarray, np.ndarray]:
    """Device positions (N, 2) and object positions (N,) from eqs. (5)-(6), (9), (11)-(12), the operator a spring.

    The paper's f_i in (7)-(8) and (11)-(12) acts on the device; what the fingers do to the object is its negative.
    """
    device_A, device_b = held(np.array([[0.0, 1.0], [-HAND / M, -B / M]]), np.array([0.0, 1.0 / M]))
    object_A, object_b = held(np.array([[0.0, 1.0], [0.0, -B_V / M_V]]), np.array([0.0, 1.0 / M_V]))
    first, second, body = np.array([START[0], 0.0]), np.array([START[1], 0.0]), np.zeros(2)
    fingers, centre = np.empty((SAMPLES, 2)), np.empty(SAMPLES)
    for k in range(SAMPLES):
        x1, x2, x = first[0], second[0], body[0]
        fingers[k], centre[k] = (x1, x2), x
        shared = kep * (x - (x1 + x2) / 2)
        f1 = shared + kip * (x2 - x1) / 2  # (11)
        f2 = shared - kip * (x2 - x1) / 2  # (12)
        first = device_A @ first + device_b * f1
        second = device_A @ second + device_b * f2
        body = object_A @ body - object_b * (f1 + f2)
    return fingers, centre


def run(kep: float, kip: float) -> gx.Recording:
    overrides = {"coupling.external.stiffness": kep, "coupling.internal.stiffness": kip}
    return gx.run(gx.load("reference-1dof", overrides), duration=SAMPLES * T)


@pytest.mark.parametrize(("kep", "kip"), [(30.0, 70.0), (50.0, 50.0), (20.0, 79.0)])
def test_whole_trajectory_to_a_picometre(kep: float, kip: float) -> None:
    """2000 samples to 1e-12 m; kep = kip is the conventional method (7)-(8)."""
    rec = run(kep, kip)
    fingers, centre = trajectory(kep, kip)
    assert np.abs(fingers).max() > 1e-3
    assert np.abs(rec.finger_position[:, :, 0] - fingers).max() < 1e-12
    assert np.abs(rec.object_position[:, 0] - centre).max() < 1e-12


def test_equal_gains_give_equations_7_and_8_exactly() -> None:
    rec = run(50.0, 50.0)
    expected = 50.0 * (rec.finger_position - rec.object_position[:, None, :])
    assert np.array_equal(rec.finger_force, expected)


def test_modes_evolve_independently() -> None:
    """x_e of (13)-(15) does not depend on kip, x_i of (16)-(19) not on kep: to 1e-14 m."""
    base, other_kip, other_kep = run(30.0, 70.0), run(30.0, 40.0), run(55.0, 70.0)

    def modes(rec: gx.Recording) -> tuple[np.ndarray, np.ndarray]:
        x1, x2 = rec.finger_position[:, 0, 0], rec.finger_position[:, 1, 0]
        return (x1 + x2) / 2, (x2 - x1) / 2

    assert np.abs(modes(base)[0] - modes(other_kip)[0]).max() < 1e-14
    assert np.abs(modes(base)[1] - modes(other_kep)[1]).max() < 1e-14
    assert np.abs(modes(base)[1] - modes(other_kip)[1]).max() > 1e-4
