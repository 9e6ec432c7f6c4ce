"""Equation (4) with its devices and object in plain numpy, by a user who knows that the fingers are attached."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import cos, sin, sqrt

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Springs:
    """Fingers on an object: what every program of a comparison is made from.

    Attributes:
        T: [s].
        anchors: (n, d) where the fingers are attached, in the object's frame, which is the world's at time zero [m].
        start: (n, d) of the fingers [m]; rest: (n, d) where their hands' springs pull them to [m].
        finger_mass: [kg]; finger_friction: [N s/m]; hand: stiffness [N/m].
        mass: of the object [kg]; inertia: of a cube, about any axis [kg m^2]; viscosity, rotational_viscosity.
        external, internal: kep, kip [N/m].
    """

    T: float
    anchors: FloatArray
    start: FloatArray
    rest: FloatArray
    finger_mass: float
    finger_friction: float
    hand: float
    mass: float
    inertia: float
    viscosity: float
    rotational_viscosity: float
    external: float
    internal: float

    @property
    def dimensions(self) -> int:
        return int(self.anchors.shape[1])


class PaperProgram:
    """Semi-implicit Euler for fingers and object by numpy, as a user would write it who cares for its speed.

    The fingers are attached, so that G, P and K of eq. (4) never change in the object's frame: one product gives all
    forces and the wrench there, another turns them into the world. Arrays are updated in place; the few numbers of the
    object are Python's, which are quicker than short arrays.
    """

    def __init__(self, springs: Springs) -> None:
        self.springs = g = springs
        n, d = g.anchors.shape
        G = grasp_matrix(g.anchors)
        P = np.linalg.pinv(G) @ G
        K = g.external * P + g.internal * (np.eye(n * d) - P)
        moments = np.zeros((3, n * d))  # about x, y and z, in the plane about z
        moments[3 - len(G[d:]) :] = G[d:]
        rows = [K, G[:d] @ K, (moments @ K)[-d:] if d > 1 else K[:0]]
        self._law = np.vstack(rows)  # forces (n d), then the resultant (d), then the moment's last d entries
        self._local, self._world = np.empty((len(self._law) // d, d)), np.empty((len(self._law) // d, d))
        self._e, self._step, self._turned = np.empty((n, d)), np.empty((n, d)), np.empty((n, d))
        self._flat_e, self._flat_local = self._e.reshape(-1), self._local.reshape(-1)
        self._decay = 1.0 - g.T * g.finger_friction / g.finger_mass
        self._pull = g.T * g.hand / g.finger_mass
        self._rest = self._pull * g.rest
        self._push = g.T / g.finger_mass
        self.reset()

    def reset(self) -> None:
        g = self.springs
        n, d = g.anchors.shape
        self.fingers, self.finger_velocities = g.start.copy(), np.zeros((n, d))
        self.position, self._velocity = np.zeros(d), [0.0] * d
        self._place = [0.0] * d
        self._angle, self._turn = 0.0, (0.0, 0.0, 0.0, 1.0)
        self._spin = (0.0, 0.0, 0.0)
        self._rotation, self._back = np.eye(d), np.eye(d)  # R and R'

    def tick(self) -> None:
        g, x, v, e, step = self.springs, self.fingers, self.finger_velocities, self._e, self._step
        n, d = x.shape
        np.subtract(x, self.position, out=step)
        np.matmul(step, self._rotation, out=e)  # in the object's frame: (x - p) R - a
        e -= g.anchors
        self._law.dot(self._flat_e, out=self._flat_local)
        world = np.matmul(self._local, self._back, out=self._world)
        v *= self._decay
        v += self._rest
        v -= np.multiply(x, self._pull, out=step)
        v -= np.multiply(world[:n], self._push, out=step)
        x += np.multiply(v, g.T, out=step)
        moments = self._local if d == 2 else world  # in the plane a moment does not turn with the object
        self._advance(world[n].tolist(), moments[n + 1].tolist() if d > 1 else ())

    def _advance(self, force: list[float], moment: Sequence[float]) -> None:
        """Advance the object by a period: velocity, then place; spin, then turn."""
        g, T = self.springs, self.springs.T
        for a, f in enumerate(force):
            self._velocity[a] += T * (f - g.viscosity * self._velocity[a]) / g.mass
            self._place[a] += T * self._velocity[a]
        self.position[:] = self._place
        if len(force) == 2:
            spin = self._spin[2] + T * (moment[1] - g.rotational_viscosity * self._spin[2]) / g.inertia
            self._spin = (0.0, 0.0, spin)
            self._angle += T * spin
            c, s = cos(self._angle), sin(self._angle)
            self._back[:] = (c, s), (-s, c)
            self._rotation[:] = (c, -s), (s, c)
        elif len(force) == 3:
            decay, push = 1.0 - T * g.rotational_viscosity / g.inertia, T / g.inertia
            p, q, r = (decay * w + push * m for w, m in zip(self._spin, moment, strict=True))
            self._spin = p, q, r
            x, y, z, w = self._turn
            h = 0.5 * T
            x, y, z, w = (
                x + h * (p * w + q * z - r * y),
                y + h * (q * w + r * x - p * z),
                z + h * (r * w + p * y - q * x),
                w - h * (p * x + q * y + r * z),
            )
            size = 1.0 / sqrt(x * x + y * y + z * z + w * w)
            self._turn = x, y, z, w = x * size, y * size, z * size, w * size
            self._rotation[:] = (
                (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)),
                (2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)),
                (2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)),
            )
            self._back[:] = self._rotation.T

    @property
    def forces(self) -> FloatArray:
        """Forces (n, d) on the object in the last tick [N]."""
        return self._world[: len(self.fingers)]

    def rotation(self) -> FloatArray:
        return self._rotation.copy()


def coupling(
    g: Springs, fingers: FloatArray, position: FloatArray, rotation: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Compute forces (n, d) on the object by equation (4) without damping, and their wrench."""
    n, d = g.anchors.shape
    arms = g.anchors @ rotation.T
    G = grasp_matrix(arms)
    external = np.linalg.pinv(G) @ G
    internal = np.eye(n * d) - external
    K = g.external * external + g.internal * internal
    e = (fingers - position - arms).ravel()
    f = K @ e
    return f.reshape(n, d), G @ f


def grasp_matrix(arms: FloatArray) -> FloatArray:
    """Form (w, n d) of hard fingers: forces add up, moments are arm x force."""
    n, d = arms.shape
    forces = np.hstack([np.eye(d)] * n)
    if d == 1:
        return forces
    if d == 2:
        moments = np.hstack([[[-y, x]] for x, y in arms])
    else:
        moments = np.hstack([np.cross(arm, np.eye(3)).T for arm in arms])
    return np.block([[forces], [moments]])


def rotation_matrix(d: int, angle: float, quaternion: Sequence[float] | FloatArray) -> FloatArray:
    if d == 1:
        return np.eye(1)
    if d == 2:
        return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    x, y, z, w = quaternion
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
