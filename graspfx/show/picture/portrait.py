"""The picture of one instant: shaded objects, fingertips, contact points, and forces as arrows with their scale."""

from __future__ import annotations

from collections.abc import Sequence
from math import floor, log10
from os import PathLike, fspath
from pathlib import Path
from textwrap import fill
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from graspfx.errors import InputError
from graspfx.show.picture.instant import Instant, instant
from graspfx.show.picture.painter import Camera, Painter
from graspfx.show.picture.surfaces import Surface, arrow, ball
from graspfx.show.style import FINGERS as COLOURS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from graspfx.loop.recording.record import Recording

FloatArray = NDArray[np.float64]

THINGS = ("#c3d2e0", "#e3d3b4", "#cfdcc4", "#dccbdc")  # objects in turn
FIXED, EDGE, INK, PATH = "#c9c6c0", "#4a4f55", "#222222", "#9aa0a6"
LONGEST_ARROW = 0.34  # as a share of the extent
SHAFT = 0.009
TIP = 0.016  # radius at which a fingertip that is a point is drawn
SHORTEST_ARROW = 0.02  # as a share of the longest: below this a force is no arrow
MOST_POINTS = 400  # of a path
MOST_NAMES = 8  # with more fingers, numbers
WIDTH = 5.2  # [inches]
LETTER = 0.6  # its width, as a share of the size of the text
RINGS = (1.0, 1.8, 2.6)  # distances of a name from its arrow, in half its height
TURNS = (0.0, 0.5, -0.5, 1.0, -1.0, 1.6, -1.6, 2.3, -2.3, 3.1)  # [rad] from the direction of the arrow
BELOW = -0.02  # where the scales are, as a share of the picture's height
TEXT = 9.0  # [points]
ELEVATIONS = (22.0, 35.0, 50.0)
FRONT = -60.0  # [degrees], the azimuth that is taken if none is better
ALONG_AN_AXIS = (45, 60, 75)  # [degrees] from there, where a box shows one of its faces edge on, or nearly


def picture(
    recording: Recording,
    path: str | PathLike[str],
    time: float | None = None,
    *,
    view: tuple[float, float] | None = None,
    folder: Path | None = None,
) -> tuple[str, ...]:
    """Draw one instant of a recording, in space or in the plane, to scale.

    Forces are those of the fingers on the object; an arrow ends at its fingertip. What a finger behind an object does
    is drawn dashed.

    Args:
        recording: of a run.
        path: of the picture; its ending chooses the format.
        time: [s]; by default where most fingers touch and their forces are largest, or the end.
        view: azimuth and elevation of the viewer [degrees], in space; by default from where the fingers are seen best.
        folder: where relative paths of meshes start; that of the scene if None.

    Returns:
        What could not be drawn and why, a sentence each.

    Raises:
        InputError: a recording without a tick, a time outside it, or an ending that no format has.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(layout="constrained")
    formats = FigureCanvasAgg(figure).get_supported_filetypes()
    if Path(path).suffix[1:].lower() not in formats:
        raise InputError("path", fspath(path), f"a file that ends in .{', .'.join(sorted(formats))}")
    now = instant(recording, time, folder)
    axes = figure.add_subplot()
    longest = float(np.linalg.norm(now.forces, axis=1).max(initial=0.0))
    scale = LONGEST_ARROW * now.extent / longest if longest > 0.0 else 0.0  # m per N
    if now.dimensions == 3:
        _in_space(axes, now, scale, view)
    else:
        _in_plane(axes, now, scale)
    _frame(figure, axes, now, scale, longest)
    figure.savefig(fspath(path), dpi=200)
    return now.notes


# In space ------------------------------------------------------------------------------------------------------------


def _in_space(axes: Axes, now: Instant, scale: float, view: tuple[float, float] | None) -> None:
    camera = Camera(*(view or _best_view(now)))
    painter = Painter(camera, now.extent)
    colours = _thing_colours(now)
    for thing, colour in zip(now.things, colours, strict=True):
        painter.add(thing.surface, colour, outline=EDGE, both_sides=thing.endless)
    behind = painter.hidden(_outward(now))
    for i, colour in enumerate(_finger_colours(now)):
        at = ball(_radius(now, i))
        painter.add(Surface(at.vertices + now.tips[i], at.faces), colour, outline=EDGE)
        ends = _arrow_ends(now, i, scale)
        if ends is not None:
            painter.add(arrow(*ends, SHAFT * now.extent), colour)
        painter.line(_thinned(now.paths[:, i]), colour, 0.7)
    for thing in now.things:
        painter.line(_thinned(thing.path), INK, 0.7)
    painter.draw(axes)
    low, high = painter.bounds()
    _fit(axes, now, low, high)
    _dots(axes, now, camera.project(now.contacts)[:, :2], ~behind)
    for i, colour in enumerate(_finger_colours(now)):
        ends = _arrow_ends(now, i, scale)
        if behind[i] and ends is not None:
            (x0, y0), (x1, y1) = (camera.project(end)[:2] for end in ends)
            ghost = {"arrowstyle": "-|>", "linestyle": (0, (2.5, 2)), "color": colour, "shrinkA": 0, "shrinkB": 0}
            axes.annotate("", (x1, y1), (x0, y0), arrowprops={**ghost, "linewidth": 0.9}, zorder=2)
    tails = _tails(now, scale)
    _label(
        axes,
        now,
        camera.project(tails)[:, :2],
        camera.project(tails - now.middle)[:, :2],
        camera.project(now.tips)[:, :2],
    )
    _triad(axes, camera)


def _best_view(now: Instant) -> tuple[float, float]:
    """Find a view with most contacts on the near side and apart from each other; the usual corner if none is better."""
    out = _outward(now) - now.contacts
    lengths = np.linalg.norm(out, axis=1)
    out = out[lengths > 0.0] / lengths[lengths > 0.0, None]
    best, angles = -np.inf, (FRONT, ELEVATIONS[0])
    for elevation in ELEVATIONS:
        for turn in range(0, 360, 15):
            azimuth = FRONT + turn
            if turn % 90 in ALONG_AN_AXIS:
                continue
            project = Camera(azimuth, elevation).project
            facing = project(out)[:, 2] if len(out) else np.zeros(1)
            flat = project(now.contacts)[:, :2] / now.extent
            apart = np.linalg.norm(flat[:, None] - flat, axis=2) + np.eye(len(flat))
            worth = (
                np.clip(facing + 0.35, 0.0, 0.6).sum() + 0.5 * np.clip(apart.min(axis=1, initial=0.2), 0.0, 0.2).sum()
            )
            worth -= 1e-3 * (min(turn, 360 - turn) / 15 + abs(elevation - ELEVATIONS[0]) / 15)
            if worth > best + 1e-9:
                best, angles = worth, (azimuth, elevation)
    return angles


def _outward(now: Instant) -> FloatArray:
    """Place a point a little outside of each contact: against its force, or away from the middle."""
    away = -now.forces
    idle = ~now.touching | (np.linalg.norm(away, axis=1) == 0.0)
    away[idle] = (now.contacts - now.middle)[idle]
    lengths = np.linalg.norm(away, axis=1, keepdims=True)
    return np.asarray(now.contacts + 0.02 * now.extent * away / np.where(lengths > 0.0, lengths, 1.0))


def _triad(axes: Axes, camera: Camera) -> None:
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
                ha="center", va="center", fontsize=TEXT - 1, color=INK,
            )
        )  # fmt: skip
    axes.add_artist(
        AnchoredOffsetbox("lower left", child=area, frameon=False, pad=0.0, borderpad=0.0, bbox_to_anchor=(0.0, 0.0),
                          bbox_transform=axes.transAxes)
    )  # fmt: skip


# In the plane --------------------------------------------------------------------------------------------------------


def _in_plane(axes: Axes, now: Instant, scale: float) -> None:
    from matplotlib.patches import Circle, Polygon

    low = high = now.middle
    for thing, colour in zip(now.things, _thing_colours(now), strict=True):
        v = thing.surface.vertices
        hatch = "////" if thing.endless or thing.fixed else None
        axes.add_patch(Polygon(v, facecolor=colour, edgecolor=EDGE, linewidth=1.0, hatch=hatch, zorder=1))
        if not now.on_a_line:
            path = _thinned(thing.path)
            axes.plot(path[:, 0], path[:, 1], color=INK, linewidth=0.7, zorder=1.5)
        low, high = np.minimum(low, v.min(axis=0)), np.maximum(high, v.max(axis=0))
    tails = _tails(now, scale)
    for i, colour in enumerate(_finger_colours(now)):
        radius = _radius(now, i)
        axes.add_patch(Circle(now.tips[i], radius, facecolor=colour, edgecolor=INK, linewidth=0.6, zorder=3))
        if not now.on_a_line:
            path = _thinned(now.paths[:, i])
            axes.plot(path[:, 0], path[:, 1], color=colour, linewidth=0.7, zorder=1.5)
        ends = _arrow_ends(now, i, scale)
        if ends is not None:
            axes.add_patch(Polygon(_flat_arrow(*ends, SHAFT * now.extent), facecolor=colour, linewidth=0.0, zorder=4))
        for point in (tails[i], now.tips[i] + radius, now.tips[i] - radius):
            low, high = np.minimum(low, point), np.maximum(high, point)
    _fit(axes, now, low, high)
    _dots(axes, now, now.contacts, np.ones(len(now.tips), dtype=bool))
    _label(axes, now, tails, tails - now.middle, now.tips)


def _flat_arrow(tail: FloatArray, tip: FloatArray, radius: float) -> FloatArray:
    along = tip - tail
    length = float(np.linalg.norm(along))
    u = along / length
    w = radius * np.array([-u[1], u[0]])
    neck = tip - min(6.0 * radius, 0.5 * length) * u
    return np.array([tail + w, neck + w, neck + 2.4 * w, tip, neck - 2.4 * w, neck - w, tail - w])


# Both ----------------------------------------------------------------------------------------------------------------


def _thing_colours(now: Instant) -> list[str]:
    movable = [thing.name for thing in now.things if not thing.fixed and not thing.endless]
    return [THINGS[movable.index(thing.name) % len(THINGS)] if thing.name in movable else FIXED for thing in now.things]


def _finger_colours(now: Instant) -> list[str]:
    return [COLOURS[i % len(COLOURS)] for i in range(len(now.names))]


def _radius(now: Instant, i: int) -> float:
    return float(now.radii[i]) or TIP * now.extent


def _arrow_ends(now: Instant, i: int, scale: float) -> tuple[FloatArray, FloatArray] | None:
    """Give tail and tip of a force's arrow; None for one too short to be seen.

    It ends at the near side of a ball, and of a point at the contact, so that it stands outside the object.
    """
    f = now.forces[i]
    size = float(np.linalg.norm(f))
    if size * scale < SHORTEST_ARROW * LONGEST_ARROW * now.extent or size == 0.0:
        return None
    tip = now.tips[i] - now.radii[i] * f / size if now.radii[i] > 0.0 else now.contacts[i]
    return tip - scale * f, tip


def _tails(now: Instant, scale: float) -> FloatArray:
    """Give where names go: (n, d), the tails of arrows, else the fingertips."""
    ends = [_arrow_ends(now, i, scale) for i in range(len(now.tips))]
    tails = [now.tips[i] if each is None else each[0] for i, each in enumerate(ends)]
    return np.array(tails).reshape(-1, now.dimensions)


def _thinned(path: FloatArray) -> FloatArray:
    path = path[np.isfinite(path).all(axis=1)]
    return path[:: max(1, len(path) // MOST_POINTS)]


def _fit(axes: Axes, now: Instant, low: FloatArray, high: FloatArray) -> None:
    """Fit equal axes about the drawing, with room for names."""
    size = float(np.max(high - low))
    room = 0.07 * size
    widest = max((len(text) for text in _texts(now)), default=0) * LETTER * TEXT / (72.0 * WIDTH)
    margin = max(room, min(1.3 * widest, 0.3) * size)
    axes.set_xlim(low[0] - margin, high[0] + margin)
    axes.set_ylim(low[1] - room, high[1] + room)
    axes.set_aspect("equal")


def _dots(axes: Axes, now: Instant, flat: FloatArray, visible: NDArray[np.bool_]) -> None:
    """Draw contact points of the fingers that touch; a ball shows itself where it touches."""
    dots = visible & now.touching & (now.radii == 0.0)
    axes.scatter(flat[dots, 0], flat[dots, 1], s=9.0, color="white", edgecolors=INK, linewidths=0.7, zorder=5)


def _label(axes: Axes, now: Instant, tails: FloatArray, away: FloatArray, tips: FloatArray) -> None:
    """Write names beside the tails of the arrows, away from the object, clear of arrows and of each other."""
    from matplotlib.patheffects import withStroke

    size = float(np.ptp(axes.get_xlim()))
    points = size / (72.0 * WIDTH)  # data units per point
    height = (TEXT + 8.0) * points
    occupied: list[FloatArray] = []  # centres and sizes
    along = np.linspace(0.0, 1.0, 12)[:, None, None]
    busy = (tails + along * (tips - tails)).reshape(-1, 2)  # arrows
    for i, (text, colour) in enumerate(zip(_texts(now), _finger_colours(now), strict=True)):
        box = np.array([LETTER * TEXT * points * len(text), height])
        direction = away[i] if np.linalg.norm(away[i]) > 0.0 else np.array([0.0, 1.0])
        x, y = _free_place(tails[i], float(np.arctan2(direction[1], direction[0])), box, occupied, busy)
        occupied.append(np.array([x, y, *box]))
        axes.text(
            x, y, text.replace("$", r"\$"), color=colour, fontsize=TEXT, ha="center", va="center", zorder=6,
            path_effects=[withStroke(linewidth=2.5, foreground="white")],
        )  # fmt: skip


def _texts(now: Instant) -> list[str]:
    """Name the fingers: by their names, or, where there are many, by their numbers."""
    return list(map(str, range(len(now.names)))) if len(now.names) > MOST_NAMES else list(now.names)


def _free_place(
    mark: FloatArray, first: float, box: FloatArray, occupied: Sequence[FloatArray], busy: FloatArray
) -> FloatArray:
    """Search around a mark, from a direction on, for a place where a box meets no occupied one and no busy point."""
    places = []
    for ring in RINGS:
        for turn in TURNS:
            u = np.array([np.cos(first + turn), np.sin(first + turn)])
            places.append(mark + (0.5 * np.abs(u) @ box + 0.45 * ring * box[1]) * u)
    for place in places:
        free = all((np.abs(place - other[:2]) > 0.5 * (box + other[2:])).any() for other in occupied)
        if free and (np.abs(busy - place) > 0.5 * box).any(axis=1).all():
            return np.asarray(place)
    return np.asarray(places[0])


def _frame(figure: Figure, axes: Axes, now: Instant, scale: float, longest: float) -> None:
    """Add title, scales, and the figure's size."""
    width, height = (float(np.ptp(each)) for each in (axes.get_xlim(), axes.get_ylim()))
    figure.set_size_inches(WIDTH, 0.75 + min(max(WIDTH * height / width, 1.2), 1.4 * WIDTH))
    title = fill(now.title.replace("$", r"\$"), 60)
    axes.set_title(f"{title}\nt = {now.time:.3f} s".lstrip(), fontsize=TEXT + 1, loc="left")
    axes.set_axis_off()
    length = _nice(0.3 * now.extent)
    _bar(axes, 0.98, length / width, f"{1e3 * length:g} mm", "|-|,widthA=0.25,widthB=0.25")
    if longest > 0.0:
        force = _nice(longest)
        _bar(axes, 0.98 - length / width - 0.1, force * scale / width, f"{force:g} N", "-|>")


def _bar(axes: Axes, right: float, length: float, text: str, style: str) -> None:
    """Draw a scale under the picture, from its right end; lengths are shares of the picture's width."""
    axes.annotate(
        "", (right, BELOW), (right - length, BELOW), xycoords="axes fraction", textcoords="axes fraction",
        arrowprops={"arrowstyle": style, "color": INK, "linewidth": 1.2, "shrinkA": 0, "shrinkB": 0},
        annotation_clip=False,
    )  # fmt: skip
    axes.annotate(
        text, (right - 0.5 * length, BELOW), xytext=(0, -4), textcoords="offset points", xycoords="axes fraction",
        ha="center", va="top", fontsize=TEXT, color=INK, annotation_clip=False,
    )  # fmt: skip


def _nice(value: float) -> float:
    """Find the largest of 1, 2 and 5 times a power of ten that is not above."""
    power = 10.0 ** floor(log10(value))
    share = value / power
    return (5.0 if share >= 5.0 else 2.0 if share >= 2.0 else 1.0) * power
