"""Rows of a run's figure: positions along each axis, squeeze and push, forces, rotations of the object."""

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
    """One object of a recording with its fingers: a column of the figure."""

    recording: Recording
    number: int

    @property
    def motion(self) -> ObjectMotion:
        return self.recording.objects[self.recording.layout.objects[self.number]]

    @property
    def fingers(self) -> list[int]:
        """Indices of the fingers."""
        return [i for i, thing in enumerate(self.recording.layout.finger_objects) if thing == self.number]

    @property
    def names(self) -> list[str]:
        """Names of the fingers."""
        return [self.recording.layout.fingers[i] for i in self.fingers]

    @property
    def finger_position(self) -> FloatArray:
        """Positions of the fingers (N, n, d) [m]."""
        return self.recording.finger_position[:, self.fingers]

    @property
    def finger_force(self) -> FloatArray:
        """Forces of the fingers (N, n, d) [N]."""
        return self.recording.finger_force[:, self.fingers]

    @property
    def touching(self) -> BoolArray:
        """Whether each finger touches, (N, n)."""
        return self.recording.touching[:, self.fingers]

    @property
    def dimensions(self) -> int:
        return self.recording.layout.dimensions

    @cached_property
    def displacement_modes(self) -> Modes | None:
        """Squeeze and push as displacements [m]; None if not recorded, without fingers, or with a host."""
        return None if self.recording.header.has_host else self._modes("internal_displacement", "external_displacement")

    @cached_property
    def force_modes(self) -> Modes | None:
        """Squeeze and push as forces [N]; None if not recorded, or without fingers."""
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
        """Tell whether a column, or a column of the object, is recorded."""
        name = f"objects/{self.recording.layout.objects[self.number]}/{column}"
        return not {column, name} & set(self.recording.layout.omitted)

    @property
    def is_whole(self) -> bool:
        """Tell whether all columns of the figure are recorded."""
        split = self.recording.layout.sources_of("internal_force") + self.recording.layout.sources_of(
            "internal_displacement"
        )
        return all(map(self.has, ("position", "orientation", "touching", *split)))


@dataclass(frozen=True)
class Curve:
    """One line with a value per tick.

    Attributes:
        label: Label in the legend.
        values: Values (N,).
        stroke: Style of the line.
        many: Values (N, k) whose mean is `values`; the range of these values is drawn as a band. k = 0 for a single
            curve.
    """

    label: str
    values: FloatArray
    stroke: Stroke
    many: FloatArray = field(default_factory=lambda: np.empty((0, 0)))

    @property
    def band(self) -> tuple[FloatArray, FloatArray] | None:
        """Minimum and maximum of `many` at each tick, NaN where it has no finite value; None for a single curve."""
        if not self.many.size:
            return None
        finite = np.isfinite(self.many)
        low, high = (np.where(finite, self.many, end).T for end in (np.inf, -np.inf))
        some = finite.any(axis=1)
        return np.where(some, low.min(axis=0), np.nan), np.where(some, high.max(axis=0), np.nan)


@dataclass(frozen=True)
class Row:
    """Panels side by side that share an ordinate.

    Attributes:
        label: Label of the ordinate.
        panels: One panel per view, without curves if a run lacks the quantity.
        height: Height on a screen [inches].
        signed: Whether zero is in the range and drawn.
    """

    label: str
    panels: tuple[tuple[Curve, ...], ...]
    height: float
    signed: bool = False


def views(recordings: Iterable[Recording]) -> list[View]:
    """List the objects that fingers touch, recording by recording; the first object of a recording without fingers."""
    views_ = []
    for recording in recordings:
        numbers = sorted(set(recording.layout.finger_objects)) or [0]
        views_ += [View(recording, k) for k in numbers]
    return views_


def rows(columns: Sequence[View], strokes: Mapping[str, Stroke]) -> list[Row]:
    """List the recorded rows of the figure, or one empty row if nothing is recorded.

    Args:
        columns: Views to show side by side.
        strokes: Line styles by finger name.
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
    """Select the axes whose range in a view is at least `SHARE` of the largest range; the first axis if all are zero.

    Views share an ordinate, on which even the largest range of a view may be too small to be seen.
    """
    farthest = max((float(each.max()) for each in ranges), default=0.0)
    axes = {int(a) for each in ranges for a in np.flatnonzero(each >= SHARE * farthest)}
    return sorted(axes) if farthest > 0.0 else [0]


def _ranges(view: View) -> FloatArray:
    """Compute the largest motion of object and fingers along each axis, (d,) [m]."""
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
    """Select the axes along which the external part (push) is large enough to be plotted."""
    largest = [np.abs(np.where(np.abs(each.push) < LARGEST, each.push, 0.0)).max(axis=0) for each in parts if each]
    return _axes_worth_showing(largest)


def _parts(
    label: str, columns: Sequence[View], parts: Sequence[Modes | None], axes: Sequence[int], scale: float
) -> list[Row]:
    """Make the row of the squeeze (for more than two fingers its mean and range) and of the push along each axis."""
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
    """List the rows depth, squeeze and push, as far as recorded."""
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
    """Make the curve of mean and range of the fingers' penetration depth, zero for free fingers."""
    gap = view.recording.gap if view.has("gap") and view.has("touching") else None
    if gap is None or not view.fingers:
        return ()
    depth = MM * np.where(view.touching, -gap[:, view.fingers], 0.0)
    return (curve(ALL, depth.mean(axis=1), DEPTH, depth),)


def _forces(view: View, strokes: Mapping[str, Stroke]) -> tuple[Curve, ...]:
    return _of_fingers(view, np.linalg.norm(view.finger_force, axis=2), strokes) if view.has("finger_force") else ()


def _grip(view: View) -> tuple[Curve, ...]:
    """Make the curve of the fingers' smallest friction margin, if any touches with a coefficient of friction."""
    try:
        margin = view.recording.grip_margin_of(view.fingers)
    except RecordingError:  # without some columns
        return ()
    return (curve("smallest $\\mu f_n - |f_t|$", margin, MARGIN),) if np.isfinite(margin).any() else ()


def _turns(columns: Sequence[View]) -> list[Row]:
    """Make the row of the objects' rotations from their start about world axes; no row if none rotates by `TURN`."""
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
    """Compute u theta of the rotation since the first tick, (N, 3) [degrees], continuous beyond half a turn."""
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
    """Return a row; if its lines would look straight, return changes since the first tick, with starts in labels."""
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
    """Return one curve per finger of values (N, n); for many fingers, one curve with their mean and range."""
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
