"""The hands that a scene describes: which fingers each holds, and what it does in words."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from graspfx.loop.motion import motion as motions
from graspfx.scene.tables.reading import AXES, listed

if TYPE_CHECKING:
    from graspfx.scene.tables.hands import Axis as AxisTable
    from graspfx.scene.tables.hands import MadeHand, OwnHand, SharedHand, SharedMadeHand
    from graspfx.scene.tables.scene_table import SceneTable

OPERATOR = (
    ("limb", "a limb's mass"), ("stiffening", "stiffer with grip"), ("reaction", "a late reaction"),
    ("tremor", "tremor"), ("noise", "noise"),
)  # fmt: skip

FloatArray = NDArray[np.float64]
Location = tuple[str | int, ...]


@dataclass(frozen=True)
class Holding:
    """The fingers that one hand holds, and its table (None: nobody holds them) with where that stands."""

    at: Location
    table: OwnHand | SharedHand | MadeHand | SharedMadeHand | None
    fingers: list[int]


def holdings(scene: SceneTable) -> list[Holding]:
    """List the hands of a scene in the order of their first fingers; a finger without one stands alone."""
    shared = {table.name: (("hand", k), table) for k, table in enumerate(scene.hand)}
    hands: dict[Location, Holding] = {}
    for i, finger in enumerate(scene.finger):
        label = finger.hand
        at, table = shared[label] if isinstance(label, str) else (("finger", i, "hand"), label)
        hands.setdefault(at, Holding(at, table, [])).fingers.append(i)
    return list(hands.values())


def axis_of(axis: AxisTable, dimensions: int) -> FloatArray:
    """Give the unit vector (d,) along an axis by its name or number, or along a vector."""
    if isinstance(axis, tuple):
        return motions.direction(axis, dimensions)
    return motions.direction(AXES[axis] if isinstance(axis, str) else axis, dimensions)


def descriptions(scene: SceneTable) -> Iterator[str]:
    """Describe every hand: its name, the fingers that it holds, what it does in time."""
    own: dict[str, list[str]] = {}
    for holding in holdings(scene):
        names = [scene.finger_names[i] for i in holding.fingers]
        if holding.table is not None and holding.at[0] == "hand":
            yield f"{scene.hand[int(holding.at[1])].name} holds {', '.join(names)} ({doing(holding.table)})"
        elif holding.table is not None:
            own.setdefault(doing(holding.table), []).extend(names)
    for course, names in own.items():
        yield f"{', '.join(names)} by {'itself' if len(names) == 1 else 'themselves'} ({course})"


def doing(table: OwnHand | SharedHand | MadeHand) -> str:
    """Describe what a hand does in time."""
    if table.form == "made":
        return f"as {table.kind} has it"
    texts = [f"motion: {' + '.join(each.kind for each in listed(table.motion)) or 'rest'}"]
    if table.turn is not None:
        texts.append(f"turn: {', then '.join(each.kind for each in listed(table.turn))}")
    if not isinstance(table.squeeze, int | float):
        texts.append("squeeze: " + ", ".join(f"{1e3 * s.to:g} mm at {s.begin:g} s" for s in listed(table.squeeze)))
    elif table.squeeze:
        texts.append(f"squeeze: {1e3 * table.squeeze:g} mm")
    if table.guide is not None:
        texts.append(f"guided, {1e3 * table.guide.lag:g} ms behind its goals")
    texts += [text for name, text in OPERATOR if getattr(table, name) is not None]
    return "; ".join(texts)
