"""Transfer functions, as polynomials in s = z - 1, of devices under zero-order hold and of objects by integrator."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from graspfx.errors import InputError

FloatArray = NDArray[np.float64]
Numbers = FloatArray | float

INTEGRATORS = ("explicit", "semi-implicit", "exact", "implicit", "bullet")
"""Names of the integrators of an object under a held force."""

TERMS = 20  # number of terms of the series of `force_response`, which fall below 1e-18 where the series is used
WIDE = 0.5  # distance of poles per sample above which their difference does not cancel
STIFF = 0.5  # k T^2/m above which 1 - cos does not cancel
WHOLE = 1e-9  # distance from a whole number [samples] up to which a delay counts as whole samples


def force_response(p: Numbers, kappa: Numbers, T: Numbers) -> tuple[FloatArray, FloatArray]:
    """Compute the responses R and Q of x'' + p x' + kappa x = u to a unit velocity and to a unit u held over T.

    R is the x after T that starts from x = 0 and x' = 1 with u = 0; Q starts from x = 0 and x' = 0 with u = 1. The
    state (x+, x'+) after T from any state (x, x') is

        x+ = (1 - kappa Q) x + R x' + Q u,   x'+ = -kappa R x + (1 - kappa Q - p R) x' + R u

    R and Q are accurate to rounding for all p, kappa >= 0: differences of nearly equal numbers are avoided.
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
    """Sum the power series in T of `force_response`'s Q, at the points of `where` (p T < 1.5, kappa T^2 < 0.5)."""
    x, y = np.where(where, p * T, 0.0), np.where(where, kappa * T * T, 0.0)
    before, term = np.zeros_like(x), np.ones_like(x)  # t^j terms of x(t)/T
    Q = 0.5 * term
    for j in range(2, TERMS):
        before, term = term, -(x * term + y * before / (j - 1)) / j
        Q = Q + term / (j + 1)
    return T * T * Q


def device(mass: Numbers, friction: Numbers, spring: Numbers, period: Numbers) -> tuple[FloatArray, FloatArray]:
    """Return the transfer function from held force to position: numerator (2, ...) and denominator (3, ...) in s.

    The device has a mass [kg], a viscous friction [N s/m] and a spring to the ground [N/m].
    """
    m = np.asarray(mass, float)
    p, kappa = friction / m, spring / m
    R, Q = force_response(p, kappa, period)
    low = Q * (kappa * Q + p * R) + R * R  # numerator at z = 1, times m
    numerator = stack(low / m, Q / m)
    return numerator, stack(kappa * low, 2.0 * kappa * Q + p * R, 1.0)


def samples_and_part(seconds: float, period: float) -> tuple[int, float]:
    """Divide a delay by the period: return the number of whole samples, and the remaining part (0 to 1) of a sample."""
    ratio = seconds / period
    n = math.floor(ratio + WHOLE)
    part = ratio - n
    return n, part if part > WHOLE else 0.0


def late_device(
    mass: Numbers, friction: Numbers, spring: Numbers, period: Numbers, latency: float
) -> tuple[int, FloatArray, FloatArray]:
    """Return the transfer function of `device` for a held force that begins `latency` seconds late.

    The result is exact. For the latency (n + phi) T with an integer n and 0 <= phi < 1, the previous force acts over
    the first phi T of a sample and the new force over the rest, so that the transfer function from force f to position
    x is

            x/f = z^-n (c + d/z)/den

    The polynomial c is the response to a force held over the last (1 - phi) T of the sample, and c + d is the response
    to a force held over the whole sample. A delay between the motion and its reading has the same effect as a late
    force and can be added to the latency.

    Returns:
        Latency in samples, rounded up to an integer L, and numerator and denominator of z^-L num/den, in ascending
            powers of s = z - 1. If the latency is a whole number of samples, both are bit-identical to those of
            `device`.

    Raises:
        InputError: If some of several periods give another n than the others, or phi = 0 where others give phi > 0.
    """
    periods = sorted(set(np.ravel(period).astype(float).tolist()))  # np.unique would load numpy.ma
    counts = [samples_and_part(latency, each) for each in periods]
    if len({(n, part > 0.0) for n, part in counts}) > 1:
        raise InputError(
            "latency",
            latency,
            "a latency that is the same number of whole samples, with or without a remainder, for every period",
            "pass one period at a time",
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
    """Return (p, q, 1 - r, s) of an integrator's step x+ = x + p v + q u, v+ = r v + s u.

    The step over T approximates x' = v, v' = u - rate v with u held. "bullet" is semi-implicit in position and exact in
    velocity (`objects.bullet.bullet`).
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
    """Return the transfer functions from a held force to an object's position and velocity.

    The result is both numerators and the common denominator, in ascending powers of s = z - 1. For "implicit", position
    and velocity are those at the end of the sample, on which the force in the same sample depends.
    """
    M = np.asarray(mass, float)
    p, q, decay, s = object_step(integrator, viscosity / M, period)
    position, velocity = stack((q * decay + p * s) / M, q / M), stack(0.0, s / M)
    if integrator == "implicit":
        position, velocity = times(position, ONE_PLUS), times(velocity, ONE_PLUS)
    return position, velocity, stack(0.0, decay, 1.0)


def stack(*coefficients: FloatArray | float) -> FloatArray:
    """Broadcast coefficients against one another, and stack them on a new first axis."""
    return np.stack(np.broadcast_arrays(*coefficients)).astype(float, copy=False)


ONE_PLUS = np.array([1.0, 1.0])  # z = 1 + s
S = np.array([0.0, 1.0])


def times(*factors: FloatArray) -> FloatArray:
    """Multiply polynomials whose coefficients are on the first axis; the other axes broadcast."""
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
    """Return the coefficients (n + 1,) of z^n in ascending powers of s = z - 1."""
    return np.asarray(np.polynomial.polynomial.polypow(ONE_PLUS, n))
