"""Passive walls: the largest stiffness, also with a delay, with an encoder, and over the damping (Z-width)."""

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
    """Compute the K with b = K (T/2 + t_d) + |B| [N/m] (Colgate and Schenkel 1997; Diolaiti et al. 2006).

    The wall's force K x + B (x_k - x_{k-1})/T is held over a sample and reaches the device after the delay t_d.

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
        The largest passive stiffness [N/m]; 0 if B alone uses up the device's damping.

    Raises:
        InputError: If the period is not positive, a damping or delay is negative, or numbers are not finite.
    """
    b, T, B, t = _checked(damping=damping, period=period, wall_damping=wall_damping, delay=delay)
    return max(0.0, (b - abs(B)) / (T / 2 + t))


def guaranteed_wall_limit(damping: float, period: float, *, wall_damping: float = 0.0, delay: float = 0.0) -> float:
    """Compute K = 2 (b - |B|)/(T [a + sqrt(a^2 + p (1 - p))]) [N/m], a = 1/2 + t_d/T, p the part of a sample in t_d.

    A wall with this stiffness is passive for every operator, delay and B; for B = 0 the limit is exact. An operator may
    move fast while the old force still acts and slowly afterwards; this lowers the limit by up to 7.2 % relative to
    `wall_limit` (at t_d = T/4). For delays of whole samples, both limits are equal.

    Arguments and errors are as for `wall_limit`.
    """
    b, T, B, t = _checked(damping=damping, period=period, wall_damping=wall_damping, delay=delay)
    return max(0.0, 2 * (b - abs(B)) / (T * _hold(t / T)))


def _hold(delay: float) -> float:
    """Compute 2 b/(K T) = a + sqrt(a^2 + p (1 - p)) at the limit K of a wall, for a delay in periods."""
    p, a = delay - math.floor(delay), 0.5 + delay
    return a + math.sqrt(a * a + p * (1 - p))


def _checked(**arguments: float) -> list[float]:
    """Check the arguments of walls by name."""
    return [
        number(name, value, UNITS[name], zero=name not in ("period", "stiffness"), negative=name == "wall_damping")
        for name, value in arguments.items()
    ]


@dataclass(frozen=True)
class QuantisedWall:
    """A wall stiffness compared with both frictions of a device (the plane of Diolaiti et al. 2006).

    Attributes:
        viscous: Ratio b/(K T); 1/2 + t_d/T or more is enough if the delay t_d is whole samples, up to 7.7 % more
            otherwise.
        coulomb: Ratio f_c/(K Delta); 1/2 or more is enough.
        passive: True if both ratios are large enough, so that no motion gains energy.
        calm_below: Speed [m/s] below which no motion gains energy. It is finite and above zero if only viscous friction
            is too small: Coulomb friction then also dissipates energy that the hold creates. inf if `passive`, else 0.
        calm_above: Speed [m/s] above which no motion gains energy; limit cycles are slower. It is finite and above zero
            if only Coulomb friction is too small: viscous friction then also dissipates energy that the quantisation
            creates. 0 if `passive`, else inf.
    """

    viscous: float
    coulomb: float
    passive: bool
    calm_below: float
    calm_above: float


def quantised_wall_limit(damping: float, period: float, *, friction: float, resolution: float) -> float:
    """Compute K = min(2 b/T, 2 f_c/Delta) [N/m] (Abbott and Okamura 2005).

    A mass with viscous and Coulomb friction in a wall K x held over a sample, with x rounded to encoder steps, is
    passive for every operator below this stiffness and not passive above. Rounding errs by at most Delta/2, so that the
    force errs by at most K Delta/2, which the friction f_c dissipates at any speed.

    Args:
        damping: Damping b [N s/m].
        period: Period T [s].
        friction: Coulomb friction f_c [N].
        resolution: Encoder step Delta [m]; 0 for a continuous sensor.
    """
    _checked(period=period, damping=damping, friction=friction, resolution=resolution)
    return min(2 * damping / period, 2 * friction / resolution if resolution > 0.0 else math.inf)


def quantised_wall(
    stiffness: float, damping: float, period: float, *, friction: float, resolution: float, delay: float = 0.0
) -> QuantisedWall:
    """Judge a wall K x with an encoder if the two frictions are not both sufficient; see `QuantisedWall`.

    On average, the hold generates at most the power b_n v^2, where b_n is the damping for which K is the limit of
    `guaranteed_wall_limit` (K T/2 without a delay), and rounding at most K Delta/2 |v|. Frictions dissipate b v^2 and
    f_c |v|. Therefore a motion gains no energy if its speed v, averaged over each interval of held force, satisfies

        (b_n - b) v <= f_c - K Delta/2.

    If f_c > K Delta/2 and b is too small, the wall is calm below a speed, and a faster motion may grow. If b is
    sufficient and f_c is too small, the wall is calm above a speed, and limit cycles, which feel like buzzing, are
    possible below that speed. If neither friction is sufficient, nothing is guaranteed.

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
    """Largest stiffness of a wall over its damping.

    Attributes:
        wall_damping: Damping B of the wall, (k,) [N s/m].
        passive: Largest K that is passive for every operator, (k,) [N/m]; zero if B alone is not passive.
        stable: Largest K that is stable with a free device, (k,) [N/m], zero if there is none; None without a mass.
    """

    wall_damping: FloatArray
    passive: FloatArray
    stable: FloatArray | None

    def plot(self, *, width: str = "screen") -> Any:
        """Plot the region. A notebook shows the figure; `.save(path)` writes it."""
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
    """Compute the largest stiffness of a wall K x + B (x_k - x_(k-1))/T over B (Colgate and Brown 1994).

    `passive` is the limit of `guaranteed_wall_limit`, for every operator. `stable` is the limit of
    `gx.stability.wall_limit` for a device that nobody holds, and depends on the device's mass.

    Args:
        damping: Damping b of the device [N s/m].
        period: Period T [s].
        mass: Mass m of the device [kg]; without it `stable` is None.
        delay: Delay of the force, in whole samples.
        latency: Additional delay of reading and force [s], not necessarily whole samples.
        wall_damping: Values of B in ascending order [N s/m]; if None, up to the largest B with a passive or, with a
            mass, stable stiffness.

    Raises:
        InputError: If an argument is invalid; the error names it.
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
        raise InputError("wall_damping", wall_damping, "dampings in ascending order, zero or above, (k,) [N s/m]")
    late = delay * T + latency
    passive = np.array([guaranteed_wall_limit(b, T, wall_damping=each, delay=late) for each in B.tolist()])
    stable = None if mass is None else np.array([stable_limit(each) for each in B.tolist()])
    return ZWidth(B, passive, stable)


def _largest_damping(plant: Plant, stable_limit: Callable[[float], float]) -> float:
    """Find approximately where the wall's damping alone becomes unstable, by doubling and bisection."""
    most = 1e3 * plant.mass / plant.period
    high = 1e-3 * max(plant.damping, 1e-3 * most)
    while stable_limit(high) > 0.0 and high < most:
        high *= 2.0
    low = 0.5 * high
    for _ in range(20):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if stable_limit(middle) > 0.0 else (low, middle)
    return float(high)
