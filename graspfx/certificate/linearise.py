"""Linearisation of a scene about an equilibrium of its grasps."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from os import PathLike

import numpy as np
from numpy.typing import NDArray

from graspfx import plugins
from graspfx.analysis.blas_threads import one_blas_thread
from graspfx.analysis.linearisation import Linearisation
from graspfx.assembly.grasps import set_fade, still_hands
from graspfx.assembly.mechanics import mechanics
from graspfx.assembly.resolve import ObjectPart, Parts, require_no_host, resolve
from graspfx.certificate.grip import EDGE, LOW, Grip, Ground, edge_directions, ground_under
from graspfx.certificate.matrices import (
    ScaledGains,
    assumptions,
    block_diagonal,
    contact_axes,
    force_directions,
    joined_pads,
    operated,
    pads_of,
)
from graspfx.certificate.operating_point import OperatingPoint, provisional, require_contact, squeezed
from graspfx.certificate.recorded import lateness_ends, less_stable, recorded, recording_of, set_pose
from graspfx.coupling.grasp_state import FingerState
from graspfx.errors import InputError, NoRestError, UnknownNameError
from graspfx.grasp.grasp import Grasp
from graspfx.grasp.impedance import Coupling
from graspfx.grasp.split import Split
from graspfx.loop.servo_parts import GraspedPart
from graspfx.objects import integrators as body
from graspfx.objects.dynamics_table import dynamics_of
from graspfx.recording.record import Recording
from graspfx.scene.model import Scene
from graspfx.scene.tables.part_tables import Object

FloatArray = NDArray[np.float64]

WHERE = ("squeezed", "start", "provisional", "recorded")
TOLD = ("explicit", "semi-implicit", "exact", "bullet")  # integrators of plug-ins; "implicit" would need their forces
STIFFEST = 1e-6  # relative to the largest stiffness: smaller effects of a preload are rounding of difference quotients


@dataclass(frozen=True, eq=False)
class Linearised:
    """Grasped objects of a scene with their fingers, linearised about an equilibrium.

    The n fingers have m = n d coordinates, along the principal axes of their devices' masses. The principal axes are
    the world axes unless the mass of a device depends on direction.

    Attributes:
        linear: Matrices of the loop.
        objects: Names of the objects, in the order of their coordinates.
        fingers: Indices of the fingers in the scene, in the order of their coordinates.
        finger_of_column: Index in the scene of the finger of each coordinate, (m,).
        contacts: Contact points in world axes, (n, d) [m].
        tips: Fingertips in world axes, (n, d) [m].
        normals: Unit normals into the object in world axes, (n, d).
        forces: Forces of the fingers on the object in equilibrium in world axes, (n, d) [N]; nan at the start.
        at: State of each object, as the argument `at` of `linearise`.
        assumed: Assumptions of the matrices, as sentences.
        splits: Split of each object's grasp.
        laws: Coupling law of each object, with matrices in world axes.
        margins: Ratio f_t/(mu f_n) of tangential force to largest friction force of each finger in equilibrium, (n,);
            nan without a coefficient of friction mu or a normal force f_n.
        edge: Indices in the scene of the fingers whose forces lie on the edges of their friction cones.
        slip: Matrices T and V (m, len(edge)) of the fingers in `edge`, from `edge_directions`.
        standing: Ground under each object at the start, which `linear` does not include; None for an object in the air.
        fade: For each object, the gap at which a free finger begins to fade out of the split, and the smallest gap at
            which it may begin to do so with the forces in equilibrium [m]; None if fingers do not fade.
        stiffness: Function of (a, b, c) that returns the stiffness matrix (m, m) with the external gain for
            translations times a, the external gain for rotations times b, and the internal gain times c.
        damping: Function of (a, b) that returns the damping matrix (m, m) with the external damping times a and the
            internal damping times b.
        gains: Stiffness matrices (m, m) of translations, of rotations and of internal displacements, if `stiffness`
            returns their sum with the factors a, b and c; otherwise None.
        conventional: Function of k that returns the stiffness matrix (m, m) of fingers that all have the stiffness k.
        compliance: If damping grows with penetration depth, compliance of the damper that is in series with each
            coordinate, (m,) [m/(N s)]; zero at full damping.
        pads: Normals (m, p) of the p compliant fingertips, and their stiffness in equilibrium (p,) [N/m]; None if there
            are none.
        geometric: For each object with a specified stiffness, the stiffness (r, r) that the contact forces in
            equilibrium add to it, in the object's free degrees of freedom, with moments about its centre. None for
            other objects and at the start.
    """

    linear: Linearisation
    objects: tuple[str, ...]
    fingers: tuple[int, ...]
    finger_of_column: NDArray[np.intp]
    contacts: FloatArray
    tips: FloatArray
    normals: FloatArray
    forces: FloatArray
    at: tuple[str, ...]
    assumed: tuple[str, ...]
    splits: tuple[Split, ...] = field(repr=False)
    laws: tuple[Coupling, ...] = field(repr=False)
    margins: FloatArray
    edge: tuple[int, ...]
    slip: tuple[FloatArray, FloatArray] = field(repr=False)
    standing: tuple[Ground | None, ...] = field(repr=False)
    fade: tuple[tuple[float, float] | None, ...]
    stiffness: Callable[[float, float, float], FloatArray] = field(repr=False)
    damping: Callable[[float, float], FloatArray] = field(repr=False)
    gains: tuple[FloatArray, ...] | None = field(repr=False)
    conventional: Callable[[float], FloatArray] = field(repr=False)
    compliance: FloatArray = field(repr=False)
    pads: tuple[FloatArray, FloatArray] | None = field(repr=False)
    geometric: tuple[FloatArray | None, ...] = field(repr=False)


@one_blas_thread()
def linearise(
    scene: Scene, at: str = "squeezed", object: str | None = None, recording: Recording | None = None
) -> Linearised:
    """Linearise small motions of a scene about an equilibrium of its grasps.

    Contacts that touch are treated as sticking, even if they slid before or their forces lie on the edges of the
    friction cones.

    | `at` | state |
    |---|---|
    | "squeezed" | equilibrium with the hands closed to their largest squeeze, without other motion of the hands |
    | "provisional" | approximation of this equilibrium by one linear step from the start |
    | "recorded" | last row of a recording |
    | "start" | fingers at the object's surface, without forces |

    An operator can move a finger on hardware to any position. Therefore, if such a finger does not touch the object in
    the equilibrium, "start" is used instead, and `assumed` of the result states this.

    Args:
        scene: Scene.
        at: State about which the scene is linearised.
        object: Name of the object to linearise; if None, all objects that fingers touch are linearised together.
        recording: Recording of the scene, if `at` is "recorded". A recording of hardware also determines the delay of
            forces.

    Raises:
        InputError: If a device does not state its mass or friction; objects with different integrators are linearised
            together; or no finger touches an object (`NotGraspingError`) and `at` is not "start".
        NoRestError: If no equilibrium of a grasp is found.
        UnknownNameError: If no object has the name `object`, or `at` is not one of the states.
    """
    require_no_host(scene, "a certificate")
    if at not in WHERE:
        raise UnknownNameError("operating point", at, WHERE)
    names = [thing.name for thing in scene.object]
    if object is not None and object not in names:
        raise UnknownNameError("object", object, names)
    touched = sorted(set(scene.finger_objects))
    selection = touched if object is None else [names.index(object)]
    parts = resolve(scene)
    shares = [_share(parts, index, at, recording) for index in selection]
    kinds = sorted({share.integrator for share in shares})
    if len(kinds) > 1:
        raise InputError("object", kinds, "one integrator", f"linearise the objects one by one: {', '.join(names)}")
    return _joined(parts, shares, recording)


def recorded_loop(scene: Scene, recording: Recording | str | PathLike[str]) -> Linearisation:
    """Linearise a scene about the state at the end of a recording, with the delays of forces that were recorded.

    Args:
        scene: Scene.
        recording: Recording of the scene, or its path.

    Raises:
        InputError: If the recording is of another scene or has no rows, or a device does not state its mass or
            friction.
        NoRestError: If only some fingers touch the object in the last row, a finger pulls, or forces do not converge.
        RecordingError: If the file at the path is missing or not a recording.
    """
    return linearise(scene, "recorded", recording=recording_of(scene, recording)).linear


# One object ----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _ObjectMatrices:
    """Matrices of one object and its fingers in world axes, before those of several objects are joined."""

    name: str
    fingers: NDArray[np.intp]
    grip: Grip
    place: OperatingPoint
    assumed: list[str]
    edge: NDArray[np.intp]
    slip: tuple[FloatArray, FloatArray]
    ground: Ground | None
    standing: Ground | None
    split: Split
    gains: ScaledGains
    G: FloatArray
    G_e: FloatArray
    G_c: FloatArray
    N: FloatArray
    contacts: FloatArray
    viscosity: FloatArray
    integrator: str
    geometric: FloatArray | None

    @property
    def force(self) -> FloatArray:
        """Forces in equilibrium (n, d) [N]; nan at the start."""
        g = self.grip.grasped
        return np.full_like(g.force, np.nan) if self.place.stiffness is None else g.force


def _share(parts: Parts, index: int, where: str, recording: Recording | None) -> _ObjectMatrices:
    scene, part, start = parts.scene, parts.objects[index], parts.start
    # forces are functions of the pose; with "implicit", of the predicted pose, which the analysis inserts
    grasped, fingers = part.grasped(predicts=False), part.fingers
    state = grasped.body_state
    state[body.VELOCITY : body.VELOCITY + 3] = state[body.ANGULAR_VELOCITY : body.ANGULAR_VELOCITY + 3] = 0.0
    grasped.meet(start[fingers])
    grip = Grip(grasped, np.array(scene.free(part.table)))
    inward = np.zeros_like(start)
    inward[fingers] = grasped.inward()
    set_fade(parts, [GraspedPart(part.name, grasped, fingers)], inward, start)
    initial = grip.changing.copy()
    place, ground, standing = OperatingPoint("start", None, np.full(grip.n, np.nan)), None, None
    if where == "recorded":
        if recording is None:
            raise InputError("recording", None, "a recording of the scene that ends at rest")
        set_pose(grip, recording, part.name)
        ground = ground_under(parts, index, grip)
        place = recorded(scene, index, grip, fingers, recording, ground)
    elif where != "start":
        standing = ground_under(parts, index, grip, lower=LOW)
        try:
            place = {"squeezed": squeezed, "provisional": provisional}[where](parts, index, grip, fingers)
        except NoRestError:
            grip.changing[:] = initial
            require_contact(parts, index, grip, fingers)
            raise
    if place.stiffness is None:
        grip.changing[:] = initial
        if where in ("squeezed", "provisional"):
            require_contact(parts, index, grip, fingers)
            grip.changing[:] = initial
        grasped.finger_position[:] = start[fingers]
        ground = None
    return _matrices(parts, part, grip, place, ground, standing)


def _matrices(
    parts: Parts, part: ObjectPart, grip: Grip, place: OperatingPoint, ground: Ground | None, standing: Ground | None
) -> _ObjectMatrices:
    scene, table, fingers, g = parts.scene, part.table, part.fingers, grip.grasped
    J, assumed, state, rules = place.stiffness, place.assumed, g.body_state, scene.coupling
    n, d, m, r = grip.n, grip.d, grip.m, grip.r
    R = state[body.ROTATION : body.ROTATION + 9].reshape(3, 3)
    centre = state[body.POSITION : body.POSITION + d]
    contacts = (g.array(FingerState.contact) @ R.T)[:, :d]
    tips = contacts if J is None else g.finger_position - centre
    weights = g.array(FingerState.share).copy()
    split = Split(Grasp(contacts, free=grip.free.tolist()), metric=None if (weights == 1.0).all() else weights)
    normals = force_directions(scene, grip, fingers)
    if normals is not None and normals.shape[1] == n:
        assumed.append("contacts without friction: forces act along the normals only")
    elif normals is not None:
        smooth = ", ".join(scene.finger_names[i] for i in fingers if not scene.coefficients[i])
        assumed.append(f"contacts stick, except {smooth} without friction: forces act along the normals only")
    elif rules.contact != "attached" and d > 1:
        assumed.append("contacts stick")
    if rules.contact != "attached":
        assumed.append("all fingers stay in contact")
    law = part.law
    if rules.axes != "world":
        law = law.turned(R[:d, :d] if rules.axes == "object" else contact_axes(g, R))
    pads = pads_of(g, at_rest=J is not None)
    if pads is not None and not pads[1].all():
        assumed.append("unloaded pads have no stiffness along their normals")
    compliance = np.repeat(g.damper_compliance(at_rest=J is not None), d)
    of_object = None
    if law.of_object:
        turn = np.kron(np.eye(n), R[:d, :d])
        forces = np.arange(n * g.state.coordinates) % g.state.coordinates < d  # without the torsion of soft fingers
        of_object = tuple(turn @ each[np.ix_(forces, forces)] @ turn.T for each in g.object_gains())
        if g.soft:
            assumed.append("the torsion that object_stiffness gives to soft fingers is not scaled with the gains")
    gains = ScaledGains(law, split, n, normals, pads, compliance, of_object)
    if np.isinf(compliance).any():
        assumed.append("unloaded contacts have no damping, which grows with depth")
    D = gains.damping(1.0, 1.0)
    G, G_e = grip.wrenches(contacts if rules.reaction == "contact" else tips), grip.wrenches(tips)
    N = np.zeros((m + r, m + r))
    if J is not None:
        K = gains(1.0, 1.0, 1.0)
        stretch = np.hstack([np.eye(m), -G_e.T])
        scale = float(np.abs(np.diag(K)).max(initial=0.0))
        N[:m], N[m:] = J[:m] - K @ stretch, G @ K @ stretch - J[m:]
        unit = grip.lengths() / grip.lengths()[0]
        if np.abs(N * np.outer(unit, unit)).max(initial=0.0) <= STIFFEST * scale:
            N[:] = 0.0
    geometric = None
    if of_object is not None and J is not None:
        geometric = G @ K @ G_e.T + N[m:, m:] - _unsqueezed(grip, K, contacts, R)
    if not N.any():  # without a preload, moment arms end at the contacts
        G = G_e = grip.wrenches(contacts)
    if ground is not None:
        assumed.append(
            f"the object stands on {', '.join(ground.names)} with {ground.points} points, which stick and carry load"
        )
    outside = ", ".join(scene.finger_names[i] for i in fingers[place.margins > 1.0 + EDGE])
    if outside:
        assumed.append(f"{outside} would slide here: beyond the cone's edge")
    edge = np.flatnonzero(np.abs(place.margins - 1.0) <= EDGE)
    viscosity = np.diag(np.where(grip.axes < 3, state[body.VISCOSITY], state[body.ROTATIONAL_VISCOSITY]))
    if g.soft and J is not None and D.any():
        turning = grip.axes >= 3
        extra = (grip.turning_damping() - G @ D @ G_e.T)[np.ix_(turning, turning)]
        viscosity[np.ix_(turning, turning)] += extra
        assumed.append("the damping of torsion is treated as the object's own viscosity")
    return _ObjectMatrices(
        name=table.name,
        fingers=fingers,
        grip=grip,
        place=place,
        assumed=assumed,
        edge=fingers[edge],
        slip=edge_directions(g, edge.tolist()),
        ground=ground,
        standing=standing,
        split=split,
        gains=gains,
        G=G,
        G_e=G_e,
        G_c=grip.wrenches(contacts),
        N=N,
        contacts=contacts + centre,
        viscosity=viscosity,
        integrator=_integrator(parts, table, assumed),
        geometric=geometric,
    )


def _unsqueezed(grip: Grip, K: FloatArray, contacts: FloatArray, R: FloatArray) -> FloatArray:
    """Compute the stiffness G K G' (r, r) that an object has without contact forces, including soft fingers' torsion.

    G is the grasp matrix of the contacts (n, d) relative to the object's centre, K (m, m) the stiffness matrix of the
    fingers, and R the rotation matrix of the object.
    """
    g, G = grip.grasped, grip.wrenches(contacts)
    if not g.soft:
        return np.asarray(G @ K @ G.T)
    n, d, c = grip.n, grip.d, g.state.coordinates
    whole = np.zeros((grip.r, n, c))
    whole[:, :, :d] = (G @ np.kron(np.eye(n), R)).reshape(grip.r, n, d)
    turning = grip.axes >= 3
    whole[turning, :, d] = (g.array(FingerState.patch)[:, None] * g.inward()).T[grip.axes[turning] - 3]
    G = whole.reshape(grip.r, n * c)
    return np.asarray(G @ sum(g.object_gains()[:3]) @ G.T)


def _integrator(parts: Parts, table: Object, assumed: list[str]) -> str:
    """Return the integrator of an object. If a plug-in does not state its integrator, "semi-implicit" is assumed.

    Raises:
        InputError: If a plug-in states an unknown integrator, or "implicit".
    """
    if table.dynamics == "native":
        return table.integrator
    if own := dynamics_of(table.dynamics).integrator:
        return own
    module = plugins.load_blaming("dynamics", table.dynamics, parts.folder)
    told = getattr(module, "INTEGRATOR", None)
    if told is None:
        assumed.append(
            f"the integrator of the dynamics {table.dynamics} is semi-implicit, because `INTEGRATOR` is not stated"
        )
        return "semi-implicit"
    if told not in TOLD:
        raise InputError(f"INTEGRATOR of the dynamics {table.dynamics}", told, f"one of {', '.join(TOLD)}")
    return str(told)


# All objects ---------------------------------------------------------------------------------------------------------


def _joined(parts: Parts, shares: Sequence[_ObjectMatrices], recording: Recording | None) -> Linearised:
    """Assemble the matrices of all objects and transform them to the principal axes of the devices' masses."""
    d, period = parts.scene.dimensions, parts.scene.period
    position, force = parts.start.copy(), np.zeros_like(parts.start)
    for share in shares:
        position[share.fingers] = share.grip.grasped.finger_position
        force[share.fingers] = np.nan_to_num(share.force)
    # only stiffness and damping of the hands are needed here, which do not depend on the targets of the hands
    hands = list(still_hands(parts, np.zeros_like(position)))
    devices = mechanics(parts, position, hands)
    operator, stiffer, damper = operated(parts, hands, force)
    fingers = np.concatenate([share.fingers for share in shares])
    columns = (fingers[:, None] * d + np.arange(d)).ravel()
    block = np.ix_(columns, columns)
    V, mass = np.zeros((len(columns), len(columns))), np.zeros(len(columns))
    friction = np.zeros_like(V)
    for i, finger in enumerate(fingers):
        x, A = slice(i * d, i * d + d), devices.mass[finger]
        mass[x], V[x, x] = (np.diag(A), np.eye(d)) if not (A - np.diag(np.diag(A))).any() else np.linalg.eigh(A)
        friction[x, x] = V[x, x].T @ devices.friction[finger] @ V[x, x]
    apart = friction - np.diag(np.diag(friction))

    def turned(blocks: Sequence[FloatArray]) -> FloatArray:
        return V.T @ block_diagonal(blocks) @ V

    def stiffness(shifts: float, turns: float, internal: float) -> FloatArray:
        return turned([share.gains(shifts, turns, internal) for share in shares])

    def damping(external: float, internal: float) -> FloatArray:
        return turned([share.gains.damping(external, internal) for share in shares])

    def conventional(k: float) -> FloatArray:
        return turned([share.gains.alone(k) for share in shares])

    gains: tuple[FloatArray, ...] | None = None
    if all(share.gains.is_sum for share in shares):
        gains = tuple(turned(each) for each in zip(*(share.gains.parts for share in shares), strict=True))
    G, G_e, G_c = (block_diagonal([getattr(share, name) for share in shares]) @ V for name in ("G", "G_e", "G_c"))
    hand_damping = V.T @ (devices.damping + np.diag(damper))[block] @ V
    linear = Linearisation(
        period=period,
        mass=mass,
        friction=np.diag(friction),
        G=G,
        inertia=block_diagonal([share.grip.inertia() for share in shares]),
        viscosity=block_diagonal([share.viscosity for share in shares]),
        stiffness=stiffness(1.0, 1.0, 1.0),
        damping=damping(1.0, 1.0),
        hand_stiffness=V.T @ (devices.stiffness + np.diag(stiffer))[block] @ V,
        hand_damping=hand_damping + (apart if operator is None else 0.0),
        delay=np.repeat(devices.delay[fingers], d),
        age=np.repeat(devices.age[fingers], d),
        integrator=shares[0].integrator,
        preload=_preload(shares, V),
        G_displacement=G_e,
        ground=_joined_ground(shares),
        operator=None if operator is None else replace(operator.selected(columns).on(V, V), friction=apart),
        G_contact=G_c if shares[0].integrator == "implicit" else None,
    )
    ends = np.repeat(lateness_ends(devices, recording)[:, fingers], d, axis=1)
    linear, late = less_stable(linear, ends)
    others = [*devices.assumed, *late, *assumptions(parts, fingers.tolist(), force)]
    assumed = dict.fromkeys([*(text for share in shares for text in share.assumed), *others])
    fades = (None if each.place.stiffness is None else each.grip.grasped.fade_asked() for each in shares)
    return Linearised(
        linear=linear,
        objects=tuple(share.name for share in shares),
        fingers=tuple(fingers.tolist()),
        finger_of_column=np.repeat(fingers, d),
        contacts=np.concatenate([share.contacts for share in shares]),
        tips=position[fingers],
        normals=np.concatenate([share.grip.grasped.inward() for share in shares]),
        forces=np.concatenate([share.force for share in shares]),
        at=tuple(share.place.where for share in shares),
        assumed=tuple(assumed),
        splits=tuple(share.split for share in shares),
        laws=tuple(share.gains.law for share in shares),
        margins=np.concatenate([share.place.margins for share in shares]),
        edge=tuple(int(i) for share in shares for i in share.edge),
        slip=(V.T @ block_diagonal([p.slip[0] for p in shares]), V.T @ block_diagonal([p.slip[1] for p in shares])),
        standing=tuple(share.standing for share in shares),
        fade=tuple(fades),
        geometric=tuple(share.geometric for share in shares),
        stiffness=stiffness,
        damping=damping,
        gains=gains,
        conventional=conventional,
        compliance=np.concatenate([np.atleast_1d(share.gains.compliance) for share in shares]),
        pads=joined_pads([share.gains for share in shares], V),
    )


def _preload(shares: Sequence[_ObjectMatrices], V: FloatArray) -> FloatArray | None:
    if not any(share.N.any() for share in shares):
        return None
    of_object = np.concatenate([np.arange(len(share.N)) >= share.G.shape[1] for share in shares])
    order = np.argsort(of_object, kind="stable")  # all devices, then all objects
    W = block_diagonal([V, np.eye(len(order) - len(V))])
    return np.asarray(W.T @ block_diagonal([share.N for share in shares])[np.ix_(order, order)] @ W)


def _joined_ground(shares: Sequence[_ObjectMatrices]) -> tuple[FloatArray, FloatArray] | None:
    """Assemble the block-diagonal stiffness and damping of the ground under all objects; None if all are in the air."""
    if all(share.ground is None for share in shares):
        return None
    none = [np.zeros((len(share.G), len(share.G))) for share in shares]
    grounds = [each.ground or Ground((), zero, zero, 0) for each, zero in zip(shares, none, strict=True)]
    return block_diagonal([each.stiffness for each in grounds]), block_diagonal([each.damping for each in grounds])
