"""The state of a rigid body, as it stands in a block."""

from __future__ import annotations

from graspfx.compile.kernel import kernel
from graspfx.compile.records import Record
from graspfx.spatial import Matrix, Quaternion, Vector

EXPLICIT, SEMI_IMPLICIT, EXACT, IMPLICIT = 0, 1, 2, 3  # integrators


class Motion(Record):
    """Where a body is and how it moves; components that a line or a plane does not have are zero."""

    position: Vector  # x, the centre of mass [m]
    quaternion: Quaternion  # body to world; space
    angle: float  # unwrapped; plane [rad]
    velocity: Vector  # v [m/s]
    angular_velocity: Vector  # w, world axes [rad/s]
    rotation: Matrix  # R, body to world


class Decay(Record):
    """Values of exp(-z) and its integrals (`decay.decay_integrals`), until z is another."""

    z: float  # b T/m
    exponential: float
    first: float
    second: float
    turn: float


class BodyState(Record):
    """A rigid body: its parameters, its motion, the wrench of the sample."""

    dimensions: int  # d
    mass: float  # m [kg]
    inertia: Vector  # principal moments, body axes [kg m^2]; the plane uses the third
    viscosity: float  # b [N s/m]
    rotational_viscosity: float  # b_w [N m s/rad]
    integrator: int  # EXPLICIT, SEMI_IMPLICIT, EXACT or IMPLICIT
    free_translation: Vector  # 1.0 or 0.0, world axes
    free_rotation: Vector
    gravity: Vector  # [m/s^2]
    motion: Motion
    force: Vector  # of this sample [N]
    moment: Vector  # of this sample, about the position, world axes [N m]
    next_motion: Motion  # after T under the implicit integrator with no wrench; no quaternion and no angle
    compliance: float  # displacement of a free axis per force [m/N]
    rotational_compliance: Matrix  # rotation per moment, world axes, zero where locked [rad/(N m)]
    translation_decay: Decay  # of b T/m
    rotation_decay: Decay  # of b_w T/J


@kernel
def copy_motion(source: Motion, to: Motion) -> None:
    """Copy where a body is and how it moves."""
    to.position, to.quaternion, to.angle = source.position, source.quaternion, source.angle
    to.velocity, to.angular_velocity, to.rotation = source.velocity, source.angular_velocity, source.rotation
