"""Torsion of soft fingers: rho theta about the normal, from the object's rotation since an anchor."""

from __future__ import annotations

from graspfx import elementary
from graspfx.compile.kernel import kernel
from graspfx.coupling.grasp_state import FingerState, GraspState
from graspfx.spatial import ZERO, cross, dot, with_torsion

QUARTER = 2.0  # 4 cos^2 of half the angle, for a quarter turn


@kernel
def twist(grasp: GraspState, finger: FingerState) -> None:
    """Compute a finger's torsion rho theta, its rate, and the direction a of its moment on the object.

    Fingertips do not rotate. The object's rotation since the anchor, with the quaternion (v, w), is divided into swing
    and twist; theta is minus the twist angle about the normal n, 2 atan2(v . n, w). A small rotation of the object
    changes theta by minus a . (rotation), where a = [w^2 n + w n x v + (v . n) v] / (w^2 + (v . n)^2). Torsion that
    acts along a is therefore conservative. If the reaction acts at c, as in the paper, torsion acts along a = n.
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
    """Set a finger's anchor to the object's present rotation, at which the torsion rho theta is `torsion` [m]."""
    motion = grasp.motion
    finger.anchor = motion.rotation
    finger.torsion_at_anchor = torsion
