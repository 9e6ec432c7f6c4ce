"""Two-link arm that moves a finger: kinematics, reach, and effective mass and damping at the finger."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from graspfx.protocols import DeviceError, InputError, elementary, inline

FloatArray = NDArray[np.float64]
Pair = tuple[float, float]
Elbow = Literal["left", "right"]
Drive = Literal["base", "elbow"]


@dataclass(frozen=True, slots=True)
class Both:
    """Two numbers, for the first and the second joint, link or motor."""

    first: float
    second: float


@dataclass(frozen=True, slots=True)
class Point:
    """A point or a vector in the plane."""

    x: float
    y: float


@dataclass(frozen=True, slots=True)
class Links:
    """The two links as vectors (x1, y1) and (x2, y2) [m]."""

    x1: float
    y1: float
    x2: float
    y2: float


def joint_angles(elbow: bool, a1: float, a2: float) -> Pair:
    """Return the joint angles q [rad] from the directions of the links.

    Args:
        elbow: Whether the second motor is at the elbow.
        a1, a2: Directions of the links [rad].
    """
    if elbow:
        return a1, a2 - a1
    return a1, a2


def link_directions(elbow: bool, q1: float, q2: float) -> Pair:
    """Return the directions a1, a2 of the links [rad] from the joint angles q1, q2; the inverse of `joint_angles`."""
    if elbow:
        return q1, q1 + q2
    return q1, q2


@inline
def links_at(lengths: Both, a1: float, a2: float) -> Links:
    """Return links with given lengths [m] and directions a1, a2 [rad] as vectors."""
    sin1, cos1 = elementary.sin_cos(a1)
    sin2, cos2 = elementary.sin_cos(a2)
    return Links(lengths.first * cos1, lengths.first * sin1, lengths.second * cos2, lengths.second * sin2)


@dataclass(frozen=True)
class Arm:
    """Kinematics of an arm: the finger's position p for the directions a1, a2 of the links.

        p = base + l1 (cos a1, sin a1) + l2 (cos a2, sin a2)

    Both angles are measured counterclockwise from the x axis [rad]. The joint angles are q = (a1, a2) if both motors
    are at the base (`drive="base"`: a belt or a parallelogram drives link 2), and q = (a1, a2 - a1) if the second motor
    is at the elbow (`drive="elbow"`). The elbow is to the left or to the right of the line from the base to the finger.

    Args:
        base: Position of the first joint [m].
        links: Lengths l1, l2 [m].
        elbow: Side of the elbow, "left" or "right".
        drive: Place of the second motor, "base" or "elbow".
        margin: Smallest distance of the finger from the stretched and the folded posture [m].
    """

    base: Pair
    links: Pair
    elbow: Elbow
    drive: Drive
    margin: float

    def __post_init__(self) -> None:
        if str(self.elbow) not in ("left", "right"):
            raise InputError("elbow", self.elbow, '"left" or "right", seen from the base towards the finger')
        if str(self.drive) not in ("base", "elbow"):
            raise InputError("drive", self.drive, '"base" or "elbow": the place of the second motor')
        shortest = min(self.links)
        if not 0.0 < self.margin < shortest:
            raise InputError("margin", self.margin, f"a length between 0 and the shorter link, {shortest:g} m")

    @property
    def reach(self) -> Pair:
        """Smallest and largest distance of the finger from the base [m], including the margin."""
        l1, l2 = self.links
        return abs(l1 - l2) + self.margin, l1 + l2 - self.margin

    @property
    def bend(self) -> float:
        """Sign of sin(a2 - a1): -1 with the elbow to the left, +1 with it to the right."""
        return -1.0 if self.elbow == "left" else 1.0

    def tip(self, a1: float, a2: float) -> Pair:
        """Return the position of the finger [m] for link directions a1, a2 [rad]."""
        links = links_at(Both(*self.links), a1, a2)
        return self.base[0] + links.x1 + links.x2, self.base[1] + links.y1 + links.y2

    def jacobian(self, a1: float, a2: float) -> FloatArray:
        """Compute J = dp/da (2, 2) [m], the derivative of the finger's position p with respect to a = (a1, a2)."""
        links = links_at(Both(*self.links), a1, a2)
        return np.array([[-links.y1, -links.y2], [links.x1, links.x2]])

    def angles(self, x: float, y: float) -> Pair:
        """Compute the directions a1, a2 [rad] for a finger at x, y [m]; raise DeviceError if it is out of reach."""
        dx, dy = x - self.base[0], y - self.base[1]
        low, high = self.reach
        if not low <= math.hypot(dx, dy) <= high:
            raise DeviceError(self.reach_fault(dx, dy))
        l1, l2 = self.links
        c = min(1.0, max(-1.0, (dx * dx + dy * dy - l1 * l1 - l2 * l2) / (2.0 * l1 * l2)))  # within 1 if in reach
        bend = self.bend * elementary.acos(c)
        a1 = elementary.atan2(dy, dx) - elementary.atan2(l2 * elementary.sin(bend), l1 + l2 * c)
        return a1, a1 + bend

    def reach_fault(self, dx: float, dy: float) -> str:
        """Return the error message for a finger that is out of reach, at dx, dy from the base [m]."""
        low, high = self.reach
        r = math.hypot(dx, dy)
        posture, way = ("stretched", "closer to") if r > high else ("folded", "away from")
        return (
            f"finger at ({self.base[0] + dx:.4f}, {self.base[1] + dy:.4f}) m, {r:.4f} m from the arm's base at "
            f"({self.base[0]:.4f}, {self.base[1]:.4f}) m: the arm works from {low:.4f} to {high:.4f} m (links of "
            f"{self.links[0]:g} and {self.links[1]:g} m, {self.margin:g} m short of the {posture} posture); "
            f"move the finger {way} the base, or move the base"
        )

    @property
    def elbow_fault(self) -> str:
        """Return the error message for an elbow on the wrong side."""
        side = "right" if self.elbow == "left" else "left"
        return (
            f"the elbow of the arm at ({self.base[0]:.4f}, {self.base[1]:.4f}) m is on the {side}, expected on the "
            f"{self.elbow}: the arm went through its stretched or folded posture, or `zero` does not match the "
            "encoders; bring the elbow back and open the device again"
        )


@dataclass(frozen=True)
class Mechanics:
    """Mass and damping matrices of an arm, with respect to the directions a = (a1, a2) of the links.

        M(a) = [[I1, c m + r], [c m + r, I2]],   D = [[d1, d], [d, d2]],   c = cos(a2 - a1)

    The kinetic energy is w'M w/2 with w = da/dt. The property `constants` computes I1, I2, m, r, d1, d and d2 from the
    arguments. The kinetic energy of a rotor is only that of its spin, at the joint's rate times the gear ratio.

    Args:
        arm: Geometry of the arm.
        masses: Masses of the links [kg].
        inertias: Moments of inertia of the links about their centres of mass [kg m^2].
        centres: Distances from a link's first joint to its centre of mass, along the link [m].
        reflected: Rotor inertias reflected to the joints, which are those at the motors times the squared gear ratio
            [kg m^2].
        damping: Viscous damping at the joints [N m s/rad].
    """

    arm: Arm
    masses: Pair
    inertias: Pair
    centres: Pair
    reflected: Pair
    damping: Pair

    def __post_init__(self) -> None:
        i1, i2, m, r, *_ = self.constants
        if not (i1 > 0.0 and i2 > 0.0 and i1 * i2 > (abs(m) + abs(r)) ** 2):
            raise InputError(
                "link_masses",
                self.masses,
                "masses and inertias that give both joints a positive inertia in every posture",
                "give each link a mass and an inertia about its centre, or each joint a rotor inertia",
            )

    @property
    def constants(self) -> tuple[float, float, float, float, float, float, float]:
        """Constants I1, I2, m, r [kg m^2] of the mass matrix, and d1, d, d2 [N m s/rad] of the damping matrix."""
        l1 = self.arm.links[0]
        i1 = self.inertias[0] + self.masses[0] * self.centres[0] ** 2 + self.masses[1] * l1**2
        i2 = self.inertias[1] + self.masses[1] * self.centres[1] ** 2
        r1, r, r2 = self._by_direction(self.reflected)
        return (i1 + r1, i2 + r2, self.masses[1] * l1 * self.centres[1], r, *self._by_direction(self.damping))

    def _by_direction(self, joint: Pair) -> tuple[float, float, float]:
        """Compute A'diag(joint) A, where the joint angles are q = A a; return the entries 11, 12 and 22."""
        if self.arm.drive == "base":
            return joint[0], 0.0, joint[1]
        return joint[0] + joint[1], -joint[1], joint[1]

    def mass_matrix(self, a1: float, a2: float) -> FloatArray:
        """Compute the mass matrix M(a), (2, 2) [kg m^2]."""
        i1, i2, m, r, *_ = self.constants
        mixed = m * elementary.cos(a2 - a1) + r
        return np.array([[i1, mixed], [mixed, i2]])

    def damping_matrix(self) -> FloatArray:
        """Compute the damping matrix D, (2, 2) [N m s/rad]."""
        *_, d1, d, d2 = self.constants
        return np.array([[d1, d], [d, d2]])

    def effective_mass(self, a1: float, a2: float) -> FloatArray:
        """Compute the effective mass at the finger, (J M^-1 J')^-1, (2, 2) [kg], with J = dp/da (Khatib 1987)."""
        return self._at_tip(self.mass_matrix(a1, a2), a1, a2)

    def effective_friction(self, a1: float, a2: float) -> FloatArray:
        """Compute the effective damping at the finger, J^-T D J^-1, (2, 2) [N s/m], with J = dp/da."""
        return self._at_tip(self.damping_matrix(), a1, a2)

    def _at_tip(self, A: FloatArray, a1: float, a2: float) -> FloatArray:
        to_joints = np.linalg.inv(self.arm.jacobian(a1, a2))
        at_tip: FloatArray = to_joints.T @ A @ to_joints
        return at_tip
