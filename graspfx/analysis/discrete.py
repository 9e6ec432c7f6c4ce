"""Polynomials in s = z - 1 of devices under zero-order hold, also with delays, and of objects by integrator."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from graspfx.errors import InputError

FloatArray = NDArray[np.float64]
Numbers = FloatArray | float

INTEGRATORS = ("explicit", "semi-implicit", "exact", "implicit", "bullet")
"""Names of the object's integrators under a held force."""

TERMS = 20  # number of terms of the series of `force_response`, which fall below 1e-18 where the series is used
WIDE = 0.5  # distance of poles per sample above which their difference does not cancel
STIFF = 0.5  # k T^2/m above which 1 - cos does not cancel
WHOLE = 1e-9  # distance from a whole number [samples] up to which a delay counts as whole samples


def force_response(p: Numbers, kappa: Numbers, T: Numbers) -> tuple[FloatArray, FloatArray]:
    """Compute R and Q of x'' + p x' + kappa x = u, with u held over T.

    Both are x after T from x = 0: R for x' = 1 and u = 0, Q for x' = 0 and u = 1.

        x+ = (1 - kappa Q) x + R x' + Q u,   x'+ = -kappa R x + (1 - kappa Q - p R) x' + R u

    R and Q are accurate to rounding for all p, kappa >= 0, because no differences are formed that would cancel.
    """
    p, kappa, T = np.broadcast_arrays(np.asarray(p, float), np.asarray(kappa, float), np.asarray(T, float))
    alpha = 0.5 * p
    discriminant = alpha * alpha - kappa
    root = np.sqrt(np.abs(discriminant))
    real = discriminant >= 0.0
    gap = np.where(real, 2.0 * root, 0.0)
    slow = np.where(real, -kappa / np.where(alpha + root > 0.0, alpha + root, 1.0), 0.0)  # -alpha + root
    fast = -alpha - root
    R = np.where(
        real,
        np.exp(slow * T) * T * mean_exponential(-gap * T),
        np.exp(-alpha * T) * T * np.sinc(root * T / np.pi),
    )

    wide = gap * T > WIDE
    stiff = ~wide & (kappa * T * T >= STIFF)
    apart = T * (mean_exponential(slow * T) - mean_exponential(fast * T)) / np.where(wide, gap, 1.0)
    turn = np.where(wide, 0.0, root * T)
    bend = np.where(real, turn, 0.0)
    wave = np.where(real, np.cosh(bend), np.cos(turn))
    slope = np.where(real, np.sinh(bend) / np.where(bend > 0.0, bend, 1.0), np.sinc(turn / np.pi))
    slope = np.where(turn > 0.0, slope, 1.0)
    back = (1.0 - np.exp(-alpha * T) * (wave + alpha * T * slope)) / np.where(stiff, kappa, 1.0)
    return R, np.where(wide, apart, np.where(stiff, back, _series(p, kappa, T, ~wide & ~stiff)))


def mean_exponential(x: FloatArray) -> FloatArray:
    """Compute (exp(x) - 1)/x, the mean of exp over [0, x]."""
    zero = x == 0.0
    value: FloatArray = np.where(zero, 1.0, np.expm1(x) / np.where(zero, 1.0, x))
    return value


def _series(p: FloatArray, kappa: FloatArray, T: FloatArray, where: NDArray[np.bool_]) -> FloatArray:
    """Sum Q's power series in T, where p T < 1.5 and kappa T^2 < 0.5."""
    x, y = np.where(where, p * T, 0.0), np.where(where, kappa * T * T, 0.0)
    before, term = np.zeros_like(x), np.ones_like(x)  # t^j terms of x(t)/T
    Q = 0.5 * term
    for j in range(2, TERMS):
        before, term = term, -(x * term + y * before / (j - 1)) / j
        Q = Q + term / (j + 1)
    return T * T * Q


def device(mass: Numbers, friction: Numbers, spring: Numbers, period: Numbers) -> tuple[FloatArray, FloatArray]:
    """Return the transfer function from held force to position: numerator (2, ...), denominator (3, ...), in s."""
    m = np.asarray(mass, float)
    p, kappa = friction / m, spring / m
    R, Q = force_response(p, kappa, period)
    low = Q * (kappa * Q + p * R) + R * R  # numerator at z = 1, times m
    numerator = stack(low / m, Q / m)
    return numerator, stack(kappa * low, 2.0 * kappa * Q + p * R, 1.0)


def samples_and_part(seconds: float, period: float) -> tuple[int, float]:
    """Divide a delay by the period: n whole samples, and the remaining part phi of a sample, 0 <= phi < 1."""
    ratio = seconds / period
    n = math.floor(ratio + WHOLE)
    part = ratio - n
    return n, part if part > WHOLE else 0.0


def late_device(
    mass: Numbers, friction: Numbers, spring: Numbers, period: Numbers, latency: float
) -> tuple[int, FloatArray, FloatArray]:
    """Return the polynomials of `discrete.device` for a held force that begins `latency` seconds late.

    With the delay (n + phi) T, the old force acts over the first phi T of a sample and the new one over the rest:

            x/f = z^-n (c + d/z)/den,    c: response to a force held over the last (1 - phi) T, d: whole hold minus c

    Nothing is approximated. A delay between the motion and its reading has the same effect; add it to the latency.

    Returns:
        Delay L in samples, rounded up, and numerator and denominator of z^-L num/den, in ascending powers of s. If the
            latency is whole samples, both polynomials are bit-identical to those of `discrete.device`.

    Raises:
        InputError: If the number of whole samples, or the presence of a remainder, differs between periods.
    """
    periods = sorted(set(np.ravel(period).astype(float).tolist()))  # np.unique would load numpy.ma
    counts = [samples_and_part(latency, each) for each in periods]
    if len({(n, part > 0.0) for n, part in counts}) > 1:
        raise InputError(
            "latency",
            latency,
            "a latency with the same number of whole samples for every period, and a remainder for all or none",
            "compute one period at a time",
        )
    numerator, denominator = device(mass, friction, spring, period)
    n, part = counts[0]
    if part == 0.0:
        return n, numerator, denominator
    m, T = np.asarray(mass, float), np.asarray(period, float)
    p, kappa = friction / m, spring / m
    R, Q = force_response(p, kappa, T)
    R_new, Q_new = force_response(p, kappa, (n + 1) * T - latency)

    def position(speed: FloatArray, shift: FloatArray) -> FloatArray:
        return stack((shift * (kappa * Q + p * R) + R * speed) / m, shift / m)

    old, new = position(R - R_new, Q - Q_new), position(R_new, Q_new)
    return n + 1, plus(old, times(new, ONE_PLUS)), denominator


def object_step(integrator: str, rate: Numbers, T: Numbers) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Compute (p, q, 1 - r, s) of x+ = x + p v + q u, v+ = r v + s u, for v' = u - rate v with u held over T.

    "bullet" is semi-implicit in position and exact in velocity (`objects.bullet.bullet`).
    """
    a, T = np.broadcast_arrays(np.asarray(rate, float), np.asarray(T, float))
    if integrator == "explicit":
        return T, np.zeros_like(T), T * a, T
    if integrator == "semi-implicit":
        return T * (1.0 - T * a), T * T, T * a, T
    if integrator == "implicit":
        r = 1.0 / (1.0 + T * a)
        return T * r, T * T * r, T * a * r, T * r
    R, Q = force_response(a, np.zeros_like(a), T)
    if integrator == "bullet":
        return T * (1.0 - a * R), T * R, a * R, R
    return R, Q, a * R, R


def object_response(
    mass: Numbers, viscosity: Numbers, integrator: str, period: Numbers
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return an object's position and velocity per force and their common denominator, in ascending powers of s.

    With "implicit", position and velocity refer to the end of the sample, from which the sample's force is computed.
    """
    M = np.asarray(mass, float)
    p, q, decay, s = object_step(integrator, viscosity / M, period)
    position, velocity = stack((q * decay + p * s) / M, q / M), stack(0.0, s / M)
    if integrator == "implicit":
        position, velocity = times(position, ONE_PLUS), times(velocity, ONE_PLUS)
    return position, velocity, stack(0.0, decay, 1.0)


def stack(*coefficients: FloatArray | float) -> FloatArray:
    """Stack coefficients on a first axis; the other axes index the points."""
    return np.stack(np.broadcast_arrays(*coefficients)).astype(float, copy=False)


ONE_PLUS = np.array([1.0, 1.0])  # z = 1 + s
S = np.array([0.0, 1.0])


def times(*factors: FloatArray) -> FloatArray:
    """Multiply polynomials with their coefficients on the first axis; the other axes broadcast."""
    product = factors[0]
    for factor in factors[1:]:
        shape = np.broadcast_shapes(product.shape[1:], factor.shape[1:])
        total = np.zeros((len(product) + len(factor) - 1, *shape))
        for i, a in enumerate(product):
            for j, b in enumerate(factor):
                total[i + j] += a * b
        product = total
    return product


def plus(*terms: FloatArray) -> FloatArray:
    """Add polynomials of any degrees."""
    shape = np.broadcast_shapes(*(term.shape[1:] for term in terms))
    total = np.zeros((max(map(len, terms)), *shape))
    for term in terms:
        for i, a in enumerate(term):
            total[i] += a
    return total


def power(n: int) -> FloatArray:
    """Return z^n as a polynomial."""
    return np.asarray(np.polynomial.polynomial.polypow(ONE_PLUS, n))
