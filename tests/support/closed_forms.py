"""Oracles of rigid bodies in closed form: with viscosity on a line, and without a moment in space."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import quad
from scipy.special import ellipj

FloatArray = NDArray[np.float64]
Exact = np.longdouble


def viscous_motion(
    T: float, mass: float, viscosity: float, velocity: float, forces: Sequence[float]
) -> tuple[float, float, float]:
    """Solve m v' + b v = f, each force held for T [s], from x = 0: x, v at the end and the largest |x|, in long double.

    x+ = x + (1 - E)/a v + (T - (1 - E)/a)/a f/m, v+ = E v + (1 - E)/a f/m, a = b/m > 0, E = exp(-a T).
    """
    m, h = Exact(mass), Exact(T)
    a = Exact(viscosity) / m
    E, one = np.exp(-a * h), -np.expm1(-a * h) / a
    two = (h - one) / a
    x, v, largest = Exact(0.0), Exact(velocity), Exact(0.0)
    for force in forces:
        u = Exact(force) / m
        x, v = x + one * v + two * u, E * v + one * u
        largest = max(largest, abs(x))
    return float(x), float(v), float(largest)


def turned_steadily(spin: Sequence[float], rate: float, t: float) -> FloatArray:
    """Give x y z w after t of a cube whose spin decays as exp(-rate t): exp(w0 (1 - exp(-rate t))/rate)."""
    w = np.asarray(spin, dtype=np.float64)
    speed = float(np.linalg.norm(w))
    angle = speed * (-math.expm1(-rate * t) / rate if rate else t)
    return np.append(math.sin(0.5 * angle) / speed * w, math.cos(0.5 * angle))


def turned_freely(moments: Sequence[float], spin: Sequence[float], t: float) -> FloatArray:
    """Give the rotation matrix, body to world, after t of a box without a moment on it, unturned at time zero.

    The angular velocity in body axes is that of Landau and Lifshitz (Mechanics, 37), (a cn, b sn, c dn)(p t; k^2); of
    Euler's angles about the angular momentum L two follow from it, and the third, the precession, is the integral of
    L (I1 w1^2 + I2 w2^2)/(I1^2 w1^2 + I2^2 w2^2).

    Args:
        moments: I1 < I2 < I3 [kg m^2].
        spin: (w1, 0, w3) [rad/s], both above zero, nearer to the third axis: L^2 > 2 E I2.
    """
    I1, I2, I3 = moments
    w1, _, w3 = spin
    double_energy = I1 * w1 * w1 + I3 * w3 * w3
    square = I1 * I1 * w1 * w1 + I3 * I3 * w3 * w3
    L = math.sqrt(square)
    beyond, above = double_energy * I3 - square, square - double_energy * I1
    p = math.sqrt((I3 - I2) * above / (I1 * I2 * I3))
    k2 = (I2 - I1) * beyond / ((I3 - I2) * above)
    w2 = math.sqrt(beyond / (I2 * (I3 - I2)))

    def momentum(s: float) -> tuple[float, float, float]:
        sn, cn, dn, _ = ellipj(p * s, k2)
        return I1 * w1 * float(cn), I2 * w2 * float(sn), I3 * w3 * float(dn)

    def precession(s: float) -> float:
        x, y, _ = momentum(s)
        return L * (x * x / I1 + y * y / I2) / (x * x + y * y)

    parts = np.linspace(0.0, t, 2 + int(p * t))
    phi = math.fsum(quad(precession, a, b, epsabs=1e-13, epsrel=1e-13)[0] for a, b in pairwise(parts.tolist()))

    def attitude(phi: float, s: float) -> FloatArray:
        x, y, z = momentum(s)
        tilt, own = math.atan2(math.hypot(x, y), z), math.atan2(x, y)
        return _about_z(phi) @ _about_x(tilt) @ _about_z(own)

    return np.asarray(attitude(0.0, 0.0).T @ attitude(phi, t))


def _about_z(angle: float) -> FloatArray:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def _about_x(angle: float) -> FloatArray:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])
