"""The state block of one grasped object: which entry of one flat array holds what."""

from __future__ import annotations

from typing import Any

from graspfx.objects import integrators as body

# The object, its coupling and its shape. Switches are 0.0 or 1.0.
FINGERS = 0  # n
DIMENSIONS = 1  # d
PERIOD = 2  # T [s]
EXTERNAL_STIFFNESS = 3  # kep [N/m]
EXTERNAL_DAMPING = 4  # ked [N s/m]
INTERNAL_STIFFNESS = 5  # kip [N/m]
INTERNAL_DAMPING = 6  # kid [N s/m]
EQUAL = 7  # kep = kip and ked = kid: the conventional method, no projector
DENSE = 8  # gains are matrices: K and D are squares at `dense`
DAMPED = 9  # some damping is not zero
ATTACHED = 10  # bilateral: contacts fixed in the object, no normals
STICK = 11  # a touching finger holds where it touched
FADE = 12  # a free finger's weight goes down with its gap
NEAR, FAR = 13, 14  # gaps between which it does [m]
AT_CONTACT = 15  # the reaction acts at the contact point, else at the fingertip
IMPLICIT = 16  # forces and the object's displacement come from one system
ARM_LOW, ARM_HIGH = 17, 18  # rms arms between which a rotation joins the external space [m]
SHAPE = 19  # kind; parameters in the next three
PARAMETERS = 20
MESH, WALKS = 20, 21  # of a mesh instead: offsets of its array and of the first finger's state on it, `ball.STATE` each
SHIFTS, TURNS = 23, 24  # free translations and rotations
MIXED = 25  # only some translations or some rotations are free: the modes turn with the object
COUNT = 26  # modes in use
SPLIT_KNOWN = 27
SHORTFALL = 28  # by how much NEAR was too small, at most over the run [m]
SINGULAR = 29  # some direction has no damping while others have
FRICTION = 30  # some finger has a coefficient: forces lie in cones, and contact points slip
COORDINATES = 31  # contact coordinates per finger, c: d, or 4 in space where some finger is soft
LAW = 32  # that the elastic force of this sample satisfies: 0 Coulomb's, 1 the associated one
RESIDUAL = 33  # of that law [N]
PROBLEM = 34  # offset of the friction problem of the elastic force
BRAKE = 35  # and of the damping force
RAYS = 36  # without friction, and gains are numbers: forces along the normals
OBSERVED = 37  # ELASTIC is wanted
# Of gains that are matrices; the four are kep, ked, kip, kid.
RULE = 38  # how stiffness, then damping are made of them: equal, literal, symmetric (`gains`)
AXES_OF_GAINS = 40  # in which they stand: the object's, or none; the world's; the contacts' (`gains`)
WHOLE = 41  # one flag for each of the four: (n d) x (n d), else n times d x d
GAINS = 45  # offsets of the four
SKEW = 49  # the largest sum of squares of K - K', then of D - D', so far
BLENDED = 51  # rotations that are not in the split whole, though they have an arm
IN_BAND = 52  # samples with such a rotation
RELEASE = 53  # 1/2 |Kep^-1 - Kip^-1| of matrices [m/N]
LIMITS = 54  # offset of what limits on forces need (`limit`), 0 without any
AXES = 55  # free directions in the object's frame, 6 x 3
# Damping that grows with depth (`depth`).
GRADUAL = AXES + 18
DEPTH = GRADUAL + 1  # over which it grows [m]
STIFFEST = GRADUAL + 2  # of gains that are matrices: the largest eigenvalues of kip, ked and kid
BODY = GRADUAL + 5

ROW = BODY + body.SIZE  # the first finger
# A finger's row, offsets from its start. Vectors have three entries; frame O is the object's, W the world's.
POSITION = 0  # p, W [m]
VELOCITY = 3  # p', W [m/s]
CONTACT = 6  # c, O: on the surface, which for a ball fingertip is grown by its radius [m]
NORMAL = 9  # into the object, O
FACE = 12  # active face of a box, -1 not known
GAP = 13  # positive outside [m]
WEIGHT = 14
TOUCHING = 15
# Displacements and forces have a fourth entry, the torsion of a soft finger in units of its patch length rho.
DISPLACEMENT = 16  # e = p - c, O, and rho theta [m]
RATE = 20  # e', O, and rho theta' [m/s]
FORCE = 24  # on the object, W [N]
CONTACT_WORLD = 27  # c, W [m]
FRAME = 30  # normal and tangents, O, 3 x 3
LOCAL = 39  # force, O, and torsion / rho [N]
SPLIT_CONTACT = 43  # c and weight that the modes were made from
SPLIT_WEIGHT = 46
SHARE = 47  # of the metric: the device's mass over the mean, 1 for equal devices
COEFFICIENT = 48  # mu
STATUS = 49  # 0 free, 1 stick, 2 slide, where there is a coefficient
RETAINED = 50  # e + s, what slipping and letting go leave of the displacement, O, four entries [m]
PATCH = 54  # rho of a soft finger, 0 of a hard one [m]
SPLIT_NORMAL = 55  # normal that the modes of soft fingers were made from
ANCHOR = 58  # the object's rotation from which torsion counts, row by row
KEPT = 67  # torsion at that rotation, rho theta [m]
TWIST_AXIS = 68  # direction in which torsion acts on the object, O
MOMENT = 71  # torsion on the object, W [N m]
RADIUS = 74  # of a ball fingertip, 0 for a point [m]
ELASTIC = 75  # LOCAL without damping, four entries, where it is wanted
ROOT = 79  # of the weight, where there is a projection
STRIDE = 80
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
