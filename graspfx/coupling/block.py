"""Offsets of declared fields, for code that does not take records yet."""

from __future__ import annotations

from graspfx.compile.kernel import kernel
from graspfx.compile.records import size_of, start_of
from graspfx.coupling.grasp_state import FingerState, GraspState
from graspfx.grasp.contact_state import Freedom

# Of a grasp.
FINGERS = start_of(GraspState, "count")
DIMENSIONS = start_of(GraspState, "dimensions")
EXTERNAL_STIFFNESS = start_of(GraspState, "external_stiffness")
INTERNAL_STIFFNESS = start_of(GraspState, "internal_stiffness")
EQUAL = start_of(GraspState, "equal")
DENSE = start_of(GraspState, "dense")
DAMPED = start_of(GraspState, "damped")
ATTACHED = start_of(GraspState, "attached")
STICK = start_of(GraspState, "stick")
FADE = start_of(GraspState, "fade")
NEAR = start_of(GraspState, "fade_start")
FAR = start_of(GraspState, "fade_end")
AT_CONTACT = start_of(GraspState, "at_contact")
IMPLICIT = start_of(GraspState, "implicit")
ARM_LOW = start_of(GraspState, "arm_low")
ARM_HIGH = start_of(GraspState, "arm_high")
SHAPE = start_of(GraspState, "shape")
SHIFTS = start_of(GraspState, "freedom") + start_of(Freedom, "shifts")
TURNS = start_of(GraspState, "freedom") + start_of(Freedom, "turns")
AXES = start_of(GraspState, "freedom") + start_of(Freedom, "axes")
MIXED = start_of(GraspState, "mixed")
COUNT = start_of(GraspState, "mode_count")
SPLIT_KNOWN = start_of(GraspState, "split_known")
SINGULAR = start_of(GraspState, "singular")
FRICTION = start_of(GraspState, "friction")
COORDINATES = start_of(GraspState, "coordinates")
LAW = start_of(GraspState, "law")
RESIDUAL = start_of(GraspState, "residual")
PROBLEM = start_of(GraspState, "problem")
BRAKE = start_of(GraspState, "damping_problem")
RAYS = start_of(GraspState, "rays")
PADDED = start_of(GraspState, "padded")
OBSERVED = start_of(GraspState, "observed")
LIMITS = start_of(GraspState, "limited")
BODY = start_of(GraspState, "body")
ROW = start_of(GraspState, "fingers")
MESH = start_of(GraspState, "parameters")
WALKS = MESH + 1
# Of a finger, from its row on.
STRIDE = size_of(FingerState)
CONTACT = start_of(FingerState, "contact")
NORMAL = start_of(FingerState, "normal")
PATCH = start_of(FingerState, "patch")
WEIGHT = start_of(FingerState, "weight")
FRAME = start_of(FingerState, "frame")
POSITION = start_of(FingerState, "position")
VELOCITY = start_of(FingerState, "velocity")
GAP = start_of(FingerState, "gap")
TOUCHING = start_of(FingerState, "touching")
DISPLACEMENT = start_of(FingerState, "displacement")
RATE = start_of(FingerState, "rate")
FORCE = start_of(FingerState, "force")
CONTACT_WORLD = start_of(FingerState, "contact_world")
LOCAL = start_of(FingerState, "local")
SHARE = start_of(FingerState, "share")
COEFFICIENT = start_of(FingerState, "coefficient")
STATUS = start_of(FingerState, "status")
ANCHOR = start_of(FingerState, "anchor")
KEPT = start_of(FingerState, "torsion_at_anchor")
TWIST_AXIS = start_of(FingerState, "twist_axis")
RADIUS = start_of(FingerState, "radius")
ELASTIC = start_of(FingerState, "elastic")
LIMIT = start_of(FingerState, "limit")
PAD = start_of(FingerState, "pad")


def modes(n: int) -> int:
    """Compute the offset of the rigid modes."""
    return ROW + n * STRIDE


@kernel
def stiffness_offset(grasp: GraspState) -> int:
    """Compute the offset of K, where gains are matrices."""
    return grasp.stiffness.offset
