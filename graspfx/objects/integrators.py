"""Integrators of a rigid body's motion during one sample.

The wrench and gravity are constant over the sample, and viscosity is linear: m v' + b v = f + m g and
(I w)' + b_w w = tau. Free directions are world axes; no force moves the body along a locked direction.

| integrator | translation, plane rotation | rotation in space |
|---|---|---|
| explicit | x += T v; v += T a | q = exp(T w) q; w += T w', gyroscopic term in w' |
| semi-implicit | v += T a; x += T v | w += T w'; q = exp(T w) q |
| exact | matrix exponential | isotropic inertia or one free axis: w exact, q by Magnus; else RKMK4; 4th order |
| implicit | a at the new v | (I + T b_w) w+ = I w + T (tau - w x I w); q = exp(T w+) q |

Explicit and semi-implicit require b T/m < 2; exact and implicit allow any viscosity. All integrators except the exact
one treat the gyroscopic term explicitly. If some rotations are locked, the equations are those of the free axes,
(I w)_free' = (tau - b_w w)_free, w_locked = 0, without further approximation.
"""

from __future__ import annotations

from graspfx.compile.kernel import kernel
from graspfx.compile.records import size_of, start_of
from graspfx.objects.body_state import EXACT, EXPLICIT, IMPLICIT, SEMI_IMPLICIT, BodyState, Motion
from graspfx.objects.decay import coefficients, step_coefficients
from graspfx.objects.rotation import new_spin, spin_of, turn, turn_exactly
from graspfx.spatial import ZERO, Matrix, Vector, angle_matrix, exponential, normalise, quaternion_matrix, total

__all__ = ["EXACT", "EXPLICIT", "IMPLICIT", "SEMI_IMPLICIT", "orient", "predict", "step"]

# Offsets in the block, from its declaration.
DIMENSIONS = start_of(BodyState, "dimensions")
MASS = start_of(BodyState, "mass")
INERTIA = start_of(BodyState, "inertia")
VISCOSITY = start_of(BodyState, "viscosity")
ROTATIONAL_VISCOSITY = start_of(BodyState, "rotational_viscosity")
INTEGRATOR = start_of(BodyState, "integrator")
FREE = start_of(BodyState, "free_translation")
GRAVITY = start_of(BodyState, "gravity")
_MOTION, _NEXT = start_of(BodyState, "motion"), start_of(BodyState, "next_motion")
POSITION = _MOTION + start_of(Motion, "position")
QUATERNION = _MOTION + start_of(Motion, "quaternion")
ANGLE = _MOTION + start_of(Motion, "angle")
VELOCITY = _MOTION + start_of(Motion, "velocity")
ANGULAR_VELOCITY = _MOTION + start_of(Motion, "angular_velocity")
ROTATION = _MOTION + start_of(Motion, "rotation")
FORCE = start_of(BodyState, "force")
MOMENT = start_of(BodyState, "moment")
NEXT_POSITION = _NEXT + start_of(Motion, "position")
NEXT_VELOCITY = _NEXT + start_of(Motion, "velocity")
NEXT_ANGULAR_VELOCITY = _NEXT + start_of(Motion, "angular_velocity")
NEXT_ROTATION = _NEXT + start_of(Motion, "rotation")
COMPLIANCE = start_of(BodyState, "compliance")
ROTATIONAL_COMPLIANCE = start_of(BodyState, "rotational_compliance")
DECAY = start_of(BodyState, "translation_decay")
SIZE = size_of(BodyState)

LOCKED = Matrix(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)  # no rotation for any moment


@kernel
def orient(body: BodyState) -> None:
    """Compute the rotation matrix from the quaternion or the angle."""
    motion = body.motion
    if body.dimensions == 3:
        motion.rotation = quaternion_matrix(motion.quaternion)
    else:
        motion.rotation = angle_matrix(motion.angle)


@kernel
def step(body: BodyState, T: float) -> None:
    """Move the body by T [s] under its force, its moment, gravity and viscosity."""
    d, kind, m, motion = body.dimensions, body.integrator, body.mass, body.motion
    c = step_coefficients(body.translation_decay, kind, body.viscosity / m, T)
    for a in range(d):
        if body.free_translation[a] != 0.0:
            x, v, g, f = motion.position[a], motion.velocity[a], body.gravity[a], body.force[a]
            motion.position[a] = x + c.p * v + c.q * g + c.q / m * f
            motion.velocity[a] = c.r * v + c.s * g + c.s / m * f
    if d == 2 and body.free_rotation.z != 0.0:
        J, moment, w = body.inertia.z, body.moment.z, motion.angular_velocity.z
        c = step_coefficients(body.rotation_decay, kind, body.rotational_viscosity / J, T)
        motion.angle = motion.angle + c.p * w + c.q / J * moment
        motion.angular_velocity[2] = c.r * w + c.s / J * moment
        orient(body)
    if d == 3 and total(body.free_rotation) > 0.0:
        if kind == EXACT:
            turn_exactly(body, T)
        else:
            turn(body, T, kind)
        orient(body)


@kernel
def predict(body: BodyState, T: float) -> None:
    """Compute the motion after T [s] without a wrench, and the compliance to a wrench.

    With the implicit integrator and the compliance C, x+ = x_next + C f to the last bit. In the plane
    angle+ = angle_next + C_r moment. In space R+ = exp(C_r moment) R_next, with an error of order T |w| times the
    rotation C_r moment.
    """
    d, motion, next_motion = body.dimensions, body.motion, body.next_motion
    c = coefficients(IMPLICIT, body.viscosity / body.mass, T)
    body.compliance = c.q / body.mass
    for a in range(3):
        x, v = motion.position[a], motion.velocity[a]
        if body.free_translation[a] != 0.0:
            x, v = x + c.p * v + c.q * body.gravity[a], c.r * v + c.s * body.gravity[a]
        next_motion.position[a] = x
        next_motion.velocity[a] = v
    next_motion.angular_velocity = motion.angular_velocity
    next_motion.rotation = motion.rotation
    body.rotational_compliance = LOCKED
    if d == 2 and body.free_rotation.z != 0.0:
        J, w = body.inertia.z, motion.angular_velocity.z
        c = coefficients(IMPLICIT, body.rotational_viscosity / J, T)
        next_motion.rotation = angle_matrix(motion.angle + c.p * w)
        next_motion.angular_velocity[2] = c.r * w
        body.rotational_compliance[8] = c.q / J
    if d == 3 and total(body.free_rotation) > 0.0:
        q, extra = motion.quaternion, T * body.rotational_viscosity
        spin = new_spin(body, T, IMPLICIT, ZERO)
        next_motion.angular_velocity = spin
        next_motion.rotation = quaternion_matrix(normalise(exponential(T * spin) @ q))
        x_column = spin_of(body, q, extra, Vector(1.0, 0.0, 0.0))
        y_column = spin_of(body, q, extra, Vector(0.0, 1.0, 0.0))
        z_column = spin_of(body, q, extra, Vector(0.0, 0.0, 1.0))
        body.rotational_compliance = Matrix(
            T * T * x_column.x, T * T * y_column.x, T * T * z_column.x,
            T * T * x_column.y, T * T * y_column.y, T * T * z_column.y,
            T * T * x_column.z, T * T * y_column.z, T * T * z_column.z,
        )  # fmt: skip
