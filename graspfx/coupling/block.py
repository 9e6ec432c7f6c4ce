"""The state block of one grasped object: which entry of one flat array holds what."""

from __future__ import annotations

from typing import Any

from graspfx.compile.records import size_of, start_of
from graspfx.cones.problem import ConeContact, FrictionProblem, Unknown
from graspfx.coupling.state import FingerState, GraspState
from graspfx.surfaces.triangles.mesh_finger import MeshFinger

# Offsets of the declared fields.
FINGERS = start_of(GraspState, "count")
DIMENSIONS = start_of(GraspState, "dimensions")
PERIOD = start_of(GraspState, "period")
EXTERNAL_STIFFNESS = start_of(GraspState, "external_stiffness")
EXTERNAL_DAMPING = start_of(GraspState, "external_damping")
INTERNAL_STIFFNESS = start_of(GraspState, "internal_stiffness")
INTERNAL_DAMPING = start_of(GraspState, "internal_damping")
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
PARAMETERS = start_of(GraspState, "parameters")
SHIFTS = start_of(GraspState, "shifts")
TURNS = start_of(GraspState, "turns")
MIXED = start_of(GraspState, "mixed")
COUNT = start_of(GraspState, "mode_count")
SPLIT_KNOWN = start_of(GraspState, "split_known")
SHORTFALL = start_of(GraspState, "shortfall")
SINGULAR = start_of(GraspState, "singular")
FRICTION = start_of(GraspState, "friction")
COORDINATES = start_of(GraspState, "coordinates")
LAW = start_of(GraspState, "law")
RESIDUAL = start_of(GraspState, "residual")
PROBLEM = start_of(GraspState, "problem")
BRAKE = start_of(GraspState, "damping_problem")
RAYS = start_of(GraspState, "rays")
OBSERVED = start_of(GraspState, "observed")
RULE = start_of(GraspState, "stiffness_rule")
AXES_OF_GAINS = start_of(GraspState, "axes_of_gains")
WHOLE = start_of(GraspState, "whole")
GAINS = start_of(GraspState, "gains")
SKEW = start_of(GraspState, "skew")
BLENDED = start_of(GraspState, "blended")
IN_BAND = start_of(GraspState, "in_band")
RELEASE = start_of(GraspState, "release")
LIMITS = start_of(GraspState, "limits")
AXES = start_of(GraspState, "axes")
GRADUAL = start_of(GraspState, "gradual")
DEPTH = start_of(GraspState, "damping_depth")
STIFFEST = start_of(GraspState, "stiffest")
BODY = start_of(GraspState, "body")
ROW = start_of(GraspState, "fingers")
MESH, WALKS = PARAMETERS, PARAMETERS + 1
WALK = size_of(MeshFinger)  # entries of a finger on a mesh
# Of a finger, from its row on.
POSITION = start_of(FingerState, "position")
VELOCITY = start_of(FingerState, "velocity")
CONTACT = start_of(FingerState, "contact")
NORMAL = start_of(FingerState, "normal")
FACE = start_of(FingerState, "face")
GAP = start_of(FingerState, "gap")
WEIGHT = start_of(FingerState, "weight")
TOUCHING = start_of(FingerState, "touching")
DISPLACEMENT = start_of(FingerState, "displacement")
RATE = start_of(FingerState, "rate")
FORCE = start_of(FingerState, "force")
CONTACT_WORLD = start_of(FingerState, "contact_world")
FRAME = start_of(FingerState, "frame")
LOCAL = start_of(FingerState, "local")
SPLIT_CONTACT = start_of(FingerState, "split_contact")
SPLIT_WEIGHT = start_of(FingerState, "split_weight")
SHARE = start_of(FingerState, "share")
COEFFICIENT = start_of(FingerState, "coefficient")
STATUS = start_of(FingerState, "status")
RETAINED = start_of(FingerState, "retained")
PATCH = start_of(FingerState, "patch")
SPLIT_NORMAL = start_of(FingerState, "split_normal")
ANCHOR = start_of(FingerState, "anchor")
KEPT = start_of(FingerState, "torsion_at_anchor")
TWIST_AXIS = start_of(FingerState, "twist_axis")
MOMENT = start_of(FingerState, "moment")
RADIUS = start_of(FingerState, "radius")
ELASTIC = start_of(FingerState, "elastic")
ROOT = start_of(FingerState, "sqrt_weight")
STRIDE = size_of(FingerState)
MADE = 7  # entries per finger that tell from what K and D were made: weight, contact point, normal


def modes(n: int) -> int:
    """Offset of the rigid modes: up to six of 1 + 3 n entries, or of 1 + 4 n with soft fingers."""
    return ROW + n * STRIDE


def unknowns(n: int, c: int) -> int:
    """Rows of the square that is pivoted: contact coordinates, and the object's own under the implicit integrator."""
    return n * c + 6


def square(n: int) -> int:
    """Offset of the matrix that is pivoted, unknowns x unknowns."""
    return modes(n) + 6 * (1 + 4 * n)


def vector(n: int, c: int) -> int:
    return square(n) + unknowns(n, c) ** 2


def diagonal(n: int, c: int) -> int:
    """Offset of the matrix' diagonal before any pivot."""
    return vector(n, c) + unknowns(n, c)


def known(n: int, c: int) -> int:
    """Offset of what a projection starts from, n c entries in contact frames: displacement, or elastic force."""
    return diagonal(n, c) + unknowns(n, c)


def marks(n: int, c: int) -> int:
    """Offset of one mark per contact coordinate."""
    return known(n, c) + n * c


def engaged(n: int, c: int) -> int:
    """Offset of the state per finger: 1 engaged, 0 released, -1 left alone."""
    return marks(n, c) + n * c


def scratch(n: int, c: int) -> int:
    return engaged(n, c) + n


def part(n: int, c: int) -> int:
    """Offset of K or D / T by itself under the implicit integrator, (n c) x (n c), in contact frames."""
    return scratch(n, c) + 6


def rest(n: int, c: int) -> int:
    """Offset of a vector of n c entries that goes with `part`."""
    return part(n, c) + (n * c) ** 2


def levers(n: int, c: int) -> int:
    """Offset of G in contact frames under the implicit integrator, six rows of n c."""
    return rest(n, c) + n * c


def dense(n: int, c: int) -> int:
    """Offset of K, then D, (n c) x (n c) each, in the object's axes; present only when gains are matrices."""
    return levers(n, c) + 6 * n * c


def made(n: int, c: int) -> int:
    """Offset of what K and D were last made from, with scratch behind it; present only when gains are matrices."""
    return dense(n, c) + 2 * (n * c) ** 2


def skewest(n: int, c: int) -> int:
    """Offset of the K, then the D with the largest skew part so far."""
    return made(n, c) + 46 + MADE * n + 24 * n * c


def gains(n: int, c: int) -> int:
    """Offset of the first gain that is a matrix."""
    return skewest(n, c) + 2 * (n * c) ** 2


def problems(n: int, c: int, matrices: int) -> int:
    """Offset of what friction needs, where there is a coefficient: the elastic problem, then that of the damping.

    `matrices` is how many entries the four gains take, 0 where they are numbers.
    """
    return gains(n, c) + matrices if matrices else dense(n, c)


def size(n: int, c: int, matrices: int, problem: int) -> int:
    """Entries of the block; `problem` is the size of a friction problem."""
    return problems(n, c, matrices) + 2 * problem


# Of a friction problem's contacts and unknowns.
CONE = size_of(ConeContact)
CONE_STATUS = start_of(ConeContact, "status")
CONE_COEFFICIENT = start_of(ConeContact, "coefficient")
CONE_LIMIT = start_of(ConeContact, "limit")
CONE_COMPLIANCE = start_of(ConeContact, "compliance")
CONE_DISPLACEMENT = start_of(ConeContact, "displacement")
CONE_BASE = start_of(ConeContact, "base_force")
CONE_FORCE = start_of(ConeContact, "force")
CONE_SLIP = start_of(ConeContact, "slip")
STARTED = start_of(FrictionProblem, "started")
ROOM = start_of(FrictionProblem, "room")
UNKNOWNS = start_of(FrictionProblem, "unknowns")
UNKNOWN = size_of(Unknown)


def cones(S: Any, o: int) -> int:
    """Offset of the first contact of the friction problem at o."""
    room = int(S[o + ROOM])
    return o + UNKNOWNS + room * (UNKNOWN + 1 + room)


# What limits on forces need, from LIMITS on: the limits that the cones are cut off at, n entries, infinite but while
# they are; those that the devices give; who stands at a limit; the law's forces W, n x 3; then scratch.
LIMIT_MARGIN = 1.0 - 1e-14  # of a limit is used: then a device's own, which acts last, shortens nothing by rounding


def device_limits(S: Any) -> int:
    return int(S[LIMITS]) + int(S[FINGERS])


def saturation(S: Any) -> int:
    return int(S[LIMITS]) + 2 * int(S[FINGERS])


def law_force(S: Any) -> int:
    return int(S[LIMITS]) + 3 * int(S[FINGERS])


def scratch_limits(S: Any) -> int:
    """Offset of a force, n x 4."""
    return int(S[LIMITS]) + 6 * int(S[FINGERS])


def limit_modes(S: Any) -> int:
    """Offset of up to six directions, 1 + 4 n entries each."""
    return int(S[LIMITS]) + 10 * int(S[FINGERS])


def limits_size(n: int) -> int:
    """Entries that limits take."""
    return 10 * n + 6 * (1 + 4 * n)
