"""The paper's 1-DOF system for many variants at once, as arrays of numpy: an entry per variant, a loop over ticks."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class OneDof:
    """A system that all variants share: two devices m x'' + b x' + k x = u (eq. 5), and an internal stiffness.

    Attributes:
        T: [s].
        start: of the two fingers [m]; their hands rest at zero.
        device_mass: [kg]; friction: [N s/m]; hand: stiffness of the springs that hold them [N/m].
        internal: kip [N/m].
    """

    T: float
    start: tuple[float, float]
    device_mass: float
    friction: float
    hand: float
    internal: float


def last_positions(
    system: OneDof, external: FloatArray, viscosity: FloatArray, mass: FloatArray, ticks: int
) -> FloatArray:
    """Compute where the fingers and the object are at the last tick, (V, 3) [m], by eqs. (4)-(12).

    Args:
        system: what all variants share.
        external: kep [N/m], (V,).
        viscosity: of the object [N s/m], (V,).
        mass: of the object [kg], (V,).
        ticks: of which the last one's positions are asked for.
    """
    V = len(external)
    A, B = device_step(system)
    E = np.exp(-viscosity / mass * system.T)
    travel = (1.0 - E) * mass / viscosity
    drift, kick = 2.0 * external * (system.T - travel) / viscosity, 2.0 * external * travel / mass
    difference = external - system.internal
    q, v = np.repeat(np.array(system.start)[:, None], V, axis=1), np.zeros((2, V))
    x, speed, mean, y = (np.zeros(V) for _ in range(4))
    e, f, z = (np.empty((2, V)) for _ in range(3))
    a, b, c, d = A.ravel().tolist()
    to_place, to_speed = B.tolist()
    for _ in range(ticks - 1):
        np.subtract(q, x, out=e)
        np.add(e[0], e[1], out=mean)
        mean *= 0.5
        np.multiply(e, system.internal, out=f)
        f += np.multiply(difference, mean, out=y)
        x += np.multiply(travel, speed, out=y)  # the fingers' forces add up to 2 kep times their mean displacement
        x += np.multiply(drift, mean, out=y)
        speed *= E
        speed += np.multiply(kick, mean, out=y)
        np.multiply(q, c, out=z)
        q *= a
        q += np.multiply(v, b, out=e)
        q -= np.multiply(f, to_place, out=e)
        v *= d
        v += z
        v -= np.multiply(f, to_speed, out=e)
    return np.stack([*q, x], axis=1)


def device_step(system: OneDof) -> tuple[FloatArray, FloatArray]:
    """Compute A and B of a device over a period, its force constant."""
    from scipy.linalg import expm

    m, b, k = system.device_mass, system.friction, system.hand
    E = np.asarray(expm(np.array([[0.0, 1.0, 0.0], [-k / m, -b / m, 1.0 / m], [0.0, 0.0, 0.0]]) * system.T))
    return E[:2, :2], E[:2, 2]


def one_dof(scene: Any) -> OneDof:
    """Read what all variants share from the scene `reference-1dof`."""
    finger = scene.finger[0]
    first, second = (float(each.start[0]) for each in scene.finger)
    return OneDof(
        T=scene.period,
        start=(first, second),
        device_mass=finger.device.settings["mass"],
        friction=finger.device.settings["damping"],
        hand=float(np.asarray(finger.hand.stiffness)),
        internal=float(np.asarray(scene.coupling.internal.stiffness)),
    )
