"""Walls seen through an encoder: what Coulomb friction pays of the energy that steps of position create."""

from __future__ import annotations

import math
from dataclasses import dataclass

from graspfx.analysis.arguments import number


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
    `graspfx.analysis.passivity.guaranteed_wall_limit` (K T/2 without a delay), and rounding up to K Delta/2 |v|;
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
