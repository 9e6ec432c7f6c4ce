"""Pictures of one instant: objects, fingers, and their forces as arrows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import floor, log10
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from graspfx.errors import InputError
from graspfx.numeric import finite
from graspfx.show import style
from graspfx.show.picture.instant import EDGE, TIP, Instant, colours_of, instant
from graspfx.show.picture.painter import Camera, Painter, Solid, best_view
from graspfx.show.picture.surfaces import Surface, ball
from graspfx.show.style import EXTERNAL, FINGERS, INK, INTERNAL, Drawing, plain

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from graspfx.recording.record import Recording
    from graspfx.show.sheet import Sheet

FloatArray = NDArray[np.float64]
Forces = Literal["two", "total"]

LONGEST = 0.34  # length of the longest arrow, as a fraction of the extent
SHAFT = 0.008  # half the width of a shaft, as a fraction of the extent
HEAD, WIDE = 6.0, 2.5  # length and half the width of a head, in half shaft widths
MOST_HEAD = 0.6  # largest head, as a fraction of the arrow's length
SHORTEST = 0.06  # forces below this fraction of the largest are not drawn
ALONG = 0.3  # sine of the angle below which two arrows of a finger would overlap
APART = 1.6  # distance of either arrow from their common line, in half shaft widths


@dataclass(frozen=True)
class Arrow:
    """Arrow that represents a force of a finger.

    Attributes:
        finger: Index of the finger.
        tail, tip: Ends of the arrow (d,) [m].
        colour: Colour of the internal or external part, or, for the total force, of the finger.
        offset: Distance of the arrow from the line of action of the force, positive to the left of the force's
            direction, in half shaft widths.
    """

    finger: int
    tail: FloatArray
    tip: FloatArray
    colour: str
    offset: float = 0.0


def finger_colours(now: Instant) -> list[str]:
    return [FINGERS[i % len(FINGERS)] for i in range(len(now.names))]


def radius(now: Instant, i: int) -> float:
    """Return the radius at which fingertip i is drawn [m]."""
    return float(now.radii[i]) or TIP * now.extent


def shown_forces(now: Instant, forces: Forces) -> list[tuple[FloatArray, list[str]]]:
    """Return the forces to draw, each (n, d) [N] with n colours: internal and external parts, or total forces.

    If the recording does not contain the parts, the total forces are returned for any value of `forces`.
    """
    if forces == "total" or now.parts is None:
        return [(now.forces, finger_colours(now))]
    return [(part, [colour] * len(now.names)) for part, colour in zip(now.parts, (INTERNAL, EXTERNAL), strict=True)]


def outward(now: Instant) -> FloatArray:
    """Return a point outside the object near each contact, (n, d) [m].

    The point is displaced from the contact against the force. If the finger exerts no force, the point is displaced
    away from the centre of the drawing.
    """
    away = -now.forces
    idle = ~now.touching | (np.linalg.norm(away, axis=1) == 0.0)
    away[idle] = (now.contacts - now.middle)[idle]
    lengths = np.linalg.norm(away, axis=1, keepdims=True)
    return np.asarray(now.contacts + 0.02 * now.extent * away / np.where(lengths > 0.0, lengths, 1.0))


def arrows(now: Instant, scale: float, forces: Forces, flat: FloatArray) -> list[Arrow]:
    """Place the arrows of all forces outside the object.

    The arrow of a pushing force ends at the contact; the arrow of a pulling force begins at the contact. Two arrows of
    one finger that would overlap in the view are placed side by side.

    Args:
        now: Instant to draw.
        scale: Length of an arrow per force [m/N].
        forces: "two" for internal and external parts, or "total".
        flat: Matrix (2, d) whose rows are the unit vectors to the right and up in the view.
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
    turn = 1.0 if a @ b > 0.0 else -1.0  # left of a direction is right of the opposite one
    return [replace(own[0], offset=APART), replace(own[1], offset=-turn * APART)]


def draw(axes: Axes, arrow: Arrow, extent: float, painter: Painter | None = None) -> None:
    """Draw an arrow; hidden parts of its shaft are dashed, and its head is white if the arrow's tip is hidden."""
    from matplotlib.patches import Polygon

    half = SHAFT * extent
    pieces = _pieces(np.array([arrow.tail, arrow.tip]), painter)
    ends = np.array([pieces[0][0][0, :2], pieces[-1][0][-1, :2]])
    shift = arrow.offset * half * _left(ends[1] - ends[0])
    neck = ends[1] - _head(ends, half) * _unit(ends[1] - ends[0])
    for piece, visible in pieces:
        begin, end = piece[0, :2], piece[-1, :2]
        along = _unit(ends[1] - ends[0])
        end = min(end, neck, key=lambda point: float((point - begin) @ along))  # the head is drawn separately
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
    """Return the corners (3, 2) of an arrow's head."""
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


MOST_POINTS = 400  # largest number of points of a path
SHORT = 0.04  # shortest path drawn, as a fraction of the extent
MOST_NAMES = 8  # largest number of fingers with names; more are numbered
SCREEN = 5.2  # [inches]
LOW, HIGH = 0.25, 1.3  # smallest and largest height of the picture, relative to its width
LETTER = 0.62  # width of a letter, relative to the size of the text
RINGS = (1.0, 1.8, 2.6, 3.6)  # distances of a name from its arrow, in about half the name's height
TURNS = (0.0, 0.5, -0.5, 1.0, -1.0, 1.6, -1.6, 2.3, -2.3, 3.1)  # [rad] from the direction of the arrow
BELOW = -0.02  # vertical position of the scales, as a fraction of the picture's height
PATH = 0.7  # [points]


def portrait(
    recording: Recording,
    time: float | None = None,
    *,
    view: tuple[float, float] | None = None,
    folder: Path | None = None,
    forces: Forces = "two",
    width: str = "screen",
) -> Drawing:
    """Draw one instant of a recording to scale, in space or in the plane.

    Arrows represent the forces of the fingers on the object. They are outside the object: the arrow of a pushing force
    ends at the contact, the arrow of a pulling force begins at the contact. Shafts are dashed where an object hides
    them. The `notes` of the returned drawing list the parts of the scene that are not drawn.

    Args:
        recording: Recording of a run.
        time: Time of the instant [s]. If None, the instant is the tick with the largest sum of the magnitudes of the
            forces among the ticks with the most touching fingers; if all forces are zero, it is the last tick.
        view: Azimuth and elevation of the viewer in space [degrees]; by default a view in which the contacts are
            visible and well separated.
        folder: Folder to which relative paths of meshes refer; by default the scene's folder.
        forces: "two" for an arrow each for the internal and external part, or "total" for one arrow.
        width: "screen", "page" (7.2 inches) or "column" (3.5 inches).

    Raises:
        InputError: If the recording has no ticks, the time is outside the recording, nothing can be drawn, the view is
            not two numbers, or `forces` or the width is unknown.
    """
    if forces not in ("two", "total"):
        raise InputError("forces", forces, "'two' or 'total'")
    if view is not None:
        expected = "two numbers, the azimuth and the elevation of the viewer [degrees]"
        angles = finite("view", view, expected)
        if angles.shape != (2,):
            raise InputError("view", view, expected)
        view = float(angles[0]), float(angles[1])
    now = instant(recording, time, folder)
    longest = max(float(np.linalg.norm(values, axis=1).max(initial=0.0)) for values, _ in shown_forces(now, forces))
    scale = LONGEST * now.extent / longest if longest > 0.0 else 0.0  # m per N
    camera = painter = None
    if now.dimensions == 3:
        camera = Camera(*(view or best_view(now.contacts, outward(now) - now.contacts, now.extent)))
        painter = Painter(camera, now.extent, _solids(now))
    placed = arrows(now, scale, forces, np.eye(2) if camera is None else camera.axes[:2])

    def flat(points: FloatArray) -> FloatArray:
        return points if camera is None else camera.project(points)[..., :2]

    with style.look(width):
        drawing = style.figure([1.0], width=width, inches=SCREEN if width == "screen" else 0.0)
        axes, text = drawing.panels[0, 0], drawing.width.text
        axes.grid(visible=False)
        axes.set_axis_off()
        visible = np.ones(len(now.tips), dtype=bool)
        if painter is None:
            low, high = _draw_plane(axes, now)
        else:
            low, high = painter.bounds
            visible = ~painter.hidden(outward(now))
            painter.draw(axes, EDGE)
        for path, colour in _paths(now):
            for piece, is_seen in _pieces(path, painter, before_all=True):
                if is_seen and np.ptp(piece[:, :2], axis=0).max() > SHORT * now.extent:
                    axes.plot(piece[:, 0], piece[:, 1], color=colour, lw=PATH, zorder=1.5)
        for arrow in placed:
            draw(axes, arrow, now.extent, painter)
        seen = [replace(each, tail=flat(each.tail), tip=flat(each.tip)) for each in placed]
        ends = np.array([end for each in placed for end in (each.tail, each.tip)]).reshape(-1, now.dimensions)
        _fit(axes, now, np.array([low, high, *flat(ends)]), text)
        _dots(axes, now, flat(now.contacts), visible)
        _label(axes, now, seen, flat(now.tips), flat(now.middle), text)
        if camera is not None:
            _triad(axes, camera, text)
        _frame(drawing, axes, now, scale, longest)
        _explain(drawing, placed)
    return Drawing(drawing, now.notes)


def _solids(now: Instant) -> list[Solid]:
    """Return the surfaces of objects, obstacles and fingertips in space; fingertips are spheres that hide no arrow."""
    solids = [
        Solid(thing.surface, colour, both_sides=thing.endless)
        for thing, colour in zip(now.things, _thing_colours(now), strict=True)
    ]
    for i, colour in enumerate(finger_colours(now)):
        at = ball(radius(now, i))
        solids.append(Solid(Surface(at.vertices + now.tips[i], at.faces), colour, hides=False))
    return solids


def _draw_plane(axes: Axes, now: Instant) -> FloatArray:
    """Draw objects, obstacles and fingertips in the plane; return the lower and upper corner of their box (2, 2)."""
    from matplotlib.patches import Circle, Polygon

    corners = [now.middle]
    for thing, colour in zip(now.things, _thing_colours(now), strict=True):
        v = thing.surface.vertices
        hatch = "////" if thing.endless or thing.fixed else None
        axes.add_patch(Polygon(v, facecolor=colour, edgecolor=EDGE, linewidth=1.0, hatch=hatch, zorder=1))
        corners += [v.min(axis=0), v.max(axis=0)]
    for i, colour in enumerate(finger_colours(now)):
        size = radius(now, i)
        axes.add_patch(Circle(now.tips[i], size, facecolor=colour, edgecolor=INK, linewidth=0.6, zorder=3))
        corners += [now.tips[i] - size, now.tips[i] + size]
    return np.array([np.min(corners, axis=0), np.max(corners, axis=0)])


def _pieces(line: FloatArray, painter: Painter | None, *, before_all: bool = False) -> list[tuple[FloatArray, bool]]:
    """Cut a polyline into visible and hidden pieces; without a painter (in the plane), all of it is visible."""
    return [(line, True)] if painter is None else list(painter.pieces(line, before_all=before_all))


def _triad(axes: Axes, camera: Camera, text: float) -> None:
    """Draw the world's axes in the lower left corner."""
    from matplotlib.offsetbox import AnchoredOffsetbox, DrawingArea
    from matplotlib.patches import FancyArrowPatch
    from matplotlib.text import Text

    size, length = 46.0, 19.0  # [points]
    area = DrawingArea(size, size)
    for k in np.argsort(camera.axes[2]):
        x, y = camera.axes[:2, k] * length
        area.add_artist(
            FancyArrowPatch(
                (size / 2, size / 2), (size / 2 + x, size / 2 + y),
                arrowstyle="-|>", mutation_scale=6.0, linewidth=0.9, color=INK, shrinkA=0, shrinkB=0,
            )
        )  # fmt: skip
        norm = max(float(np.hypot(x, y)), 0.2 * length)
        area.add_artist(
            Text(
                size / 2 + x * (1 + 5 / norm), size / 2 + y * (1 + 5 / norm), "xyz"[k],
                ha="center", va="center", fontsize=text - 1, color=INK,
            )
        )  # fmt: skip
    axes.add_artist(
        AnchoredOffsetbox("lower left", child=area, frameon=False, pad=0.0, borderpad=0.0, bbox_to_anchor=(0.0, 0.0),
                          bbox_transform=axes.transAxes)
    )  # fmt: skip


def _thing_colours(now: Instant) -> list[str]:
    movable = [thing.name for thing in now.things if not thing.fixed and not thing.endless]
    return colours_of([thing.name for thing in now.things], movable)


def _paths(now: Instant) -> list[tuple[FloatArray, str]]:
    """Return the paths of fingertips and objects that have moved, with their colours; none for a scene on a line."""
    if now.on_a_line:
        return []
    ways = [(now.paths[:, i], colour) for i, colour in enumerate(finger_colours(now))]
    ways += [(thing.path, INK) for thing in now.things]
    ways = [(path[np.isfinite(path).all(axis=1)], colour) for path, colour in ways]
    thin = [(path[:: max(1, len(path) // MOST_POINTS)], colour) for path, colour in ways if len(path) > 1]
    return [each for each in thin if np.ptp(each[0], axis=0).max() > SHORT * now.extent]


def _fit(axes: Axes, now: Instant, points: FloatArray, text: float) -> None:
    """Set the limits of the axes to the range of `points` (k, 2), with margins for the fingers' names."""
    low, high = points.min(axis=0), points.max(axis=0)
    size = float(np.max(high - low))
    room = 0.06 * size
    widest = max((len(name) for name in _names(now)), default=0) * LETTER * text / (72.0 * SCREEN)
    margin = max(room, min(1.2 * widest, 0.25) * size)
    axes.set_xlim(low[0] - margin, high[0] + margin)
    axes.set_ylim(low[1] - room, high[1] + room)


def _dots(axes: Axes, now: Instant, flat: FloatArray, visible: NDArray[np.bool_]) -> None:
    """Draw the visible contact points of touching fingers that have point fingertips."""
    dots = visible & now.touching & (now.radii == 0.0)
    axes.scatter(flat[dots, 0], flat[dots, 1], s=9.0, color="white", edgecolors=INK, linewidths=0.7, zorder=5)


def _label(
    axes: Axes, now: Instant, placed: Sequence[Arrow], tips: FloatArray, middle: FloatArray, text: float
) -> None:
    """Write the fingers' names beyond the outer ends of the arrows, if possible without overlap."""
    from matplotlib.patheffects import withStroke

    size = max(np.ptp(axes.get_xlim()), np.ptp(axes.get_ylim()) / HIGH)  # width of the panel, which `_frame` limits
    unit = float(size) / (72.0 * SCREEN)  # data units per point
    height = (text + 8.0) * unit
    occupied: list[FloatArray] = []  # centres and sizes
    along = [each.tail + share * (each.tip - each.tail) for each in placed for share in np.linspace(0.0, 1.0, 12)]
    busy = np.array([*along, *tips]).reshape(-1, 2)
    for i, (name, colour) in enumerate(zip(_names(now), finger_colours(now), strict=True)):
        ends = [end for arrow in placed if arrow.finger == i for end in (arrow.tail, arrow.tip)]
        mark = max([tips[i], *ends], key=lambda end: float(np.linalg.norm(end - middle)))
        away = mark - middle if np.linalg.norm(mark - middle) > 0.0 else np.array([0.0, 1.0])
        box = np.array([LETTER * text * unit * len(name), height])
        x, y = _free_place(mark, float(np.arctan2(away[1], away[0])), box, occupied, busy)
        occupied.append(np.array([x, y, *box]))
        axes.text(
            x, y, plain(name), color=colour, fontsize=text, ha="center", va="center", zorder=6,
            path_effects=[withStroke(linewidth=2.5, foreground="white")],
        )  # fmt: skip


def _names(now: Instant) -> list[str]:
    """Return the fingers' labels: names, or indices if there are more than `MOST_NAMES` fingers."""
    return list(map(str, range(len(now.names)))) if len(now.names) > MOST_NAMES else list(now.names)


def _free_place(
    mark: FloatArray, first: float, box: FloatArray, occupied: Sequence[FloatArray], busy: FloatArray
) -> FloatArray:
    """Return the centre (2,) of a place near `mark` where a box of size `box` (2,) overlaps nothing.

    The search begins in the direction `first` [rad]. If every place overlaps something, a place that overlaps arrows
    but no other box is preferred.

    Args:
        occupied: Centre and size of each box placed before (4,).
        busy: Points on arrows and fingertips (k, 2).
    """
    places = []
    for ring in RINGS:
        for turn in TURNS:
            u = np.array([np.cos(first + turn), np.sin(first + turn)])
            places.append(mark + (0.5 * np.abs(u) @ box + 0.45 * ring * box[1]) * u)
    apart = [p for p in places if all((np.abs(p - each[:2]) > 0.5 * (box + each[2:])).any() for each in occupied)]
    free = [p for p in apart if (np.abs(busy - p) > 0.5 * box).any(axis=1).all()]
    return np.asarray([*free, *apart, *places][0])


def _frame(drawing: Sheet, axes: Axes, now: Instant, scale: float, longest: float) -> None:
    """Add the title and the scales, and set the height of the panel to the aspect ratio of the drawing."""
    width, height = (float(np.ptp(each)) for each in (axes.get_xlim(), axes.get_ylim()))
    axes.set_aspect("equal")
    drawing.heights[0] = drawing.width.inches * min(max(height / width, LOW), HIGH)
    time = f"t = {now.time:.3f} s".replace(" ", "\N{NO-BREAK SPACE}")
    drawing.title(", ".join(filter(None, (plain(now.title), time))))
    share = min(1.0, HIGH * width / height)  # fraction of the panel's width that the drawing uses
    length = nice(0.3 * now.extent)
    _bar(axes, 0.98, length / width * share, f"{1e3 * length:g} mm", "|-|,widthA=0.25,widthB=0.25", drawing.width.text)
    if longest > 0.0:
        force = nice(longest)
        right = 0.98 - length / width * share - 0.1
        _bar(axes, right, force * scale / width * share, f"{force:g} N", "-|>", drawing.width.text)


def _bar(axes: Axes, right: float, length: float, words: str, arrow: str, text: float) -> None:
    """Draw a scale below the picture; `right` (its right end) and `length` are fractions of the picture's width."""
    axes.annotate(
        "", (right, BELOW), (right - length, BELOW), xycoords="axes fraction", textcoords="axes fraction",
        arrowprops={"arrowstyle": arrow, "color": INK, "linewidth": 1.2, "shrinkA": 0, "shrinkB": 0},
        annotation_clip=False,
    )  # fmt: skip
    axes.annotate(
        words, (right - 0.5 * length, BELOW), xytext=(0, -4), textcoords="offset points", xycoords="axes fraction",
        ha="center", va="top", fontsize=text, color=INK, annotation_clip=False,
    )  # fmt: skip


def _explain(drawing: Sheet, placed: Sequence[Arrow]) -> None:
    """Add a legend of the internal and external forces that are drawn."""
    from matplotlib.lines import Line2D

    names = {INTERNAL: "internal force", EXTERNAL: "external force"}
    drawn = {arrow.colour for arrow in placed}
    drawing.legend(0, [
        Line2D([], [], color=colour, lw=3.0, marker=">", markevery=[1], markersize=7.0, label=name)
        for colour, name in names.items() if colour in drawn
    ])  # fmt: skip


def nice(value: float) -> float:
    """Return the largest number that is 1, 2 or 5 times a power of ten and does not exceed `value`."""
    power = 10.0 ** floor(log10(value))
    share = value / power
    return (5.0 if share >= 5.0 else 2.0 if share >= 2.0 else 1.0) * power
