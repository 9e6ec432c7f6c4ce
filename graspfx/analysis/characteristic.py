"""The characteristic polynomials D + k N of a device on a wall and of a device that moves an object."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from graspfx.analysis.discrete import ONE_PLUS, S, plus, power, thing, times
from graspfx.analysis.fractional_delay import late_device
from graspfx.errors import InputError

LATEST = 20  # samples of delay: beyond, coefficients lose the digits of the roots (4e-9 of |z| at 20, 1e-4 at 25)

FloatArray = NDArray[np.float64]
Numbers = FloatArray | float


def wall(
    mass: Numbers,
    friction: Numbers,
    period: Numbers,
    *,
    spring: Numbers,
    damping: Numbers,
    delay: int,
    latency: float = 0.0,
) -> tuple[FloatArray, FloatArray]:
    """Give D and N of f = k x + B (x_k - x_(k-1))/T, displayed `delay` samples late; ascending powers of s = z - 1.

    z^L [den + z^-delay (k + B (1 - 1/z)/T) num], the device num/den under zero-order hold, `latency` s later still.
    """
    late, numerator, denominator = late_device(mass, friction, spring, period, latency)
    delay += late
    _check("delay", delay)
    more = int(np.any(damping))
    D = times(denominator, power(delay + more))
    if more:
        D = plus(D, times(numerator, S, constant(np.divide(damping, period))))
    return D, pad(times(numerator, power(more)), D)


def external(
    mass: Numbers,
    friction: Numbers,
    period: Numbers,
    object_mass: Numbers,
    object_viscosity: Numbers,
    *,
    spring: Numbers,
    damping: Numbers,
    integrator: str,
    delay: int,
    object_delay: int,
    latency: float = 0.0,
) -> tuple[FloatArray, FloatArray]:
    """Give D and N of one device and one object through f = k (x - x_o) + B ((x_k - x_(k-1))/T - v_o).

    The object's velocity is its state; "implicit" takes its position and velocity at the end of the sample. A motion of
    both together that no force opposes (no spring) is a root z = 1 of D and N: it is put at z = 0, out of the way.
    """
    late, numerator, denominator = late_device(mass, friction, spring, period, latency)
    delay += late
    _check("delay", delay)
    _check("object_delay", object_delay)
    position, velocity, body = thing(object_mass, object_viscosity, integrator, period)
    more = int(np.any(damping))
    L = max(delay + more, object_delay)
    D = times(denominator, body, power(L))
    N = plus(
        times(numerator, body, power(L - delay)),
        times(position, denominator, power(L - object_delay)),
    )
    if more:
        rate = plus(
            times(numerator, S, body, power(L - delay - 1), constant(np.divide(1.0, period))),
            times(velocity, denominator, power(L - object_delay)),
        )
        D = plus(D, times(rate, constant(damping)))
    return without_drift(D, pad(N, D))


def constant(value: Numbers) -> FloatArray:
    """Write numbers as polynomials of degree zero, so that they broadcast against coefficients of others."""
    return np.asarray(value, dtype=float)[None]


def _check(name: str, delay: int) -> None:
    if delay > LATEST:
        raise InputError(name, delay, f"at most {LATEST} samples", "`spectral_radius` of a Linearisation takes any")


def pad(N: FloatArray, D: FloatArray) -> FloatArray:
    """Pad N to as many coefficients as D, on the same axes."""
    return plus(N, np.zeros_like(D))


def without_drift(D: FloatArray, N: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Move every common root at z = 1 to z = 0; they are exact zeros here, s being a factor of both."""
    while True:
        common = (D[0] == 0.0) & (N[0] == 0.0)
        if not common.any():
            return D, N
        D, N = (np.where(common, times(A[1:], ONE_PLUS), A) for A in (D, N))
