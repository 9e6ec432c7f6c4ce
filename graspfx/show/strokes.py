"""Colours, dashes and markers, such that lines which coincide can still be told apart."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

Dashes = tuple[float, tuple[float, ...]]  # offset, then on and off, in widths of the line

COLOURS = ("#c1272d", "#0071bc", "#39803a", "#8e44ad", "#d35400", "#128c8c")
MARKERS = ("o", "s", "^", "D", "v", "P", "X")  # as many as have no common factor with the colours
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
    width: float = 1.6
    dashes: str | Dashes = "-"
    marker: str = ""
    place: float = 0.0


OBJECT = Stroke("#1a1a1a", 2.6)  # so wide that it shows on either side of a finger
APART = Stroke("#1a1a1a", 1.6)
ASTRAY = Stroke("#e07b00", 1.3, "--")
CONTACTS = Stroke("#6b6b6b", 1.0, ":")
TURNS = (Stroke("#8e44ad", 1.4, "-."), Stroke("#128c8c", 1.4, "--"), Stroke("#1a1a1a", 1.6))  # about x, y, z


def finger_strokes(groups: Iterable[Sequence[str]]) -> dict[str, Stroke]:
    """Give each finger its stroke: two dashed, one in the gaps of the other; more, with markers in turn.

    Args:
        groups: the names of the fingers in each column; one that comes again keeps its stroke.
    """
    columns = list(groups)
    half: dict[str, int] = {}
    for names in columns:
        for i, name in enumerate(names):
            half.setdefault(name, i % 2)
    marked = any(len({half[name] for name in names}) < len(names) for names in columns)
    return {
        name: Stroke(
            COLOURS[k % len(COLOURS)],
            1.2,
            (half[name] * (ON + OFF) / 2.0, (ON, OFF)),
            MARKERS[k % len(MARKERS)] if marked else "",
            (k + 0.5) / len(half),
        )
        for k, name in enumerate(half)
    }
