"""Grasps of a scene at the start of a run: stationary hands, contacts, squeezing forces and automatic fade."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from graspfx.assembly.resolve import Parts
from graspfx.coupling.closed_motion import CREATES, TURN, worst_turn
from graspfx.coupling.rules import FADE, gaps, release_compliance
from graspfx.loop.plant import Hand
from graspfx.loop.servo_parts import GraspedPart
from graspfx.objects.body import NativeBody
from graspfx.scene.tables.reading import listed

if TYPE_CHECKING:
    from graspfx.assembly.hands import HandPart
    from graspfx.scene.model import Scene


FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class StillHand:
    """A hand without motion and turns, the indices of its fingers, and the time of its largest squeeze [s]."""

    hand: Hand
    fingers: list[int]
    closed: float

    def stiffness(self, force: FloatArray) -> FloatArray:
        """Compute the stiffness K of the hand at equilibrium, (d, n, n) [N/m].

        For each axis, positions p (n,) of the fingers and forces f (n,) satisfy f = K (r - p), with targets r (n,).

        Args:
            force: Forces of the fingers at equilibrium, (n, d) [N], on which K depends if the hand stiffens with the
                grip.
        """
        operator = getattr(self.hand, "operator", None)
        return self.hand.stiffness if operator is None else np.asarray(operator.at_rest(self.hand.stiffness, force))


def still_hands(parts: Parts, inward: FloatArray, *, guided: bool = True) -> Iterator[StillHand]:
    """Make the hands of a scene without motion and turns.

    Args:
        parts: Parts of the scene.
        inward: Unit normals of the fingers' contacts, into the objects, (n, d).
        guided: Whether guides displace the hands to their goals; if False, guides are ignored.
    """
    for hand in parts.hands:
        yield StillHand(hand.still(guided=guided).hold(parts.start, inward), hand.fingers, _closing_time(hand))


def most_forces(parts: Parts, inward: FloatArray, contacts: FloatArray) -> FloatArray:
    """Compute the largest squeezing force |K (r - p)| of each finger, (n,) [N].

    K is the stiffness of the hand, r the target of the finger at the largest squeeze without a guide, and p the start
    position of the finger. For a finger that starts inside the object, p is the contact point instead, because the
    start position is closer to r and would give too small a force.

    Args:
        parts: Parts of the scene.
        inward: Unit normals of the fingers' contacts, into the objects, (n, d).
        contacts: Contact points, (n, d) [m].
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
    """Return the time of a hand's largest squeeze [s]."""
    table = hand.holding.table
    if table is None or table.form == "made":
        return 0.0
    if isinstance(table.squeeze, int | float):
        return table.squeeze_ramp
    most = max(listed(table.squeeze), key=lambda step: step.to)
    return float(most.begin + most.duration) if most.to > 0.0 else 0.0  # a hand starts without squeeze


def set_fade(parts: Parts, objects: Sequence[GraspedPart], inward: FloatArray, start: FloatArray) -> None:
    """Set the distances [h1, h2] of an automatic fade from the hands' largest squeezing forces f.

    h1 is 1/2 |1/kep - 1/kip| sum |f|, with the stiffnesses kep and kip of the coupling, and at least 2 mm; h2 is h1 + 8
    mm. The contacts of `objects` must have been computed.
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
    """Compute the sum of the fingers' largest squeezing forces on each object [N], from its present contacts."""
    contacts = parts.start.copy()
    for each in objects:
        contacts[each.fingers] = each.grasped.contact_position
    forces = most_forces(parts, inward, contacts)
    return [float(forces[each.fingers].sum()) for each in objects]


def grasps(parts: Parts) -> list[GraspedPart]:
    """Make the objects that fingers touch, with the contacts of the fingers at their start positions."""
    start = parts.start
    inward = np.zeros_like(start)
    objects = []
    for part in parts.objects:
        if not len(part.fingers):
            continue
        grasped, fingers = part.grasped(), part.fingers
        if grasped.implicit:
            NativeBody(grasped.body_state).free_motion(parts.scene.period)  # samples of this body use the next pose
        grasped.meet(start[fingers])
        inward[fingers] = grasped.inward()
        grasped.finger_position[:] = start[fingers]
        objects.append(GraspedPart(part.name, grasped, fingers))
    set_fade(parts, objects, inward, parts.start)
    return objects


def axes_notes(parts: Parts) -> list[str]:
    """Report the energy that matrix gains generate in a closed rotation of each object.

    Matrix gains generate energy only in world axes, or if the reaction is at the contact. The energy is the line
    integral of `worst_turn` about the grasp at the start, without friction cones.
    """
    return list(_notes(parts)) if _has_axes(parts.scene) else []


def _has_axes(scene: Scene) -> bool:
    """Return whether a gain is a matrix in axes, or with a reaction, for which it may generate energy."""
    rules = scene.coupling
    sound = rules.axes != "world" and rules.reaction == "fingertip"
    if hasattr(rules.external, "object_stiffness"):
        return scene.dimensions > 1 and not sound
    gains = [gain for part in (rules.external, rules.internal) for gain in (part.stiffness, part.damping)]
    return scene.dimensions > 1 and not sound and any(np.ndim(gain) > 1 for gain in gains)


def _notes(parts: Parts) -> Iterator[str]:
    rules = parts.scene.coupling
    for part in grasps(parts):
        if not part.grasped.state.freedom.turns:
            continue
        energy = worst_turn(part.grasped, part.grasped.finger_position.copy())
        if abs(energy.share) <= CREATES:
            continue
        where = f"in {rules.axes} axes" + (" with reaction = 'contact'" if rules.reaction == "contact" else "")
        yield (
            f"matrix gains {where} generate energy on {part.name} as it rotates: up to "
            f"{100.0 * abs(energy.share):.2g} % of the largest stored energy in a closed rotation of +-{TURN:g} rad; "
            "axes = 'object' with reaction = 'fingertip' and form = 'symmetric' generates no energy"
        )
