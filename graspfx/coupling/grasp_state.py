"""Block of a grasped object: state of the object, the coupling and the fingers, and workspace of the solvers."""

from __future__ import annotations

from graspfx.compile.records import Floats, Many, Record, Ref, Table, floats, many, room, table
from graspfx.cones.problem import FrictionProblem
from graspfx.grasp.rigid_modes import FramedContact, Freedom
from graspfx.objects.body_state import BodyState, Motion
from graspfx.spatial import Matrix, Vector, Vector4
from graspfx.surfaces.triangles.mesh_tree import MeshFinger, MeshTree


class FingerState(FramedContact):
    """State of a finger; O and W mark vectors in the object's frame and in the world frame.

    Contact, normal and contact frame are expressed in O.
    """

    position: Vector  # p, W [m]
    velocity: Vector  # p', W [m/s]
    face: int  # active face of a box, -1 if unknown
    gap: float  # positive outside [m]
    touching: bool
    displacement: Vector4  # e = p - c, O; for a soft finger also rho theta [m]
    rate: Vector4  # e', O, and rho theta' [m/s]
    force: Vector  # force on the object, W [N]
    contact_world: Vector  # c, W [m]
    local: Vector4  # force, O, and torsion / rho [N]
    split_contact: Vector  # c, weight and normal from which the modes were computed
    split_weight: float
    split_normal: Vector
    share: float  # weight in the metric, such as the device's mass over the mean mass; 1 for equal weights
    coefficient: float  # mu
    status: int  # 0 free, 1 stick, 2 slide, with a coefficient of friction
    retained: Vector4  # e + s, displacement that remains after slip and release, O [m]
    anchor: Matrix  # the object's rotation at zero torsion
    torsion_at_anchor: float  # rho theta [m]
    twist_axis: Vector  # direction in which torsion acts on the object, O
    moment: Vector  # torsion on the object, W [N m]
    radius: float  # radius of a ball fingertip, 0 for a point [m]
    elastic: Vector4  # elastic part of `local`, if needed
    sqrt_weight: float  # square root of `weight`, only with a projection
    gains_contact: Vector  # c, weight and normal from which K and D were computed
    gains_weight: float
    gains_normal: Vector
    walk: Ref[MeshFinger]  # search state of the finger on a mesh shape
    limit: float  # largest force of the finger's device, infinite without a limit [N]
    cut: float  # limit at which the finger's cone is cut off, infinite for a whole cone [N]
    saturated: bool  # force is at its limit
    law_force: Vector  # force by the law, before limits, W [N]
    carried: Vector4  # P f: the finger's part of the smallest forces with the same wrench, O [N]
    normal_world: Vector  # normal into the object, W, if some finger is soft or has friction
    twist_axis_world: Vector
    pad: float  # stiffness k of the compliant fingertip, 0 if rigid [N/m^1.5]


class Gain(Record):
    """Format and location of a matrix gain in the block."""

    whole: bool  # one (n d) x (n d) matrix, otherwise n matrices d x d
    of_object: bool  # 6 x 6 external gain on the object's degrees of freedom (`object_gains`)
    first: int  # index of the gain's first entry among the entries of all four gains


class PadState(Record):
    """State of a compliant fingertip in the search for its depth (module `pad`)."""

    depth: float  # delta [m]
    whole: Vector4  # e; the law uses e - delta n
    push: float  # f_n of the present pass [N]
    stretch: float  # e_n - delta of the present pass [m]
    before_push: float  # f_n of the previous pass
    before_stretch: float
    from_push: float  # f_n of the pass from which the next step starts
    from_stretch: float
    from_depth: float
    bound: float  # row sum of the normals' part of K [N/m]
    pushes: bool  # whether the finger pushed in the sample for which B was filled
    presses: bool  # whether the fingertip may have a depth
    moves: bool  # whether the depth is free, not held at zero


class RecoilState(Record):
    """Levers, linear systems and columns of the law for an object that moves within the sample (module `recoil`).

    Directions are the object's free directions, translations first. V denotes the columns of a law K = W^1/2 (A - V E
    V') W^1/2.
    """

    most: int  # largest number of columns
    twisted: bool  # torsion acts along axes other than the normals, so elastic levers are not sums of modes
    distant: bool  # rates and damping levers refer to the fingertips, not the contacts
    current: bool  # elastic levers belong to the present modes
    stuck: bool  # all forces of the last sample were inside their cones
    elastic_share: Table = table("6", "6")  # T = Q'sqrt(W) G', one row per mode
    elastic_weight: Table = table("6", "6")  # G W G' of rotations
    damping_share: Table = table("6", "6")  # T with H, the levers of damping, in place of G
    damping_weight: Table = table("6", "6")
    system: Table = table("6", "6")  # C^-1 + G K G' + H D H' / T
    motion: Floats = floats("6")  # u, along the free directions [m], [rad]
    stretch: Floats = floats("most")  # V'e
    rate: Floats = floats("most")  # V'e'
    near: Table = table("most", "most")  # V'V of the elastic columns
    far: Table = table("most", "most")  # V'R^-1 V of the damping columns
    gram: Table = table("most", "most")  # V'A^-1 V
    elastic_part: Table = table("most", "most")  # k_i E of stiffness; then of damping
    damping_part: Table = table("most", "most")
    whole: Table = table("most", "most")  # E of stiffness and damping, with the object's motion eliminated
    levers: Table = table("most", "6")  # coefficients of K G' + D H' / T on the columns
    products: Table = table("most", "6")  # work
    turned: Table = table("6", "6")  # work
    work: Table = table("most", "most")
    signs: Floats = floats("most")
    row: Floats = floats("most")


class GraspState(Record):
    """State of a grasped object: motion, shape, coupling and fingers. Switches are 0.0 or 1.0."""

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
    attached: bool  # bilateral: contacts fixed in the object, without normals
    stick: bool  # a touching finger sticks to its contact point
    fade: bool  # a free finger's weight decreases with its gap
    fade_start: float  # gap at which the decrease starts [m]
    fade_end: float
    at_contact: bool  # the reaction acts at the contact point, otherwise at the fingertip
    implicit: bool  # forces and the object's displacement are solved together
    arm_low: float  # rms arms between which a rotation enters the external space [m]
    arm_high: float
    shape: int  # kind
    parameters: Vector  # parameters of the shape, zero for a mesh
    mesh: Ref[MeshTree]  # mesh, if the shape is one
    mixed: bool  # only some translations or some rotations are free: the modes turn with the object
    centre: Vector  # centre of the object in this sample, W, if `mixed` [m]
    mode_count: int  # modes in use
    split_known: bool
    shortfall: float  # largest amount in the run by which `fade_start` was too small [m]
    singular: bool  # the external or the internal damping is zero in some direction
    friction: bool  # some finger has a coefficient: forces lie in cones, and contact points slip
    coordinates: int  # contact coordinates per finger, c: d, or 4 if some finger is soft
    width: int  # entries of a finger in a mode: 3, or 4 if some finger is soft
    unknowns: int  # n c, plus the number of the object's free directions with the implicit integrator
    components: int  # n c for matrix gains, else 0
    matrix_entries: int  # entries of all four gains, 0 if they are scalars
    object_freedoms: int  # 6 if the external gains are those of the object, else 0
    law: int  # friction law of this sample's elastic force: 0 Coulomb's, 1 the associated law, 2 unresolved
    residual: float  # residual of that law [N]
    force_bound: float  # largest force that the law may compute for a finger; a larger force is a fault [N]
    excess: float  # force that exceeded the bound [N]
    problem: Ref[FrictionProblem]  # friction problem of the elastic force
    damping_problem: Ref[FrictionProblem]  # friction problem of the damping force
    rays: bool  # scalar gains without friction: forces along the normals
    observed: bool  # an observer of energy needs the elastic force
    stiffness_rule: int  # composition of K from matrix gains: equal, literal, symmetric (`gains`)
    damping_rule: int  # composition of D
    axes_of_gains: int  # axes of matrix gains: the object's or none, the world's, the contacts' (`gains`)
    kep: Gain  # external stiffness, for matrix gains
    ked: Gain
    kip: Gain
    kid: Gain
    stiffness_skew: float  # largest sum of squares of K - K' so far
    damping_skew: float
    blended: int  # number of rotations with an arm that have a partial weight in the split
    in_band: float  # samples with such a rotation
    release: float  # 1/2 |Kep^-1 - Kip^-1| of matrix gains [m/N]
    limited: bool  # some device has a largest force
    guarded: bool  # forces pass a safety chain
    squeeze: float  # lambda of `limit.scale` in this sample, with a safety chain
    outer: float
    gradual: bool  # damping grows with depth (`depth`)
    damping_depth: float  # depth at which damping reaches its full value [m]
    stiffest: Vector  # for matrix gains: the largest eigenvalues of kip, ked and kid
    padded: bool  # some finger has a compliant fingertip (`pad`)
    padded_count: int  # n if some finger has a compliant fingertip, else 0
    pads_known: bool  # B has been filled
    pad_passes: int  # passes of the last search for depths
    recoils: bool  # the object moves under the sample's forces, with scalar gains (`recoil`)
    recoil_entries: int  # entries of `recoil`, 0 without recoil
    gains_known: bool
    gains_rotation: Matrix  # the object's rotation from which K and D were computed
    freedom: Freedom
    body: BodyState
    mode_force: Floats = floats("6")  # contribution of each mode to the internal force
    fingers: Many[FingerState] = many("count")
    modes: Table = table("6", "1 + width * count")  # a blend, then each finger's motion (`grasp.rigid_modes`)
    recoil: RecoilState = room("recoil_entries")
    square: Table = table("unknowns", "unknowns")  # the law in contact frames; pivots change it
    vector: Floats = floats("unknowns")  # vector of the law in contact frames
    diagonal: Floats = floats("unknowns")  # diagonal of `square` before pivoting
    start: Floats = floats("count * coordinates")  # input of a projection: displacement, or elastic force
    marks: Floats = floats("count * coordinates")  # 1.0 for a contact coordinate to be released
    engaged: Floats = floats("count")  # 1 engaged, 0 released, -1 unchanged
    part: Table = table("count * coordinates", "count * coordinates")  # K or D / T alone, implicit integrator
    rest: Floats = floats("count * coordinates")  # vector of `part`
    levers: Table = table("6", "count * coordinates")  # G in contact frames, implicit integrator
    stiffness: Table = table("components", "components")  # K in the object's axes, for matrix gains
    damping: Table = table("components", "components")  # D
    mode_rows: Table = table("24", "components")  # L^-1 q_k, L q_k, and their products with two gains
    mode_products: Table = table("6", "6")
    wrenches: Table = table("object_freedoms", "2 * object_freedoms")  # wrenches of the modes, and their reduction
    motions: Table = table("object_freedoms", "object_freedoms")  # motions of the object for unit motions of the modes
    free_gain: Table = table("object_freedoms", "object_freedoms")  # K_o or D_o on the free degrees of freedom
    modal_gain: Table = table("object_freedoms", "object_freedoms")  # A of `object_gains`
    held: Floats = floats("object_freedoms")  # mode of each degree of freedom, -1 if no mode holds it
    directions: Table = table("6", "1 + 4 * count")  # directions with a wrench: length, forces (`limit`)
    skewest_stiffness: Table = table("components", "components")  # K with the largest skew part so far
    skewest_damping: Table = table("components", "components")
    matrices: Floats = floats("matrix_entries")  # kep, ked, kip, kid
    pads: Many[PadState] = many("padded_count")
    pad_slope: Table = table("padded_count", "padded_count")  # B, the present estimate of d f_n/d e_n [N/m]
    pad_square: Table = table("padded_count", "padded_count")  # matrix of the model
    pad_vector: Floats = floats("padded_count")

    @property
    def alone(self) -> bool:
        """Whether each force depends only on the displacement of its own finger.

        This is the conventional method with scalar gains and without the implicit integrator.
        """
        return self.equal and not self.dense and not self.implicit

    @property
    def motion(self) -> Motion:
        """Motion of the object in this sample, or its predicted motion with the implicit integrator."""
        return self.body.next_motion if self.implicit else self.body.motion
