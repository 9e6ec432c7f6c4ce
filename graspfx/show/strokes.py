"""Colours, dashes and markers, such that lines which coincide can still be told apart."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from graspfx.show.style import AXES, EXTERNAL, FINGERS, INK, INTERNAL, LINE, MARKERS, NEUTRAL, THICK

Dashes = tuple[float, tuple[float, ...]]  # offset, then on and off, in widths of the line

ON, OFF = 5.0, 3.0


@dataclass(frozen=True)
class Stroke:
    """How a line is drawn.

    Attributes:
        colour: of the line and its markers.
        width: [points].
        dashes: a name of matplotlib's, or offset and lengths.
        marker: a name of matplotlib's; none if empty.
        place: of the first marker, as a share of the distance from marker to marker.
    """

    colour: str
    width: float = LINE
    dashes: str | Dashes = "-"
    marker: str = ""
    place: float = 0.0


OBJECT = Stroke(INK, THICK)  # so wide that it shows on either side of a finger
FINGERS_TOGETHER = Stroke(NEUTRAL, LINE, (0.0, (ON, OFF)))
SQUEEZE = Stroke(INTERNAL, 2.6)  # so wide that it shows beneath a push of the same size
PUSHES = tuple(Stroke(EXTERNAL, LINE, dashes) for dashes in AXES)
TURNS = tuple(Stroke(INK, LINE, dashes) for dashes in AXES)


def finger_strokes(groups: Iterable[Sequence[str]]) -> dict[str, Stroke]:
    """Give each finger its colour, its marker, and dashes of which every other one fills the gaps of the one before.

    Args:
        groups: the names of the fingers in each column; one that comes again keeps its stroke.
    """
    half: dict[str, int] = {}
    for names in groups:
        for i, name in enumerate(names):
            half.setdefault(name, i % 2)
    return {
        name: Stroke(
            FINGERS[k % len(FINGERS)],
            LINE,
            (half[name] * (ON + OFF) / 2.0, (ON, OFF)),
            MARKERS[k % len(MARKERS)],
            (k + 0.5) / len(half),
        )
        for k, name in enumerate(half)
    }
