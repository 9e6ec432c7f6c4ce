"""Rows of the figure of a run: positions, squeeze and push, forces, grip margin, and rotations of the objects."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from graspfx.errors import RecordingError
from graspfx.show.squeeze_and_push import Modes, directions, mean, modes
from graspfx.show.style import FINGERS_TOGETHER, INK, MARGIN, OBJECT, PUSHES, SQUEEZE, TURNS, Stroke
from graspfx.spatial import Quaternion

if TYPE_CHECKING:
    from graspfx.recording.history import ObjectMotion
    from graspfx.recording.record import Recording

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

MM = 1e3
SHARE = 0.15  # fraction of the main axis' range above which another axis gets a row or a line
FLAT = 0.03  # fraction of the row's range below which lines look straight
NOISE = 1e-6  # relative range below which lines are straight
TURN = 0.1  # smallest rotation that is drawn [degrees]
LARGEST = 1e12  # largest drawn value of a diverged run
MOST_FINGERS = 5  # largest number of fingers with one line each; more are drawn as mean and range
TALL, LOW, BRIEF = 1.75, 1.2, 1.1  # panels [inches]
DEPTH = Stroke(INK, SQUEEZE.width)
ALL = "fingers: mean and range"


@dataclass(frozen=True)
class View:
    """An object of a recording with its fingers, which is a column of the figure."""

    recording: Recording
    number: int

    @property
    def motion(self) -> ObjectMotion:
        return self.recording.objects[self.recording.layout.objects[self.number]]

    @property
    def fingers(self) -> list[int]:
        """Indices of the object's fingers."""
        return [i for i, thing in enumerate(self.recording.layout.finger_objects) if thing == self.number]

    @property
    def names(self) -> list[str]:
        """Names of the object's fingers."""
        return [self.recording.layout.fingers[i] for i in self.fingers]

    @property
    def finger_position(self) -> FloatArray:
        """Positions of the object's fingers, (N, n, d) [m]."""
        return self.recording.finger_position[:, self.fingers]

    @property
    def finger_force(self) -> FloatArray:
        """Forces of the object's fingers, (N, n, d) [N]."""
        return self.recording.finger_force[:, self.fingers]

    @property
    def touching(self) -> BoolArray:
        """Whether each of the object's fingers touches, (N, n)."""
        return self.recording.touching[:, self.fingers]

    @property
    def dimensions(self) -> int:
        return self.recording.layout.dimensions

    @cached_property
    def displacement_modes(self) -> Modes | None:
        """Squeeze and push as displacements [m]; None without fingers, with a host, or if they are not recorded."""
        return None if self.recording.header.has_host else self._modes("internal_displacement", "external_displacement")

    @cached_property
    def force_modes(self) -> Modes | None:
        """Squeeze and push as forces [N]; None without fingers, or if they are not recorded."""
        return self._modes("internal_force", "external_force")

    def _modes(self, internal: str, external: str) -> Modes | None:
        if not self.fingers:
            return None
        try:
            inner, outer = (getattr(self.recording, name)[:, self.fingers] for name in (internal, external))
            contacts = self.recording.contact_position[:, self.fingers]
            return modes(inner, outer, directions(contacts, self.finger_position - contacts), self.touching)
        except RecordingError:  # recording of an earlier format, or without some columns
            return None

    def has(self, column: str) -> bool:
        """Return whether a column of this name, of the recording or of the object, is recorded."""
        name = f"objects/{self.recording.layout.objects[self.number]}/{column}"
        return not {column, name} & set(self.recording.layout.omitted)

    @property
    def is_whole(self) -> bool:
        """Whether all columns of the figure are recorded."""
        split = self.recording.layout.sources_of("internal_force") + self.recording.layout.sources_of(
            "internal_displacement"
        )
        return all(map(self.has, ("position", "orientation", "touching", *split)))


@dataclass(frozen=True)
class Curve:
    """A line of a panel, with one value per row of the recording.

    Attributes:
        label: Label in the legend.
        values: Values of the line, (N,).
        stroke: Style of the line.
        many: Values (N, k) with the mean `values`, whose range is drawn as a band; k = 0 if no band is drawn.
    """

    label: str
    values: FloatArray
    stroke: Stroke
    many: FloatArray = field(default_factory=lambda: np.empty((0, 0)))

    @property
    def band(self) -> tuple[FloatArray, FloatArray] | None:
        """Minimum and maximum of `many` in each row, NaN if no value is finite; None if no band is drawn."""
        if not self.many.size:
            return None
        finite = np.isfinite(self.many)
        low, high = (np.where(finite, self.many, end).T for end in (np.inf, -np.inf))
        some = finite.any(axis=1)
        return np.where(some, low.min(axis=0), np.nan), np.where(some, high.max(axis=0), np.nan)


@dataclass(frozen=True)
class Row:
    """A row of panels with the same quantity and a common ordinate.

    Attributes:
        label: Label of the ordinate.
        panels: Curves of each view; empty if its recording lacks the quantity.
        height: Height on a screen [inches].
        signed: Whether the ordinate includes zero, with a line at zero.
    """

    label: str
    panels: tuple[tuple[Curve, ...], ...]
    height: float
    signed: bool = False


def views(recordings: Iterable[Recording]) -> list[View]:
    """Return a view for each object that fingers touch; for a recording without fingers, for its first object."""
    views_ = []
    for recording in recordings:
        numbers = sorted(set(recording.layout.finger_objects)) or [0]
        views_ += [View(recording, k) for k in numbers]
    return views_


def rows(columns: Sequence[View], strokes: Mapping[str, Stroke]) -> list[Row]:
    """Return the rows of the figure whose quantities are recorded; one empty row if there are none.

    Args:
        columns: Views to show side by side.
        strokes: Style of each finger's line, by name of the finger.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        axes = _axes_worth_showing([_ranges(view) for view in columns])
        height = TALL if len(axes) == 1 else LOW
        rows_ = [_changes(_positions(columns, a, strokes, height)) for a in axes]
        displacements = [view.displacement_modes for view in columns]
        forces = [view.force_modes for view in columns]
        rows_ += _parts("displacement [mm]", columns, displacements, pushes(displacements), MM)
        rows_ += _parts("force [N]", columns, forces, pushes(forces), 1.0)
        if not any(forces) or any(len(view.fingers) > 2 for view in columns):
            panels = tuple(_forces(view, strokes) for view in columns)
            rows_.append(Row("force of a\nfinger [N]", panels, LOW, signed=True))
        rows_.append(Row("grip margin [N]", tuple(map(_grip, columns)), LOW, signed=True))
        rows_ += _turns(columns)
        drawn = [row for row in rows_ if any(row.panels)]
        return drawn or rows_[:1]


def _axes_worth_showing(ranges: Sequence[FloatArray]) -> list[int]:
    """Return the axes whose range, in at least one view, is `SHARE` of the largest range or more.

    The ranges are compared over all views, because the views share an ordinate. If all ranges are zero, the first axis
    is returned.
    """
    farthest = max((float(each.max()) for each in ranges), default=0.0)
    axes = {int(a) for each in ranges for a in np.flatnonzero(each >= SHARE * farthest)}
    return sorted(axes) if farthest > 0.0 else [0]


def _ranges(view: View) -> FloatArray:
    """Return the largest range of motion of the object and its fingers along each axis, (d,) [m]."""
    lines = [view.motion.position] if view.has("position") else []
    if view.has("finger_position"):
        lines.extend(np.moveaxis(view.finger_position, 1, 0))
    return np.array([max((_range(line[:, a]) for line in lines), default=0.0) for a in range(view.dimensions)])


def _positions(columns: Sequence[View], a: int, strokes: Mapping[str, Stroke], height: float) -> Row:
    def panel(view: View) -> tuple[Curve, ...]:
        if a >= view.dimensions:
            return ()
        curves: tuple[Curve, ...] = ()
        if view.has("position") and not view.recording.header.has_host:
            curves = (curve("object", MM * view.motion.position[:, a], OBJECT),)
        if view.has("finger_position"):
            curves += _of_fingers(view, MM * view.finger_position[:, :, a], strokes)
        return curves

    return Row(f"position {'xyz'[a]} [mm]", tuple(map(panel, columns)), height)


def pushes(parts: Sequence[Modes | None]) -> list[int]:
    """Return the axes along which the push (external part) is large enough to be plotted."""
    largest = [np.abs(np.where(np.abs(each.push) < LARGEST, each.push, 0.0)).max(axis=0) for each in parts if each]
    return _axes_worth_showing(largest)


def _parts(
    label: str, columns: Sequence[View], parts: Sequence[Modes | None], axes: Sequence[int], scale: float
) -> list[Row]:
    """Return the row of the squeeze and of the push along `axes`; empty if no view has these quantities.

    With more than two fingers, the squeeze is drawn as its mean and range.
    """
    if not any(parts):
        return []
    crowded = any(len(view.fingers) > 2 for view in columns)
    name = "internal (squeeze), mean and range" if crowded else "internal (squeeze)"
    panels = tuple(
        (*_squeeze(view, each, name, scale), *_push(view, each, axes, "external (push)", scale))
        for view, each in zip(columns, parts, strict=True)
    )
    return [Row(label, panels, LOW, signed=True)]


def _squeeze(view: View, each: Modes | None, name: str, scale: float = 1.0) -> tuple[Curve, ...]:
    if each is None or len(view.fingers) < 2:
        return ()
    return (curve(name, scale * each.mean_squeeze, SQUEEZE, scale * each.squeeze),)


def _push(view: View, each: Modes | None, axes: Sequence[int], name: str, scale: float = 1.0) -> tuple[Curve, ...]:
    if each is None:
        return ()
    along = [f", {'xyz'[a]}" if view.dimensions > 1 else "" for a in axes]
    return tuple(
        curve(name + word, scale * each.push[:, a], PUSHES[a])
        for a, word in zip(axes, along, strict=True)
        if a < view.dimensions
    )


def brief_rows(columns: Sequence[View]) -> list[Row]:
    """Return the rows for depth, squeeze and push, those of them whose quantities are recorded."""
    with np.errstate(over="ignore", invalid="ignore"):
        forces = [view.force_modes for view in columns]
        pairs, axes = list(zip(columns, forces, strict=True)), pushes(forces)
        rows_ = [
            Row("depth [mm]", tuple(map(_depth, columns)), BRIEF),
            Row("squeeze [N]", tuple(_squeeze(*each, _internal(each[0])) for each in pairs), BRIEF),
            Row("push [N]", tuple(_push(*each, axes, "external force") for each in pairs), BRIEF, signed=True),
        ]
    return [row for row in rows_ if any(row.panels)]


def _internal(view: View) -> str:
    return "internal force" if len(view.fingers) == 2 else "internal force, mean and range"


def _depth(view: View) -> tuple[Curve, ...]:
    """Return a curve of the mean and the range of the fingers' penetration depths, which are zero for free fingers."""
    gap = view.recording.gap if view.has("gap") and view.has("touching") else None
    if gap is None or not view.fingers:
        return ()
    depth = MM * np.where(view.touching, -gap[:, view.fingers], 0.0)
    return (curve(ALL, depth.mean(axis=1), DEPTH, depth),)


def _forces(view: View, strokes: Mapping[str, Stroke]) -> tuple[Curve, ...]:
    return _of_fingers(view, np.linalg.norm(view.finger_force, axis=2), strokes) if view.has("finger_force") else ()


def _grip(view: View) -> tuple[Curve, ...]:
    """Return a curve of the smallest friction margin; none if no finger with a coefficient of friction touches."""
    try:
        margin = view.recording.grip_margin_of(view.fingers)
    except RecordingError:  # without some columns
        return ()
    return (curve("smallest $\\mu f_n - |f_t|$", margin, MARGIN),) if np.isfinite(margin).any() else ()


def _turns(columns: Sequence[View]) -> list[Row]:
    """Return a row of the rotations of the objects about world axes; empty if no object rotates by `TURN` or more."""
    if not all(view.has("orientation") for view in columns):
        return []
    turns = [_rotation_vector(view.motion.orientation) for view in columns]
    ranges = [np.array([_range(turn[:, a]) for a in range(3)]) for turn in turns]
    ranges = [np.where(each >= TURN, each, 0.0) for each in ranges]
    if not any(each.any() for each in ranges):
        return []
    axes = _axes_worth_showing(ranges)
    panels = tuple(
        tuple(curve(f"about {'xyz'[a]}", turn[:, a], TURNS[a]) for a in axes if view.dimensions == 3 or a == 2)
        if view.dimensions > 1
        else ()
        for view, turn in zip(columns, turns, strict=True)
    )
    return [Row("turn [degrees]", panels, LOW, signed=True)]


def _rotation_vector(orientation: FloatArray | None) -> FloatArray:
    """Return the rotation vectors since the first row, (N, 3) [degrees], continuous beyond half a turn."""
    if orientation is None:
        return np.zeros((1, 3))
    if orientation.ndim == 1:
        return np.degrees(np.outer(orientation - orientation[0], [0.0, 0.0, 1.0]))
    turned: Any = Quaternion(*orientation.T) @ Quaternion(*orientation[0]).conjugate  # of columns of ticks
    v, w = np.stack([turned.x, turned.y, turned.z], axis=1), turned.w
    s = np.linalg.norm(v, axis=1)
    u = v / np.where(s > 0.0, s, 1.0)[:, None]
    side = np.cumprod(np.where(np.sum(u[1:] * u[:-1], axis=1) < 0.0, -1.0, 1.0))  # u and -u describe the same axis
    side = np.concatenate([[1.0], side])
    angle = np.unwrap(2.0 * np.arctan2(side * s, w))
    turn: FloatArray = np.degrees((side * angle)[:, None] * u)
    return turn


def _changes(row: Row) -> Row:
    """Return the changes of a row's curves since the first tick, with the first values in the labels.

    The row is returned unchanged if the changes are large enough to be seen, or within rounding.
    """
    curves = [curve for panel in row.panels for curve in panel]
    ends = [_ends(values) for curve in curves for values in (curve.values, curve.many)]
    span = max((high for _, high in ends), default=0.0) - min((low for low, _ in ends), default=0.0)
    change = max((_range(curve.values) for curve in curves), default=0.0)
    if not NOISE * span < change < FLAT * span:
        return row
    starts: dict[str, set[str]] = {}
    for curve in curves:
        starts.setdefault(curve.label, set()).add(f"{round(float(curve.values[0]), 1) + 0.0:.1f}")
    panels = tuple(tuple(_since_start(curve, starts[curve.label]) for curve in panel) for panel in row.panels)
    return replace(row, label=row.label.replace("position", "change of"), panels=panels, signed=True)


def _since_start(curve: Curve, starts: set[str]) -> Curve:
    begin = f" (from {min(starts)})".replace("-", "\N{MINUS SIGN}") if len(starts) == 1 and not curve.many.size else ""
    label, many = curve.label + begin, curve.many - curve.many[:1]
    return replace(curve, label=label, values=curve.values - curve.values[0], many=many)


def _of_fingers(view: View, values: FloatArray, strokes: Mapping[str, Stroke]) -> tuple[Curve, ...]:
    """Return a curve of values (N, n) for each finger; for more than MOST_FINGERS, one curve of mean and range."""
    if len(view.fingers) > MOST_FINGERS:
        return (curve(ALL, mean(values, np.isfinite(values)), FINGERS_TOGETHER, values),)
    return tuple(curve(name, values[:, i], strokes[name]) for i, name in enumerate(view.names))


def curve(label: str, values: FloatArray, stroke: Stroke, many: FloatArray | None = None) -> Curve:
    whole = Curve(label, np.where(np.abs(values) < LARGEST, values, np.nan), stroke)
    return whole if many is None else replace(whole, many=np.where(np.abs(many) < LARGEST, many, np.nan))


def _range(values: FloatArray) -> float:
    low, high = _ends(values)
    return high - low


def _ends(values: FloatArray) -> tuple[float, float]:
    finite = values[np.abs(values) < LARGEST]
    return (float(finite.min()), float(finite.max())) if finite.size else (0.0, 0.0)
