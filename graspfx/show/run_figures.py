"""Figures of runs: positions of objects and fingers, internal and external forces."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from graspfx.card import setting
from graspfx.errors import InputError, RecordingError
from graspfx.recording.record import Recording
from graspfx.show import style
from graspfx.show.panels import Curve, Row, View, brief_rows, rows, views
from graspfx.show.style import BAND, HAIR, NEUTRAL, NOTE, finger_strokes, panel, plain

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from graspfx.recording.record import Recording
    from graspfx.show.sheet import Sheet

FloatArray = NDArray[np.float64]

MOST = 1 << 25  # largest size of rows that are drawn without thinning [bytes]
SPANS = 1500  # number of intervals into which a longer recording is divided


class Thinned(Recording):
    """Selected rows of a recording, not equally spaced in time.

    Args:
        whole: Complete recording.
        rows: Selected rows of the complete recording.
        numbers: Indices of the selected rows in the complete recording.
    """

    def __init__(self, whole: Recording, rows: FloatArray, numbers: NDArray[np.intp]) -> None:
        super().__init__(rows, whole.layout, whole.header, whole.outcome)
        self._numbers, self._end = numbers, whole.end

    def part(self, first: int, stop: int) -> Thinned:
        """Return the selected rows `first` to `stop` - 1."""
        return Thinned(self, self.rows[first:stop], self._numbers[first:stop])

    @cached_property
    def time(self) -> FloatArray:
        """Times of the selected rows (N,) [s]."""
        return self.header.every * self._numbers.astype(float) * self.header.period

    @property
    def end(self) -> float:
        """Time at which the run ended [s]."""
        return self._end


def thinned(recording: Recording) -> Recording:
    """Select rows of a long recording for drawing.

    The recording is returned unchanged if it is in memory, has at most `MOST` bytes, or contains values that were
    changed during the run. Otherwise it is divided into about `SPANS` equal intervals. From each interval, the first
    row and the rows with the smallest and the largest value of each drawn quantity (such as positions, forces and their
    parts) are selected, which preserves the envelopes of the curves.
    """
    size = 8 * recording.layout.width * len(recording)
    if not recording.is_stored or size <= MOST or recording.changes:
        return recording
    step = -(-len(recording) // SPANS)
    rows, numbers = [], []
    for first in range(0, len(recording), step):
        part = recording.part(first, min(first + step, len(recording)))
        rows_drawn = _ends(part)
        rows.append(part.rows[rows_drawn])
        numbers.append(first + rows_drawn)
    return Thinned(recording, np.concatenate(rows), np.concatenate(numbers))


def _ends(part: Recording) -> NDArray[np.intp]:
    """Return the indices of the first row and of the rows with an extreme value of a drawn quantity, in order."""
    names = ["finger_position", "finger_force", "gap"]
    names += [f"objects/{name}/{place}" for name in part.layout.objects for place in ("position", "orientation")]
    drawn = [part.array(name) for name in names if name in part.layout.columns]
    with suppress(RecordingError):  # the recording has no split rule
        drawn += [part.external_force, part.internal_displacement]
    with suppress(RecordingError):  # the recording has no normals
        drawn.append(part.grip_margin)
    numbers = np.concatenate([np.nan_to_num(each.reshape(len(part), -1)) for each in drawn], axis=1)
    return np.unique(np.concatenate([[0], numbers.argmin(axis=0), numbers.argmax(axis=0)]))


IntArray = NDArray[np.int64]

EQUALS = "\N{NO-BREAK SPACE}=\N{NO-BREAK SPACE}"  # equals sign at which titles are not wrapped
GAINS = ("coupling.external.stiffness", "coupling.internal.stiffness")
LEFT_OUT = "columns that were not recorded are omitted"
MARKERS = 5  # number of markers on a line
LONG_WAY = 40.0  # total variation in panel heights above which a line would look like an area
THIN = 0.5
MOST_POINTS = 6000  # largest number of points per line that a picture can resolve


def sheet(
    recordings: Sequence[Recording],
    titles: Sequence[str] | None = None,
    *,
    labels: Sequence[str] | None = None,
    brief: bool = False,
    width: str = "screen",
) -> Sheet:
    """Draw recordings side by side with shared axes, as in Kawai and Yoshikawa, Figs. 12-13.

    The rows of panels are, from the top:

    - positions of the object and the fingers along each axis with noticeable motion,
    - displacements of the fingers from their contacts, as squeeze and push,
    - forces, as squeeze and push,
    - with more than two fingers, the magnitude of each finger's force,
    - with friction, the grip margin,
    - if the object rotates, its rotation since the start.

    The squeeze is the internal part, positive into the object, and is drawn while at least two fingers touch. The push
    is the external part along each axis where it is noticeable, and is drawn while at least one finger touches. From
    six fingers on, the mean and the range of the fingers are drawn instead of each finger.

    If `brief` is True, the rows are the mean and range of the fingers' penetration depth, the squeeze, and the push.

    If a curve of positions would look straight, the change since the first tick is drawn, and the label states the
    initial value. Panels whose columns were not recorded are omitted, and the title says so. A recording of several
    objects has a column of panels for each object that fingers touch.

    Args:
        recordings: One or more recordings.
        titles: Titles, one per recording; by default the settings of each recording.
        labels: Labels, one per recording, written before the recording's settings.
        brief: Whether to draw only penetration depth, squeeze and push.
        width: "screen", "page" (7.2 inches) or "column" (3.5 inches).

    Raises:
        InputError: If there are no recordings, a recording has no ticks, the number of titles or labels differs from
            the number of recordings, or the width is unknown; or if `brief` is True and no recording has penetration
            depths or internal and external forces.
    """
    for each in recordings:
        if not isinstance(each, Recording):
            raise InputError("recordings", each, "a recording", "pass complete recordings, as in rec.plot(other)")
    if not recordings or not all(len(recording) for recording in recordings):
        raise InputError("recordings", len(recordings), "one or more recordings with at least one tick each")
    for name, texts in (("titles", titles), ("labels", labels)):
        if texts is None:
            continue
        if not hasattr(texts, "__getitem__") or not all(isinstance(text, str) for text in texts):
            raise InputError(name, texts, "texts, one per recording")
        if len(texts) != len(recordings):
            raise InputError(name, len(texts), f"one per recording, {len(recordings)} in all")
    recordings = [thinned(each) for each in recordings]
    columns = views(recordings)
    rows_ = brief_rows(columns) if brief else rows(columns, finger_strokes([view.names for view in columns]))
    if not rows_:
        raise InputError("brief", True, "recordings with penetration depths, or internal and external forces")
    with style.look(width):
        drawing = style.figure([row.height for row in rows_], len(columns), width=width)
        names: list[str] = []
        for k, (row, panels) in enumerate(zip(rows_, drawing.panels, strict=True)):
            _draw_row(row, panels, columns, drawing.width.weight)
            fresh = [label for axes in panels for label in axes.get_legend_handles_labels()[1]]
            if not set(fresh) <= set(names):
                drawing.legend(k)
            names = fresh
        for axes in drawing.panels[-1]:
            panel(axes, x="time [s]")
        drawing.panels[0, 0].set_xlim(0.0, max(each.end for each in recordings))
        drawing.letters()
        _add_titles(drawing, recordings, titles, labels)
    return drawing


def _draw_row(row: Row, panels: Sequence[Axes], columns: Sequence[View], weight: float) -> None:
    for axes, curves, view in zip(panels, row.panels, columns, strict=True):
        for each in curves:
            _draw(axes, view.recording.time, each, weight)
        if not curves:
            word = "does not apply" if view.is_whole else "not recorded"
            axes.text(0.5, 0.5, word, transform=axes.transAxes, ha="center", va="center", color=NOTE)
    first = panels[0]
    if row.signed:
        for axes in panels:
            axes.axhline(0.0, color=NEUTRAL, linewidth=weight * HAIR, zorder=0.9, label="_zero")
    low, high = first.get_ylim()
    _thin_out(row, panels, high - low)
    panel(first, y=row.label)


def _draw(axes: Axes, time: FloatArray, curve: Curve, weight: float) -> None:
    stroke, places = curve.stroke, _sampled_places(curve.values)
    step = max(1, len(places) // MARKERS)
    if curve.band is not None:
        both = np.union1d(*map(_sampled_places, curve.band))
        low, high = (each[both] for each in curve.band)
        axes.fill_between(time[both], low, high, color=stroke.colour, alpha=BAND, linewidth=0.0, zorder=1.5)
    axes.plot(
        time[places], curve.values[places], linestyle=stroke.dashes, linewidth=weight * stroke.width,
        color=stroke.colour, marker=stroke.marker, markevery=(int(stroke.place * step), step),
        label=_entry(curve.label),
    )  # fmt: skip


def _thin_out(row: Row, panels: Sequence[Axes], height: float) -> None:
    ways = [np.nansum(np.abs(np.diff(curve.values))) for panel in row.panels for curve in panel]
    if max(ways, default=0.0) > LONG_WAY * height:
        for axes in panels:
            for line in axes.get_lines():
                line.set_linewidth(THIN * line.get_linewidth())


def _sampled_places(values: FloatArray) -> IntArray:
    """Return the indices of the values to draw.

    From up to about 1.5 `MOST_POINTS` values, all are drawn. More values are divided into intervals, and the smallest
    and the largest value of each interval are drawn.
    """
    size = 2 * len(values) // MOST_POINTS
    if size < 3:
        return np.arange(len(values))
    whole = len(values) // size * size
    pieces = np.nan_to_num(values[:whole]).reshape(-1, size)
    ends = np.stack([pieces.argmin(axis=1), pieces.argmax(axis=1)], axis=1) + np.arange(0, whole, size)[:, None]
    return np.unique(np.concatenate([[0], ends.ravel(), np.arange(whole, len(values))]))


def _entry(label: str) -> str:
    """Return a label for a legend, with a leading space if it begins with "_", since matplotlib omits such labels."""
    return f" {label}" if label.startswith("_") else label


def _add_titles(
    drawing: Sheet, recordings: Sequence[Recording], titles: Sequence[str] | None, labels: Sequence[str] | None
) -> None:
    """Set the titles: settings and object above each column, and the scene above the figure if it is the only one."""
    names = [_name(recording) for recording in recordings]
    if titles is None and len(set(names)) == 1:
        drawing.title(names[0])
    column = 0
    for number, recording in enumerate(recordings):
        own = views([recording])
        heading = titles[number] if titles is not None else _settings(recording)
        if labels is not None and titles is None:
            between = "\n" if len(recordings) > 2 else ": "  # narrow columns have a line for each
            heading = between.join(filter(None, (plain(labels[number]), heading)))
        if titles is None and len(set(names)) > 1:
            heading = f"{names[number]}\n{heading}"
        ends = [each.tick * recording.period for each in recording.faults]
        fault = f"fault at {min(ends):.4g} s" if ends else ""
        for view in own:
            thing = f"object {recording.layout.objects[view.number]}" if len(own) > 1 else ""
            note = "" if view.is_whole else LEFT_OUT
            drawing.title("\n".join(filter(None, (heading, plain(thing), fault, note))), column)
            column += 1


def _name(recording: Recording) -> str:
    header = recording.header
    preset = f", preset {header.preset}" if header.preset else ""
    return plain((header.title or Path(header.scene).stem or "run") + preset)


def _settings(recording: Recording) -> str:
    """Format the gains, and all other overrides of the scene that the preset does not set to the same value."""
    header = recording.header
    preset = header.scene_table.get("preset", {}).get(header.preset, {}).get("set", {})
    own = {key: value for key, value in header.overrides.items() if key not in preset or preset[key] != value}
    others = [setting(key, value, str) for key, value in own.items() if key not in GAINS]
    return ", ".join([*_gains(header.scene_table), *map(plain, others)])


def _gains(scene: Mapping[str, Any]) -> list[str]:
    coupling = scene.get("coupling", {}) if scene.get("host") is None else {}
    kep, kip = (coupling.get(share, {}).get("stiffness") for share in ("external", "internal"))
    if not isinstance(kep, int | float) or not isinstance(kip, int | float):
        return []
    if kep == kip:
        return [f"$k_p${EQUALS}{kep:g}\N{NO-BREAK SPACE}N/m"]
    return [f"$k_{{ep}}${EQUALS}{kep:g}, $k_{{ip}}${EQUALS}{kip:g}\N{NO-BREAK SPACE}N/m"]
