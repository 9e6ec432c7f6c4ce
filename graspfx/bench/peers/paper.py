"""Equation (4) and its devices and object as a reader of the paper would write them: plain numpy."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

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
    """Semi-implicit Euler for fingers and object, the pseudoinverse of the grasp matrix in every tick."""

    def __init__(self, given: Springs) -> None:
        self.given = given
        self.reset()

    def reset(self) -> None:
        g = self.given
        n, d = g.anchors.shape
        self.fingers, self.finger_velocities = g.start.copy(), np.zeros((n, d))
        self.position, self.velocity = np.zeros(d), np.zeros(d)
        self.angle, self.quaternion = 0.0, np.array([0.0, 0.0, 0.0, 1.0])
        self.spin = np.zeros({1: 0, 2: 1, 3: 3}[d])

    def tick(self) -> None:
        g, T = self.given, self.given.T
        d = g.dimensions
        forces, wrench = coupling(g, self.fingers, self.position, self.rotation())
        pulls = g.hand * (g.rest - self.fingers) - g.finger_friction * self.finger_velocities - forces
        self.finger_velocities = self.finger_velocities + T * pulls / g.finger_mass
        self.fingers = self.fingers + T * self.finger_velocities
        self.velocity = self.velocity + T * (wrench[:d] - g.viscosity * self.velocity) / g.mass
        self.position = self.position + T * self.velocity
        self.spin = self.spin + T * (wrench[d:] - g.rotational_viscosity * self.spin) / g.inertia
        if d == 2:
            self.angle += T * self.spin[0]
        if d == 3:
            w = np.append(self.spin, 0.0)
            self.quaternion = self.quaternion + 0.5 * T * quaternion_product(w, self.quaternion)
            self.quaternion = self.quaternion / np.linalg.norm(self.quaternion)

    def rotation(self) -> FloatArray:
        return rotation_matrix(self.given.dimensions, self.angle, self.quaternion)


def coupling(
    g: Springs, fingers: FloatArray, position: FloatArray, rotation: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Forces (n, d) on the object by equation (4) without damping, and their wrench."""
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
    """(w, n d) of hard fingers: forces add up, moments are arm x force."""
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


def quaternion_product(p: FloatArray, q: FloatArray) -> FloatArray:
    """Of x y z w."""
    vector = p[3] * q[:3] + q[3] * p[:3] + np.cross(p[:3], q[:3])
    return np.append(vector, p[3] * q[3] - p[:3] @ q[:3])
