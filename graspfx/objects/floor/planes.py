"""What stands beside the block of a body on fixed planes: the planes, the body's features, their contacts."""

from __future__ import annotations

from graspfx.compile.records import Floats, Many, Record, Ref, Table, floats, many, table
from graspfx.cones.problem import FrictionProblem
from graspfx.objects.body_state import Motion
from graspfx.spatial import Matrix, Vector

SIDES = 8  # fixed points of a rim, and directions in which a plane's contacts are chosen
MOST = SIDES + 1  # contacts with one plane


class FloorPlane(Record):
    """A fixed plane."""

    frame: Matrix  # rows: the unit normal towards the body, then tangents
    distance: float  # from the origin along the normal [m]


class Feature(Record):
    """What of a body can touch a plane (`lowest`)."""

    kind: int  # BALL, RIM, NOTCH or ELLIPSOID
    place: Vector  # in the body, or the semi-axes of an ellipsoid [m]
    radius: float  # [m]


class PlaneContact(Record):
    """A contact point of this sample."""

    pair: int  # of plane and feature: which row of the memory is its own
    plane: int
    share: float  # of the stiffness
    arm: Vector  # from the body's centre [m]
    gap: float  # at the end of the sample without contact [m]
    speed: Vector  # there, along the plane's normal and tangents [m/s]
    pressed: bool  # it bears a force
    slip: Vector  # along the normal and the tangents [m/s]
    stretch: Vector  # along the tangents, since it stuck; the first entry is not used [m]


class FloorState(Record):
    """A body's planes, features and contacts, and the law of contact."""

    plane_count: int
    feature_count: int
    stiffness: float  # k of a contact point [N/m]
    damping: float  # b [N s/m]
    friction: float  # mu
    reach: float  # from the centre to the farthest point [m]
    problem: Ref[FrictionProblem]  # of as many contacts as there can be
    problem_entries: int
    touching: int  # contacts in the last sample
    associated: int  # samples in which no answer of Coulomb's law was found and the associated one stands
    force: Vector  # of the planes on the body in the last sample [N]
    moment: Vector  # [N m]
    unknowns: Floats = floats("6")  # that the next search starts from
    finger_force: Vector  # of the fingers, while that of the planes is added [N]
    finger_moment: Vector  # [N m]
    before: Motion  # at the sample's beginning
    planes: Many[FloorPlane] = many("plane_count")
    features: Many[Feature] = many("feature_count")
    memory: Table = table("plane_count * feature_count", "2")  # stretch of each pair's contact [m]
    contacts: Many[PlaneContact] = many("9 * plane_count + feature_count")  # before those of a plane are thinned out
    modes: Floats = floats("6 * (1 + 3 * (9 * plane_count + feature_count))")  # the columns of M^-1/2 G
    problem_room: Floats = floats("problem_entries")
