"""Walls: passive up to which stiffness, also late, through an encoder, and over their damping (Z-width)."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspfx.analysis.arguments import number, numbers
from graspfx.analysis.plant import Plant
from graspfx.card import Card, Carded
from graspfx.errors import InputError

FloatArray = NDArray[np.float64]

COUNT = 161  # dampings of the wall


def wall_limit(damping: float, period: float, *, wall_damping: float = 0.0, delay: float = 0.0) -> float:
    """Compute K = (b - |B|)/(T/2 + t_d): b > K (T/2 + t_d) + |B| [N/m] (Colgate, Schenkel 1997; Diolaiti et al. 2006).

    The wall's force K x + B (x_k - x_{k-1})/T is held over a sample and reaches the device t_d late.

    | delay t_d | B | the limit is |
    |---|---|---|
    | none | any | exact: passive below, not above |
    | whole samples | B <= 0 | exact |
    | whole samples | B > 0 | safe, and low: its two terms are worst at different frequencies |
    | part of a sample | any | up to 7.7 % too high; `guaranteed_wall_limit` is safe |

    Args:
        damping: b of the device [N s/m].
        period: T [s].
        wall_damping: B [N s/m].
        delay: t_d [s].

    Returns:
        The largest stiffness, 0 where B alone takes all of the device's damping.

    Raises:
        InputError: a period that is not positive, a negative damping or delay, numbers that are not finite.
    """
    b, T, t = _wall(damping, period, wall_damping, delay)
    return max(0.0, (b - abs(wall_damping)) / (T / 2 + t))


def guaranteed_wall_limit(damping: float, period: float, *, wall_damping: float = 0.0, delay: float = 0.0) -> float:
    """Compute K = 2 (b - |B|)/(T [a + sqrt(a^2 + p (1 - p))]) [N/m], a = 1/2 + t_d/T, p the part of a sample in t_d.

    Safe for every operator, delay and B, and exact for B = 0: an operator may move fast while the force is still the
    old one and slowly afterwards, which costs up to 7.2 % of the stiffness of `wall_limit` (at t_d = T/4). For delays
    of whole samples the two are equal.

    Args and errors: as `wall_limit`.
    """
    b, T, t = _wall(damping, period, wall_damping, delay)
    p = t / T - math.floor(t / T)
    a = 0.5 + t / T
    return max(0.0, 2 * (b - abs(wall_damping)) / (T * (a + math.sqrt(a * a + p * (1 - p)))))


def _wall(damping: float, period: float, wall_damping: float, delay: float) -> tuple[float, float, float]:
    number("wall_damping", wall_damping, "N s/m", negative=True)
    return (
        number("damping", damping, "N s/m"),
        number("period", period, "s", zero=False),
        number("delay", delay, "s"),
    )


@dataclass(frozen=True)
class QuantisedWall:
    """A stiffness against both frictions of a device (the plane of Diolaiti et al. 2006).

    Attributes:
        viscous: b/(K T), enough from 1/2 + t_d/T on.
        coulomb: f_c/(K Delta), enough from 1/2 on.
        passive: whether both are enough, so that no motion gains energy.
        calm_below: speed [m/s] up to which no motion gains energy: Coulomb friction pays also for the hold; infinity if
            the viscous one does.
        calm_above: speed [m/s] from which none does: viscosity pays also for the steps; what buzzes stays slower. Zero
            if Coulomb friction pays for them, infinity if viscosity has nothing left.
    """

    viscous: float
    coulomb: float
    passive: bool
    calm_below: float
    calm_above: float


def quantised_wall_limit(damping: float, period: float, *, friction: float, resolution: float) -> float:
    """Compute K = min(2 b/T, 2 f_c/Delta) [N/m] (Abbott and Okamura 2005).

    A mass with viscous and Coulomb friction in a wall K x, held over a sample, x rounded to an encoder's steps: passive
    to every operator below, and for no stiffness above. Rounding is Delta/2 off at most, so that the force is wrong by
    K Delta/2, which friction f_c takes whatever the speed.

    Args:
        damping: b [N s/m].
        period: T [s].
        friction: f_c, Coulomb friction [N].
        resolution: Delta, one step [m]; 0 for a continuous sensor.
    """
    _check(damping, period, friction, resolution, 0.0)
    return min(2 * damping / period, 2 * friction / resolution if resolution > 0.0 else math.inf)


def quantised_wall(
    stiffness: float, damping: float, period: float, *, friction: float, resolution: float, delay: float = 0.0
) -> QuantisedWall:
    """Judge a wall K x through an encoder where the two frictions are not both enough; see `QuantisedWall`.

    Over time the hold creates up to b_n v^2 per second, b_n the damping that makes K the limit of
    `guaranteed_wall_limit` (K T/2 without a delay), and rounding up to K Delta/2 |v|;
    frictions take b v^2 and f_c |v|. So no motion gains energy whose speed v, averaged over each stretch of held force,
    keeps to

        (b_n - b) v <= f_c - K Delta/2.

    With f_c > K Delta/2 and b too small: calm below a speed, and a kick beyond it may grow. With b enough and f_c too
    small: calm above a speed, and limit cycles under it that feel like buzzing. With neither: nothing is claimed.

    Args:
        stiffness: K [N/m].
        delay: t_d [s].
        damping, period, friction, resolution: as `quantised_wall_limit`.
    """
    _check(damping, period, friction, resolution, delay)
    number("stiffness", stiffness, "N/m", zero=False)
    p = delay / period - math.floor(delay / period)
    a = 0.5 + delay / period
    needed = stiffness * period * (a + math.sqrt(a * a + p * (1 - p))) / 2
    short, spare = needed - damping, friction - stiffness * resolution / 2
    viscous = damping / (stiffness * period)
    coulomb = friction / (stiffness * resolution) if resolution > 0.0 else math.inf
    if short <= 0.0 <= spare:
        return QuantisedWall(viscous, coulomb, True, math.inf, 0.0)
    below = spare / short if short > 0.0 and spare > 0.0 else 0.0
    above = spare / short if short < 0.0 and spare < 0.0 else math.inf
    return QuantisedWall(viscous, coulomb, False, below, above)


def _check(damping: float, period: float, friction: float, resolution: float, delay: float) -> None:
    number("period", period, "s", zero=False)
    arguments = {
        "damping": (damping, "N s/m"),
        "friction": (friction, "N"),
        "resolution": (resolution, "m"),
        "delay": (delay, "s"),
    }
    for name, (value, unit) in arguments.items():
        number(name, value, unit)


@dataclass(frozen=True, eq=False, repr=False)
class ZWidth(Carded):
    """The largest stiffness of a wall over its damping.

    Attributes:
        wall_damping: B, (k,) [N s/m].
        passive: the largest K that is passive to every operator, (k,) [N/m]; zero where B alone is not.
        stable: the largest K that is stable with the device let go of, (k,) [N/m], zero where none is; None without a
            mass.
    """

    wall_damping: FloatArray
    passive: FloatArray
    stable: FloatArray | None

    def plot(self, *, width: str = "screen") -> Any:
        """Draw the region; the figure is shown by a notebook, `.save(path)` writes it."""
        from graspfx.show.loop_figures import z_width

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

    Passive: `guaranteed_wall_limit`, safe for every operator. Stable: `gx.stability.wall_limit`, of the device that
    nobody holds, which takes its mass.

    Args:
        damping: b of the device [N s/m].
        period: T [s].
        mass: m of the device [kg]; without it there is no `stable`.
        delay: whole samples until the force acts.
        latency: besides, of reading and force, any time [s].
        wall_damping: B, rising [N s/m]; if None up to where no stiffness is passive or, with a mass, stable.

    Raises:
        InputError: naming the argument that cannot be.
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
        raise InputError("wall_damping", wall_damping, "rising numbers [N s/m]")
    late = delay * T + latency
    passive = np.array([guaranteed_wall_limit(b, T, wall_damping=each, delay=late) for each in B.tolist()])
    stable = None if mass is None else np.array([stable_limit(each) for each in B.tolist()])
    return ZWidth(B, passive, stable)


def _largest_damping(plant: Plant, stable_limit: Callable[[float], float]) -> float:
    """Find about where the wall's damping alone is not stable any more, by doubling and halving."""
    most = 1e3 * plant.mass / plant.period
    high = 1e-3 * max(plant.damping, 1e-3 * most)
    while stable_limit(high) > 0.0 and high < most:
        high *= 2.0
    low = 0.5 * high
    for _ in range(20):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if stable_limit(middle) > 0.0 else (low, middle)
    return float(high)
