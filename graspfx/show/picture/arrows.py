"""Arrows of forces at fingers: where they stand beside the object and one another, and their shapes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from graspfx.show.picture.described import TIP
from graspfx.show.picture.instant import Instant
from graspfx.show.style import EXTERNAL, FINGERS, INTERNAL

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from graspfx.show.picture.painter import Painter

FloatArray = NDArray[np.float64]
Forces = Literal["two", "total"]

LONGEST = 0.34  # as a share of the extent
SHAFT = 0.008  # half its width, as a share of the extent
HEAD, WIDE = 6.0, 2.5  # length and half the width of a head, in halves of a shaft's width
MOST_HEAD = 0.6  # of an arrow's length
SHORTEST = 0.06  # as a share of the longest: below this a force is no arrow
ALONG = 0.3  # sine of the angle below which two arrows at a finger would lie on one another
APART = 1.6  # from the middle of the two to either, in halves of a shaft's width


@dataclass(frozen=True)
class Arrow:
    """One force at one finger.

    Attributes:
        finger: its number.
        tail, tip: (d,) [m].
        colour: of the part, or of the finger.
        offset: how far it stands beside its line, to the left of its way if positive, in halves of a shaft's width.
    """

    finger: int
    tail: FloatArray
    tip: FloatArray
    colour: str
    offset: float = 0.0


def finger_colours(now: Instant) -> list[str]:
    return [FINGERS[i % len(FINGERS)] for i in range(len(now.names))]


def radius(now: Instant, i: int) -> float:
    """Radius at which a fingertip is drawn [m]."""
    return float(now.radii[i]) or TIP * now.extent


def shown_forces(now: Instant, forces: Forces) -> list[tuple[FloatArray, list[str]]]:
    """List the forces (n, d) that are drawn, each with the fingers' colours: two parts, or the total."""
    if forces == "total" or now.parts is None:
        return [(now.forces, finger_colours(now))]
    return [(part, [colour] * len(now.names)) for part, colour in zip(now.parts, (INTERNAL, EXTERNAL), strict=True)]


def outward(now: Instant) -> FloatArray:
    """Place a point a little outside of each contact: against its force, or away from the middle."""
    away = -now.forces
    idle = ~now.touching | (np.linalg.norm(away, axis=1) == 0.0)
    away[idle] = (now.contacts - now.middle)[idle]
    lengths = np.linalg.norm(away, axis=1, keepdims=True)
    return np.asarray(now.contacts + 0.02 * now.extent * away / np.where(lengths > 0.0, lengths, 1.0))


def arrows(now: Instant, scale: float, forces: Forces, flat: FloatArray) -> list[Arrow]:
    """Place the arrows: outside of the object, ending where a force pushes in, beginning where it pulls out.

    Two at one finger that would lie on one another as seen stand side by side.

    Args:
        now: the instant.
        scale: [m/N].
        forces: "two", internal and external, or "total".
        flat: directions to the right and up, as seen (2, d).
    """
    out = outward(now) - now.contacts
    placed: list[Arrow] = []
    for i in range(len(now.names)):
        own = []
        for values, colours in shown_forces(now, forces):
            f, size = values[i], float(np.linalg.norm(values[i]))
            if size == 0.0 or size * scale < SHORTEST * LONGEST * now.extent:
                continue
            pulls = f @ out[i] > 1e-9 * size * np.linalg.norm(out[i])
            side = (1.0 if pulls else -1.0) * now.radii[i] * f / size
            at = now.tips[i] + side if now.radii[i] > 0.0 else now.contacts[i]
            own.append(Arrow(i, at, at + scale * f, colours[i]) if pulls else Arrow(i, at - scale * f, at, colours[i]))
        placed += _beside(own, flat)
    return placed


def _beside(own: list[Arrow], flat: FloatArray) -> list[Arrow]:
    if len(own) != 2:
        return own
    (a, b) = (flat @ (each.tip - each.tail) for each in own)
    size = float(np.linalg.norm(a) * np.linalg.norm(b))
    if size == 0.0 or abs(a[0] * b[1] - a[1] * b[0]) > ALONG * size:
        return own
    turn = 1.0 if a @ b > 0.0 else -1.0  # to the left of a way is to the right of the opposite one
    first, second = own
    return [
        Arrow(first.finger, first.tail, first.tip, first.colour, APART),
        Arrow(second.finger, second.tail, second.tip, second.colour, -turn * APART),
    ]


def draw(axes: Axes, arrow: Arrow, extent: float, painter: Painter | None = None) -> None:
    """Draw an arrow; in space, dashed where something hides it, and its head, then an outline, always."""
    from matplotlib.patches import Polygon

    half = SHAFT * extent
    pieces = [(np.array([arrow.tail, arrow.tip]), True)] if painter is None else list(painter.pieces(
        np.array([arrow.tail, arrow.tip])
    ))  # fmt: skip
    ends = np.array([pieces[0][0][0, :2], pieces[-1][0][-1, :2]])
    shift = arrow.offset * half * _left(ends[1] - ends[0])
    neck = ends[1] - _head(ends, half) * _unit(ends[1] - ends[0])
    for piece, visible in pieces:
        begin, end = piece[0, :2], piece[-1, :2]
        along = _unit(ends[1] - ends[0])
        end = min(end, neck, key=lambda point: float((point - begin) @ along))  # a head is drawn by itself
        if (end - begin) @ along <= 0.0:
            continue
        if visible:
            side = half * _left(along)
            corners = np.array([begin + side, end + side, end - side, begin - side]) + shift
            axes.add_patch(Polygon(corners, facecolor=arrow.colour, linewidth=0.0, zorder=4.0))
        else:
            axes.plot(*(np.array([begin, end]) + shift).T, color=arrow.colour, lw=1.0, ls=(0.0, (2.5, 1.5)), zorder=4.0)
    visible = pieces[-1][1]
    axes.add_patch(
        Polygon(
            head(ends, half) + shift, facecolor=arrow.colour if visible else "white", edgecolor=arrow.colour,
            linewidth=0.8, joinstyle="miter", zorder=4.1, label="_head",
        )
    )  # fmt: skip


def head(ends: FloatArray, half: float) -> FloatArray:
    """Give the corners (3, 2) of an arrow's head."""
    along = _unit(ends[1] - ends[0])
    length = _head(ends, half)
    side = WIDE * half * min(1.0, 1.5 * length / (HEAD * half)) * _left(along)
    neck = ends[1] - length * along
    return np.array([neck + side, ends[1], neck - side])


def _head(ends: FloatArray, half: float) -> float:
    return min(HEAD * half, MOST_HEAD * float(np.linalg.norm(ends[1] - ends[0])))


def _unit(along: FloatArray) -> FloatArray:
    length = float(np.linalg.norm(along))
    return along / length if length > 0.0 else np.array([1.0, 0.0])


def _left(along: FloatArray) -> FloatArray:
    x, y = _unit(along)
    return np.array([-y, x])


def points(placed: list[Arrow]) -> Iterator[FloatArray]:
    """Yield points along the arrows, that words keep clear of."""
    for arrow in placed:
        for share in np.linspace(0.0, 1.0, 12):
            yield arrow.tail + share * (arrow.tip - arrow.tail)
