"""Largest stable gains of the loop of operator, device, bridge and linear environment, from an exact sampled model."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from graspfx.analysis.stability.loop import advance
from graspfx.card import Card, Carded
from graspfx.errors import InputError
from graspfx.numeric import number

FloatArray = NDArray[np.float64]

DECADES, PER_DECADE = (-9.0, 1.0), 60  # range and number of gains tried, as stiffness in units of m/T^2
STEADY = 1e-10  # largest |z| - 1 of a slow motion that is treated as stable
STEPS = 60  # number of bisections


@dataclass(frozen=True, eq=False)
class GainLimits(Carded):
    """Gains up to which the loop is stable.

    Attributes:
        push: Largest stable push gain; inf if every gain is stable.
        squeeze: Largest stable squeeze gain; inf if every gain is stable.
        stiffness: Largest stable stiffness that a finger feels, the gain times the environment's stiffness, for either
            port [N/m].
        delay: Delay, within the given range, at which this stiffness is the limit [ticks].
        frequency: Frequency of the oscillation at the limit [Hz].
    """

    push: float
    squeeze: float
    stiffness: float
    delay: int
    frequency: float

    def _card(self) -> Card:
        rows = [
            ("push gain", f"below {self.push:.4g}"),
            ("squeeze gain", f"below {self.squeeze:.4g}"),
            ("felt stiffness", f"{self.stiffness:.4g} N/m, at a delay of {self.delay} ticks, {self.frequency:.3g} Hz"),
        ]
        return Card("Limits of a host's gains, in a linear environment", rows, ".push, .squeeze, .stiffness")


def gain_limits(
    *,
    mass: float,
    damping: float,
    period: float,
    host_ticks: int,
    delay: int | tuple[int, int],
    push_stiffness: float,
    squeeze_stiffness: float,
    hand_stiffness: float = 0.0,
    hand_damping: float = 0.0,
    predict: str = "hold",
    model: float = 1.0,
) -> GainLimits:
    """Compute the largest stable push and squeeze gains g, from the loop of one finger in each port.

        m x'' + (b + b_h) x' + k_h x = f,    f held over T,    f_j = -g k y_j

    Here x is the position of the finger, f_j the force in tick j, and k the environment's stiffness. The host samples
    the operator at ticks R i, and tick j uses the sample of tick s = R floor((j - D)/R). Then y_j is x_s ("hold"), x_s
    + (x_s - x_(s-R)) a/R at a ticks after the sample's arrival ("linear"), or (1 - r) x_s + r x_j, with a model of r
    times the environment's stiffness ("model"). Over R ticks the loop is a linear map of x, x' and the samples on the
    delay line; the gain is increased until an eigenvalue leaves the unit circle.

    Every constant delay of a range is considered, but not delays that change between samples. The smallest unstable
    gain is located on a grid of 60 gains per decade, and then refined by bisection.

    Args:
        mass: Mass m of the device at a finger [kg].
        damping: Viscous damping b of the device [N s/m].
        period: Period T of the loop [s].
        host_ticks: Number R of ticks from one sample of the host to the next.
        delay: Delay D from the tick that reads the operator's position to the tick that displays the host's answer to
            it [ticks], or a range (least, most) of this delay. With a real host, the delay is at least 1.
        push_stiffness, squeeze_stiffness: Stiffness k of the environment at one finger [N/m], for a gain of 1, if all
            fingers move together (push) or towards each other (squeeze).
        hand_stiffness, hand_damping: Stiffness [N/m] and damping [N s/m] between the operator's finger and ground.
        model: Ratio r of the model's stiffness to g k; only for "model".

    Raises:
        InputError: If an argument is invalid.
    """
    m, T = number("mass", mass, "a mass [kg]", zero=False), number("period", period, "a time [s]", zero=False)
    b, k_h = number("damping", damping, "N s/m"), number("hand_stiffness", hand_stiffness, "N/m")
    b_h = number("hand_damping", hand_damping, "N s/m")
    stiffness = {
        "push": number("push_stiffness", push_stiffness, "N/m"),
        "squeeze": number("squeeze_stiffness", squeeze_stiffness, "N/m"),
    }
    if type(host_ticks) is not int or host_ticks < 1:
        raise InputError("host_ticks", host_ticks, "an integer number of ticks, at least 1")
    low, high = delay if isinstance(delay, tuple) and len(delay) == 2 else (delay, delay)
    if not (type(low) is int and type(high) is int and 0 <= low <= high):
        raise InputError("delay", delay, "a non-negative integer number of ticks, or a tuple (least, most) of two")
    if str(predict) not in ("hold", "linear", "model"):
        raise InputError("predict", predict, "'hold', 'linear' or 'model'")
    ratio = number("model", model, "a ratio, zero or above")
    r = ratio if predict == "model" else 0.0
    E = advance(np.array([[k_h / m]]), np.array([[(b + b_h) / m]]), np.array([[1.0 / m]]), T)
    worst, at, angle = math.inf, low, 0.0
    for D in range(low, high + 1):
        limit, turn = _first_loss(partial(_lifted, E, host_ticks, D, predict == "linear", r), m / T**2)
        if limit < worst:
            worst, at, angle = limit, D, turn
    gains = {name: worst / k if k > 0.0 else math.inf for name, k in stiffness.items()}
    return GainLimits(gains["push"], gains["squeeze"], worst, at, angle / (2.0 * math.pi * host_ticks * T))


def _lifted(E: FloatArray, R: int, D: int, linear: bool, r: float, stiffness: float) -> FloatArray:
    """Compute the map of s = (x, x', x_(i-1), ..., x_(i-q)) over R ticks; x_i is the sample of the first tick.

    Args:
        E: Map of (x, x', f) to (x, x') over a tick, (2, 3).
        R: Ticks from one sample to the next.
        D: Delay [ticks].
        linear: Whether forces are extrapolated from the last two samples.
        r: Fraction of the force that follows the position immediately.
        stiffness: Felt stiffness g k [N/m].
    """
    back = -(-D // R) + int(linear)  # number of stored samples
    size = 2 + back
    samples = np.eye(size)[[0, *range(2, size)]]  # x_i, x_(i-1), ...
    motion = np.eye(size)[:2]
    for j in range(R):
        age, past = (j - D) % R, -((j - D) // R)
        y = samples[past]
        if linear:
            y = y + (y - samples[past + 1]) * (age / R)
        f = -stiffness * ((1.0 - r) * y + r * motion[0])
        motion = E @ np.vstack([motion, f])
    return np.asarray(np.vstack([motion, samples[:back]]))


def _radius(matrix: FloatArray) -> tuple[float, float]:
    """Compute the largest |z| of the eigenvalues z of a map, and the angle of this eigenvalue [rad]."""
    values = np.linalg.eigvals(matrix)
    z = values[np.argmax(np.abs(values))]
    return float(abs(z)), float(abs(np.angle(z)))


def _first_loss(loop: Callable[[float], FloatArray], unit: float) -> tuple[float, float]:
    """Find the smallest stiffness at which a loop is unstable [N/m], or inf, and the angle of the eigenvalue [rad]."""
    low = 0.0
    for power in np.linspace(*DECADES, int((DECADES[1] - DECADES[0]) * PER_DECADE) + 1).tolist():
        high = unit * 10.0**power
        if _radius(loop(high))[0] > 1.0 + STEADY:
            break
        low = high
    else:
        return math.inf, 0.0
    if low == 0.0:
        return 0.0, 0.0
    for _ in range(STEPS):
        middle = 0.5 * (low + high)
        if _radius(loop(middle))[0] > 1.0:
            high = middle
        else:
            low = middle
    return low, _radius(loop(high))[1]
