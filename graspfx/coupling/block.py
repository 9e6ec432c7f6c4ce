"""The state block of one grasped object: which entry of one flat array holds what."""

from __future__ import annotations

from graspfx.objects import kernels as body

# The object, its coupling and its shape. Switches are 0.0 or 1.0.
FINGERS = 0  # n
DIMENSIONS = 1  # d
PERIOD = 2  # T [s]
EXTERNAL_STIFFNESS = 3  # kep [N/m]
EXTERNAL_DAMPING = 4  # ked [N s/m]
INTERNAL_STIFFNESS = 5  # kip [N/m]
INTERNAL_DAMPING = 6  # kid [N s/m]
EQUAL = 7  # kep = kip and ked = kid: the conventional method, no projector
DENSE = 8  # gains are matrices: the squares at `dense` are filled from outside
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
AXES = 30  # free directions in the object's frame, 6 x 3
BODY = AXES + 18

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
DISPLACEMENT = 16  # e = p - c, O [m]
RATE = 19  # e', O [m/s]
FORCE = 22  # on the object, W [N]
CONTACT_WORLD = 25  # c, W [m]
FRAME = 28  # normal and tangents, O, 3 x 3
LOCAL = 37  # force, O [N]
SPLIT_CONTACT = 40  # c and weight that the modes were made from
SPLIT_WEIGHT = 43
RADIUS = 44  # of a ball fingertip, 0 for a point [m]
STRIDE = 45


def modes(n: int) -> int:
    """Offset of the rigid modes: up to six of 1 + 3 n entries."""
    return ROW + n * STRIDE


def unknowns(n: int, d: int) -> int:
    """Rows of the square that is pivoted: contact coordinates, and the object's own under the implicit integrator."""
    return n * d + 6


def square(n: int) -> int:
    """Offset of the matrix that is pivoted, unknowns x unknowns."""
    return modes(n) + 6 * (1 + 3 * n)


def vector(n: int, d: int) -> int:
    return square(n) + unknowns(n, d) ** 2


def diagonal(n: int, d: int) -> int:
    """Offset of the matrix' diagonal before any pivot."""
    return vector(n, d) + unknowns(n, d)


def known(n: int, d: int) -> int:
    """Offset of what a projection starts from, n d entries in contact frames: displacement, or elastic force."""
    return diagonal(n, d) + unknowns(n, d)


def marks(n: int, d: int) -> int:
    """Offset of one mark per contact coordinate."""
    return known(n, d) + n * d


def engaged(n: int, d: int) -> int:
    """Offset of the state per finger: 1 engaged, 0 released, -1 left alone."""
    return marks(n, d) + n * d


def scratch(n: int, d: int) -> int:
    return engaged(n, d) + n


def part(n: int, d: int) -> int:
    """Offset of K or D / T by itself under the implicit integrator, (n d) x (n d), in contact frames."""
    return scratch(n, d) + 6


def rest(n: int, d: int) -> int:
    """Offset of a vector of n d entries that goes with `part`."""
    return part(n, d) + (n * d) ** 2


def dense(n: int, d: int) -> int:
    """Offset of K, then D, (n d) x (n d) each, in the object's axes; present only when gains are matrices."""
    return rest(n, d) + n * d


def size(n: int, d: int, *, matrices: bool) -> int:
    return dense(n, d) + (2 * (n * d) ** 2 if matrices else 0)
