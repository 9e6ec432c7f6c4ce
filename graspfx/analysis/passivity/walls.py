"""Largest passive stiffness of a virtual wall, with delay, encoder resolution and wall damping (Z-width)."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspfx.analysis.checked_arguments import number, numbers
from graspfx.analysis.sampled_plant import Plant
from graspfx.card import Card, Carded
from graspfx.errors import InputError

FloatArray = NDArray[np.float64]

COUNT = 161  # number of wall dampings
UNITS = {
    "damping": "N s/m", "period": "s", "wall_damping": "N s/m", "delay": "s", "friction": "N", "resolution": "m",
    "stiffness": "N/m",
}  # fmt: skip


def wall_limit(damping: float, period: float, *, wall_damping: float = 0.0, delay: float = 0.0) -> float:
    """Compute the passivity limit K = (b - |B|)/(T/2 + t_d) of the stiffness of a wall.

    The wall's force K x + B (x_k - x_{k-1})/T is held over a sample and reaches the device after the delay t_d (Colgate
    and Schenkel 1997; Diolaiti et al. 2006).

    | delay t_d | B | the limit is |
    |---|---|---|
    | none | any | exact: passive below, not above |
    | whole samples | B <= 0 | exact |
    | whole samples | B > 0 | conservative: the two terms are largest at different frequencies |
    | part of a sample | any | up to 7.7 % too high; use `guaranteed_wall_limit` |

    Args:
        damping: Damping b of the device [N s/m].
        period: Period T [s].
        wall_damping: Damping B of the wall [N s/m].
        delay: Delay t_d [s].

    Returns:
        The largest passive stiffness [N/m]; 0 if |B| exceeds the device's damping.

    Raises:
        InputError: If the period is not positive, the device's damping or the delay is negative, or an argument is
            infinite or nan.
    """
    b, T, B, t = _checked(damping=damping, period=period, wall_damping=wall_damping, delay=delay)
    return max(0.0, (b - abs(B)) / (T / 2 + t))


def guaranteed_wall_limit(damping: float, period: float, *, wall_damping: float = 0.0, delay: float = 0.0) -> float:
    """Compute a stiffness limit of a wall that guarantees passivity also if the delay is not a whole number of samples.

    With a = 1/2 + t_d/T and the fractional part p of t_d/T, the limit is

        K = 2 (b - |B|)/(T [a + sqrt(a^2 + p (1 - p))])  [N/m]

    A wall with this stiffness is passive for every operator; for B = 0 the limit is exact. It is up to 7.2 % lower than
    `wall_limit` (at t_d = T/4), because an operator may move fast while the previous force still acts in a sample, and
    slowly afterwards. For delays of whole samples, both limits are equal.

    Arguments and errors are as for `wall_limit`.
    """
    b, T, B, t = _checked(damping=damping, period=period, wall_damping=wall_damping, delay=delay)
    return max(0.0, 2 * (b - abs(B)) / (T * _hold(t / T)))


def _hold(delay: float) -> float:
    """Compute the factor a + sqrt(a^2 + p (1 - p)) in `guaranteed_wall_limit`, for a delay in periods."""
    p, a = delay - math.floor(delay), 0.5 + delay
    return a + math.sqrt(a * a + p * (1 - p))


def _checked(**arguments: float) -> list[float]:
    """Check arguments of the functions for walls, and return their values."""
    return [
        number(name, value, UNITS[name], zero=name not in ("period", "stiffness"), negative=name == "wall_damping")
        for name, value in arguments.items()
    ]


@dataclass(frozen=True)
class QuantisedWall:
    """Passivity of a wall of stiffness K on a device with an encoder (the plane of Diolaiti et al. 2006).

    The device has viscous friction b, Coulomb friction f_c, sampling period T, delay t_d and encoder step Delta.

    Attributes:
        viscous: Ratio b/(K T). It is sufficient from 1/2 + t_d/T if the delay is a whole number of samples; otherwise
            up to 7.7 % more is needed.
        coulomb: Ratio f_c/(K Delta). It is sufficient from 1/2.
        passive: Whether both ratios are sufficient, so that no motion gains energy.
        calm_below: Speed [m/s] below which no motion gains energy: inf if `passive`; finite and above zero if only the
            viscous friction is too small, so that Coulomb friction must dissipate the rest; otherwise 0.
        calm_above: Speed [m/s] above which no motion gains energy: 0 if `passive`; finite and above zero if only the
            Coulomb friction is too small, so that viscous friction must dissipate the rest; otherwise inf. Limit cycles
            are slower than this speed.
    """

    viscous: float
    coulomb: float
    passive: bool
    calm_below: float
    calm_above: float


def quantised_wall_limit(damping: float, period: float, *, friction: float, resolution: float) -> float:
    """Compute the largest passive stiffness K = min(2 b/T, 2 f_c/Delta) of a wall with an encoder [N/m].

    A device with viscous and Coulomb friction on a wall K x, with x rounded to encoder steps and the force held over a
    sample, is passive for every operator below this stiffness and not passive above it (Abbott and Okamura 2005).
    Rounding changes the force by at most K Delta/2; an equal Coulomb friction f_c dissipates the energy of this error.

    Args:
        damping: Damping b [N s/m].
        period: Period T [s].
        friction: Coulomb friction f_c of the device [N].
        resolution: Encoder step Delta [m]; 0 for a continuous sensor.
    """
    _checked(period=period, damping=damping, friction=friction, resolution=resolution)
    return min(2 * damping / period, 2 * friction / resolution if resolution > 0.0 else math.inf)


def quantised_wall(
    stiffness: float, damping: float, period: float, *, friction: float, resolution: float, delay: float = 0.0
) -> QuantisedWall:
    """Find the speeds at which a wall K x with an encoder gains no energy; see `QuantisedWall`.

    On average, the hold generates at most the power b_n v^2, where b_n is the damping for which K is the limit of
    `guaranteed_wall_limit` (K T/2 without a delay), and rounding generates at most K Delta/2 |v|. Viscous and Coulomb
    friction dissipate b v^2 and f_c |v|. Therefore a motion gains no energy if its speed v, averaged over each interval
    of held force, satisfies

        (b_n - b) v <= f_c - K Delta/2.

    If only b is too small, motions below a limiting speed gain no energy, and faster motions may grow. If only f_c is
    too small, motions above a limiting speed gain no energy, and slower limit cycles, which are felt as buzzing, are
    possible. If both are too small, no speed is guaranteed.

    Args:
        stiffness: Stiffness K [N/m].
        delay: Delay t_d [s].
        damping, period, friction, resolution: As for `quantised_wall_limit`.
    """
    wall = {"period": period, "damping": damping, "friction": friction, "resolution": resolution, "delay": delay}
    _checked(**wall, stiffness=stiffness)
    needed = stiffness * period * _hold(delay / period) / 2
    short, spare = needed - damping, friction - stiffness * resolution / 2
    viscous = damping / (stiffness * period)
    coulomb = friction / (stiffness * resolution) if resolution > 0.0 else math.inf
    if short <= 0.0 <= spare:
        return QuantisedWall(viscous, coulomb, True, math.inf, 0.0)
    below = spare / short if short > 0.0 and spare > 0.0 else 0.0
    above = spare / short if short < 0.0 and spare < 0.0 else math.inf
    return QuantisedWall(viscous, coulomb, False, below, above)


@dataclass(frozen=True, eq=False, repr=False)
class ZWidth(Carded):
    """Largest passive and largest stable stiffness of a wall, as functions of the wall's damping.

    Attributes:
        wall_damping: Damping B of the wall, (k,) [N s/m].
        passive: Largest stiffness that is passive for every operator, (k,) [N/m]; zero where no stiffness is passive.
        stable: Largest stiffness that is stable for a device that nobody holds, (k,) [N/m]; zero where no stiffness is
            stable. None if the device's mass was not given.
    """

    wall_damping: FloatArray
    passive: FloatArray
    stable: FloatArray | None

    def plot(self, *, width: str = "screen") -> Any:
        """Plot the stiffnesses over the damping. A notebook shows the figure; `.save(path)` writes it."""
        from graspfx.show.certificate_figures import z_width

        return z_width(self, width=width)

    def _card(self) -> Card:
        low, high = self.wall_damping[0], self.wall_damping[-1]
        stable = "not computed: no mass" if self.stable is None else f"up to {self.stable.max():.4g} N/m"
        rows = [
            ("wall damping", f"{low:.4g} to {high:.4g} N s/m, {len(self.wall_damping)} of them"),
            ("passive", f"up to {self.passive.max():.4g} N/m"),
            ("stable", stable),
        ]
        return Card("Z-width: stiffness of a wall over its damping", rows, ".plot(), .wall_damping, .passive, .stable")


def z_width(
    damping: float,
    period: float,
    *,
    mass: float | None = None,
    delay: int = 0,
    wall_damping: ArrayLike | None = None,
    latency: float = 0.0,
) -> ZWidth:
    """Compute the largest stiffness K of a wall for each damping B (Colgate and Brown 1994).

    The wall's force is K x + B (x_k - x_(k-1))/T. The largest passive stiffness is that of `guaranteed_wall_limit`, for
    every operator; the largest stable stiffness is that of `gx.stability.wall_limit`, for a device that nobody holds.

    Args:
        damping: Damping b of the device [N s/m].
        period: Sampling period T [s].
        mass: Mass m of the device [kg]; if None, `stable` is not computed.
        delay: Delay of the force, in whole samples.
        latency: Additional delay of reading and force [s], not necessarily whole samples.
        wall_damping: Values of B in ascending order [N s/m]. If None, they extend to the largest B for which a
            stiffness is passive or, if a mass is given, stable.

    Raises:
        InputError: If an argument is invalid; the message names the argument.
    """
    plant = Plant(1.0 if mass is None else mass, damping, period, delay=delay, latency=latency).checked(single=True)
    b, T = plant.damping, plant.period

    def stable_limit(B: float) -> float:
        return replace(plant, coupling_damping=B).limits().limit

    if wall_damping is None:
        top = b if mass is None else max(b, _largest_damping(plant, stable_limit))
        top = 1.02 * top if top > 0.0 else 1.0
        B = np.linspace(0.0, top, COUNT) if mass is None else np.geomspace(1e-2 * (min(b, top) or top), top, COUNT)
    else:
        B = numbers("wall_damping", wall_damping, "N s/m")
    if B.ndim != 1 or not len(B) or (np.diff(B) <= 0.0).any():
        raise InputError("wall_damping", wall_damping, "increasing dampings, zero or above, (k,) [N s/m]")
    late = delay * T + latency
    passive = np.array([guaranteed_wall_limit(b, T, wall_damping=each, delay=late) for each in B.tolist()])
    stable = None if mass is None else np.array([stable_limit(each) for each in B.tolist()])
    return ZWidth(B, passive, stable)


def _largest_damping(plant: Plant, stable_limit: Callable[[float], float]) -> float:
    """Find, approximately, the largest wall damping that is stable without stiffness, by doubling and bisection."""
    most = 1e3 * plant.mass / plant.period
    high = 1e-3 * max(plant.damping, 1e-3 * most)
    while stable_limit(high) > 0.0 and high < most:
        high *= 2.0
    low = 0.5 * high
    for _ in range(20):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if stable_limit(middle) > 0.0 else (low, middle)
    return float(high)
