"""Rows of a run's figure: positions along each axis, distances, forces, rotation of the object."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from textwrap import fill
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from graspfx.show.strokes import APART, ASTRAY, CONTACTS, OBJECT, TURNS, Stroke

if TYPE_CHECKING:
    from graspfx.loop.recording.history import ObjectMotion
    from graspfx.loop.recording.record import Recording

FloatArray = NDArray[np.float64]

MM = 1e3
SHARE = 0.15  # of the main axis' range, from which on another axis is worth a row
FLAT = 0.03  # lines whose own range is a smaller share of the row's look straight
NOISE = 1e-6  # and below this share they are
TURN = 0.1  # [degrees] from which on an object turns
LARGEST = 1e12  # what is drawn of a run that diverged
LONGEST_NOTE = 64  # characters in a line
MOST_STARTS = 7  # curves whose first values a note gives
AS_ABOVE = "fingers as in (a)"


@dataclass(frozen=True)
class View:
    """One object of a recording with its fingers: a column of the figure."""

    recording: Recording
    number: int

    @property
    def motion(self) -> ObjectMotion:
        return self.recording.objects[self.recording.layout.objects[self.number]]

    @property
    def fingers(self) -> list[int]:
        """Numbers of the fingers."""
        return [i for i, thing in enumerate(self.recording.layout.finger_objects) if thing == self.number]

    @property
    def names(self) -> list[str]:
        """The fingers'."""
        return [self.recording.layout.fingers[i] for i in self.fingers]

    @property
    def finger_position(self) -> FloatArray:
        """(N, n, d) [m]."""
        return self.recording.finger_position[:, self.fingers]

    @property
    def dimensions(self) -> int:
        return self.recording.layout.dimensions


@dataclass(frozen=True)
class Curve:
    """One line: a value per tick."""

    label: str
    values: FloatArray
    stroke: Stroke
    for_scale: bool = False  # there to compare others with, and to be left out where only changes are shown
    labelled: bool = True  # beside the row


@dataclass(frozen=True)
class Row:
    """Panels side by side that share an ordinate.

    Attributes:
        letter: by which a text refers to it; empty for what continues the row above.
        label: of the ordinate.
        panels: one per view; one without curves where a run does not have the quantity.
        height: [inches].
        notes: one per view, to stand in the panel.
        remark: to stand beside the row, under the curves' names.
        distance: whether zero is the least that a value can be.
    """

    letter: str
    label: str
    panels: tuple[tuple[Curve, ...], ...]
    height: float
    notes: tuple[str, ...] = ()
    remark: str = ""
    distance: bool = False


def views(recordings: Iterable[Recording]) -> list[View]:
    """List every object that fingers touch, recording by recording; the first object of a recording without fingers."""
    views_ = []
    for recording in recordings:
        numbers = sorted(set(recording.layout.finger_objects)) or [0]
        views_ += [View(recording, k) for k in numbers]
    return views_


def rows(columns: Sequence[View], strokes: Mapping[str, Stroke]) -> list[Row]:
    """List the rows of the figure.

    Args:
        columns: what to show side by side.
        strokes: by finger's name.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        axes = _axes_worth_showing([_ranges(view) for view in columns])
        height = 2.5 if len(axes) == 1 else 1.9
        rows_ = []
        for k, a in enumerate(axes):
            panels = tuple(_positions(view, a, strokes, labelled=k == 0) for view in columns)
            row = Row("a" if k == 0 else "", f"position {'xyz'[a]} [mm]", panels, height)
            rows_.append(_changes(row, f"displacement {'xyz'[a]} [mm]"))
        panels = tuple(_distances(view, strokes) for view in columns)
        crowded = any(len(view.fingers) > 2 for view in columns)
        remark = f"{AS_ABOVE}: to their centre" if crowded else ""
        row = Row("b", "distance [mm]", panels, 2.2, remark=remark, distance=True)
        rows_.append(_changes(row, "change of distance [mm]"))
        panels = tuple(_forces(view, strokes) for view in columns)
        rows_.append(Row("c", "force [N]", panels, 1.5, remark=AS_ABOVE, distance=True))
        rows_ += _turns(columns)
        return rows_


def _axes_worth_showing(ranges: Sequence[FloatArray]) -> list[int]:
    """Pick the axes along which a view moves by more than a share of its main axis; of views at rest, the first."""
    axes = {int(a) for each in ranges for a in np.flatnonzero(each >= SHARE * each.max()) if each.max() > 0.0}
    return sorted(axes) or [0]


def _ranges(view: View) -> FloatArray:
    """Measure how far object and fingers go along each axis, (d,) [m]: how far the one goes that goes farthest."""
    p, x = view.finger_position, view.motion.position
    lines = [x, *(p[:, i] for i in range(p.shape[1]))]
    return np.array([max(_range(line[:, a]) for line in lines) for a in range(view.dimensions)])


def _positions(view: View, a: int, strokes: Mapping[str, Stroke], *, labelled: bool) -> tuple[Curve, ...]:
    if a >= view.dimensions:
        return ()
    x = _curve("object", MM * view.motion.position[:, a], OBJECT, labelled=labelled)
    return (x, *_of_fingers(view, MM * view.finger_position[:, :, a], strokes, labelled=labelled))


def _distances(view: View, strokes: Mapping[str, Stroke]) -> tuple[Curve, ...]:
    """Plot the distance of two fingers; that of more from their centre; and that of the object from it."""
    p, fingers = view.finger_position, view.fingers
    if not fingers:
        return ()
    centre = p.mean(axis=1)
    curves: list[Curve] = []
    if len(fingers) == 2:
        curves.append(_curve("between fingers", MM * np.linalg.norm(p[:, 1] - p[:, 0], axis=1), APART))
        c = view.recording.contact_position[:, fingers]
        touch = MM * np.linalg.norm(c[:, 1] - c[:, 0], axis=1)
        if touch.any():  # contacts attached to the object's centre have none
            curves.append(_curve("between contact points", touch, CONTACTS, for_scale=True))
    elif len(fingers) > 2:
        away = MM * np.linalg.norm(p - centre[:, None, :], axis=2)
        curves += _of_fingers(view, away, strokes)
    astray = MM * np.linalg.norm(view.motion.position - centre, axis=1)
    name = "object to finger" if len(fingers) == 1 else "object to centre of fingers"
    return (*curves, _curve(name, astray, ASTRAY))


def _forces(view: View, strokes: Mapping[str, Stroke]) -> tuple[Curve, ...]:
    return _of_fingers(view, np.linalg.norm(view.recording.finger_force[:, view.fingers], axis=2), strokes)


def _turns(columns: Sequence[View]) -> list[Row]:
    """Plot how the objects turn from where they begin, about world axes; no row if none does."""
    turns = [_rotation_vector(view.motion.orientation) for view in columns]
    ranges = [np.array([_range(turn[:, a]) for a in range(3)]) for turn in turns]
    ranges = [np.where(each >= TURN, each, 0.0) for each in ranges]
    if not any(each.any() for each in ranges):
        return []
    axes = _axes_worth_showing(ranges)
    panels = tuple(
        tuple(_curve(f"about {'xyz'[a]}", turn[:, a], TURNS[a]) for a in axes if view.dimensions == 3 or a == 2)
        if view.dimensions > 1
        else ()
        for view, turn in zip(columns, turns, strict=True)
    )
    return [Row("d", "turn [degrees]", panels, 1.5)]


def _rotation_vector(orientation: FloatArray | None) -> FloatArray:
    """Compute u theta of the rotation since the first tick, (N, 3) [degrees]; it goes on beyond half a turn."""
    if orientation is None:
        return np.zeros((1, 3))
    if orientation.ndim == 1:
        return np.degrees(np.outer(orientation - orientation[0], [0.0, 0.0, 1.0]))
    v0, w0 = -orientation[0, :3], orientation[0, 3]
    v, w = orientation[:, :3], orientation[:, 3]
    v, w = w[:, None] * v0 + w0 * v + np.cross(v, v0), w * w0 - v @ v0  # q q0'
    s = np.linalg.norm(v, axis=1)
    u = v / np.where(s > 0.0, s, 1.0)[:, None]
    side = np.cumprod(np.where(np.sum(u[1:] * u[:-1], axis=1) < 0.0, -1.0, 1.0))  # u and -u are one axis
    side = np.concatenate([[1.0], side])
    angle = np.unwrap(2.0 * np.arctan2(side * s, w))
    turn: FloatArray = np.degrees((side * angle)[:, None] * u)
    return turn


def _changes(row: Row, label: str) -> Row:
    """Return the row, or, if its lines would look straight, the changes since the first tick."""
    curves = [curve for panel in row.panels for curve in panel]
    ends = [_ends(curve.values) for curve in curves] + ([(0.0, 0.0)] if row.distance else [])
    span = max(high for _, high in ends) - min(low for low, _ in ends)
    change = max((_range(curve.values) for curve in curves if not curve.for_scale), default=0.0)
    if not NOISE * span < change < FLAT * span:
        return row
    panels = tuple(
        tuple(replace(c, values=c.values - c.values[0]) for c in panel if not c.for_scale) for panel in row.panels
    )
    return replace(row, label=label, panels=panels, notes=tuple(map(_starts, row.panels)), distance=False)


def _starts(panel: Sequence[Curve]) -> str:
    """Note where changes are counted from, unless there are so many curves that the note would hide them."""
    if len(panel) > MOST_STARTS:
        return "changes since t = 0"
    values = ", ".join(f"{curve.label} {curve.values[0] + 0.0:.1f}" for curve in panel)
    return fill(f"at t = 0: {values} mm".replace("-0.0", "0.0").replace(" -", " \N{MINUS SIGN}"), LONGEST_NOTE)


def _of_fingers(
    view: View, values: FloatArray, strokes: Mapping[str, Stroke], *, labelled: bool = False
) -> tuple[Curve, ...]:
    """Draw one curve per finger, from values (N, n)."""
    return tuple(_curve(name, values[:, i], strokes[name], labelled=labelled) for i, name in enumerate(view.names))


def _curve(label: str, values: FloatArray, stroke: Stroke, *, for_scale: bool = False, labelled: bool = True) -> Curve:
    return Curve(label, np.where(np.abs(values) < LARGEST, values, np.nan), stroke, for_scale, labelled)


def _range(values: FloatArray) -> float:
    low, high = _ends(values)
    return high - low


def _ends(values: FloatArray) -> tuple[float, float]:
    finite = values[np.abs(values) < LARGEST]
    return (float(finite.min()), float(finite.max())) if finite.size else (0.0, 0.0)
