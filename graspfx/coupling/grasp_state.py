"""The state of a grasped object, as it stands in a block: the object, its coupling, its fingers, what solvers need."""

from __future__ import annotations

from graspfx.compile.records import Floats, Many, Record, floats, many
from graspfx.objects.body_state import BodyState, Motion
from graspfx.spatial import Matrix, Vector, Vector4


class FingerState(Record):
    """A finger; frame O is the object's, W the world's."""

    position: Vector  # p, W [m]
    velocity: Vector  # p', W [m/s]
    contact: Vector  # c, O: on the surface, which for a ball fingertip is grown by its radius [m]
    normal: Vector  # into the object, O
    face: int  # active face of a box, -1 not known
    gap: float  # positive outside [m]
    weight: float
    touching: bool
    displacement: Vector4  # e = p - c, O, and rho theta of a soft finger [m]
    rate: Vector4  # e', O, and rho theta' [m/s]
    force: Vector  # on the object, W [N]
    contact_world: Vector  # c, W [m]
    frame: Matrix  # normal and tangents as rows, O
    local: Vector4  # force, O, and torsion / rho [N]
    split_contact: Vector  # c and weight that the modes were computed from
    split_weight: float
    share: float  # of the metric: the device's mass over the mean, 1 for equal devices
    coefficient: float  # mu
    status: int  # 0 free, 1 stick, 2 slide, where there is a coefficient
    retained: Vector4  # e + s, what slipping and letting go leave of the displacement, O [m]
    patch: float  # rho of a soft finger, 0 of a hard one [m]
    split_normal: Vector  # normal that the modes of soft fingers were computed from
    anchor: Matrix  # the object's rotation from which torsion counts
    torsion_at_anchor: float  # rho theta [m]
    twist_axis: Vector  # direction in which torsion acts on the object, O
    moment: Vector  # torsion on the object, W [N m]
    radius: float  # of a ball fingertip, 0 for a point [m]
    elastic: Vector4  # `local` without damping, where it is wanted
    sqrt_weight: float  # where there is a projection


class GraspState(Record):
    """An object, its coupling and its shape; switches are 0.0 or 1.0."""

    count: int  # n
    dimensions: int  # d
    period: float  # T [s]
    external_stiffness: float  # kep [N/m]
    external_damping: float  # ked [N s/m]
    internal_stiffness: float  # kip [N/m]
    internal_damping: float  # kid [N s/m]
    equal: bool  # kep = kip and ked = kid: the conventional method, no projector
    dense: bool  # gains are matrices
    damped: bool  # some damping is not zero
    attached: bool  # bilateral: contacts fixed in the object, no normals
    stick: bool  # a touching finger holds where it touched
    fade: bool  # a free finger's weight goes down with its gap
    fade_start: float  # gaps between which it does [m]
    fade_end: float
    at_contact: bool  # the reaction acts at the contact point, else at the fingertip
    implicit: bool  # forces and the object's displacement come from one system
    arm_low: float  # rms arms between which a rotation joins the external space [m]
    arm_high: float
    shape: int  # kind; parameters in the next three
    parameters: Vector  # of a mesh instead: offsets of its array and of the first finger's state on it
    shifts: int  # free translations
    turns: int  # free rotations
    mixed: bool  # only some translations or some rotations are free: the modes turn with the object
    mode_count: int  # modes in use
    split_known: bool
    shortfall: float  # by how much `fade_start` was too small, at most over the run [m]
    singular: bool  # some direction has no damping while others have
    friction: bool  # some finger has a coefficient: forces lie in cones, and contact points slip
    coordinates: int  # contact coordinates per finger, c: d, or 4 in space where some finger is soft
    law: int  # that the elastic force of this sample satisfies: 0 Coulomb's, 1 the associated one
    residual: float  # of that law [N]
    problem: int  # offset of the friction problem of the elastic force
    damping_problem: int  # and of the damping force
    rays: bool  # without friction, and gains are numbers: forces along the normals
    observed: bool  # the elastic force is wanted
    stiffness_rule: int  # how K of matrices is composed: equal, literal, symmetric (`gains`)
    damping_rule: int  # and D
    axes_of_gains: int  # in which they stand: the object's, or none; the world's; the contacts' (`gains`)
    whole: Floats = floats("4")  # kep, ked, kip, kid: 1.0 for (n d) x (n d), else n times d x d
    gains: Floats = floats("4")  # offsets of the four
    skew: Floats = floats("2")  # the largest sum of squares of K - K', then of D - D', so far
    blended: int  # rotations that are not in the split whole, though they have an arm
    in_band: float  # samples with such a rotation
    release: float  # 1/2 |Kep^-1 - Kip^-1| of matrices [m/N]
    limits: int  # offset of what limits on forces need (`limit`), 0 without any
    axes: Floats = floats("18")  # free directions in the object's frame, 6 x 3
    gradual: bool  # damping grows with depth (`depth`)
    damping_depth: float  # over which it grows [m]
    stiffest: Vector  # of gains that are matrices: the largest eigenvalues of kip, ked and kid
    body: BodyState
    fingers: Many[FingerState] = many("count")

    @property
    def motion(self) -> Motion:
        """The motion that this sample is about: under the implicit integrator where the object will be."""
        return self.body.next_motion if self.implicit else self.body.motion
