"""Exact limits of one gain: of walls, of objects that fingers move, over arrays of parameters, and for a design."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any, Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspfx.analysis.arguments import count, number, numbers
from graspfx.analysis.critical import Limits, is_stable
from graspfx.analysis.discrete import INTEGRATORS
from graspfx.analysis.plant import BLOCK, ObjectOptions, Plant, WallOptions

FloatArray = NDArray[np.float64]

DECADES = -6, 3  # of b T/m in which a friction is looked for
GRID = 361  # frictions looked at first, 40 to a decade
REFINED = 65, 6  # frictions between two neighbours, and how often: to 1e-12


def _on_wall(mass: ArrayLike, damping: ArrayLike, period: ArrayLike, wall_damping: Any = 0.0, **options: Any) -> Plant:
    return Plant(mass, damping, period, coupling_damping=wall_damping, **options)


def _with_object(
    mass: ArrayLike, damping: ArrayLike, period: ArrayLike, object_mass: ArrayLike, object_damping: ArrayLike,
    **options: Any,
) -> Plant:  # fmt: skip
    things = {"object_mass": object_mass, "object_damping": object_damping, "fingers": 2}
    return Plant(mass, damping, period, **(things | options))


def wall_limit(mass: float, damping: float, period: float, **options: Unpack[WallOptions]) -> float:
    """Find the first loss of stability of a wall as its stiffness grows from zero [N/m], inf where there is none.

        m x'' + (b + b_s) x' + k_s x = -f,    f = k x_j + B (x_j - x_(j-1))/T,    f held over T, `delay` samples late

    It is the limit of k_ip for every internal motion of a grasp with such devices. Without spring, damping and delay it
    is min{(1 - E)/b0, 2 (1 + E)/(b1 - b0) if b1 > b0}, p = b/m, E = exp(-p T), b1 = (T - (1 - E)/p)/b,
    b0 = ((1 - E)/p - T E)/b.

    Args:
        mass: m of the device [kg].
        damping: b, its viscous damping [N s/m].
        period: T [s].
        spring: k_s, between the device and the ground, as the operator's finger is [N/m]; 0 if not given.
        wall_damping: B [N s/m], on the backward difference of the position, as `simulated` devices without encoders
            report velocity; a negative one is allowed. 0 if not given.
        delay: of the displayed force, whole samples; 0 if not given.
        spring_damping: b_s, the operator's [N s/m]; 0 if not given.
        latency: besides, from the motion to its reading and from there to the force, any time [s]: a delay of
            (n + phi) T acts on the held force within a sample, exactly. 0 if not given.

    Raises:
        InputError: naming the argument that cannot be.
    """
    return wall_limits(mass, damping, period, **options).limit


def wall_limits(mass: float, damping: float, period: float, **options: Unpack[WallOptions]) -> Limits:
    """Find all stable stiffnesses of a wall; the arguments are those of `wall_limit`."""
    return _on_wall(mass, damping, period, **options).checked(single=True).limits()


def wall_limit_map(
    mass: ArrayLike, damping: ArrayLike, period: ArrayLike, **options: Unpack[WallOptions]
) -> FloatArray:
    """Compute `wall_limit` for arrays of parameters that broadcast against one another, in their common shape."""
    return _on_wall(mass, damping, period, **options).checked().limit_map()


def external_limit(
    mass: float,
    damping: float,
    period: float,
    object_mass: float,
    object_damping: float,
    **options: Unpack[ObjectOptions],
) -> float:
    """Find the first loss of stability of fingers that move an object as k_ep grows from zero [N/m], inf without one.

    n equal fingers along one axis are one device of mass m coupled to an object of mass m_v/n and viscosity b_v/n:

        m x'' + (b + b_s) x' + k_s x = -f,    m_v/n x_v'' + b_v/n x_v' = f
        f = k (x - x_v) + B ((x_j - x_(j-1))/T - x_v')

    The object moves by one of the integrators of `INTEGRATORS`; "implicit" solves the force together with the object's
    new state, "bullet" is PyBullet's with exact viscosity. B acts on the backward difference of the device's position
    and on the object's own velocity, as in a run with `simulated` devices without encoders.

    Args:
        mass: m of a device [kg].
        damping: b, its viscous damping [N s/m].
        period: T [s].
        object_mass: m_v [kg].
        object_damping: b_v [N s/m].
        fingers: n; 2 if not given.
        spring: k_s between each device and the ground, as the operator's finger is [N/m]; 0 if not given. Without one,
            the motion of devices and object together is left out: no force depends on it.
        integrator: of the object; "exact" if not given.
        delay: of the displayed force, whole samples; 0 if not given.
        object_delay: of the force on the object, whole samples, none under "implicit"; 0 if not given.
        coupling_damping: B [N s/m]; 0 if not given.
        spring_damping: b_s [N s/m]; 0 if not given.
        latency: of each device besides, from the motion to its reading and from there to the force, any time [s]; 0 if
            not given.

    Raises:
        InputError: naming the argument that cannot be; UnknownNameError: for the integrator.
    """
    return external_limits(mass, damping, period, object_mass, object_damping, **options).limit


def external_limits(
    mass: float,
    damping: float,
    period: float,
    object_mass: float,
    object_damping: float,
    **options: Unpack[ObjectOptions],
) -> Limits:
    """Find all stable k_ep of fingers that move an object; the arguments are those of `external_limit`."""
    return _with_object(mass, damping, period, object_mass, object_damping, **options).checked(single=True).limits()


def external_limit_map(
    mass: ArrayLike,
    damping: ArrayLike,
    period: ArrayLike,
    object_mass: ArrayLike,
    object_damping: ArrayLike,
    **options: Unpack[ObjectOptions],
) -> FloatArray:
    """Compute `external_limit` for arrays of parameters that broadcast against one another, in their common shape."""
    return _with_object(mass, damping, period, object_mass, object_damping, **options).checked().limit_map()


def external_limit_blocks(
    mass: ArrayLike,
    damping: ArrayLike,
    period: ArrayLike,
    object_mass: ArrayLike,
    object_damping: ArrayLike,
    **options: Unpack[ObjectOptions],
) -> Iterator[tuple[int, FloatArray]]:
    """Compute `external_limit_map` a block at a time, as (first index, values) in the order of the flat array.

    Whatever the number of points, only one block is held: parameters that broadcast are not spread out.
    """
    return _with_object(mass, damping, period, object_mass, object_damping, **options).checked().limit_blocks()


def external_stable_map(
    gain: ArrayLike,
    mass: ArrayLike,
    damping: ArrayLike,
    period: ArrayLike,
    object_mass: ArrayLike,
    object_damping: ArrayLike,
    **options: Unpack[ObjectOptions],
) -> NDArray[np.bool_]:
    """Tell whether given k_ep [N/m] are stable: Jury's conditions, by Routh's array in w = (z - 1)/(z + 1)."""
    plant = _with_object(mass, damping, period, object_mass, object_damping, **options).checked()
    plant = replace(plant, gain=numbers("gain", gain, "N/m"))
    stable = np.empty(plant.shape, dtype=bool)
    flat = stable.reshape(-1)
    for start, block in plant.blocks():
        flat[start : start + BLOCK] = is_stable(*block.polynomials(), block.gain).ravel()
    return stable


def stable_intervals(
    mass: float,
    damping: float,
    period: float,
    object_mass: float,
    object_damping: float,
    *,
    upper: float = 1e4,
    **options: Unpack[ObjectOptions],
) -> list[tuple[float, float]]:
    """List the intervals of stable k_ep up to `upper` [N/m]; the other arguments are those of `external_limit`.

    There can be several: more stiffness may stabilise again what less has made unstable.
    """
    limits = external_limits(mass, damping, period, object_mass, object_damping, **options)
    top = number("upper", upper, "N/m", zero=False)
    return [(low, min(high, top)) for low, high in limits.intervals if low < top]


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
    pushing: bool = True,
    **options: Any,
) -> Gains:
    """Find gains that may be `margin` times as large, and all smaller, before n fingers along one axis become unstable.

    k_ip is the wall's limit over the margin, k_ep that of the object of mass m_v/n. With `pushing`, k_ep is lowered
    until any s of the n fingers can push too: they see 1/[(1 - s/n)/k_ip + (s/n)/k_ep] and an object of mass m_v/s.

    Args:
        margin: above 1 leaves room.
        options: `spring`, `integrator`, `delay` and `object_delay`, and the others, as in `stability.external_limit`.
    """
    room = number("margin", margin, "1", zero=False)
    n = count("fingers", fingers, 1)
    moving = _with_object(mass, damping, period, object_mass, object_damping, **options).checked(single=True)

    def largest(touching: int) -> float:
        return replace(moving, fingers=touching).limits().limit / room

    internal = replace(moving, object_mass=None, object_delay=0, coupling_damping=0.0).limits().limit / room
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
    mass: float, period: float, stiffness: float, *, margin: float = 1.0, **options: Unpack[WallOptions]
) -> float:
    """Find the least viscous friction b of a device whose wall is stable up to `margin` times a stiffness [N s/m].

    The first crossing on a logarithmic grid of b T/m from 1e-6 to 1e3, refined; inf if none is enough.
    """
    number("stiffness", stiffness, "N/m", zero=False)
    return _least(lambda b: wall_limit_map(mass, b, period, **options), margin * stiffness, mass / period)


def least_friction(
    mass: float,
    period: float,
    object_mass: float,
    object_damping: float,
    stiffness: float,
    *,
    margin: float = 1.0,
    **options: Unpack[ObjectOptions],
) -> float:
    """Find the least b of devices that move an object stably with k_ep up to `margin` times a stiffness [N s/m].

    Found as in `least_wall_friction`; inf if no friction is enough: the object's own viscosity may be too small.
    """
    number("stiffness", stiffness, "N/m", zero=False)

    def limit(b: FloatArray) -> FloatArray:
        return external_limit_map(mass, b, period, object_mass, object_damping, **options)

    return _least(limit, margin * stiffness, mass / period)


def integrators_compared(
    mass: float,
    damping: float,
    period: float,
    object_mass: float,
    object_damping: float,
    **options: Any,
) -> dict[str, Limits]:
    """Compare the limits of k_ep under every integrator of the object, by name; arguments as in `external_limit`."""
    plant = _with_object(mass, damping, period, object_mass, object_damping, **options)
    return {name: replace(plant, integrator=name).checked(single=True).limits() for name in INTEGRATORS}


def _least(limit: Callable[[FloatArray], FloatArray], target: float, unit: float) -> float:
    """Find the least friction at which a limit reaches the target."""
    b = np.concatenate([[0.0], unit * np.logspace(*DECADES, GRID)])
    points, repetitions = REFINED
    for _ in range(repetitions):
        enough = limit(b) >= target
        if not enough.any():
            return math.inf
        i = int(np.argmax(enough))
        if i == 0:
            return float(b[0])
        b = np.linspace(b[i - 1], b[i], points)
    return float(b[int(np.argmax(limit(b) >= target))])
