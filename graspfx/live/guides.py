"""Guides of a live run: handles that move a hand or a finger by an operator offset."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from graspfx.assembly.hands import holdings
from graspfx.assembly.live import value_of

if TYPE_CHECKING:
    from graspfx.assembly.real_time_session import LiveSession
    from graspfx.scene.model import Scene

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Guide:
    """Handle of a hand or of a finger.

    Attributes:
        name: Name of the hand or finger.
        fingers: Numbers of the fingers that the handle moves.
        position: Initial position, the mean of the fingers (d,) [m].
        hand: Number of the handle's hand among the guided hands.
        place: Index of the moved finger in the hand; None for all fingers.
        all_fingers: Numbers of all fingers of the hand.
        lag: Time constant of the hand's followers [s].
    """

    name: str
    fingers: list[int]
    position: FloatArray
    hand: int
    place: int | None
    all_fingers: list[int]
    lag: float


def guided_scene(scene: Scene) -> Scene:
    """Add a guide to each hand without a guide, except to hands of plug-ins."""
    changes: dict[str, Any] = {
        ".".join(map(str, (*each.at, "guide"))): {}
        for each in holdings(scene)
        if each.table is not None and each.table.form != "made" and each.table.guide is None
    }
    return scene.replace(changes) if changes else scene


def hand_name(scene: Scene, table: str, fingers: Sequence[int]) -> str:
    """Name a hand by its table, such as `hand.0`; the hand of a single finger has the finger's name."""
    return scene.hand[int(table.split(".")[1])].name if table.startswith("hand.") else scene.finger_names[fingers[0]]


def guides_of(session: LiveSession, kind: Literal["hands", "fingers"] | None) -> Sequence[Guide]:
    """List the guides of a run."""
    names, start = session.scene.finger_names, session.start
    guides: list[Guide] = []
    for number, (table, fingers) in enumerate(session.guided if kind else []):
        lag = value_of(session.scene, f"{table}.guide.lag")
        if kind == "hands":
            hand = hand_name(session.scene, table, fingers)
            guides.append(Guide(hand, fingers, start[fingers].mean(axis=0), number, None, fingers, lag))
            continue
        guides += [Guide(names[f], [f], start[f].copy(), number, i, fingers, lag) for i, f in enumerate(fingers)]
    return guides
