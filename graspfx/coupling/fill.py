"""Specification of a grasp, and creation of the block that contains its state."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspfx.compile.memory import zeros
from graspfx.compile.records import numbers, size_for, size_of, start_of
from graspfx.cones.friction import LEAST
from graspfx.cones.problem import MODES, problem_size, set_up
from graspfx.coupling.contacts import LARGEST
from graspfx.coupling.gains import ALONE, CONTACT, LITERAL, OBJECT, SYMMETRIC, WORLD
from graspfx.coupling.grasp_state import FingerState, GraspState, RecoilState
from graspfx.coupling.object_gains import WIDE
from graspfx.coupling.rules import Rules, release_compliance
from graspfx.errors import InputError
from graspfx.grasp.impedance import Coupling, per_finger
from graspfx.grasp.object_impedance import ObjectImpedance
from graspfx.grasp.rigid_modes import NO_ARM
from graspfx.numeric import each, real
from graspfx.objects.body_state import BodyState
from graspfx.objects.integrators import IMPLICIT
from graspfx.spatial import Vector
from graspfx.surfaces.closed_form.proxy import KINDS
from graspfx.surfaces.triangles.mesh_tree import MeshFinger

FloatArray = NDArray[np.float64]

RULES = {"equal": ALONE, "literal": LITERAL, "symmetric": SYMMETRIC}
AXES = {"object": OBJECT, "world": WORLD, "contact": CONTACT}
BODY = start_of(GraspState, "body")
EYE = np.eye(3).ravel()
FREEDOMS = {1: [0], 2: [0, 1, 5], 3: [0, 1, 2, 3, 4, 5]}  # indices of an object's freedoms, by d


class Shape(Protocol):
    """Protocol of a shape for the coupling: kind, parameters and data for the shape's closest-point kernel."""

    @property
    def kind(self) -> int: ...

    @property
    def parameters(self) -> tuple[float, float, float]: ...

    @property
    def data(self) -> FloatArray | None: ...


@dataclass(frozen=True)
class Grip:
    """Specification of the coupling of a `GraspedObject`; it is checked before the block is created.

    Attributes:
        count: Number of fingers n.
        dimensions: Number of dimensions d.
        law: Gains of eq. (4).
        rules: Contact rules.
        fill_body: Function that writes the parameters and the initial state of the object to a block of a `BodyState`.
        shape: Shape of the object; None is allowed only for attached contacts.
        radius: Radius of the ball fingertips, one for all fingers or (n,) [m].
        limit: Largest force of each finger, one for all fingers or (n,) [N]; None for no limits.
        live: Names of fields of `GraspState` that may change during a run.
    """

    count: int
    dimensions: int
    law: Coupling
    rules: Rules
    fill_body: Callable[[FloatArray], None]
    shape: Shape | None
    radius: ArrayLike
    limit: ArrayLike | None
    live: frozenset[str] = frozenset()

    def __post_init__(self) -> None:
        rules, mu = self.rules, self.friction
        if self.soft and self.dimensions != 3:
            raise InputError("patch", rules.patch, "soft fingers in 3-D only", "use hard fingers in 1-D and 2-D")
        directed = any(np.ndim(gain) for gain in (self.gains[2:] if self.law.of_object else self.gains))
        if self.soft and directed:
            raise InputError("patch", rules.patch, "scalar gains for soft fingers, except for a gain of the object")
        if self.soft and not (rules.attached or rules.stick or mu[self.patch > 0.0].all()):
            raise InputError(
                "patch",
                rules.patch,
                "a coefficient of friction for each soft finger",
                "soft fingers without friction exert no torsion",
            )
        self._check_pads()
        if not 0.0 <= rules.damping_depth < np.inf:
            raise InputError("damping_depth", rules.damping_depth, "a length, zero or more [m]")
        if not 0.0 < rules.force_bound <= LARGEST:
            raise InputError("force_bound", rules.force_bound, "a force above zero [N]")
        kep, kip = self.law.external.stiffness, self.law.internal.stiffness
        if not (self.matrices or rules.attached or (kep and kip)):
            raise InputError(
                "stiffness", f"external {kep}, internal {kip} N/m", "both above zero",
                "unilateral contact needs both stiffnesses: attach the contacts to study a zero stiffness",
            )  # fmt: skip
        for quantity, pair in ("stiffness", (kep, kip)), ("damping", (self.gains[1], self.gains[3])):
            if not (self.matrices or rules.attached) and 0.0 < min(pair) < LEAST * max(pair):
                raise InputError(
                    quantity, f"external {pair[0]}, internal {pair[1]}",
                    f"zero, or at least {LEAST:g} times the other gain",
                    "for smaller ratios the forces would be inaccurate",
                )  # fmt: skip
        if self.soft and self.shape is None:
            raise InputError("shape", None, "a shape", "soft fingers exert torsion about the normal of the shape")
        if self.shape is not None and self.shape.kind not in KINDS:
            raise InputError(
                "shape", self.shape, "a shape whose kind `closest` supports", "see docs/development/shape.md"
            )
        if self.shape is None and not rules.attached:
            raise InputError("shape", None, "a shape", "give the object a shape, or attach the contacts")

    def _check_pads(self) -> None:
        if self.padded and self.rules.attached:
            raise InputError(
                "pad", self.rules.pad, "unilateral contacts", "a pad cannot pull, whereas an attached contact can"
            )
        if self.padded and self.implicit and self.damped:
            raise InputError(
                "pad", self.rules.pad, "no damping with the implicit integrator",
                "this integrator solves damping together with the motion, which is not supported for pads",
            )  # fmt: skip

    @cached_property
    def friction(self) -> FloatArray:
        """The coefficients of friction, (n,)."""
        return each("friction", self.rules.friction, self.count, "a coefficient, zero or more, or one for each finger")

    @cached_property
    def patch(self) -> FloatArray:
        """The lengths of the contact patches, (n,) [m]."""
        return each("patch", self.rules.patch, self.count, "a length, zero or more, or one for each finger [m]")

    @cached_property
    def pad(self) -> FloatArray:
        """The stiffnesses of compliant fingertips, (n,) [N/m^1.5]."""
        return each("pad", self.rules.pad, self.count, "zero or more, for all fingers or one for each [N/m^1.5]")

    @cached_property
    def radii(self) -> FloatArray:
        """The radii of the ball fingertips, (n,) [m]."""
        return each("radius", self.radius, self.count, f"a finite length, zero or more, or {self.count} of them [m]")

    @cached_property
    def limits(self) -> FloatArray | None:
        """The largest forces of the fingers, (n,) [N], infinite for a finger without a limit, or None for no limits."""
        if self.limit is None:
            return None
        limits = real("limit", self.limit)
        if limits.shape not in ((), (self.count,)) or not (limits > 0.0).all():
            expected = f"a force above zero, or {self.count} of them [N]"
            raise InputError("limit", self.limit, expected, "use inf for a finger without a limit")
        return np.broadcast_to(limits, (self.count,))

    @cached_property
    def body(self) -> FloatArray:
        """The parameters and the initial state of the object, as a block of a `BodyState`."""
        state = np.zeros(size_of(BodyState))
        self.fill_body(state)
        return state

    @cached_property
    def free(self) -> NDArray[np.bool_]:
        """Mask of the object's free degrees of freedom: three translations, then three rotations, (6,)."""
        body = BodyState(self.body)
        free = np.concatenate([body.array(BodyState.free_translation), body.array(BodyState.free_rotation)])
        return np.asarray(free != 0.0)

    @property
    def padded(self) -> bool:
        """Whether some fingertip is compliant."""
        return bool(np.any(self.pad))

    @property
    def gains(self) -> list[float | FloatArray]:
        """The gains kep [N/m], ked [N s/m], kip [N/m] and kid [N s/m], each a number or a matrix."""
        return [gain for part in (self.law.external, self.law.internal) for gain in (part.stiffness, part.damping)]

    @cached_property
    def squares(self) -> list[FloatArray]:
        """The gains kep, ked, kip and kid as arrays in the block's format, or an empty list if all gains are scalar.

        Gains of the object are 6 x 6 matrices.
        """
        if not self.matrices:
            return []
        n, d, law = self.count, self.dimensions, self.law
        squares = [per_finger(gain, n, d) for gain in (law.internal.stiffness, law.internal.damping)]
        if isinstance(law.external, ObjectImpedance):
            outer = law.external.about(np.zeros(d))
            return [*(whole_gain(gain, d) for gain in (outer.stiffness, outer.damping)), *squares]
        return [*(per_finger(gain, n, d) for gain in (law.external.stiffness, law.external.damping)), *squares]

    @property
    def matrices(self) -> bool:
        """Whether some gain is a matrix."""
        return any(np.ndim(gain) for gain in self.gains)

    @property
    def soft(self) -> bool:
        """Whether some finger exerts torsion."""
        return bool(np.any(self.patch))

    @property
    def slips(self) -> bool:
        """Whether some finger has a coefficient of friction and contacts are not attached."""
        return bool(np.any(self.friction)) and not self.rules.attached

    @property
    def implicit(self) -> bool:
        """Whether forces and the object's displacement are solved together."""
        return bool(BodyState(self.body).integrator == IMPLICIT)

    @property
    def damped(self) -> bool:
        """Whether some damping is not zero."""
        return bool(np.any(self.gains[1]) or np.any(self.gains[3]))

    @property
    def gradual(self) -> bool:
        """Whether damping grows with depth."""
        return self.rules.damping_depth > 0.0 and not self.rules.attached and self.damped

    @property
    def recoils(self) -> bool:
        """Whether the object's motion in the sample is eliminated in modal unknowns: implicit with scalar gains."""
        return self.implicit and not self.matrices

    @property
    def columns(self) -> int:
        """Largest number of columns V of the damped law (`damping_flexibility`), at least 1."""
        modes, tips = int(self.free.sum()), 0 if self.rules.at_contact else int(self.free[3:].sum())
        softened = modes if self.gradual or "gradual" in self.live else 0
        return max(modes + softened + tips + (tips if self.soft else 0), 1)

    @property
    def rays(self) -> bool:
        """Whether frictionless contact is solved as a friction problem in which each cone is a ray along the normal."""
        return self.pushes_apart and (self.implicit or not self.law.equal)

    @property
    def pushes_apart(self) -> bool:
        """Whether contacts are unilateral, without friction and without sticking, and gains are scalar."""
        return not (self.slips or self.rules.attached or self.rules.stick or self.matrices)

    @property
    def problems(self) -> bool:
        """Whether forces may be solutions of friction problems: in friction cones, on rays, or limited to balls."""
        holds = self.rules.attached or (self.rules.stick and not self.slips)
        balls = self.limit is not None and holds and not (self.matrices or self.implicit)
        apart = "equal" in self.live or self.implicit or not self.law.equal
        return self.slips or (apart and (self.pushes_apart or balls))


def make_block(grip: Grip, period: float) -> FloatArray:
    """Create the block of a grasp: state, friction problems, the fingers' searches on a mesh, and the mesh."""
    n, d, shape = grip.count, grip.dimensions, grip.shape
    coordinates = 4 if grip.soft else d
    sizes = {
        "count": n,
        "width": 4 if grip.soft else 3,
        "coordinates": coordinates,
        "unknowns": n * coordinates + (int(grip.free.sum()) if grip.implicit else 0),
        "components": n * coordinates if grip.matrices else 0,
        "matrix_entries": sum(matrix.size for matrix in grip.squares),
        "object_freedoms": WIDE if grip.law.of_object else 0,
        "padded_count": n if grip.padded else 0,
        "recoil_entries": size_for(RecoilState, most=grip.columns) if grip.recoils else 0,
    }
    most = grip.columns if grip.recoils else MODES
    unknowns = max(n * coordinates, most) if grip.implicit or grip.matrices else MODES
    end = size_for(GraspState, **sizes)
    problem = problem_size(n, unknowns, most) if grip.problems else 0
    walks = end + 2 * problem
    data = None if shape is None else shape.data
    mesh = walks + (0 if data is None else n * size_of(MeshFinger))
    block = zeros(mesh + (0 if data is None else data.size))
    grasp = GraspState(block)
    for name, size in sizes.items():
        setattr(grasp, name, size)
    grasp.dimensions, grasp.period = d, period
    block[BODY : BODY + size_of(BodyState)] = grip.body
    _fill_rules(grasp, grip)
    _fill_freedom(grasp, grip.free)
    _fill_gains(grasp, grip)
    _fill_fingers(grasp, grip)
    for k, name in enumerate(("problem", "damping_problem")):
        block[start_of(GraspState, name)] = end + k * problem
        if grip.problems:
            posed = set_up(block, end + k * problem, n, unknowns, most)
            posed.flexible = grip.recoils
            posed.limited = grip.limit is not None and not grip.implicit
            posed.compliant = grip.gradual and name == "damping_problem"
    if shape is not None:
        grasp.shape = shape.kind
        grasp.parameters = Vector(*shape.parameters)
    if data is not None:
        block[start_of(GraspState, "mesh")] = mesh
        own = grasp.fingers.offset + size_of(FingerState) * np.arange(n)
        grasp.fingers.array(FingerState.walk)[:] = walks + size_of(MeshFinger) * np.arange(n) - own
        block[mesh:] = data
    return block


def _fill_rules(grasp: GraspState, grip: Grip) -> None:
    rules = grip.rules
    grasp.attached, grasp.stick, grasp.at_contact = rules.attached, rules.stick, rules.at_contact
    grasp.friction, grasp.rays, grasp.implicit = grip.slips, grip.rays, grip.implicit
    grasp.force_bound = rules.force_bound
    grasp.limited, grasp.recoils = grip.limit is not None, grip.recoils
    if grip.recoils:
        tips = bool(grip.free[3:].any()) and not rules.at_contact
        grasp.recoil.most, grasp.recoil.distant, grasp.recoil.twisted = grip.columns, tips, tips and grip.soft
    grasp.padded = grip.padded
    grasp.gradual, grasp.damping_depth = grip.gradual, rules.damping_depth
    if rules.fade is not None and not rules.attached:
        grasp.fade = True
        grasp.fade_start, grasp.fade_end = rules.fade
    grasp.arm_low, grasp.arm_high = rules.blend or (NO_ARM, NO_ARM)


def _fill_freedom(grasp: GraspState, free: NDArray[np.bool_]) -> None:
    d, freedom = grasp.dimensions, grasp.freedom
    shifts, turns = int(free[:3].sum()), int(free[3:].sum())
    freedom.shifts, freedom.turns = shifts, turns
    for k, axis in enumerate(np.vstack([np.eye(3), np.eye(3)])[free]):
        freedom.axes[k].vector = Vector(*axis.tolist())
    # if all or none are free, the directions are the same in any frame; the plane's rotation axis is fixed
    grasp.mixed = d > 1 and (shifts not in (0, d) or turns not in (0, 1 if d == 2 else 3))


def _fill_gains(grasp: GraspState, grip: Grip) -> None:
    """Write kep, ked, kip and kid: scalars, or matrices for each finger or for all fingers together."""
    law, S, squares = grip.law, grasp.buffer, grip.squares
    grasp.equal, grasp.damped = law.equal, grip.damped
    grasp.singular = any(_least(part.damping) == 0.0 for part in (law.external, law.internal))
    if not squares:
        kep, ked, kip, kid = (float(gain) for gain in grip.gains)
        grasp.external_stiffness, grasp.external_damping = kep, ked
        grasp.internal_stiffness, grasp.internal_damping = kip, kid
        return
    grasp.dense = True
    o, first = grasp.matrices.offset, 0
    for gain, matrix in zip((grasp.kep, grasp.ked, grasp.kip, grasp.kid), squares, strict=True):
        gain.of_object = law.of_object and first < 2 * WIDE * WIDE
        gain.whole, gain.first = matrix.ndim == 2 and not gain.of_object, first
        S[o + first : o + first + matrix.size] = matrix.ravel()
        first += matrix.size
    grasp.stiffness_rule, grasp.damping_rule = RULES[law.rule("stiffness")], RULES[law.rule("damping")]
    directed = any(np.ndim(gain) > 1 for gain in grip.gains[2 if law.of_object else 0 :])
    grasp.axes_of_gains = AXES[grip.rules.axes] if grip.dimensions > 1 and directed else OBJECT
    grasp.release = release_compliance(law, grip.count, grip.dimensions)
    grasp.stiffest = Vector(*(float(np.linalg.eigvalsh(squares[k]).max()) for k in (2, 1, 3)))  # kip, ked, kid


def whole_gain(gain: FloatArray, d: int) -> FloatArray:
    """Extend a gain matrix of an object in d dimensions to all six degrees of freedom.

    Raises:
        InputError: If the matrix has the wrong size.
    """
    places = FREEDOMS[d]
    if len(gain) != len(places):
        raise InputError(
            "external", gain.shape, f"a matrix ({len(places)}, {len(places)}) on the object's degrees of freedom"
        )
    whole = np.zeros((WIDE, WIDE))
    whole[np.ix_(places, places)] = gain
    return whole


def _fill_fingers(grasp: GraspState, grip: Grip) -> None:
    fingers = grasp.fingers
    fingers.array(FingerState.share)[:] = 1.0 if grip.rules.share is None else grip.rules.share
    fingers.array(FingerState.weight)[:] = fingers.array(FingerState.share)
    fingers.array(FingerState.coefficient)[:] = grip.friction if grip.slips else 0.0
    fingers.array(FingerState.patch)[:] = grip.patch
    fingers.array(FingerState.pad)[:] = grip.pad
    fingers.array(FingerState.face)[:] = -1.0
    fingers.array(FingerState.frame)[:] = EYE
    fingers.array(FingerState.anchor)[:] = list(numbers(grasp.body.motion.rotation))
    fingers.array(FingerState.radius)[:] = grip.radii
    fingers.array(FingerState.touching)[:] = grip.rules.attached
    if grip.limits is not None:
        fingers.array(FingerState.cut)[:] = np.inf
        fingers.array(FingerState.limit)[:] = grip.limits


def _least(gain: float | FloatArray) -> float:
    """Compute the smallest gain in any direction; a value of rounding size counts as zero."""
    values = np.linalg.eigvalsh(gain) if np.ndim(gain) > 1 else np.atleast_1d(gain)
    return 0.0 if values.min() <= 1e-12 * values.max() else float(values.min())
