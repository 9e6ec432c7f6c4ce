"""Choosing gains and devices: largest gains with a margin, least friction for wanted gains, integrators compared."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from graspfx.analysis.arguments import count, number
from graspfx.analysis.discrete import INTEGRATORS
from graspfx.analysis.maps.maps import external_limit_map, wall_limit_map
from graspfx.analysis.stability.limits import Limits
from graspfx.analysis.stability.one_gain import external_limit, external_limits, wall_limit

FloatArray = NDArray[np.float64]

DECADES = -6, 3  # of b T/m in which a friction is looked for
GRID = 361  # frictions looked at first, 40 to a decade
REFINED = 65, 6  # frictions between two neighbours, and how often: to 1e-12


@dataclass(frozen=True)
class Gains:
    """Stiffnesses [N/m]: k_ep, k_ip of the split, and k_p of the conventional method, their smaller limit."""

    external: float
    internal: float
    conventional: float


def largest_gains(
    mass: float,
    damping: float,
    period: float,
    object_mass: float,
    object_damping: float,
    *,
    margin: float = 2.0,
    fingers: int = 2,
    spring: float = 0.0,
    integrator: str = "exact",
    delay: int = 0,
    object_delay: int = 0,
    pushing: bool = True,
) -> Gains:
    """Find gains that may be `margin` times as large, and all smaller, before n fingers along one axis become unstable.

    k_ip is the wall's limit over the margin, k_ep that of the object of mass m_v/n. With `pushing`, k_ep is lowered
    until any s of the n fingers can push too: they see 1/[(1 - s/n)/k_ip + (s/n)/k_ep] and an object of mass m_v/s.

    Args:
        margin: above 1 leaves room.
        others: as in `stability.external_limit`.
    """
    room = number("margin", margin, "1", zero=False)
    n = count("fingers", fingers, 1)

    def largest(touching: int) -> float:
        limit = external_limit(
            mass,
            damping,
            period,
            object_mass,
            object_damping,
            fingers=touching,
            spring=spring,
            integrator=integrator,
            delay=delay,
            object_delay=object_delay,
        )
        return limit / room

    internal = wall_limit(mass, damping, period, spring=spring, delay=delay) / room
    external = largest(n)
    conventional = min(internal, external)
    for s in range(1, n) if pushing else ():
        gain = largest(s)
        softness = (1.0 / gain if gain > 0.0 else math.inf) - (1.0 - s / n) / internal if internal > 0.0 else math.inf
        if softness > 0.0:
            external = min(external, s / n / softness)
        conventional = min(conventional, gain)
    return Gains(external, internal, conventional)


def least_wall_friction(
    mass: float,
    period: float,
    stiffness: float,
    *,
    margin: float = 1.0,
    spring: float = 0.0,
    wall_damping: float = 0.0,
    delay: int = 0,
) -> float:
    """Find the least viscous friction b of a device whose wall is stable up to `margin` times a stiffness [N s/m].

    The first crossing on a logarithmic grid of b T/m from 1e-6 to 1e3, refined; inf if none is enough.
    """
    number("stiffness", stiffness, "N/m", zero=False)

    def limit(b: FloatArray) -> FloatArray:
        return wall_limit_map(mass, b, period, spring=spring, wall_damping=wall_damping, delay=delay)

    return _least(limit, margin * stiffness, mass / period)


def least_friction(
    mass: float,
    period: float,
    object_mass: float,
    object_damping: float,
    stiffness: float,
    *,
    margin: float = 1.0,
    fingers: int = 2,
    spring: float = 0.0,
    integrator: str = "exact",
    delay: int = 0,
    object_delay: int = 0,
    coupling_damping: float = 0.0,
) -> float:
    """Find the least b of devices that move an object stably with k_ep up to `margin` times a stiffness [N s/m].

    Found as in `least_wall_friction`; inf if no friction is enough: the object's own viscosity may be too small.
    """
    number("stiffness", stiffness, "N/m", zero=False)

    def limit(b: FloatArray) -> FloatArray:
        return external_limit_map(
            mass,
            b,
            period,
            object_mass,
            object_damping,
            fingers=fingers,
            spring=spring,
            integrator=integrator,
            delay=delay,
            object_delay=object_delay,
            coupling_damping=coupling_damping,
        )

    return _least(limit, margin * stiffness, mass / period)


def integrators_compared(
    mass: float,
    damping: float,
    period: float,
    object_mass: float,
    object_damping: float,
    *,
    fingers: int = 2,
    spring: float = 0.0,
    delay: int = 0,
) -> dict[str, Limits]:
    """Compare the limits of k_ep under every integrator of the object, by name."""
    return {
        name: external_limits(
            mass,
            damping,
            period,
            object_mass,
            object_damping,
            fingers=fingers,
            spring=spring,
            integrator=name,
            delay=delay,
        )
        for name in INTEGRATORS
    }


def _least(limit: Callable[[FloatArray], FloatArray], target: float, unit: float) -> float:
    """Find the least friction at which a limit reaches the target."""
    b = np.concatenate([[0.0], unit * np.logspace(*DECADES, GRID)])
    points, times = REFINED
    for _ in range(times):
        enough = limit(b) >= target
        if not enough.any():
            return math.inf
        i = int(np.argmax(enough))
        if i == 0:
            return float(b[0])
        b = np.linspace(b[i - 1], b[i], points)
    return float(b[int(np.argmax(limit(b) >= target))])
