"""The grasps of a scene at the start: hands that have closed, contacts, and where a fade begins."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from graspfx.assembly.resolve import Parts
from graspfx.coupling import block as at
from graspfx.coupling.closed_motion import CREATES, TURN, worst_turn
from graspfx.coupling.fade import FADE, gaps, release_compliance
from graspfx.loop.parts import GraspedPart
from graspfx.loop.plant import Hand
from graspfx.objects.body import NativeBody
from graspfx.scene.tables.reading import listed

if TYPE_CHECKING:
    from graspfx.assembly.hands import HandPart
    from graspfx.scene.model import Scene


FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class StillHand:
    """A hand without its motion and turns: the fingers that it holds, and when it is closed most [s]."""

    hand: Hand
    fingers: list[int]
    closed: float

    def stiffness(self, force: FloatArray) -> FloatArray:
        """Give K (d, n, n) with which it holds its fingers at rest [N/m]: r - p = K^-1 f.

        Args:
            force: f of its fingers at rest (n, d) [N], for a hand that grip makes stiffer.
        """
        operator = getattr(self.hand, "operator", None)
        return self.hand.stiffness if operator is None else np.asarray(operator.at_rest(self.hand.stiffness, force))


def still_hands(parts: Parts, inward: FloatArray, *, guided: bool = True) -> Iterator[StillHand]:
    """Make the hands of a scene as they would close if they neither moved nor turned.

    Args:
        parts: of the scene.
        inward: unit normals of the fingers' contacts (n, d).
        guided: whether their guides have led them to their goals; else they have none.
    """
    for hand in parts.hands:
        yield StillHand(hand.still(guided=guided).hold(parts.start, inward), hand.fingers, _closing_time(hand))


def most_forces(parts: Parts, inward: FloatArray, contacts: FloatArray) -> FloatArray:
    """Give the forces with which hands squeeze at most, K (r - p), (n,) [N].

    r is where a hand closes to, without its guide, and p the finger's start, or its contact if it starts inside of the
    object: a finger that is squeezed in is nearer to r.

    Args:
        parts: of the scene.
        inward: unit normals of the fingers' contacts (n, d).
        contacts: contact points (n, d) [m].
    """
    start = parts.start
    inside = ((start - contacts) * inward).sum(axis=1) > 0.0
    p = np.where(inside[:, None], contacts, start)
    force = np.zeros_like(start)
    for still in still_hands(parts, inward, guided=False):
        away = still.hand.target(still.closed)[0] - p[still.fingers]
        K = still.stiffness(np.zeros_like(away))
        for a in range(start.shape[1]):
            force[still.fingers, a] = K[a] @ away[:, a]
    return np.asarray(np.linalg.norm(force, axis=1))


def _closing_time(hand: HandPart) -> float:
    """Give when a hand is closed most [s]."""
    table = hand.holding.table
    if table is None or table.form == "made":
        return 0.0
    if isinstance(table.squeeze, int | float):
        return table.squeeze_ramp
    most = max(listed(table.squeeze), key=lambda step: step.to)
    return float(most.begin + most.duration) if most.to > 0.0 else 0.0  # hands begin with none


def set_fade(parts: Parts, objects: Sequence[GraspedPart], inward: FloatArray, start: FloatArray) -> None:
    """Let an automatic fade begin where the squeeze of the hands asks for it: fingers have met their objects.

    h1 = 1/2 |1/kep - 1/kip| sum |f|, |f| the most with which a hand squeezes, and 2 mm at least; h2 = h1 + 8 mm.
    """
    rules = parts.scene.coupling
    if rules.fade != "auto" or rules.absent == "follow" or rules.contact == "attached":
        return
    compliance = [release_compliance(each.grasped.law, len(each.fingers), start.shape[1]) for each in objects]
    if not any(compliance):
        return
    for each, soft, push in zip(objects, compliance, squeezes(parts, objects, inward), strict=True):
        fade = gaps(soft * push)
        if fade != FADE:
            each.grasped.set_fade(*fade)
            each.grasped.meet(start[each.fingers])


def squeezes(parts: Parts, objects: Sequence[GraspedPart], inward: FloatArray) -> list[float]:
    """Add up the most that hands squeeze each object with, sum |f| [N]: fingers have met their objects."""
    contacts = parts.start.copy()
    for each in objects:
        contacts[each.fingers] = each.grasped.contact_position
    forces = most_forces(parts, inward, contacts)
    return [float(forces[each.fingers].sum()) for each in objects]


def grasps(parts: Parts) -> list[GraspedPart]:
    """Make the objects that fingers are assigned to, with their contacts where the fingers meet them."""
    start = parts.start
    inward = np.zeros_like(start)
    objects = []
    for part in parts.objects:
        if not len(part.fingers):
            continue
        grasped, fingers = part.grasped(), part.fingers
        if grasped.implicit:
            NativeBody(grasped.body_state).free_motion(parts.scene.period)  # its samples are about the next pose
        grasped.meet(start[fingers])
        inward[fingers] = grasped.inward()
        grasped.finger_position[:] = start[fingers]
        objects.append(GraspedPart(part.name, grasped, fingers))
    set_fade(parts, objects, inward, parts.start)
    return objects


def axes_notes(parts: Parts) -> list[str]:
    """Say how much energy the gains of each object create on a closed turn, where they stand in axes that allow it.

    Those are the world's axes, and any axes where the reaction acts at the contact. The figure is the line integral of
    `worst_turn` about the grasp at the start, without cones.
    """
    return list(_notes(parts)) if _has_axes(parts.scene) else []


def _has_axes(scene: Scene) -> bool:
    """Tell whether a gain is a matrix, and stands where springs may create energy."""
    rules = scene.coupling
    sound = rules.axes != "world" and rules.reaction == "fingertip"
    if hasattr(rules.external, "object_stiffness"):
        return scene.dimensions > 1 and not sound
    gains = [gain for part in (rules.external, rules.internal) for gain in (part.stiffness, part.damping)]
    return scene.dimensions > 1 and not sound and any(np.ndim(gain) > 1 for gain in gains)


def _notes(parts: Parts) -> Iterator[str]:
    rules = parts.scene.coupling
    for part in grasps(parts):
        if not part.grasped.block[at.TURNS]:
            continue
        energy = worst_turn(part.grasped, part.grasped.finger_position.copy())
        if abs(energy.share) <= CREATES:
            continue
        where = f"in {rules.axes} axes" + (" with reaction = 'contact'" if rules.reaction == "contact" else "")
        yield (
            f"gains that are matrices {where} create energy on {part.name} as it turns: up to "
            f"{100.0 * abs(energy.share):.2g} % of the largest stored on a closed turn of +-{TURN:g} rad; "
            "axes = 'object' with reaction = 'fingertip' and form = 'symmetric' creates none"
        )
