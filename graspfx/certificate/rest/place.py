"""Where a grasp is linearised: brought to rest by still hands, as it begins, or as a recording left it."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from graspfx import log
from graspfx.build.resolve import Parts
from graspfx.build.still_hands import still_hands
from graspfx.certificate.rest.cone_edge import grip_margins
from graspfx.certificate.rest.ground import bearers
from graspfx.certificate.rest.resting import SHIFT, STEPS, Grip, settle
from graspfx.coupling.grasp_state import FingerState
from graspfx.errors import InputError, NoRestError
from graspfx.loop.device import is_hardware
from graspfx.objects import integrators as body
from graspfx.scene.model import Scene

FloatArray = NDArray[np.float64]

UNFORCED = "contacts as at the start and no force on them: "
STRAIGHT = 1e-6  # of its length: what a straight way may be off
PRESSED = 5.0 * SHIFT  # [m]: how deep a finger has to be for difference quotients to find it touching
ON_SURFACE = 1e-9  # [m]: the rounding of a finger that starts on the surface
MOST_GRIPS = 60  # repetitions, of a grip and the stiffness that it gives
SAME_GRIP = 1e-8  # relative: what the forces of two of them may differ by
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
    """The pull on a grasp besides its coupling: hands K_h (m, m), their course (STEPS, m), the weight (r,)."""

    hands: FloatArray
    course: FloatArray
    weight: FloatArray


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
    K, course = np.zeros((n, d, n, d)), np.tile(start, (STEPS, 1, 1))
    for still in still_hands(parts, inward):
        for k in range(STEPS):
            course[k, still.fingers] = still.hand.target(still.closed * ((k + 1) / STEPS))[0]
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
    return Load(own, course[:, fingers].reshape(STEPS, -1), weight[grip.axes])


def squeezed(parts: Parts, index: int, grip: Grip, fingers: NDArray[np.intp]) -> Place:
    """Bring the grip to rest; the place has no stiffness, and says why, where a finger does not touch there.

    Hands that grip makes stiffer are as stiff as the forces at rest make them, which is looked for by repetition.

    Raises:
        NoRestError: none was found.
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
    straight = start.ravel() + np.linspace(1.0 / STEPS, 1.0, STEPS)[:, None] * (load.course[-1] - start.ravel())
    result = settle(grip, straight, load.hands, load.weight)
    if result is None or result.slid.any() or bent(load.course, start.ravel()):
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
        return unforced(place, untouching(scene, grip, fingers))
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
        pull = load.hands @ (load.course[-1] - g.finger_position.ravel()) - now[: grip.m]
        grip.move(np.linalg.lstsq(A, np.concatenate([pull, now[grip.m :] + load.weight]), rcond=None)[0])
        if grip.forces() is None:
            raise restless(name, "the forces of a sample do not settle")
    place.assumed.append(
        "provisional: the squeeze of one step from the start, as if contacts stuck; no rest was sought"
    )
    if not grip.grasped.touching.all():
        return unforced(place, untouching(parts.scene, grip, fingers))
    return about(name, grip, place)


def require_contact(parts: Parts, index: int, grip: Grip, fingers: NDArray[np.intp]) -> None:
    """Require that still hands bring at least one finger to the object on the way to where they are closed.

    Fingers on hardware may be led anywhere: nothing is required of them.

    Raises:
        NotGraspingError: none touches on the way.
    """
    led = {i for wire in parts.wires if is_hardware(wire.device) for i in wire.fingers}
    if parts.scene.coupling.contact == "attached" or led.intersection(fingers.tolist()):
        return
    course = load_of(parts, index, grip, fingers, Place("start", None, np.empty(0))).course
    gaps = grip.grasped.array(FingerState.gap)
    for positions in course.reshape(-1, grip.n, grip.d):
        grip.grasped.meet(positions)
        if gaps.min() <= ON_SURFACE:
            return
    raise NotGraspingError(parts.objects[index].name, float(gaps.min()), "hands closed and still")


def untouching(scene: Scene, grip: Grip, fingers: NDArray[np.intp]) -> str:
    """Say which fingers do not touch although the hands are closed."""
    apart = ", ".join(scene.finger_names[i] for i in fingers[grip.grasped.touching == 0.0])
    return f"with the hands closed {apart} do not touch the object"


def about(name: str, grip: Grip, place: Place) -> Place:
    """Give the place of an object its stiffness and margins as the grip is now."""
    place.margins = grip_margins(grip.grasped)
    with grip.frozen():
        J = grip.stiffness(grip.lengths())
    if J is None or not np.isfinite(J).all():
        raise restless(name, "the forces have no derivative at rest")
    place.stiffness = J
    return place


def restless(name: str, why: str) -> NoRestError:
    """Make the error of an object's grasp that has no rest: no other state stands in for it."""
    do = f"{why}; run the scene until it rests, and certify its recording"
    return NoRestError("object", name, "a grasp that comes to rest", do)


def unforced(place: Place, why: str) -> Place:
    """Give the start instead of a place, and why."""
    return Place("start", None, np.full_like(place.margins, np.nan), [*place.assumed, UNFORCED + why])
