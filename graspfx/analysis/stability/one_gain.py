"""Exact stability limits of walls and of fingers that move an object, and gains and dampings designed from them."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any, Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspfx.analysis.checked_arguments import number, numbers
from graspfx.analysis.critical import Limits, is_stable
from graspfx.analysis.discrete import INTEGRATORS
from graspfx.analysis.sampled_plant import BLOCK, ObjectOptions, Plant, WallOptions
from graspfx.numeric import count

FloatArray = NDArray[np.float64]

DECADES = -6, 3  # range of log10(b T/m) in which a friction is searched
GRID = 361  # number of frictions of the first grid, 40 per decade
REFINED = 65, 6  # number of frictions between two neighbours, and of refinements, to a relative width of 1e-12


def _on_wall(mass: ArrayLike, damping: ArrayLike, period: ArrayLike, wall_damping: Any = 0.0, **options: Any) -> Plant:
    return Plant(mass, damping, period, coupling_damping=wall_damping, **options)


def _with_object(
    mass: ArrayLike, damping: ArrayLike, period: ArrayLike, object_mass: ArrayLike, object_damping: ArrayLike,
    **options: Any,
) -> Plant:  # fmt: skip
    things = {"object_mass": object_mass, "object_damping": object_damping, "fingers": 2}
    return Plant(mass, damping, period, **(things | options))


def wall_limit(mass: float, damping: float, period: float, **options: Unpack[WallOptions]) -> float:
    """Compute the smallest stiffness k at which a device on a wall is unstable [N/m]; inf if every k is stable.

        m x'' + (b + b_s) x' + k_s x = -f,    f = k x_j + B (x_j - x_(j-1))/T

    The wall's force f is computed from the positions x_j in samples j, held over T, and displayed `delay` samples late.
    The result is also the limit of k_ip for every internal motion of a grasp with such devices. If k_s, B, b_s and all
    delays are zero, the limit is min{(1 - E)/b0, 2 (1 + E)/(b1 - b0) if b1 > b0}, with p = b/m, E = exp(-p T), b1 = (T
    - (1 - E)/p)/b and b0 = ((1 - E)/p - T E)/b.

    Args:
        mass: Mass m of the device [kg].
        damping: Viscous damping b of the device [N s/m].
        period: Sampling period T [s].
        spring: Stiffness k_s between device and ground, for example of the operator's finger [N/m]; 0 if not given.
        wall_damping: Damping B of the wall [N s/m], which may be negative; 0 if not given. It acts on the backward
            difference of the position, which `simulated` devices without encoders report as velocity.
        delay: Delay of the displayed force, in whole samples; 0 if not given.
        spring_damping: Damping b_s of the operator [N s/m]; 0 if not given.
        latency: Sum of the additional delays from the motion to its reading and from the reading to the force [s],
            which need not be a whole number of samples; 0 if not given.

    Raises:
        InputError: If an argument is invalid; the message names the argument.
    """
    return wall_limits(mass, damping, period, **options).limit


def wall_limits(mass: float, damping: float, period: float, **options: Unpack[WallOptions]) -> Limits:
    """Compute all stable stiffnesses of a wall; arguments are as for `wall_limit`."""
    return _on_wall(mass, damping, period, **options).checked(single=True).limits()


def wall_limit_map(
    mass: ArrayLike, damping: ArrayLike, period: ArrayLike, **options: Unpack[WallOptions]
) -> FloatArray:
    """Compute `wall_limit` for parameters that are arrays; the result has the shape to which they broadcast."""
    return _on_wall(mass, damping, period, **options).checked().limit_map()


def external_limit(
    mass: float,
    damping: float,
    period: float,
    object_mass: float,
    object_damping: float,
    **options: Unpack[ObjectOptions],
) -> float:
    """Compute the smallest stiffness k_ep at which fingers that move an object are unstable [N/m]; inf if none is.

    n equal fingers along one axis are equivalent to one device of mass m and an object of mass m_v/n and viscosity
    b_v/n. With the device's position x, the object's position x_v and k = k_ep,

        m x'' + (b + b_s) x' + k_s x = -f,    m_v/n x_v'' + b_v/n x_v' = f
        f = k (x - x_v) + B ((x_j - x_(j-1))/T - x_v')

    where f is held over each sample j. The integrator of the object is one of `INTEGRATORS`: "implicit" solves for the
    force together with the object's new state, and "bullet" is PyBullet's integrator with exact viscosity. B acts on
    the backward difference of the device's position and on the velocity state of the object, as in a run with
    `simulated` devices without encoders.

    Args:
        mass: Mass m of a device [kg].
        damping: Viscous damping b of a device [N s/m].
        period: Sampling period T [s].
        object_mass: Mass m_v of the object [kg].
        object_damping: Viscosity b_v of the object [N s/m].
        fingers: Number n of fingers; 2 if not given.
        spring: Stiffness k_s between each device and ground, for example of the operator's finger [N/m]; 0 if not
            given. If it is 0, the common motion of devices and object is excluded, because no force depends on this
            motion.
        integrator: Integrator of the object; "exact" if not given.
        delay: Delay of the displayed force, in whole samples; 0 if not given.
        object_delay: Delay of the force on the object, in whole samples; 0 if not given, and always 0 for "implicit".
        coupling_damping: Damping B of the coupling [N s/m]; 0 if not given.
        spring_damping: Damping b_s of the operator [N s/m]; 0 if not given.
        latency: Sum of the additional delays of each device, from the motion to its reading and from the reading to the
            force [s]; 0 if not given.

    Raises:
        InputError: If an argument is invalid; the message names the argument.
        UnknownNameError: If the integrator is unknown.
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
    """Compute all stable k_ep of fingers that move an object; arguments are as for `external_limit`."""
    return _with_object(mass, damping, period, object_mass, object_damping, **options).checked(single=True).limits()


def external_limit_map(
    mass: ArrayLike,
    damping: ArrayLike,
    period: ArrayLike,
    object_mass: ArrayLike,
    object_damping: ArrayLike,
    **options: Unpack[ObjectOptions],
) -> FloatArray:
    """Compute `external_limit` for parameters that are arrays; the result has the shape to which they broadcast."""
    return _with_object(mass, damping, period, object_mass, object_damping, **options).checked().limit_map()


def external_limit_blocks(
    mass: ArrayLike,
    damping: ArrayLike,
    period: ArrayLike,
    object_mass: ArrayLike,
    object_damping: ArrayLike,
    **options: Unpack[ObjectOptions],
) -> Iterator[tuple[int, FloatArray]]:
    """Yield the values of `external_limit_map` in blocks, each with the index of its first value in the flattened map.

    Only one block is held in memory, and parameters are not broadcast to the shape of the map.
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
    """Test whether stiffnesses k_ep = `gain` [N/m] are stable; other arguments are as for `external_limit_map`.

    Jury's conditions are evaluated as Routh's array in w = (z - 1)/(z + 1).
    """
    plant = _with_object(mass, damping, period, object_mass, object_damping, **options).checked()
    plant = replace(plant, gain=numbers("gain", gain, "N/m"))
    stable = np.empty(plant.shape, dtype=bool)
    flat = stable.reshape(-1)
    for start, block in plant.blocks():
        D, N = block.polynomials()
        if D.ndim == 1:  # all parameters but the gain are numbers
            D, N = D[:, None], N[:, None]
        flat[start : start + BLOCK] = is_stable(D, N, block.gain).ravel()
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
    """List the intervals of stable k_ep up to `upper` [N/m]; other arguments are as for `external_limit`.

    There may be several intervals, because a stiffness above an unstable one may be stable.
    """
    limits = external_limits(mass, damping, period, object_mass, object_damping, **options)
    top = number("upper", upper, "N/m", zero=False)
    return [(low, min(high, top)) for low, high in limits.intervals if low < top]


@dataclass(frozen=True)
class Gains:
    """Stiffnesses of the coupling [N/m].

    Attributes:
        external: Stiffness k_ep for external forces.
        internal: Stiffness k_ip for internal forces.
        conventional: Single stiffness k_p of the conventional method, which does not divide forces.
    """

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
    """Compute the largest gains of n fingers along one axis that remain stable if multiplied by `margin`.

    k_ip is the limit of a wall without damping divided by `margin`, k_ep is `external_limit` divided by `margin`, and
    k_p is the smaller one of k_ip and k_ep. If `pushing` is True, k_ep and k_p are reduced until the object can also be
    pushed by any s < n of the fingers alone. Each of these fingers has the stiffness 1/[(1 - s/n)/k_ip + (s/n)/k_ep],
    and each finger moves the mass m_v/s.

    Args:
        mass, damping, period, object_mass, object_damping: As for `external_limit`.
        margin: Safety factor, above 0; if it is 1, the gains are equal to the limits.
        fingers: Number n of fingers.
        pushing: Whether fewer than n fingers may push the object.
        options: Options of `external_limit`, such as `spring`, `integrator`, `delay` and `object_delay`.
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
    """Compute the smallest damping b of a device for which `wall_limit` is at least `margin * stiffness` [N s/m].

    The limit is computed for b = 0 and for b T/m on a logarithmic grid from 1e-6 to 1e3, with mass m and period T. The
    first interval in which the limit reaches this value is refined. The result is inf if no damping is sufficient.
    """
    target, unit = _search(mass, period, stiffness, margin)
    return _least(lambda b: wall_limit_map(mass, b, period, **options), target, unit)


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
    """Compute the smallest damping b of devices for which `external_limit` is at least `margin * stiffness` [N s/m].

    The search is that of `least_wall_friction`. The result is inf if no damping is sufficient, for example because the
    object's viscosity is too small.
    """
    target, unit = _search(mass, period, stiffness, margin)

    def limit(b: FloatArray) -> FloatArray:
        return external_limit_map(mass, b, period, object_mass, object_damping, **options)

    return _least(limit, target, unit)


def integrators_compared(
    mass: float,
    damping: float,
    period: float,
    object_mass: float,
    object_damping: float,
    **options: Any,
) -> dict[str, Limits]:
    """Compute `external_limits` for every integrator of the object, by name of the integrator."""
    plant = _with_object(mass, damping, period, object_mass, object_damping, **options)
    return {name: replace(plant, integrator=name).checked(single=True).limits() for name in INTEGRATORS}


def _search(mass: float, period: float, stiffness: float, margin: float) -> tuple[float, float]:
    """Check the arguments of a search; return its target, the stiffness times the margin, and the unit of friction."""
    target = number("stiffness", stiffness, "N/m", zero=False) * number("margin", margin, "1", zero=False)
    return target, number("mass", mass, "kg", zero=False) / number("period", period, "s", zero=False)


def _least(limit: Callable[[FloatArray], FloatArray], target: float, unit: float) -> float:
    """Find the smallest damping at which `limit` reaches `target`; `unit` is mass over period [N s/m]."""
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
