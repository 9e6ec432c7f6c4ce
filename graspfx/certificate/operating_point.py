"""State about which a grasp is linearised, and the search for its equilibrium with closed hands."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from graspfx import log
from graspfx.analysis.grasp_stiffness import released
from graspfx.assembly.grasps import still_hands
from graspfx.assembly.resolve import Parts
from graspfx.certificate.grip import SHIFT, Grip, bearers, edge_directions, grip_margins
from graspfx.cones.problem import SLIDE
from graspfx.coupling.grasp_state import FingerState
from graspfx.errors import InputError, NoRestError
from graspfx.loop.device import is_hardware
from graspfx.objects import integrators as body
from graspfx.scene.model import Scene

FloatArray = NDArray[np.float64]

STEPS = 24  # steps in which the hands close; then gravity is applied
EARLY = 2  # number of those steps in which contacts may begin on the quick path
QUICK = np.array([1.0 / STEPS, 2.0 / STEPS, 0.25, 0.5, 0.75, 1.0])  # fractions of the way on the quick path
COMPARED_AT = np.array([0.2, 0.45, 0.7, 1.0])  # fractions of the way at which the path is compared with a line
SETTLING = 40  # further steps, of increasing length
SLIDING = 1500  # further steps if contacts slid
SETTLED = 1e-9  # relative to the largest force: remaining imbalance at rest
REFRESH = 16  # number of successive further steps that share one stiffness
MEETING = 8  # steps with strong resistance after a finger begins or ceases to touch
DISTRUST = 8  # steps with frozen contacts after the imbalance has increased
STRAIGHT = 1e-6  # relative to the length: largest deviation of a path that is treated as straight
PRESSED = 5.0 * SHIFT  # depth at which all difference quotients find a finger touching [m]
ON_SURFACE = 1e-9  # rounding of a finger that starts on the surface [m]
MOST_GRIPS = 60  # largest number of iterations for the grip force and the stiffness that depends on it
SAME_GRIP = 1e-8  # relative difference of the forces of two iterations at convergence
UNFORCED = "contacts are those of the start, without forces: "
SLID = (
    "contacts slid while the hands closed slowly; forces in the equilibrium of a run may differ by a few per cent: "
    "certify its recording"
)


class NotGraspingError(InputError):
    """Error: no finger touches an object, so that there is no grasp whose stability could be judged.

    Args:
        object: Name of the object.
        gap: Distance from the object to the nearest finger [m].
        where: Situation in which no finger touches, such as "hands closed and still".
    """

    def __init__(self, object: str, gap: float, where: str) -> None:
        self.object, self.gap, self.where = object, gap, where
        given = f"nearest finger {1e3 * gap:.3g} mm away, {where}"
        remedy = (
            "place fingers nearer or squeeze more; if fingers reach the object by a motion, certify a recording "
            "that ends in a grasp"
        )
        super().__init__(f"fingers of {object}", given, "at least one that touches the object", remedy)


@dataclass
class OperatingPoint:
    """State about which a grasp is linearised.

    Attributes:
        where: Kind of the state: "squeezed", "provisional", "recorded" or "start" (see `linearise`).
        stiffness: Derivative of forces and wrench with sticking contacts, (m + r, m + r) (`Grip.stiffness`); None at
            the start, where there are no forces.
        margins: Ratio f_t/(mu f_n) of each finger, (n,) (`grip_margins`).
        assumed: Assumptions, as sentences.
    """

    where: str
    stiffness: FloatArray | None
    margins: FloatArray
    assumed: list[str] = field(default_factory=list)


@dataclass(frozen=True, eq=False)
class Load:
    """Hands and weight that act on a grasp.

    Attributes:
        hands: Stiffness matrix of the hands, (m, m) [N/m].
        weight: Weight of the object along its free degrees of freedom, (r,) [N, N m]; zero if fingers do not carry it.
        closing: Function that returns the intended finger positions (k, m) [m] after k fractions (k,) of the closing of
            the hands.
    """

    hands: FloatArray
    weight: FloatArray
    closing: Callable[[FloatArray], FloatArray]

    @property
    def course(self) -> FloatArray:
        """Intended finger positions after each of the steps in which the hands close, (STEPS, m) [m]."""
        return self.closing(np.arange(1, STEPS + 1) / STEPS)


def load_of(
    parts: Parts,
    index: int,
    grip: Grip,
    fingers: NDArray[np.intp],
    point: OperatingPoint,
    force: FloatArray | None = None,
) -> Load:
    """Return the hands that close to their largest squeeze, without other motion, and the weight if fingers carry it.

    Args:
        parts: Parts of the scene.
        index: Index of the object.
        grip: Object with its fingers.
        fingers: Indices in the scene of the fingers on the object.
        point: State to whose assumptions ignored weights are added.
        force: Forces of the fingers on the object, (n, d) [N], which determine the stiffness of hands that stiffen with
            the grip force; None for zero.
    """
    scene, start = parts.scene, parts.start
    n, d = start.shape
    inward = np.zeros_like(start)
    inward[fingers] = grip.grasped.inward()
    grips = np.zeros_like(start)
    grips[fingers] = 0.0 if force is None else force
    K, hands = np.zeros((n, d, n, d)), list(still_hands(parts, inward))
    for still in hands:
        stiffness = still.stiffness(grips[still.fingers])
        for a in range(d):
            K[np.ix_(still.fingers, [a], still.fingers, [a])] = stiffness[a][:, None, :, None]
    own = K[fingers][:, :, fingers].reshape(grip.m, grip.m)
    weight = np.zeros(6)
    rules = scene.coupling
    carried = rules.contact == "attached" or rules.friction == "stick" or any(scene.coefficients) or d == 1
    if scene.gravity is not None and carried and not scene.obstacle:
        weight[:d] = float(grip.grasped.body_state[body.MASS]) * np.array(scene.gravity)
    elif scene.gravity is not None:
        others = ", ".join(bearers(scene, index))
        point.assumed.append(
            f"the weight is carried by other supports, which are ignored ({others})"
            if others
            else "the weight is ignored: without friction the fingers do not carry it"
        )

    def closing(shares: FloatArray) -> FloatArray:
        course = np.tile(start, (len(shares), 1, 1))
        for still in hands:
            for k, share in enumerate(shares.tolist()):
                course[k, still.fingers] = still.hand.target(still.closed * share)[0]
        return course[:, fingers].reshape(len(shares), -1)

    return Load(own, weight[grip.axes], closing)


def squeezed(parts: Parts, index: int, grip: Grip, fingers: NDArray[np.intp]) -> OperatingPoint:
    """Find the equilibrium of a grasp with closed hands.

    For hands that stiffen with the grip force, the search is repeated until the stiffness of the hands agrees with the
    forces in equilibrium. If all fingers that do not touch the object in equilibrium are on hardware, the start is
    returned.

    Raises:
        NoRestError: If no equilibrium is found, or a finger that is not on hardware does not touch in equilibrium.
    """
    first, force = grip.changing.copy(), np.zeros((grip.n, grip.d))
    point = _squeezed(parts, index, grip, fingers, force)
    if not any(_stiffens(parts, i) for i in fingers.tolist()):
        return point
    for _ in range(MOST_GRIPS):
        before, force = force, grip.grasped.force.copy()
        if point.stiffness is None or np.abs(force - before).max() <= SAME_GRIP * np.abs(force).max():
            return point
        grip.changing[:] = first
        point = _squeezed(parts, index, grip, fingers, force)
    raise no_rest_error(
        parts.objects[index].table.name,
        f"grip forces and stiffness of the hands still change by more than {SAME_GRIP:g} after {MOST_GRIPS} iterations",
    )


def _stiffens(parts: Parts, finger: int) -> bool:
    """Return whether the hand of a finger stiffens with the grip force."""
    table = next(hand.holding.table for hand in parts.hands if finger in hand.fingers)
    return getattr(table, "stiffening", None) is not None


def _squeezed(parts: Parts, index: int, grip: Grip, fingers: NDArray[np.intp], force: FloatArray) -> OperatingPoint:
    """Find the equilibrium of a grasp with the stiffness that the hands have at given forces (n, d) [N]."""
    scene, start, name = parts.scene, parts.start[fingers], parts.objects[index].table.name
    point = OperatingPoint("squeezed", None, np.full(grip.n, np.nan))
    load = load_of(parts, index, grip, fingers, point, force)
    grip.grasped.finger_position[:] = start
    initial = grip.changing.copy()
    some = load.closing(COMPARED_AT)
    is_bent, way = bent(some, start.ravel()), some[-1] - start.ravel()
    result = None
    if not is_bent:  # the path is irrelevant if every contact begins early or never, and no contact slides
        result = settle(grip, start.ravel() + QUICK[:, None] * way, load.hands, load.weight, early=EARLY)
        if result is None or not result.rest:
            grip.changing[:] = initial
            result = None
    if result is None:
        straight = start.ravel() + np.linspace(1.0 / STEPS, 1.0, STEPS)[:, None] * way
        result = settle(grip, straight, load.hands, load.weight)
    if result is None or result.slid.any() or is_bent:
        # the path matters if contacts slide, or hands approach from the side
        first, reached = result, grip.changing.copy()
        grip.changing[:] = initial
        result = settle(grip, load.course, load.hands, load.weight)
        if (result is None or not result.rest) and first is not None and first.rest:
            result, grip.changing[:] = first, reached
    if result is not None:
        log.info("settling: %s in %d steps", "at rest" if result.rest else "no rest", result.steps)
    if result is None:
        raise no_rest_error(name, "the forces of a sample did not converge during the search")
    if not result.rest:
        slipping = [scene.finger_names[i] for i in fingers[result.sliding]]
        raise no_rest_error(
            name,
            f"contacts of {', '.join(slipping)} still slide after {result.steps} steps, although the hands do not move"
            if slipping
            else f"the forces do not balance after {result.steps} steps, although the hands do not move",
        )
    if result.slid.any():
        point.assumed.append(SLID)
    if not grip.grasped.touching.all():
        return at_start(parts, index, grip, fingers, point)
    return operating_point(name, grip, point)


def bent(course: FloatArray, start: FloatArray) -> bool:
    """Return whether the intended path of the fingers from their start to the last row of `course` is not straight."""
    way = course[-1] - start
    length = float(np.linalg.norm(way))
    along = np.outer((course - start) @ way, way) / max(length**2, 1e-300)
    return bool(np.abs(course - start - along).max(initial=0.0) > STRAIGHT * length)


def provisional(parts: Parts, index: int, grip: Grip, fingers: NDArray[np.intp]) -> OperatingPoint:
    """Approximate the equilibrium of a grasp with closed hands by one linear step from the start."""
    point, name = OperatingPoint("provisional", None, np.full(grip.n, np.nan)), parts.objects[index].table.name
    load = load_of(parts, index, grip, fingers, point)
    g = grip.grasped
    # slightly inside, so that difference quotients find every finger touching
    g.finger_position[:] = g.contact_position + PRESSED * g.inward()
    with grip.frozen():
        now = grip.forces()
        J = None if now is None else grip.stiffness(grip.lengths(), both=False)
        if now is None or J is None:
            raise no_rest_error(name, "the forces of a sample do not converge")
        A = np.vstack([J[: grip.m], -J[grip.m :]])
        A[: grip.m, : grip.m] += load.hands
        pull = load.hands @ (load.closing(np.ones(1))[0] - g.finger_position.ravel()) - now[: grip.m]
        grip.move(np.linalg.lstsq(A, np.concatenate([pull, now[grip.m :] + load.weight]), rcond=None)[0])
        if grip.forces() is None:
            raise no_rest_error(name, "the forces of a sample do not converge")
    point.assumed.append(
        "provisional: the equilibrium is approximated by one linear step from the start, with sticking contacts"
    )
    if not grip.grasped.touching.all():
        return at_start(parts, index, grip, fingers, point)
    return operating_point(name, grip, point)


def require_contact(parts: Parts, index: int, grip: Grip, fingers: NDArray[np.intp]) -> None:
    """Raise an error if no finger touches the object while the hands close without other motion.

    There is no error if contacts are attached or a finger is on hardware, because operators can move such fingers to
    the object.

    Raises:
        NotGraspingError: If no finger touches the object while the hands close.
    """
    if parts.scene.coupling.contact == "attached" or led(parts).intersection(fingers.tolist()):
        return
    course = load_of(parts, index, grip, fingers, OperatingPoint("start", None, np.empty(0))).course
    gaps = grip.grasped.array(FingerState.gap)
    for positions in course.reshape(-1, grip.n, grip.d):
        grip.grasped.meet(positions)
        if gaps.min() <= ON_SURFACE:
            return
    raise NotGraspingError(parts.objects[index].name, float(gaps.min()), "hands closed and still")


def led(parts: Parts) -> set[int]:
    """Return the indices of the fingers on hardware, which the operator can move to any position."""
    return {i for wire in parts.wires if is_hardware(wire.device) for i in wire.fingers}


def operating_point(name: str, grip: Grip, point: OperatingPoint) -> OperatingPoint:
    """Compute `stiffness` and `margins` of the state `point` from the present positions of the grip, and return it.

    Raises:
        NoRestError: If the derivative of the forces cannot be computed.
    """
    point.margins = grip_margins(grip.grasped)
    with grip.frozen():
        J = grip.stiffness(grip.lengths())
    if J is None or not np.isfinite(J).all():
        raise no_rest_error(name, "the derivative of the forces cannot be computed in equilibrium")
    point.stiffness = J
    return point


def no_rest_error(
    name: str, why: str, do: str = "run the scene until it rests, and certify its recording"
) -> NoRestError:
    """Return the error for a grasp whose equilibrium was not found, with the reason and what the user can do."""
    return NoRestError("object", name, "a grasp that comes to rest", f"{why}; {do}")


def incomplete(scene: Scene, index: int, apart: NDArray[np.intp], when: str) -> NoRestError:
    """Return the error for an equilibrium in which the fingers `apart` do not touch the object."""
    names = ", ".join(scene.finger_names[i] for i in apart)
    does = "does" if len(apart) == 1 else "do"
    why = f"{when} {names} {does} not touch the object"
    return no_rest_error(scene.object[index].name, why, "place these fingers nearer, or omit them to judge the others")


def at_start(parts: Parts, index: int, grip: Grip, fingers: NDArray[np.intp], point: OperatingPoint) -> OperatingPoint:
    """Return the start as the state about which a grasp is linearised, because some fingers do not touch the object.

    Raises:
        NoRestError: If a finger that does not touch the object is not on hardware.
    """
    apart = fingers[grip.grasped.touching == 0.0]
    if not led(parts).issuperset(apart.tolist()):
        raise incomplete(parts.scene, index, apart, "with the hands closed")
    why = f"{UNFORCED}{', '.join(parts.scene.finger_names[i] for i in apart)} can be moved to the object"
    return OperatingPoint("start", None, np.full_like(point.margins, np.nan), [*point.assumed, why])


# The search for the rest ---------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Settlement:
    """Result of a search for an equilibrium.

    Attributes:
        rest: Whether an equilibrium was found.
        slid: Mask of the contacts that slid during the search, (n,).
        sliding: Mask of the contacts that slide in the last step, (n,).
        steps: Number of steps.
    """

    rest: bool
    slid: NDArray[np.bool_]
    sliding: NDArray[np.bool_]
    steps: int


def settle(
    grip: Grip, course: FloatArray, hands: FloatArray, weight: FloatArray, early: int | None = None
) -> Settlement | None:
    """Find the equilibrium K_h (r - p) = f, w + w_g = 0 of a grasp.

    K_h is the stiffness matrix of the hands, r are the intended and p the actual finger positions, f the contact forces
    on the object, w their wrench, and w_g the weight of the object.

    The hands close along `course`, and then the weight is applied. The steps are implicit time steps of a motion
    against viscous friction; with increasing time step they approach Newton steps. As a step is linear, it does not
    account for contacts that begin or end during the step. Therefore, the viscous friction is increased for some steps
    after a contact has begun or ended; otherwise, the object could move back and forth between the fingers.

    The faces, anchors and slip of contacts are stored between steps, as in a run. Each step treats contacts as
    sticking, but the imbalance of forces is computed with contacts that can slide. If contacts slide, a step multiplies
    the imbalance by about k/(k + k_h), with the stiffness k of the contact and k_h of the hand. Later steps therefore
    treat sliding contacts as sliding, as long as this reduces the imbalance.

    Args:
        grip: Object with its fingers, which are moved to the equilibrium.
        course: Intended positions r in each step of the closing, (steps, m) [m].
        hands: Stiffness matrix K_h, (m, m) [N/m].
        weight: Weight w_g along the free degrees of freedom, (r,) [N, N m].
        early: Last step in which a contact may begin or end. If a contact begins or ends later, or slides, the search
            ends without an equilibrium. None for no such condition.

    Returns:
        Result of the search; None if the forces of a sample do not converge.
    """
    m, size = grip.m, grip.m + grip.r
    lengths = grip.lengths()
    scale = (SHIFT / lengths) ** 2
    drag = float(np.abs(np.diag(hands)).max(initial=0.0)) or 1.0
    every = 1 if size <= 24 else 6
    p, status = grip.grasped.finger_position, grip.grasped.array(FingerState.status)
    slid = np.zeros(grip.n, dtype=bool)
    J: FloatArray | None = None
    touching, met, stiffest = grip.grasped.touching.copy(), 0, drag
    steps = len(course)
    end, trusted = steps + SETTLING, steps
    before = np.inf
    for k in range(end + SLIDING):
        falling = weight * min(1.0, max(0.0, (k - steps) / steps))
        r = course[min(k, steps - 1)]
        now = grip.forces()
        if now is None:
            return None
        sliding = status == SLIDE
        slid |= sliding
        changed = not np.array_equal(touching, grip.grasped.touching)
        if early is not None and (slid.any() or (changed and k > early)):
            break
        left = np.concatenate([hands @ (r - p.ravel()) - now[:m], now[m:] + falling])
        force = max(float(np.abs(now[:m]).max(initial=0.0)), 1e-6)
        if k > 2 * steps and np.abs(left[:m]).max(initial=0.0) < SETTLED * force:
            turns = np.abs(left[m:] * (lengths[m:] / SHIFT)).max(initial=0.0)
            if turns < SETTLED * force:
                return Settlement(True, slid, sliding, k)
        if k >= end and not slid.any():
            break
        if k % (every if k < end else REFRESH) == 0 or J is None:
            with grip.frozen() if slid.any() else nullcontext():
                J = grip.stiffness(lengths, both=False)
            if J is None:
                return None
        unbalanced = float(np.linalg.norm(left * lengths / SHIFT))
        if unbalanced > before:
            trusted = max(trusted, k + DISTRUST)
        before = unbalanced
        tangent = softened(grip, J, sliding) if k >= trusted and sliding.any() else J
        A = np.vstack([tangent[:m], -tangent[m:]])
        A[:m, :m] += hands
        slow = drag * (1.0 if k < steps else 10.0 ** (-8.0 * min((k - steps) / steps, 1.0)))
        stiffest = max(stiffest, float(np.abs(np.diag(J)[:m]).max(initial=0.0)))
        if changed:
            touching, met = grip.grasped.touching.copy(), k + MEETING
        if k < met:
            slow = max(slow, grip.n * stiffest)
        step = np.linalg.solve(A + slow * np.diag(scale), left)
        longest = float(np.abs(step * SHIFT / lengths).max(initial=0.0))
        grip.move(step * min(1.0, 1e-3 / longest) if longest > 1e-3 else step)
    return Settlement(False, slid, sliding, k)


def softened(grip: Grip, J: FloatArray, sliding: NDArray[np.bool_]) -> FloatArray:
    """Return the derivative J of the forces (m + r, m + r) for the case that sliding contacts continue to slide.

    The result is J itself if Coulomb's law has no solution.
    """
    wide = np.zeros((2, len(J), int(sliding.sum())))
    wide[:, : grip.m] = edge_directions(grip.grasped, np.flatnonzero(sliding).tolist())
    softer = released(J, *wide)
    return J if softer is None else softer
