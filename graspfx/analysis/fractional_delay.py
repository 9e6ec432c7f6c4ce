"""Delays that are no whole number of samples: the force of a tick begins to act within a sample."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from graspfx.analysis.discrete import ONE_PLUS, Numbers, device, force_response, plus, stack, times
from graspfx.errors import InputError

FloatArray = NDArray[np.float64]

WHOLE = 1e-9  # of a sample: what a delay is off a whole number by is rounding


def samples_and_part(seconds: float, period: float) -> tuple[int, float]:
    """Divide a delay by the period: n whole samples, and the part phi of one that is left, 0 <= phi < 1."""
    ratio = seconds / period
    n = math.floor(ratio + WHOLE)
    part = ratio - n
    return n, part if part > WHOLE else 0.0


def late_device(
    mass: Numbers, friction: Numbers, spring: Numbers, period: Numbers, latency: float
) -> tuple[int, FloatArray, FloatArray]:
    """Give `discrete.device` for a force held over a sample that begins `latency` seconds late.

    With the delay (n + phi) T the old force acts over the first phi T of a sample and the new one over the rest:

        x/f = z^-n (c + d/z)/den,    c: response to a force held over the last (1 - phi) T, d: whole hold less that

    Nothing is approximated. A delay between the motion and its reading has the same effect, and is to be added.

    Returns:
        Whole samples, numerator and denominator: z^-samples num/den, ascending powers of s; without a part of a sample
        those of `discrete.device`, to the bit.

    Raises:
        InputError: periods of which the delay is not the same number of whole samples.
    """
    periods = np.unique(np.asarray(period, dtype=float))
    counts = [samples_and_part(latency, each) for each in periods.tolist()]
    if len({(n, part > 0.0) for n, part in counts}) > 1:
        raise InputError("latency", latency, "as many whole samples for every period", "compute one period at a time")
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
