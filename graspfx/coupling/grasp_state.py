"""The state of a grasped object, as it stands in a block: the object, its coupling, its fingers, what solvers need."""

from __future__ import annotations

from graspfx.compile.records import Floats, Many, Record, Ref, Table, floats, many, room, table
from graspfx.cones.problem import FrictionProblem
from graspfx.coupling.recoil_state import RecoilState
from graspfx.grasp.contact_state import FramedContact, Freedom
from graspfx.objects.body_state import BodyState, Motion
from graspfx.spatial import Matrix, Vector, Vector4
from graspfx.surfaces.triangles.mesh_finger import MeshFinger
from graspfx.surfaces.triangles.mesh_tree import MeshTree


class FingerState(FramedContact):
    """A finger; frame O is the object's, in which contact, normal and contact frame are, W the world's."""

    position: Vector  # p, W [m]
    velocity: Vector  # p', W [m/s]
    face: int  # active face of a box, -1 not known
    gap: float  # positive outside [m]
    touching: bool
    displacement: Vector4  # e = p - c, O, and rho theta of a soft finger [m]
    rate: Vector4  # e', O, and rho theta' [m/s]
    force: Vector  # on the object, W [N]
    contact_world: Vector  # c, W [m]
    local: Vector4  # force, O, and torsion / rho [N]
    split_contact: Vector  # c, weight and normal that the modes were computed from
    split_weight: float
    split_normal: Vector
    share: float  # of the metric: the device's mass over the mean, 1 for equal devices
    coefficient: float  # mu
    status: int  # 0 free, 1 stick, 2 slide, where there is a coefficient
    retained: Vector4  # e + s, what slipping and letting go leave of the displacement, O [m]
    anchor: Matrix  # the object's rotation from which torsion counts
    torsion_at_anchor: float  # rho theta [m]
    twist_axis: Vector  # direction in which torsion acts on the object, O
    moment: Vector  # torsion on the object, W [N m]
    radius: float  # of a ball fingertip, 0 for a point [m]
    elastic: Vector4  # `local` without damping, where it is wanted
    sqrt_weight: float  # where there is a projection
    gains_contact: Vector  # c, weight and normal that K and D were computed from
    gains_weight: float
    gains_normal: Vector
    walk: Ref[MeshFinger]  # its state on a mesh, where the shape is one
    limit: float  # largest force of its device, infinite where there is none [N]
    cut: float  # limit that its cone is cut off at, infinite except while it is [N]
    saturated: bool  # at its limit
    law_force: Vector  # the law's own, before limits, W [N]
    carried: Vector4  # P f, its part of the least force of the same wrench, O [N]
    normal_world: Vector  # into the object, W, where some finger is soft or has friction
    twist_axis_world: Vector
    pad: float  # k of its compliant fingertip, 0 where it has none [N/m^1.5]


class Gain(Record):
    """A gain that is a matrix."""

    whole: bool  # (n d) x (n d), else n times d x d
    of_object: bool  # 6 x 6, on the object's freedoms, its external gain (`object_gains`)
    first: int  # of its entries among those of all four


class PadState(Record):
    """A finger's compliant fingertip in the search for its depth (`pad`)."""

    depth: float  # delta [m]
    whole: Vector4  # e, of which the law gets e - delta n
    push: float  # f_n of a pass [N]
    stretch: float  # and e_n - delta, which goes with it [m]
    before_push: float  # of the pass before
    before_stretch: float
    from_push: float  # of the pass that the next step starts from
    from_stretch: float
    from_depth: float
    bound: float  # sum of its row of the normals' part of K [N/m]
    pushes: bool  # in the sample for which B was filled
    presses: bool  # may have a depth
    moves: bool  # is not held at none


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
    shape: int  # kind
    parameters: Vector  # of the shape, zero of a mesh
    mesh: Ref[MeshTree]  # where the shape is one
    mixed: bool  # only some translations or some rotations are free: the modes turn with the object
    centre: Vector  # of the object in this sample, W, where `mixed` [m]
    mode_count: int  # modes in use
    split_known: bool
    shortfall: float  # by how much `fade_start` was too small, at most over the run [m]
    singular: bool  # some direction has no damping while others have
    friction: bool  # some finger has a coefficient: forces lie in cones, and contact points slip
    coordinates: int  # contact coordinates per finger, c: d, or 4 in space where some finger is soft
    width: int  # entries of a finger in a mode: 3, or 4 where some finger is soft
    unknowns: int  # n c, and the object's free directions under the implicit integrator
    components: int  # n c where gains are matrices, else 0
    matrix_entries: int  # of the four gains together, 0 where they are numbers
    object_freedoms: int  # 6 where the external gains are the object's, else 0
    law: int  # that the elastic force of this sample satisfies: 0 Coulomb's, 1 the associated one
    residual: float  # of that law [N]
    force_bound: float  # largest force of a finger that the law may give: more is a fault [N]
    excess: float  # the force of that fault [N]
    problem: Ref[FrictionProblem]  # of the elastic force
    damping_problem: Ref[FrictionProblem]  # of the damping force
    rays: bool  # without friction, and gains are numbers: forces along the normals
    observed: bool  # the elastic force is wanted
    stiffness_rule: int  # how K of matrices is composed: equal, literal, symmetric (`gains`)
    damping_rule: int  # and D
    axes_of_gains: int  # in which they stand: the object's, or none; the world's; the contacts' (`gains`)
    kep: Gain  # external stiffness, where gains are matrices
    ked: Gain
    kip: Gain
    kid: Gain
    stiffness_skew: float  # the largest sum of squares of K - K' so far
    damping_skew: float
    blended: int  # rotations that are not in the split whole, though they have an arm
    in_band: float  # samples with such a rotation
    release: float  # 1/2 |Kep^-1 - Kip^-1| of matrices [m/N]
    limited: bool  # some device has a largest force
    guarded: bool  # forces pass a safety chain
    squeeze: float  # lambda and alpha of `scaling` in this sample, where there is a chain
    outer: float
    gradual: bool  # damping grows with depth (`depth`)
    damping_depth: float  # over which it grows [m]
    stiffest: Vector  # of gains that are matrices: the largest eigenvalues of kip, ked and kid
    padded: bool  # some finger has a compliant fingertip (`pad`)
    padded_count: int  # n where some finger has one, else 0
    pads_known: bool  # B has been filled
    pad_passes: int  # of the last search for depths
    recoils: bool  # the object moves under the forces of the sample, and gains are numbers (`recoil`)
    recoil_entries: int  # of `recoil`, 0 where it does not
    gains_known: bool
    gains_rotation: Matrix  # of the object, that K and D were computed from
    freedom: Freedom
    body: BodyState
    mode_force: Floats = floats("6")  # what each mode adds to the internal force
    fingers: Many[FingerState] = many("count")
    modes: Table = table("6", "1 + width * count")  # a blend, then each finger's motion (`grasp.rigid_modes`)
    recoil: RecoilState = room("recoil_entries")
    square: Table = table("unknowns", "unknowns")  # the law in contact frames; pivots change it
    vector: Floats = floats("unknowns")  # that goes with it
    diagonal: Floats = floats("unknowns")  # of the square before any pivot
    start: Floats = floats("count * coordinates")  # what a projection starts from: displacement, or elastic force
    marks: Floats = floats("count * coordinates")  # 1.0 for a contact coordinate to be released
    engaged: Floats = floats("count")  # 1 engaged, 0 released, -1 left alone
    part: Table = table("count * coordinates", "count * coordinates")  # K or D / T by itself, implicit integrator
    rest: Floats = floats("count * coordinates")  # vector that goes with it
    levers: Table = table("6", "count * coordinates")  # G in contact frames, implicit integrator
    stiffness: Table = table("components", "components")  # K in the object's axes, where gains are matrices
    damping: Table = table("components", "components")  # D
    mode_rows: Table = table("24", "components")  # L^-1 q_k, L q_k, and their products with two gains
    mode_products: Table = table("6", "6")
    wrenches: Table = table("object_freedoms", "2 * object_freedoms")  # of the modes, and what they are reduced by
    motions: Table = table("object_freedoms", "object_freedoms")  # of the object, for unit motions of the modes
    free_gain: Table = table("object_freedoms", "object_freedoms")  # K_o or D_o on the free freedoms
    modal_gain: Table = table("object_freedoms", "object_freedoms")  # A of `object_gains`
    held: Floats = floats("object_freedoms")  # the mode that a freedom goes with, -1 where none does
    directions: Table = table("6", "1 + 4 * count")  # a length, then contact forces that have a wrench (`scaling`)
    skewest_stiffness: Table = table("components", "components")  # the K with the largest skew part so far
    skewest_damping: Table = table("components", "components")
    matrices: Floats = floats("matrix_entries")  # kep, ked, kip, kid
    pads: Many[PadState] = many("padded_count")
    pad_slope: Table = table("padded_count", "padded_count")  # B, d f_n/d e_n as it is known [N/m]
    pad_square: Table = table("padded_count", "padded_count")  # of the model, and the vector that goes with it
    pad_vector: Floats = floats("padded_count")

    @property
    def alone(self) -> bool:
        """Whether each finger's force depends on its own displacement alone: the conventional method, numbers."""
        return self.equal and not self.dense and not self.implicit

    @property
    def motion(self) -> Motion:
        """The motion that this sample is about: under the implicit integrator where the object will be."""
        return self.body.next_motion if self.implicit else self.body.motion
