"""A grasped object: its state block, named views of it, and one sample at a time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspfx.compile.records import start_of
from graspfx.cones.problem import MODES, choices, problem_size, set_up
from graspfx.coupling import block as at
from graspfx.coupling.approach import NOT_FINITE, UNRESOLVED, approach
from graspfx.coupling.depth import compliance
from graspfx.coupling.fade import release_compliance
from graspfx.coupling.gains import ALONE, CONTACT, KED, KID, KIP, LITERAL, OBJECT, SYMMETRIC, WORLD
from graspfx.coupling.law import push
from graspfx.coupling.rules import Rules
from graspfx.coupling.sample import let_go, sample
from graspfx.errors import InputError
from graspfx.grasp.impedance import Coupling, per_finger
from graspfx.grasp.rigid_modes import NO_ARM
from graspfx.objects import integrators as body
from graspfx.surfaces.triangles import mesh_tree
from graspfx.surfaces.triangles.mesh_finger import NEW, MeshFinger

FloatArray = NDArray[np.float64]
Index = NDArray[np.intp]


STRUCTURE = (
    at.FINGERS, at.DIMENSIONS, at.COORDINATES, at.EQUAL, at.DENSE, at.DAMPED, at.SINGULAR, at.ATTACHED, at.STICK,
    at.FADE, at.AT_CONTACT, at.IMPLICIT, at.SHAPE, at.SHIFTS, at.TURNS, at.MIXED, at.FRICTION, at.RAYS, at.OBSERVED,
    at.PROBLEM, at.BRAKE, at.GRADUAL, at.LIMITS, at.RULE, at.RULE + 1, at.AXES_OF_GAINS,
    *range(at.WHOLE, at.WHOLE + 4),
    *range(at.GAINS, at.GAINS + 4),
)  # fmt: skip
MODE, REACH = start_of(MeshFinger, "mode"), start_of(MeshFinger, "reach")
RULES = {"equal": ALONE, "literal": LITERAL, "symmetric": SYMMETRIC}
AXES = {"object": OBJECT, "world": WORLD, "contact": CONTACT}


class Shape(Protocol):
    """What the coupling needs of a shape: the number, the parameters and the data of its closest-point kernel."""

    @property
    def kind(self) -> int: ...

    @property
    def parameters(self) -> tuple[float, float, float]: ...

    @property
    def data(self) -> FloatArray | None: ...


class GraspedObject:
    """n fingers coupled to one object in d dimensions.

    Every sample: write `finger_position` and `finger_velocity` (n, d), call `sample()`, read `force` (n, d) on the
    object; the object's wrench is in the body's part of the block, ready for `body.step`.

    Args:
        fingers: n.
        dimensions: d.
        period: T [s].
        law: the gains of eq. (4).
        rules: how fingers touch.
        shape: None only with attached contacts, which then are at the object's centre.
        fill_body: writes the object's parameters and initial state into its part of the block.
        radius: of the balls that the fingertips are, one or (n,) [m]; zero is a point.
        limit: largest force of each finger, one or (n,) [N], infinite where there is none; None for none at all.

    Raises:
        InputError: unilateral contact without a shape or with a stiffness of zero; a radius that is no length; soft
            fingers outside of space, with matrix gains, without friction, or attached to no shape.
    """

    def __init__(
        self,
        fingers: int,
        dimensions: int,
        period: float,
        law: Coupling,
        rules: Rules,
        fill_body: Callable[[FloatArray], None],
        *,
        shape: Shape | None = None,
        radius: ArrayLike = 0.0,
        limit: ArrayLike | None = None,
    ) -> None:
        n, d = fingers, dimensions
        self.fingers, self.dimensions, self.law = n, d, law
        gains = [gain for part in (law.external, law.internal) for gain in (part.stiffness, part.damping)]
        self.matrices = any(np.ndim(gain) for gain in gains)
        mu, patch = np.broadcast_to(rules.friction, n), np.broadcast_to(rules.patch, n)
        slips = bool(np.any(mu)) and not rules.attached
        self.soft = bool(np.any(patch))
        if self.soft:
            self._require_soft(rules, mu)
        c = self.coordinates = 4 if self.soft else d
        state = np.zeros(body.SIZE)
        fill_body(state)
        implicit = state[body.INTEGRATOR] == body.IMPLICIT
        square = self.matrices or bool(implicit)
        # without friction the cones are rays, and six unknowns do for numbers; else principal pivoting
        rays = not (slips or rules.attached or rules.stick or square or law.equal)
        holds = rules.attached or (rules.stick and not slips)
        balls = limit is not None and holds and not (square or law.equal)  # limits where there is no friction cone
        room = n * c if square else MODES
        problem = problem_size(n, room) if slips or rays or balls else 0
        squares = [per_finger(gain, n, d) for gain in gains] if self.matrices else []
        entries = sum(matrix.size for matrix in squares)
        if not 0.0 <= rules.damping_depth < np.inf:
            raise InputError("damping_depth", rules.damping_depth, "a length, zero or more [m]")
        gradual = rules.damping_depth > 0.0 and not rules.attached and bool(np.any(gains[1]) or np.any(gains[3]))
        limits = at.size(n, c, entries, problem)
        end = limits + (at.limits_size(n) if limit is not None else 0)
        data = None if shape is None else shape.data
        self.block = np.zeros(end if data is None else end + n * at.WALK + data.size)
        self._S = memoryview(self.block)  # its items are Python floats, which run twice as fast as array items
        S = self.block
        S[at.FINGERS], S[at.DIMENSIONS], S[at.PERIOD] = n, d, period
        S[at.COORDINATES], S[at.FRICTION], S[at.RAYS] = c, slips, rays
        S[at.PROBLEM] = at.problems(n, c, entries)
        S[at.BRAKE] = S[at.PROBLEM] + problem
        self._problems = [int(S[at.PROBLEM]), int(S[at.BRAKE])] if problem else []
        for o in self._problems:
            posed = set_up(S, o, n, room)
            posed.limited = limit is not None and not implicit
            posed.compliant = gradual and o == S[at.BRAKE]
        S[at.GRADUAL], S[at.DEPTH] = gradual, rules.damping_depth
        self.limit: FloatArray | None = None
        if limit is not None:
            S[at.LIMITS] = limits
            S[limits : limits + n] = np.inf
            self.limit = S[limits + n : limits + 2 * n]
            self.limit[:] = _limits(limit, n)
        S[at.EQUAL] = law.equal
        S[at.DAMPED] = bool(np.any(gains[1]) or np.any(gains[3]))
        S[at.SINGULAR] = any(_least(part.damping) == 0.0 for part in (law.external, law.internal))
        if self.matrices:
            self._place_gains(squares, rules.axes)
            S[at.RELEASE] = release_compliance(law, n, d)
            S[at.STIFFEST : at.STIFFEST + 3] = [np.linalg.eigvalsh(squares[k]).max() for k in (KIP, KED, KID)]
        else:
            S[at.EXTERNAL_STIFFNESS : at.INTERNAL_DAMPING + 1] = gains
            if not rules.attached and not (gains[0] and gains[2]):
                raise InputError(
                    "stiffness", f"external {gains[0]}, internal {gains[2]} N/m", "both above zero",
                    "unilateral contact shares a push between them; attach the contacts to study a zero",
                )  # fmt: skip
        S[at.ATTACHED], S[at.STICK], S[at.AT_CONTACT] = rules.attached, rules.stick, rules.at_contact
        if rules.fade is not None and not rules.attached:
            S[at.FADE] = 1.0
            S[at.NEAR], S[at.FAR] = rules.fade
        S[at.ARM_LOW], S[at.ARM_HIGH] = rules.blend or (NO_ARM, NO_ARM)
        S[at.BODY : at.BODY + body.SIZE] = state
        S[at.IMPLICIT] = implicit
        self._free_directions()
        rows = self.rows = S[at.ROW : at.ROW + n * at.STRIDE].reshape(n, at.STRIDE)
        rows[:, at.SHARE] = 1.0 if rules.share is None else rules.share
        rows[:, at.WEIGHT] = rows[:, at.SHARE]
        rows[:, at.COEFFICIENT] = mu if slips else 0.0
        rows[:, at.PATCH] = patch
        rows[:, at.FACE] = -1.0
        rows[:, at.FRAME : at.FRAME + 9] = np.eye(3).ravel()
        rows[:, at.ANCHOR : at.ANCHOR + 9] = S[at.BODY + body.ROTATION : at.BODY + body.ROTATION + 9]
        self._shaped = shape is not None
        if self.soft and not self._shaped:
            raise InputError("shape", None, "a shape", "soft fingers exert torsion about its normal")
        if shape is None and not rules.attached:
            raise InputError("shape", None, "a box or a sphere", "give the object a shape, or attach the contacts")
        if shape is not None:
            S[at.SHAPE] = shape.kind
            S[at.PARAMETERS : at.PARAMETERS + 3] = shape.parameters
        rows[:, at.RADIUS] = _radii(radius, n)
        self._walks: FloatArray | None = None
        if data is not None:
            S[at.WALKS], S[at.MESH] = end, end + n * at.WALK
            self._walks = S[end : end + n * at.WALK].reshape(n, at.WALK)
            self._walks[:, REACH] = np.inf
            if S[at.FADE]:
                self.set_fade(*S[[at.NEAR, at.FAR]])
            S[end + n * at.WALK :] = data
        self.body_state = S[at.BODY : at.BODY + body.SIZE]
        self.finger_position = rows[:, at.POSITION : at.POSITION + d]
        self.finger_velocity = rows[:, at.VELOCITY : at.VELOCITY + d]
        self.contact_position = rows[:, at.CONTACT_WORLD : at.CONTACT_WORLD + d]
        self.force = rows[:, at.FORCE : at.FORCE + d]
        self.moment = rows[:, at.MOMENT : at.MOMENT + 3]
        self.touching = rows[:, at.TOUCHING]
        self.touching[:] = rules.attached
        self.where = self._entries()

    @property
    def wrench(self) -> FloatArray:
        """f_v of eq. (2) about the object's centre, (w,): force, then moment."""
        return self.block[self.where["wrench"]]

    @property
    def structure(self) -> Index:
        """Entries of `block` that never change in a run and choose what is computed: counts, switches, offsets.

        Values are not among them but for zeros that stay zero, gains, and what a finger lacks of friction, of a patch
        and of a radius; and for weights of one that never fade.
        """
        fixed = [*STRUCTURE, *(at.BODY + entry for entry in (body.DIMENSIONS, body.INTEGRATOR))]
        fixed += range(at.BODY + body.FREE, at.BODY + body.FREE + 6)
        for o in self._problems:
            fixed += [o, *choices(o)]  # the count too
        if self._walks is not None:
            start = int(self.block[at.MESH])
            fixed += [at.MESH, at.WALKS, *mesh_tree.choices(start)]
        lacking = list(range(at.EXTERNAL_STIFFNESS, at.INTERNAL_DAMPING + 1))
        for o in range(at.ROW, at.ROW + self.fingers * at.STRIDE, at.STRIDE):
            lacking += [o + at.COEFFICIENT, o + at.PATCH, o + at.RADIUS]
        fixed += [entry for entry in lacking if self.block[entry] == 0.0]
        if not self.block[at.FADE]:
            weights = range(at.ROW + at.WEIGHT, at.ROW + self.fingers * at.STRIDE, at.STRIDE)
            fixed += [entry for entry in weights if self.block[entry] == 1.0]
        return np.array(sorted(fixed), dtype=np.intp)

    @property
    def implicit(self) -> bool:
        """The body's free motion has to be predicted before each sample."""
        return bool(self.block[at.IMPLICIT])

    @property
    def shortfall(self) -> float:
        """By how much the fade began too near the surface, at most so far [m]; 0 if it never did."""
        return float(self.block[at.SHORTFALL])

    @property
    def fade_needed(self) -> float:
        """Where the fade would have had to begin for the forces so far [m]; 0 if it began there."""
        return float(self.block[at.NEAR] + self.block[at.SHORTFALL]) if self.block[at.SHORTFALL] else 0.0

    def fade_asked(self) -> tuple[float, float] | None:
        """Where the fade begins, and where the forces of the last sample ask it to [m]; None where nothing fades."""
        S = self.block
        if not S[at.FADE] or S[at.EQUAL]:
            return None
        d = self.dimensions
        pushes = sum(push(self._S, i, d) for i in range(self.fingers))
        return float(S[at.NEAR]), release_compliance(self.law, self.fingers, d) * float(pushes)

    @property
    def blended(self) -> int:
        """Samples in which a rotation was in the split with a part of its weight."""
        return int(self.block[at.IN_BAND])

    def set_fade(self, low: float, high: float) -> None:
        """Let a free finger leave the split between two gaps [m]."""
        S = self.block
        S[at.NEAR], S[at.FAR] = low, high
        if self._walks is not None:
            self._walks[:, REACH] = high + self.rows[:, at.RADIUS]

    def inward(self) -> FloatArray:
        """Unit normals into the object at the fingers' contacts, world axes, (n, d)."""
        d = self.dimensions
        R = self.body_state[body.ROTATION : body.ROTATION + 9].reshape(3, 3)
        return (self.rows[:, at.NORMAL : at.NORMAL + 3] @ R.T)[:, :d]

    def attach(self, contacts: FloatArray) -> None:
        """Attached contact points, (n, d) in the object's frame [m]; the object's centre unless they are set."""
        self.rows[:, at.CONTACT : at.CONTACT + self.dimensions] = contacts

    def meet(self, position: FloatArray) -> None:
        """Find each finger's contact point on the shape from where it starts, (n, d) [m]: the face that it will be on.

        Attached contacts stay where this puts them.
        """
        if not self._shaped:
            return
        self.finger_position[:] = position
        if self._walks is not None:
            self._walks[:, MODE] = NEW
        attached, touching = self.block[at.ATTACHED], self.touching.copy()
        self.block[at.ATTACHED] = self.touching[:] = 0.0
        approach(self._S)
        self.block[at.ATTACHED], self.touching[:] = attached, touching

    def sample(self) -> int:
        """Forces and wrench from the motion of fingers and object (its free motion under the implicit integrator)."""
        return sample(self._S)

    def damper_compliance(self, *, at_rest: bool = True) -> FloatArray:
        """Compliances C_i of the dampers in series with the fingers, (n,) [m/(N s)]; zero where a finger has all.

        Args:
            at_rest: at the forces of the last sample, which had no rates; else at none, where they are infinite.
        """
        S, n = self._S, self.fingers
        if not S[at.GRADUAL]:
            return np.zeros(n)
        if not at_rest:
            return np.full(n, np.inf)
        forces = [push(S, i, self.dimensions) for i in range(n)]
        return np.array([compliance(S, i, f) for i, f in enumerate(forces)]) / self.rows[:, at.WEIGHT]

    def check_activity(self) -> None:
        """Warn of matrices for gains whose largest skew part so far can create energy: once, and if it grows tenfold.

        Samples do not warn; who runs them asks here.
        """
        if self.matrices:
            o, m = at.skewest(self.fingers, self.dimensions), self.fingers * self.dimensions
            K, D = self.block[o : o + 2 * m * m].reshape(2, m, m)
            self.law.warn_if_active("stiffness", K)
            self.law.warn_if_active("damping", D)

    def let_go(self) -> None:
        """Zero force and wrench."""
        let_go(self._S)

    def _entries(self) -> dict[str, Index]:
        """Which entries of the block hold what a recording asks for."""
        n, d = self.fingers, self.dimensions
        rows = np.arange(at.ROW, at.ROW + n * at.STRIDE).reshape(n, at.STRIDE)
        o = at.BODY
        turns = {1: [], 2: [2], 3: [0, 1, 2]}[d]
        angle = {1: [], 2: [body.ANGLE], 3: [body.QUATERNION + a for a in range(4)]}[d]
        limits: dict[str, Index] = {}
        if self.limit is not None:
            law = at.law_force(self.block)
            limits["saturated"] = np.arange(n) + at.saturation(self.block)
            limits["law_force"] = (law + np.arange(3 * n).reshape(n, 3))[:, :d]
        return limits | {
            "finger_position": rows[:, at.POSITION : at.POSITION + d],
            "finger_velocity": rows[:, at.VELOCITY : at.VELOCITY + d],
            "contact_position": rows[:, at.CONTACT_WORLD : at.CONTACT_WORLD + d],
            "finger_force": rows[:, at.FORCE : at.FORCE + d],
            "finger_moment": rows[:, at.MOMENT : at.MOMENT + 3],
            "touching": rows[:, at.TOUCHING],
            "status": rows[:, at.STATUS],
            "gap": rows[:, at.GAP],
            "position": np.arange(o + body.POSITION, o + body.POSITION + d),
            "velocity": np.arange(o + body.VELOCITY, o + body.VELOCITY + d),
            "orientation": np.array([o + a for a in angle], dtype=np.intp),
            "angular_velocity": np.array([o + body.ANGULAR_VELOCITY + a for a in turns], dtype=np.intp),
            "law": np.array([at.LAW]),
            "residual": np.array([at.RESIDUAL]),
            "wrench": np.array([o + body.FORCE + a for a in range(d)] + [o + body.MOMENT + a for a in turns]),
        }

    def _require_soft(self, rules: Rules, mu: FloatArray) -> None:
        if self.dimensions != 3:
            raise InputError(
                "patch", rules.patch, "soft fingers in space only", "elsewhere a soft finger is a hard one"
            )
        if self.matrices:
            raise InputError("patch", rules.patch, "one number for each gain where fingers are soft")
        if not (rules.attached or rules.stick or mu[np.broadcast_to(rules.patch, mu.shape) > 0.0].all()):
            raise InputError("patch", rules.patch, "friction where a finger is soft", "without it there is no torsion")

    def _free_directions(self) -> None:
        S, d = self.block, self.dimensions
        free = S[at.BODY + body.FREE : at.BODY + body.FREE + 6] != 0.0
        shifts, turns = int(free[:3].sum()), int(free[3:].sum())
        S[at.SHIFTS], S[at.TURNS] = shifts, turns
        S[at.AXES : at.AXES + 18].reshape(6, 3)[: shifts + turns] = np.vstack([np.eye(3), np.eye(3)])[free]
        # all or none of a kind is the same set of directions in any frame; the plane has one axis, which never turns
        S[at.MIXED] = d > 1 and (shifts not in (0, d) or turns not in (0, 1 if d == 2 else 3))

    def _place_gains(self, squares: Sequence[FloatArray], axes: str) -> None:
        """Place kep, ked, kip and kid as matrices, for each finger or for all of them together."""
        S, n, d, law = self.block, self.fingers, self.dimensions, self.law
        S[at.DENSE] = 1.0
        o = at.gains(n, d)
        for k, matrix in enumerate(squares):
            S[at.GAINS + k], S[at.WHOLE + k] = o, matrix.ndim == 2
            S[o : o + matrix.size] = matrix.ravel()
            o += matrix.size
        S[at.RULE], S[at.RULE + 1] = RULES[law.rule("stiffness")], RULES[law.rule("damping")]
        directed = any(
            np.ndim(part.stiffness) > 1 or np.ndim(part.damping) > 1 for part in (law.external, law.internal)
        )
        S[at.AXES_OF_GAINS] = AXES[axes] if d > 1 and directed else OBJECT


def _radii(given: ArrayLike, n: int) -> FloatArray:
    radii = np.asarray(given, dtype=float)
    if radii.shape not in ((), (n,)) or not (np.isfinite(radii) & (radii >= 0.0)).all():
        raise InputError("radius", given, f"a finite length, zero or more, or {n} of them [m]")
    return np.broadcast_to(radii, (n,))


def _limits(given: ArrayLike, n: int) -> FloatArray:
    limits = np.asarray(given, dtype=float)
    if limits.shape not in ((), (n,)) or not (limits > 0.0).all():
        raise InputError("limit", given, f"a force above zero, or {n} of them [N]", "inf where there is no limit")
    return np.broadcast_to(limits, (n,))


def _least(gain: float | FloatArray) -> float:
    """The least a gain does in any direction, zero to rounding as zero."""
    values = np.linalg.eigvalsh(gain) if np.ndim(gain) > 1 else np.atleast_1d(gain)
    return 0.0 if values.min() <= 1e-12 * values.max() else float(values.min())


def fault_text(fault: int, fingers: Sequence[str]) -> str:
    """What a fault of `sample` means to the user."""
    if fault == NOT_FINITE:
        return f"a finger's position or velocity is not finite ({', '.join(fingers)}); all forces are zero"
    if fault == UNRESOLVED:
        return "the contact forces did not settle; all forces are zero"
    return "the object's motion or a force on it is not finite; all forces are zero"
