"""Displacements e = p - c of the fingers p from contact points c, their rates, torsions and weights.

All are computed in the object's frame.
"""

from __future__ import annotations

from graspfx import elementary
from graspfx.compile.kernel import inline, kernel
from graspfx.cones.cone import contact_frame
from graspfx.cones.problem import SLIDE
from graspfx.coupling.grasp_state import FingerState, GraspState
from graspfx.grasp.rigid_modes import faded_weight, rigid_modes
from graspfx.spatial import ZERO, Vector, cross, dot, with_torsion
from graspfx.surfaces.closed_form.proxy import MESH, closest_to_ball
from graspfx.surfaces.triangles.ball import ball_contact
from graspfx.surfaces.triangles.walk import mesh_contact

NOT_FINITE = 1  # a finger's motion is NaN, infinite, or too large to be squared
UNRESOLVED = 2  # the projection did not converge
LOST = 3  # the object's motion or a force is not finite
AGAIN = 4  # a contact point has moved: recompute the split and the forces
EXCESSIVE = 5  # the law's force on a finger exceeds `force_bound`
LARGEST = 1e150  # larger numbers may have infinite squares; comparisons with NaN are false

QUARTER = 2.0  # 4 cos^2 of half the angle, for a quarter turn


@kernel
def approach(grasp: GraspState) -> int:
    """Compute the contact point, displacement, rate and weight of every finger; return 0, NOT_FINITE or LOST.

    A ball fingertip is represented by its centre p, which touches the shape's surface offset outwards by the ball's
    radius. The contact point c is the position of p on the offset surface at first touch. A reaction at the fingertip
    acts at p, and a reaction at the contact acts at c. The energy balance of a ball is therefore the same as that of a
    point.
    """
    motion = grasp.motion
    total = 0.0
    for a in range(3):
        R = motion.rotation.row(a)
        total += motion.position[a] + motion.velocity[a] + motion.angular_velocity[a] + R.x + R.y + R.z
    if not abs(total) <= LARGEST:
        return LOST
    for finger in grasp.fingers:
        total = 0.0
        for a in range(grasp.dimensions):
            total += finger.position[a] + finger.velocity[a]
        if not abs(total) <= LARGEST:
            return NOT_FINITE
        p = finger.position - motion.position
        if grasp.dimensions > 1:
            p = motion.rotation.transpose @ p
        if not grasp.attached:
            touch(grasp, finger, p)
        displace(grasp, finger, p)
    return 0


@kernel
def displace(grasp: GraspState, finger: FingerState, p: Vector) -> None:
    """Compute e = p - c, c in world axes, and e' = p' - v - w x r of a finger at p in the object's frame.

    The object has the velocity v and the angular velocity w.

    The vector r points from the object's centre to the point at which the reaction acts: the fingertip or c. With this
    choice of r, damping generates no energy.
    """
    motion = grasp.motion
    c = finger.contact
    finger.displacement = with_torsion(p - c, finger.displacement.t)
    if grasp.dimensions > 1:
        c = motion.rotation @ c
    finger.contact_world = motion.position + c
    if grasp.damped:
        r = c if grasp.at_contact else finger.position - motion.position
        rate = finger.velocity - motion.velocity - cross(motion.angular_velocity, r)
        finger.rate = with_torsion(motion.rotation.transpose @ rate, finger.rate.t)
    if grasp.coordinates > 3:
        twist(grasp, finger)


@kernel
def touch(grasp: GraspState, finger: FingerState, p: Vector) -> None:
    """Compute the contact point, normal, gap and weight of a finger at p in the object's frame.

    With a coefficient of friction, the contact point slips until the finger's displacement along the surface equals the
    tangential part of e + s in the last sample. The contact point of a sliding finger slips before this sample's
    motion. The contact point of a free finger follows the motion and slips afterwards. With matrix gains and without
    friction, the contact point slips after the motion, whether the finger touches or not. The displacement of the
    springs is then w = e + s = K^-1 f, which has a tangential part even if f is normal, and no energy is generated.
    """
    slips = finger.coefficient > 0.0
    if finger.touching and slips and finger.status == SLIDE:
        place_contact(grasp, finger, finger.contact + finger.displacement.vector - along_surface(finger))
    if finger.touching and (slips or grasp.stick):
        finger.gap = dot(finger.normal, finger.contact - p)
    elif slips or grasp.dense:
        place_contact(grasp, finger, p - along_surface(finger))
    else:
        place_contact(grasp, finger, p)
    if grasp.fade and is_weight_used(grasp):
        fade(grasp, finger)


@inline
def is_weight_used(grasp: GraspState) -> bool:
    """Return whether the weight of a free finger is used, which requires coupled fingers, friction or an observer."""
    return not grasp.alone or grasp.friction or grasp.observed


@kernel
def fade(grasp: GraspState, finger: FingerState) -> None:
    """Compute a finger's weight from its gap."""
    finger.weight = faded_weight(finger.share, finger.gap, grasp.fade_start, grasp.fade_end)


@inline
def along_surface(finger: FingerState) -> Vector:
    """Compute the tangential part of the displacement that a finger retains after slip."""
    n, h = finger.normal, finger.retained.vector
    return h - dot(n, h) * n


@kernel
def place_contact(grasp: GraspState, finger: FingerState, p: Vector) -> None:
    """Compute the contact point, normal, contact frame, face and gap of a finger at p in the object's frame."""
    radius = finger.radius
    if grasp.shape == MESH:
        if radius > 0.0:
            contact = ball_contact(grasp.mesh, finger.walk, radius, p)
        else:
            contact = mesh_contact(grasp.mesh, finger.walk, p)
    else:
        last = finger.contact + radius * finger.normal
        contact = closest_to_ball(grasp.shape, grasp.dimensions, grasp.parameters, radius, p, finger.face, last)
    finger.contact = contact.point - radius * contact.normal
    finger.normal = contact.normal
    finger.face = contact.face
    finger.gap = contact.gap
    finger.frame = contact_frame(finger.normal, grasp.dimensions)


@kernel
def refactor(grasp: GraspState) -> None:
    """Recompute the rigid modes if a contact point, a weight or, for soft fingers, a normal has changed.

    If `mixed` is true, the modes are recomputed in every sample.
    """
    current = grasp.split_known and not grasp.mixed
    for finger in grasp.fingers:
        same = finger.weight == finger.split_weight
        for a in range(grasp.dimensions):
            same = same and finger.contact[a] == finger.split_contact[a]
            if grasp.coordinates > 3:
                same = same and finger.normal[a] == finger.split_normal[a]
        if not same:
            current = False
            finger.split_weight = finger.weight
            finger.split_contact = finger.contact
            finger.split_normal = finger.normal
    if not current:
        grasp.mode_count, grasp.blended = rigid_modes(
            grasp.fingers, grasp.freedom, grasp.dimensions, grasp.arm_low, grasp.arm_high, grasp.width, grasp.recoils,
            grasp.modes,
        )  # fmt: skip
        grasp.split_known = True
        if grasp.recoils:
            grasp.recoil.current = False


@kernel
def turn_axes(grasp: GraspState) -> None:
    """Compute the object's free directions, given in world axes, in the object's frame; translations come first."""
    motion = grasp.motion
    grasp.centre = motion.position
    k = 0
    for a in range(3):
        if grasp.body.free_translation[a] != 0.0:
            grasp.freedom.axes[k].vector = motion.rotation.row(a)
            k += 1
    for a in range(3):
        if grasp.body.free_rotation[a] != 0.0:
            grasp.freedom.axes[k].vector = motion.rotation.row(a)
            k += 1


@kernel
def twist(grasp: GraspState, finger: FingerState) -> None:
    """Compute the torsional displacement rho theta of a finger, its rate, and the axis a of its moment on the object.

    Here rho is the patch length, and fingertips do not rotate. The object's rotation since the anchor, with the
    quaternion (v, w), is divided into swing and twist. The angle theta is minus the twist angle 2 atan2(v . n, w) about
    the normal n. A small rotation of the object, as a vector phi, changes theta by -a . phi with a = [w^2 n + w n x v +
    (v . n) v] / (w^2 + (v . n)^2). A torsion that acts along a is therefore conservative. If the reaction acts at the
    contact point, as in the paper, torsion acts along a = n.
    """
    if not finger.touching:
        set_anchor(grasp, finger, finger.retained.t)
    motion = grasp.motion
    v = ZERO  # 4 w v of the quaternion
    w = 1.0  # 4 w^2
    for k in range(3):
        v += cross(motion.rotation.row(k), finger.anchor.row(k))
        w += dot(finger.anchor.row(k), motion.rotation.row(k))
    n = finger.normal
    along = dot(v, n)
    theta = 2.0 * finger.patch * elementary.atan2(along, w)
    finger.displacement = with_torsion(finger.displacement.vector, finger.torsion_at_anchor - theta)
    axis = n
    length = w * w + along * along
    if not grasp.at_contact and length > 0.0:
        axis = (w * w * n + w * cross(n, v) + along * v) / length
    finger.twist_axis = axis
    if grasp.damped:
        rate = dot(axis, motion.rotation.transpose @ motion.angular_velocity)
        finger.rate = with_torsion(finger.rate.vector, -finger.patch * rate)
    if w < QUARTER:  # far below half a turn, where the angle would jump
        set_anchor(grasp, finger, finger.displacement.t)


@kernel
def set_anchor(grasp: GraspState, finger: FingerState, torsion: float) -> None:
    """Set the anchor of a finger to the object's present rotation.

    At this rotation, the torsional displacement rho theta is `torsion` [m].
    """
    motion = grasp.motion
    finger.anchor = motion.rotation
    finger.torsion_at_anchor = torsion
