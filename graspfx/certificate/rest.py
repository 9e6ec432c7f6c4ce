"""Where a grasp is linearised: the rest to which still hands bring it, one step from the start, or the start itself."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from graspfx import log
from graspfx.analysis.grasp_stiffness import released
from graspfx.assembly.resolve import Parts
from graspfx.assembly.still_hands import still_hands
from graspfx.certificate.grip import SHIFT, Grip, bearers, edge_directions, grip_margins
from graspfx.cones.problem import SLIDE
from graspfx.coupling import block as at
from graspfx.coupling.grasp_state import FingerState
from graspfx.errors import InputError, NoRestError
from graspfx.loop.device import is_hardware
from graspfx.objects import integrators as body
from graspfx.scene.model import Scene

FloatArray = NDArray[np.float64]

STEPS = 24  # in which the hands close, then the weight comes on
EARLY = 2  # of them, in which contacts may begin on a quick way
QUICK = np.array([1.0 / STEPS, 2.0 / STEPS, 0.25, 0.5, 0.75, 1.0])  # of the way to closed hands: the first as slow
LOOKED_AT = np.array([0.2, 0.45, 0.7, 1.0])  # of the way, where it is compared with a straight one
SETTLING = 40  # further steps, each longer than the last
SLIDING = 1500  # steps after those, where contacts slid
SETTLED = 1e-9  # of the largest force: what may be left unbalanced
REFRESH = 16  # of those steps for one stiffness
MEETING = 8  # steps after a finger has begun or ceased to touch, in which nothing moves far
DISTRUST = 8  # steps of frozen contacts after one of sliding contacts that has not helped
STRAIGHT = 1e-6  # of its length: what a straight way may be off
PRESSED = 5.0 * SHIFT  # [m]: how deep a finger has to be for difference quotients to find it touching
ON_SURFACE = 1e-9  # [m]: the rounding of a finger that starts on the surface
MOST_GRIPS = 60  # repetitions, of a grip and the stiffness that it gives
SAME_GRIP = 1e-8  # relative: what the forces of two of them may differ by
UNFORCED = "contacts as at the start and no force on them: "
SLID = (
    "contacts slid while the hands closed, one after another and slowly; a run rests elsewhere by some per cent: "
    "certify its recording"
)


class NotGraspingError(InputError):
    """A grasp that no finger touches: it has no rest to be judged at.

    Args:
        object: its name.
        gap: of the nearest finger [m].
        where: the hands then, in words.
    """

    def __init__(self, object: str, gap: float, where: str) -> None:
        self.object, self.gap, self.where = object, gap, where
        given = f"nearest finger {1e3 * gap:.3g} mm away, {where}"
        remedy = "bring them nearer or squeeze more; where motions bring them, certify a recording that ends in a grasp"
        super().__init__(f"fingers of {object}", given, "at least one that touches the object", remedy)


@dataclass
class Place:
    """A grasp where it is linearised.

    Attributes:
        where: "squeezed", "provisional", "recorded" or "start".
        stiffness: J (m + r, m + r) there, contacts sticking; None at the start, without any force.
        margins: f_t/(mu f_n) of each finger, (n,); nan where there is none.
        assumed: what that takes for granted.
    """

    where: str
    stiffness: FloatArray | None
    margins: FloatArray
    assumed: list[str] = field(default_factory=list)


@dataclass(frozen=True, eq=False)
class Load:
    """The pull on a grasp besides its coupling.

    Attributes:
        hands: K_h (m, m) [N/m].
        weight: on the free freedoms (r,) [N, N m].
        closing: gives the intended positions (k, m) [m] at shares (k,) of the hands' way.
    """

    hands: FloatArray
    weight: FloatArray
    closing: Callable[[FloatArray], FloatArray]

    @property
    def course(self) -> FloatArray:
        """The intended positions step by step (STEPS, m) [m]."""
        return self.closing(np.arange(1, STEPS + 1) / STEPS)


def load_of(
    parts: Parts, index: int, grip: Grip, fingers: NDArray[np.intp], place: Place, force: FloatArray | None = None
) -> Load:
    """Give the hands without their motions, closed as far as they ever are, and the weight where fingers bear it.

    Args:
        parts, index, grip, fingers: of the scene, and of the object in it.
        place: that is told what is left out.
        force: of the fingers (n, d) [N], for hands that grip makes stiffer; zero if None.
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
        place.assumed.append(
            f"the weight is carried by something else, which is left out ({others})"
            if others
            else "the weight is left out: without friction the fingers do not carry it"
        )

    def closing(shares: FloatArray) -> FloatArray:
        course = np.tile(start, (len(shares), 1, 1))
        for still in hands:
            for k, share in enumerate(shares.tolist()):
                course[k, still.fingers] = still.hand.target(still.closed * share)[0]
        return course[:, fingers].reshape(len(shares), -1)

    return Load(own, weight[grip.axes], closing)


def squeezed(parts: Parts, index: int, grip: Grip, fingers: NDArray[np.intp]) -> Place:
    """Bring the grip to rest; the place has no stiffness, and says why, where a finger on hardware does not touch.

    Hands that grip makes stiffer are as stiff as the forces at rest make them, which is looked for by repetition.

    Raises:
        NoRestError: none was found, or one without all fingers.
    """
    first, force = grip.changing.copy(), np.zeros((grip.n, grip.d))
    place = _squeezed(parts, index, grip, fingers, force)
    if not any(_stiffens(parts, i) for i in fingers.tolist()):
        return place
    for _ in range(MOST_GRIPS):
        before, force = force, grip.grasped.force.copy()
        if place.stiffness is None or np.abs(force - before).max() <= SAME_GRIP * np.abs(force).max():
            return place
        grip.changing[:] = first
        place = _squeezed(parts, index, grip, fingers, force)
    raise restless(parts.objects[index].table.name, "the grip and the stiffness that it gives the hands do not settle")


def _stiffens(parts: Parts, finger: int) -> bool:
    """Tell whether grip makes the hand of a finger stiffer."""
    table = next(hand.holding.table for hand in parts.hands if finger in hand.fingers)
    return getattr(table, "stiffening", None) is not None


def _squeezed(parts: Parts, index: int, grip: Grip, fingers: NDArray[np.intp], force: FloatArray) -> Place:
    """Bring the grip to rest in hands as stiff as these forces make them."""
    scene, start, name = parts.scene, parts.start[fingers], parts.objects[index].table.name
    place = Place("squeezed", None, np.full(grip.n, np.nan))
    load = load_of(parts, index, grip, fingers, place, force)
    grip.grasped.finger_position[:] = start
    initial = grip.changing.copy()
    some = load.closing(LOOKED_AT)
    is_bent, way = bent(some, start.ravel()), some[-1] - start.ravel()
    result = None
    if not is_bent:  # where contacts begin at once or not at all, and none slides, the way makes no difference
        result = settle(grip, start.ravel() + QUICK[:, None] * way, load.hands, load.weight, early=EARLY)
        if result is None or not result.rest:
            grip.changing[:] = initial
            result = None
    if result is None:
        straight = start.ravel() + np.linspace(1.0 / STEPS, 1.0, STEPS)[:, None] * way
        result = settle(grip, straight, load.hands, load.weight)
    if result is None or result.slid.any() or is_bent:
        # where contacts slide, or hands come from aside, it matters how they close
        first, reached = result, grip.changing.copy()
        grip.changing[:] = initial
        result = settle(grip, load.course, load.hands, load.weight)
        if (result is None or not result.rest) and first is not None and first.rest:
            result, grip.changing[:] = first, reached
    if result is not None:
        log.info("settling: %s in %d steps", "at rest" if result.rest else "no rest", result.steps)
    if result is None:
        raise restless(name, "on the way to rest the forces of a sample do not settle")
    if not result.rest:
        slipping = [scene.finger_names[i] for i in fingers[result.sliding]]
        raise restless(
            name,
            f"with still hands {', '.join(slipping)} still slide after {result.steps} steps"
            if slipping
            else f"with still hands forces do not balance after {result.steps} steps",
        )
    if result.slid.any():
        place.assumed.append(SLID)
    if not grip.grasped.touching.all():
        return unforced(parts, index, grip, fingers, place)
    return about(name, grip, place)


def bent(course: FloatArray, start: FloatArray) -> bool:
    """Tell whether hands close to their last targets by another way than a straight one from the fingers' start."""
    way = course[-1] - start
    length = float(np.linalg.norm(way))
    along = np.outer((course - start) @ way, way) / max(length**2, 1e-300)
    return bool(np.abs(course - start - along).max(initial=0.0) > STRAIGHT * length)


def provisional(parts: Parts, index: int, grip: Grip, fingers: NDArray[np.intp]) -> Place:
    """Squeeze the grip by one linear step from its contacts at the start, as if they stuck; no search for a rest."""
    place, name = Place("provisional", None, np.full(grip.n, np.nan)), parts.objects[index].table.name
    load = load_of(parts, index, grip, fingers, place)
    g = grip.grasped
    # just inside, so that quotients find every finger touching
    g.finger_position[:] = g.contact_position + PRESSED * g.inward()
    with grip.frozen():
        now = grip.forces()
        J = None if now is None else grip.stiffness(grip.lengths(), both=False)
        if now is None or J is None:
            raise restless(name, "the forces of a sample do not settle")
        A = np.vstack([J[: grip.m], -J[grip.m :]])
        A[: grip.m, : grip.m] += load.hands
        pull = load.hands @ (load.closing(np.ones(1))[0] - g.finger_position.ravel()) - now[: grip.m]
        grip.move(np.linalg.lstsq(A, np.concatenate([pull, now[grip.m :] + load.weight]), rcond=None)[0])
        if grip.forces() is None:
            raise restless(name, "the forces of a sample do not settle")
    place.assumed.append(
        "provisional: the squeeze of one step from the start, as if contacts stuck; no rest was sought"
    )
    if not grip.grasped.touching.all():
        return unforced(parts, index, grip, fingers, place)
    return about(name, grip, place)


def require_contact(parts: Parts, index: int, grip: Grip, fingers: NDArray[np.intp]) -> None:
    """Require that still hands bring at least one finger to the object on the way to where they are closed.

    Fingers on hardware may be led anywhere: nothing is required of them.

    Raises:
        NotGraspingError: none touches on the way.
    """
    if parts.scene.coupling.contact == "attached" or led(parts).intersection(fingers.tolist()):
        return
    course = load_of(parts, index, grip, fingers, Place("start", None, np.empty(0))).course
    gaps = grip.grasped.array(FingerState.gap)
    for positions in course.reshape(-1, grip.n, grip.d):
        grip.grasped.meet(positions)
        if gaps.min() <= ON_SURFACE:
            return
    raise NotGraspingError(parts.objects[index].name, float(gaps.min()), "hands closed and still")


def led(parts: Parts) -> set[int]:
    """Give the fingers on hardware, which may be led anywhere."""
    return {i for wire in parts.wires if is_hardware(wire.device) for i in wire.fingers}


def about(name: str, grip: Grip, place: Place) -> Place:
    """Give the place of an object its stiffness and margins as the grip is now."""
    place.margins = grip_margins(grip.grasped)
    with grip.frozen():
        J = grip.stiffness(grip.lengths())
    if J is None or not np.isfinite(J).all():
        raise restless(name, "the forces have no derivative at rest")
    place.stiffness = J
    return place


def restless(name: str, why: str, do: str = "run the scene until it rests, and certify its recording") -> NoRestError:
    """Make the error of an object's grasp that has no rest: no other state stands in for it."""
    return NoRestError("object", name, "a grasp that comes to rest", f"{why}; {do}")


def incomplete(scene: Scene, index: int, apart: NDArray[np.intp], when: str) -> NoRestError:
    """Make the error of a grasp that rests without some of its fingers."""
    names = ", ".join(scene.finger_names[i] for i in apart)
    does = "does" if len(apart) == 1 else "do"
    why = f"{when} {names} {does} not touch the object"
    return restless(scene.object[index].name, why, "bring such fingers nearer, or leave them out to judge the others")


def unforced(parts: Parts, index: int, grip: Grip, fingers: NDArray[np.intp], place: Place) -> Place:
    """Give the start instead of a place where fingers that do not touch are on hardware.

    Raises:
        NoRestError: hands that are simulated leave a finger away from the object.
    """
    apart = fingers[grip.grasped.touching == 0.0]
    if not led(parts).issuperset(apart.tolist()):
        raise incomplete(parts.scene, index, apart, "with the hands closed")
    why = f"{UNFORCED}{', '.join(parts.scene.finger_names[i] for i in apart)} may be led to the object"
    return Place("start", None, np.full_like(place.margins, np.nan), [*place.assumed, why])


# The search for the rest ---------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Settlement:
    """How a search for rest went.

    Attributes:
        rest: whether it was reached.
        slid: (n,), which contacts slid on the way.
        sliding: (n,), which ones still slid at the end.
        steps: that it took.
    """

    rest: bool
    slid: NDArray[np.bool_]
    sliding: NDArray[np.bool_]
    steps: int


def settle(
    grip: Grip, course: FloatArray, hands: FloatArray, weight: FloatArray, early: int | None = None
) -> Settlement | None:
    """Bring fingers and object to rest: K_h (r - p) = f, wrench + weight = 0. None if a sample's forces fault.

    The hands close along `course`, then the weight comes on: implicit steps of a motion that friction alone resists,
    its time step growing until they are Newton's. A step knows nothing of contacts that are not there yet: where one
    begins or ends, the next steps are resisted as by the stiffest one, or an object would be thrown from finger to
    finger.

    Contacts keep what a run would keep: faces, anchors, what has slipped. Each step is that of contacts frozen where
    they are, and the forces left over are the true ones: where contacts slide they shrink in proportion only, by
    k/(k + k_h) a step or so. So after a while steps are those of contacts that slide on, as long as that helps.

    Args:
        course: intended positions r (steps, m) [m], the last ones from then on.
        hands: K_h (m, m) [N/m].
        weight: on the free freedoms (r,) [N, N m].
        early: the last step at which a contact may begin: one that begins, ends or slides later ends the search
            without a rest. None for any.
    """
    m, size = grip.m, grip.m + grip.r
    lengths = grip.lengths()
    scale = (SHIFT / lengths) ** 2
    drag = float(np.abs(np.diag(hands)).max(initial=0.0)) or 1.0
    every = 1 if size <= 24 else 6
    p, status = grip.grasped.finger_position, grip.grasped.rows[:, at.STATUS]
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
    """Give J of contacts that slide on the way that they slide now; J itself where friction leaves no answer."""
    wide = np.zeros((2, len(J), int(sliding.sum())))
    wide[:, : grip.m] = edge_directions(grip.grasped, np.flatnonzero(sliding).tolist())
    softer = released(J, *wide)
    return J if softer is None else softer
