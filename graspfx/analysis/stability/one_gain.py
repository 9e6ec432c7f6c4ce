"""Exact limits of one gain of a sampled coupling: walls, and objects that fingers move; the modes of a grasp."""

from __future__ import annotations

from typing import Unpack

from graspfx.analysis.arguments import number
from graspfx.analysis.blas_threads import one_blas_thread
from graspfx.analysis.linearisation import Subject, linear_of
from graspfx.analysis.sampled_plant import ObjectOptions, plant_on_wall, plant_with_object
from graspfx.analysis.stability.fullloop import radius_of
from graspfx.analysis.stability.limits import Limits, limits_of
from graspfx.analysis.stability.modal import Mode
from graspfx.analysis.stability.modal import modes as modes_of


def wall_limit(
    mass: float,
    damping: float,
    period: float,
    *,
    spring: float = 0.0,
    wall_damping: float = 0.0,
    delay: int = 0,
    spring_damping: float = 0.0,
    latency: float = 0.0,
) -> float:
    """Find the first loss of stability of a wall as its stiffness grows from zero [N/m], inf where there is none.

        m x'' + (b + b_s) x' + k_s x = -f,    f = k x_j + B (x_j - x_(j-1))/T,    f held over T, `delay` samples late

    It is the limit of k_ip for every internal motion of a grasp with such devices. Without spring, damping and delay it
    is min{(1 - E)/b0, 2 (1 + E)/(b1 - b0) if b1 > b0}, p = b/m, E = exp(-p T), b1 = (T - (1 - E)/p)/b,
    b0 = ((1 - E)/p - T E)/b.

    Args:
        mass: m of the device [kg].
        damping: b, its viscous damping [N s/m].
        period: T [s].
        spring: k_s, between the device and the ground, as the operator's finger is [N/m].
        wall_damping: B [N s/m], on the backward difference of the position, as `simulated` devices without encoders
            report velocity; a negative one is allowed.
        delay: of the displayed force, whole samples.
        spring_damping: b_s, the operator's [N s/m].
        latency: besides, from the motion to its reading and from there to the force, any time [s]: a delay of
            (n + phi) T acts on the held force within a sample, exactly.

    Raises:
        InputError: naming the argument that cannot be.
    """
    return wall_limits(
        mass,
        damping,
        period,
        spring=spring,
        wall_damping=wall_damping,
        delay=delay,
        spring_damping=spring_damping,
        latency=latency,
    ).limit


def wall_limits(
    mass: float,
    damping: float,
    period: float,
    *,
    spring: float = 0.0,
    wall_damping: float = 0.0,
    delay: int = 0,
    spring_damping: float = 0.0,
    latency: float = 0.0,
) -> Limits:
    """Find all stable stiffnesses of a wall; the arguments are those of `wall_limit`."""
    plant = plant_on_wall(number, mass, damping, period, spring, wall_damping, delay, spring_damping, latency)
    return limits_of(*plant.polynomials(), plant.unit, plant.period)


def external_limit(
    mass: float,
    damping: float,
    period: float,
    object_mass: float,
    object_damping: float,
    *,
    fingers: int = 2,
    spring: float = 0.0,
    integrator: str = "exact",
    delay: int = 0,
    object_delay: int = 0,
    coupling_damping: float = 0.0,
    spring_damping: float = 0.0,
    latency: float = 0.0,
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
        fingers: n.
        spring: k_s between each device and the ground, as the operator's finger is [N/m]. Without one, the motion of
            devices and object together is left out: no force depends on it.
        integrator: of the object.
        delay: of the displayed force, whole samples.
        object_delay: of the force on the object, whole samples; none under "implicit".
        coupling_damping: B [N s/m].
        spring_damping: b_s [N s/m].
        latency: of each device besides, from the motion to its reading and from there to the force, any time [s].

    Raises:
        InputError: naming the argument that cannot be; UnknownNameError: for the integrator.
    """
    return external_limits(
        mass,
        damping,
        period,
        object_mass,
        object_damping,
        fingers=fingers,
        spring=spring,
        integrator=integrator,
        delay=delay,
        object_delay=object_delay,
        coupling_damping=coupling_damping,
        spring_damping=spring_damping,
        latency=latency,
    ).limit


def external_limits(
    mass: float,
    damping: float,
    period: float,
    object_mass: float,
    object_damping: float,
    **options: Unpack[ObjectOptions],
) -> Limits:
    """Find all stable k_ep of fingers that move an object; the arguments are those of `external_limit`."""
    plant = plant_with_object(number, mass, damping, period, object_mass, object_damping, **options)
    return limits_of(*plant.polynomials(), plant.unit, plant.period)


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


@one_blas_thread()
def spectral_radius(linear: Subject, recording: object = None, *, drift: bool = False) -> float:
    """Find the largest |z| of the sampled closed loop about a grasp at rest; below 1 it is stable.

    Args:
        linear: a `Linearisation`, a scene, or the name or path of one.
        recording: of the scene, or its path: the loop is that at the rest that it ended with, and of hardware with the
            forces as late as they came in it, the worse end of 98 % of the samples.
        drift: count motions of fingers and object together that change no force (no operator's spring), too.
    """
    return radius_of(linear_of(linear, recording), drift=drift)


def modes(linear: Subject) -> list[Mode]:
    """List the internal and external modes of a grasp of equal devices at zero preload (`analysis.stability.modal`).

    Args:
        linear: a `Linearisation`, a scene, or the name or path of one.
    """
    return modes_of(linear_of(linear))
