"""Record of a body on fixed planes, in addition to its block: planes, features of the body, contacts."""

from __future__ import annotations

from graspfx.compile.records import Floats, Many, Record, Ref, Table, floats, many, table
from graspfx.cones.problem import FrictionProblem
from graspfx.objects.body_state import Motion
from graspfx.spatial import Matrix, Vector

SIDES = 8  # number of fixed points on a rim, and of directions for selecting a plane's contacts
MOST = SIDES + 1  # largest number of contacts with one plane


class FloorPlane(Record):
    """A fixed plane."""

    frame: Matrix  # rows: the unit normal towards the body, then tangents
    distance: float  # distance from the origin along the normal [m]


class Feature(Record):
    """Part of a body that can touch a plane (`lowest`)."""

    kind: int  # BALL, RIM, NOTCH or ELLIPSOID
    place: Vector  # position in the body [m]; for an ellipsoid its semi-axes
    radius: float  # radius of a ball or rim [m]


class PlaneContact(Record):
    """Contact point of the current sample."""

    pair: int  # index of the pair of plane and feature: its row of the memory
    plane: int
    share: float  # share of the stiffness
    arm: Vector  # position from the body's centre [m]
    gap: float  # gap at the end of the sample without contact forces [m]
    speed: Vector  # velocity at that gap, along the plane's normal and tangents [m/s]
    pressed: bool  # True if the point bears a force
    slip: Vector  # slip velocity along the normal and the tangents [m/s]
    stretch: Vector  # tangential displacement since it stuck; the first entry is not used [m]


class FloorState(Record):
    """Planes, features and contacts of a body, and parameters of the contact law."""

    plane_count: int
    feature_count: int
    stiffness: float  # stiffness k of a contact point [N/m]
    damping: float  # damping b [N s/m]
    friction: float  # coefficient mu
    reach: float  # distance from the centre to the farthest point [m]
    problem: Ref[FrictionProblem]  # problem with room for all contacts
    problem_entries: int
    touching: int  # number of contacts in the last sample
    associated: int  # number of samples without a solution of Coulomb's law, which use the associated law
    force: Vector  # force of the planes on the body in the last sample [N]
    moment: Vector  # its moment [N m]
    unknowns: Floats = floats("6")  # start values of the next search
    finger_force: Vector  # force of the fingers, while that of the planes is added [N]
    finger_moment: Vector  # its moment [N m]
    before: Motion  # motion at the beginning of the sample
    planes: Many[FloorPlane] = many("plane_count")
    features: Many[Feature] = many("feature_count")
    memory: Table = table("plane_count * feature_count", "2")  # stretch of each pair's contact [m]
    contacts: Many[PlaneContact] = many("9 * plane_count + feature_count")  # room before a plane's contacts are thinned
    modes: Floats = floats("6 * (1 + 3 * (9 * plane_count + feature_count))")  # columns of M^-1/2 G
    problem_room: Floats = floats("problem_entries")
