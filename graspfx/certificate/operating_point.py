"""State about which a grasp is linearised: its rest with closed hands, one linear step from the start, or the start."""

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
SLID = "contacts slid while the hands closed slowly; a run's rest may differ by a few per cent: certify its recording"


class NotGraspingError(InputError):
    """An object that no finger touches, so that no grasp can be judged.

    Args:
        object: Name of the object.
        gap: Distance to the nearest finger [m].
        where: State of the hands, as text.
    """

    def __init__(self, object: str, gap: float, where: str) -> None:
        self.object, self.gap, self.where = object, gap, where
        given = f"nearest finger {1e3 * gap:.3g} mm away, {where}"
        remedy = "place them nearer or squeeze more; if motions close the gap, certify a recording that ends in a grasp"
        super().__init__(f"fingers of {object}", given, "at least one that touches the object", remedy)


@dataclass
class OperatingPoint:
    """Operating point: state about which a grasp is linearised.

    Attributes:
        where: "squeezed", "provisional", "recorded" or "start".
        stiffness: J (m + r, m + r) in this state, with sticking contacts; None at the start, without forces.
        margins: Friction in use f_t/(mu f_n) of each finger, (n,); nan without a coefficient or a normal force.
        assumed: Assumptions, as sentences.
    """

    where: str
    stiffness: FloatArray | None
    margins: FloatArray
    assumed: list[str] = field(default_factory=list)


@dataclass(frozen=True, eq=False)
class Load:
    """Loads on a grasp apart from the coupling's forces.

    Attributes:
        hands: Stiffness K_h of the hands, (m, m) [N/m].
        weight: Weight along the free degrees of freedom, (r,) [N, N m].
        closing: Function that returns the intended positions (k, m) [m] at fractions (k,) of the hands' closing time.
    """

    hands: FloatArray
    weight: FloatArray
    closing: Callable[[FloatArray], FloatArray]

    @property
    def course(self) -> FloatArray:
        """Intended positions of all steps, (STEPS, m) [m]."""
        return self.closing(np.arange(1, STEPS + 1) / STEPS)


def load_of(
    parts: Parts,
    index: int,
    grip: Grip,
    fingers: NDArray[np.intp],
    point: OperatingPoint,
    force: FloatArray | None = None,
) -> Load:
    """Return the load of hands that close to their largest squeeze without motions, and the weight if fingers carry it.

    Args:
        parts, index, grip, fingers: Parts of the scene, index of the object, its grip and its fingers.
        point: State whose list of assumptions gets an entry for each omitted effect.
        force: Forces of the fingers, (n, d) [N], for hands that stiffen with the grip; zero if None.
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
    """Bring the grip to rest. If a finger on hardware does not touch, the result is the start, without a stiffness.

    For hands that stiffen with the grip, iteration finds the stiffness that matches the forces at rest.

    Raises:
        NoRestError: If no rest is found, or a finger that is not on hardware does not touch at rest.
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
        parts.objects[index].table.name, "the iteration of the grip force and the hands' stiffness does not converge"
    )


def _stiffens(parts: Parts, finger: int) -> bool:
    """True if the hand of a finger stiffens with the grip."""
    table = next(hand.holding.table for hand in parts.hands if finger in hand.fingers)
    return getattr(table, "stiffening", None) is not None


def _squeezed(parts: Parts, index: int, grip: Grip, fingers: NDArray[np.intp], force: FloatArray) -> OperatingPoint:
    """Bring the grip to rest with the stiffness that the hands have at these forces."""
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
        raise no_rest_error(name, "before a rest was reached, the forces of a sample did not converge")
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
    """True if the hands' path from the fingers' start to the final targets is not straight."""
    way = course[-1] - start
    length = float(np.linalg.norm(way))
    along = np.outer((course - start) @ way, way) / max(length**2, 1e-300)
    return bool(np.abs(course - start - along).max(initial=0.0) > STRAIGHT * length)


def provisional(parts: Parts, index: int, grip: Grip, fingers: NDArray[np.intp]) -> OperatingPoint:
    """Squeeze the grip by one linear step from its sticking contacts at the start, without a search for a rest."""
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
        "provisional: the squeeze of one step from the start with sticking contacts, without a search for the rest"
    )
    if not grip.grasped.touching.all():
        return at_start(parts, index, grip, fingers, point)
    return operating_point(name, grip, point)


def require_contact(parts: Parts, index: int, grip: Grip, fingers: NDArray[np.intp]) -> None:
    """Require that at least one finger touches the object when the hands close without other motion.

    Fingers on hardware are exempt, because the operator can move them anywhere.

    Raises:
        NotGraspingError: If no finger touches while the hands close.
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
    """Return the fingers on hardware, which the operator can move anywhere."""
    return {i for wire in parts.wires if is_hardware(wire.device) for i in wire.fingers}


def operating_point(name: str, grip: Grip, point: OperatingPoint) -> OperatingPoint:
    """Set the stiffness and margins of an object's state from the present grip."""
    point.margins = grip_margins(grip.grasped)
    with grip.frozen():
        J = grip.stiffness(grip.lengths())
    if J is None or not np.isfinite(J).all():
        raise no_rest_error(name, "the forces have no derivative at rest")
    point.stiffness = J
    return point


def no_rest_error(
    name: str, why: str, do: str = "run the scene until it rests, and certify its recording"
) -> NoRestError:
    """Return the error of a grasp without a rest, for which no other state is substituted."""
    return NoRestError("object", name, "a grasp that comes to rest", f"{why}; {do}")


def incomplete(scene: Scene, index: int, apart: NDArray[np.intp], when: str) -> NoRestError:
    """Return the error of a rest at which some of the fingers do not touch the object."""
    names = ", ".join(scene.finger_names[i] for i in apart)
    does = "does" if len(apart) == 1 else "do"
    why = f"{when} {names} {does} not touch the object"
    return no_rest_error(scene.object[index].name, why, "place these fingers nearer, or omit them to judge the others")


def at_start(parts: Parts, index: int, grip: Grip, fingers: NDArray[np.intp], point: OperatingPoint) -> OperatingPoint:
    """Return the start as the state if the fingers that do not touch are on hardware.

    Raises:
        NoRestError: If a finger that does not touch is not on hardware.
    """
    apart = fingers[grip.grasped.touching == 0.0]
    if not led(parts).issuperset(apart.tolist()):
        raise incomplete(parts.scene, index, apart, "with the hands closed")
    why = f"{UNFORCED}{', '.join(parts.scene.finger_names[i] for i in apart)} can be moved to the object"
    return OperatingPoint("start", None, np.full_like(point.margins, np.nan), [*point.assumed, why])


# The search for the rest ---------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Settlement:
    """Result of a search for a rest.

    Attributes:
        rest: True if a rest was reached.
        slid: Mask of the contacts that slid during the search, (n,).
        sliding: Mask of the contacts that still slide, (n,).
        steps: Number of steps.
    """

    rest: bool
    slid: NDArray[np.bool_]
    sliding: NDArray[np.bool_]
    steps: int


def settle(
    grip: Grip, course: FloatArray, hands: FloatArray, weight: FloatArray, early: int | None = None
) -> Settlement | None:
    """Bring fingers and object to rest: K_h (r - p) = f, wrench + weight = 0. Return None if a sample fails.

    The hands close along `course`, and then gravity is applied. The steps are implicit steps of a motion that only
    friction resists. As the time step grows, they become Newton steps. A step cannot foresee new contacts. After a
    contact begins or ends, the next steps are therefore resisted by the largest contact stiffness; otherwise the object
    would be thrown from finger to finger.

    The faces, anchors and slip of contacts are stored between steps, as in a run. Each step treats contacts as frozen,
    but the remaining imbalance is computed with the true contacts. If contacts slide, a step reduces the imbalance only
    to about k/(k + k_h) of its value, with the stiffnesses k of the contact and k_h of the hand. Later steps therefore
    treat sliding contacts as sliding, as long as this reduces the imbalance.

    Args:
        course: Intended positions r (steps, m) [m]; the last positions are held.
        hands: Stiffness K_h of the hands, (m, m) [N/m].
        weight: Weight along the free degrees of freedom, (r,) [N, N m].
        early: Last step at which a contact may begin or end. A contact that begins or ends later, or slides, ends the
            search without a rest. None for no such limit.
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
    """Return J with sliding contacts that continue to slide; J itself if friction has no solution."""
    wide = np.zeros((2, len(J), int(sliding.sum())))
    wide[:, : grip.m] = edge_directions(grip.grasped, np.flatnonzero(sliding).tolist())
    softer = released(J, *wide)
    return J if softer is None else softer
