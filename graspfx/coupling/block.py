"""Offsets of declared fields, for code that does not use records."""

from __future__ import annotations

from graspfx.compile.records import size_of, start_of
from graspfx.coupling.grasp_state import FingerState, GraspState
from graspfx.grasp.rigid_modes import Freedom

# Fields of a grasp.
DIMENSIONS = start_of(GraspState, "dimensions")
EXTERNAL_STIFFNESS = start_of(GraspState, "external_stiffness")
INTERNAL_STIFFNESS = start_of(GraspState, "internal_stiffness")
EQUAL = start_of(GraspState, "equal")
DAMPED = start_of(GraspState, "damped")
ATTACHED = start_of(GraspState, "attached")
NEAR = start_of(GraspState, "fade_start")
FAR = start_of(GraspState, "fade_end")
IMPLICIT = start_of(GraspState, "implicit")
ARM_LOW = start_of(GraspState, "arm_low")
ARM_HIGH = start_of(GraspState, "arm_high")
SHAPE = start_of(GraspState, "shape")
TURNS = start_of(GraspState, "freedom") + start_of(Freedom, "turns")
SPLIT_KNOWN = start_of(GraspState, "split_known")
LAW = start_of(GraspState, "law")
RESIDUAL = start_of(GraspState, "residual")
RAYS = start_of(GraspState, "rays")
OBSERVED = start_of(GraspState, "observed")
BODY = start_of(GraspState, "body")
ROW = start_of(GraspState, "fingers")
MESH = start_of(GraspState, "mesh")
# Fields of a finger, counted from the start of its row.
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
LOCAL = start_of(FingerState, "local")
SHARE = start_of(FingerState, "share")
COEFFICIENT = start_of(FingerState, "coefficient")
STATUS = start_of(FingerState, "status")
ANCHOR = start_of(FingerState, "anchor")
TORSION_AT_ANCHOR = start_of(FingerState, "torsion_at_anchor")
TWIST_AXIS = start_of(FingerState, "twist_axis")
RADIUS = start_of(FingerState, "radius")
