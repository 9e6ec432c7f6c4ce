"""Guides of a live run: what may be led aside while it goes on, one per hand or one per finger."""

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
    """A handle of a hand or of a finger.

    Attributes:
        name: of the hand, or of the finger.
        fingers: numbers of the fingers that go along.
        position: where it starts, the fingers' mean (d,) [m].
        hand: the number of its hand among the guided ones.
        place: of its finger among the hand's; None for all.
        all_fingers: of its hand.
        lag: of its followers [s].
    """

    name: str
    fingers: list[int]
    position: FloatArray
    hand: int
    place: int | None
    all_fingers: list[int]
    lag: float


def guided_scene(scene: Scene) -> Scene:
    """Give each hand of a scene a guide that has none; a plug-in's own hand takes none."""
    changes: dict[str, Any] = {
        ".".join(map(str, (*each.at, "guide"))): {}
        for each in holdings(scene)
        if each.table is not None and each.table.form != "made" and each.table.guide is None
    }
    return scene.replace(changes) if changes else scene


def guides_of(session: LiveSession, kind: Literal["hands", "fingers"] | None) -> Sequence[Guide]:
    """List the guides of a run."""
    names, start = session.scene.finger_names, session.start
    guides: list[Guide] = []
    for number, (table, fingers) in enumerate(session.guided if kind else []):
        lag = value_of(session.scene, f"{table}.guide.lag")
        if kind == "hands":
            hand = session.scene.hand[int(table.split(".")[1])].name if table.startswith("hand.") else names[fingers[0]]
            guides.append(Guide(hand, fingers, start[fingers].mean(axis=0), number, None, fingers, lag))
            continue
        guides += [Guide(names[f], [f], start[f].copy(), number, i, fingers, lag) for i, f in enumerate(fingers)]
    return guides
