"""Records of a rigid body's parameters, motion and wrench in a block of memory."""

from __future__ import annotations

from graspfx.compile.kernel import kernel
from graspfx.compile.records import Record
from graspfx.spatial import Matrix, Quaternion, Vector

EXPLICIT, SEMI_IMPLICIT, EXACT, IMPLICIT = 0, 1, 2, 3  # integrators


class Motion(Record):
    """Position, orientation and velocities of a body; components that a line or a plane does not have are zero."""

    position: Vector  # x, the centre of mass [m]
    quaternion: Quaternion  # body to world; space
    angle: float  # unwrapped; plane [rad]
    velocity: Vector  # v [m/s]
    angular_velocity: Vector  # w, world axes [rad/s]
    rotation: Matrix  # R, body to world


class Decay(Record):
    """Cached values of exp(-z) and its integrals (see `integrators.decay_integrals`) for one value of z."""

    z: float  # b T/m, or b_w T/J
    exponential: float
    first: float
    second: float
    turn: float


class BodyState(Record):
    """Parameters of a rigid body, its motion, and the wrench of the present sample."""

    dimensions: int  # d
    mass: float  # m [kg]
    inertia: Vector  # principal moments, body axes [kg m^2]; the plane uses the third
    viscosity: float  # b [N s/m]
    rotational_viscosity: float  # b_w [N m s/rad]
    integrator: int  # EXPLICIT, SEMI_IMPLICIT, EXACT or IMPLICIT
    free_translation: Vector  # 1.0 or 0.0 per world axis
    free_rotation: Vector
    gravity: Vector  # [m/s^2]
    motion: Motion
    force: Vector  # force of this sample [N]
    moment: Vector  # moment of this sample about the position, world axes [N m]
    next_motion: Motion  # motion after T with the implicit integrator and no wrench, without quaternion and angle
    compliance: float  # displacement of a free axis per force [m/N]
    rotational_compliance: Matrix  # rotation per moment, world axes, zero for locked rotations [rad/(N m)]
    translation_decay: Decay  # for b T/m
    rotation_decay: Decay  # for b_w T/J


@kernel
def copy_motion(source: Motion, to: Motion) -> None:
    """Copy all entries of a motion record to another one."""
    to.position, to.quaternion, to.angle = source.position, source.quaternion, source.angle
    to.velocity, to.angular_velocity, to.rotation = source.velocity, source.angular_velocity, source.rotation
