"""The figure of a run: where object and fingers were, how far the fingers went in, and with what force."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import ceil
from os import PathLike, fspath
from pathlib import Path
from textwrap import fill
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from graspfx.errors import InputError
from graspfx.show.panels import Curve, Row, View, rows, views
from graspfx.show.strokes import finger_strokes

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from graspfx.loop.recording.record import Recording

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

GAINS = ("coupling.external.stiffness", "coupling.internal.stiffness")
GRID, NOTE = "#e4e4e4", "#444444"
SMALL = 9.0  # [points]
SMALLEST = 7.5
LONGEST_TITLE = 56  # characters in a line
CROWDED = 0.8  # of it where the next column begins beside it
BELOW_ZERO = 0.05  # of a distance's range, so that a line along zero is clear of the axis
NOTE_LINE = 0.09  # of a panel's height
MARKERS = 6  # on a line
NAMES_PER_INCH = 5.0  # in a legend
NAME_COLUMN = 1.0  # [inches]
LONG_WAY = 40.0  # up and down, in heights of a panel: a line that goes so far would become an area
THIN = 0.5
MOST_POINTS = 6000  # per line: more than a picture can show


def figure(recordings: Sequence[Recording], path: str | PathLike[str], titles: Sequence[str] | None = None) -> Path:
    """Draw one recording, or several side by side with shared axes, in the manner of Kawai and Yoshikawa, Figs. 12-13.

    (a) Along each axis of noticeable motion: the object solid, its fingers dashed.
    (b) For two fingers: the distance between them solid, that between the object and their centre dashed, and dotted
    the distance at which they would just touch; for more, each finger's distance from their centre.
    (c) The magnitude of each finger's force.
    (d) How the object turns from where it begins, if it does.

    Where lines in (a) or (b) would look straight, their change since the first tick is drawn, and a note says from
    where. A recording of several objects gets a column for each that fingers touch.

    Args:
        recordings: one or more.
        path: of the picture; its ending chooses the format.
        titles: one per recording; the scene and its overrides if not given.

    Returns:
        The path.

    Raises:
        InputError: no recordings, one without a tick, or another number of titles.
    """
    if not recordings or not all(len(recording) for recording in recordings):
        raise InputError("recordings", len(recordings), "one or more recordings with at least one tick each")
    if titles is not None and len(titles) != len(recordings):
        raise InputError("titles", len(titles), f"as many as recordings, {len(recordings)}")
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    columns = views(recordings)
    rows_ = rows(columns, finger_strokes([view.names for view in columns]))
    heights = [row.height for row in rows_]
    width = 4.6 if len(columns) < 3 else 3.8
    beside = 2.3 + NAME_COLUMN * (max(map(_legend_columns, rows_)) - 1)
    picture = Figure(figsize=(beside + width * len(columns), 0.9 + sum(heights)), layout="constrained")
    FigureCanvasAgg(picture)
    axes = picture.subplots(
        len(rows_), len(columns), squeeze=False, sharex=True, sharey="row", gridspec_kw={"height_ratios": heights}
    )
    for row, panels in zip(rows_, axes, strict=True):
        _draw_row(row, panels, columns)
    for each, title in zip(axes[0], _titles(recordings, titles, width / 4.6), strict=True):
        each.set_title(title, loc="left", fontweight="bold", fontsize=SMALL + 1.0)
    for each in axes[-1]:
        each.set_xlabel("time [s]", fontsize=SMALL)
    picture.align_ylabels(axes[:, 0])
    picture.savefig(fspath(path), dpi=150)
    return Path(path)


def _draw_row(row: Row, panels: Sequence[Axes], columns: Sequence[View]) -> None:
    for axes, curves, view in zip(panels, row.panels, columns, strict=True):
        for curve in curves:
            _draw(axes, view.recording.time, curve)
        if not curves:
            axes.text(0.5, 0.5, "does not apply", transform=axes.transAxes, ha="center", fontsize=SMALL, color=NOTE)
        _tidy(axes)
    first = panels[0]
    low, high = first.get_ylim()
    if row.distance:
        low, high = -BELOW_ZERO * high, (1.0 + BELOW_ZERO) * high
    _thin_out(row, panels, high - low)
    lines = max((note.count("\n") + 1 for note in row.notes), default=0)
    first.set_ylim(low, high + (high - low) * NOTE_LINE * lines)
    for axes, note in zip(panels, row.notes, strict=False):
        axes.text(0.02, 0.97, note, transform=axes.transAxes, va="top", fontsize=SMALLEST, color=NOTE)
    first.set_ylabel(row.label, fontsize=SMALL)
    if row.letter:
        first.text(-0.14, 1.02, f"({row.letter})", transform=first.transAxes, fontweight="bold", fontsize=SMALL)
    _add_legend(row, panels)


def _draw(axes: Axes, time: FloatArray, curve: Curve) -> None:
    stroke, places = curve.stroke, _sampled_places(curve.values)
    step = max(1, len(places) // MARKERS)
    axes.plot(
        time[places], curve.values[places], linestyle=stroke.dashes, linewidth=stroke.width, color=stroke.colour,
        marker=stroke.marker, markersize=4.0, markevery=(int(stroke.place * step), step), label=_entry(curve.label),
    )  # fmt: skip


def _thin_out(row: Row, panels: Sequence[Axes], height: float) -> None:
    ways = [np.nansum(np.abs(np.diff(curve.values))) for panel in row.panels for curve in panel]
    if max(ways, default=0.0) > LONG_WAY * height:
        for axes in panels:
            for line in axes.get_lines():
                line.set_linewidth(THIN * line.get_linewidth())


def _sampled_places(values: FloatArray) -> IntArray:
    """Pick the ticks to draw: all of a short run, of a long one the least and greatest value in each short while."""
    size = 2 * len(values) // MOST_POINTS
    if size < 3:
        return np.arange(len(values))
    whole = len(values) // size * size
    pieces = np.nan_to_num(values[:whole]).reshape(-1, size)
    ends = np.stack([pieces.argmin(axis=1), pieces.argmax(axis=1)], axis=1) + np.arange(0, whole, size)[:, None]
    return np.unique(np.concatenate([[0], ends.ravel(), np.arange(whole, len(values))]))


def _tidy(axes: Axes) -> None:
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(color=GRID, linewidth=0.6)
    axes.set_axisbelow(True)
    axes.tick_params(labelsize=SMALL)
    axes.margins(x=0.02)
    axes.ticklabel_format(axis="y", useOffset=False)


def _add_legend(row: Row, panels: Sequence[Axes]) -> None:
    """Name every line that any panel of the row shows, once."""
    from matplotlib.lines import Line2D

    labels = {_entry(curve.label) for panel in row.panels for curve in panel if curve.labelled}
    lines = {line.get_label(): line for axes in panels for line in axes.get_lines() if line.get_label() in labels}
    entries = sorted(lines.values(), key=lambda line: line.get_linestyle() != "-")
    if row.remark:
        entries.append(Line2D([], [], linestyle="none", label=row.remark))
    if entries:
        panels[-1].legend(
            handles=entries, loc="upper left", bbox_to_anchor=(1.0, 1.0), handlelength=2.8, frameon=False,
            fontsize=SMALL, ncols=_legend_columns(row),
        )  # fmt: skip


def _legend_columns(row: Row) -> int:
    """Count the columns that names need to stand beside the row, so that no room opens below it."""
    names = {curve.label for panel in row.panels for curve in panel if curve.labelled}
    return max(1, ceil(len(names) / int(row.height * NAMES_PER_INCH)))


def _entry(label: str) -> str:
    """Write a legend's entry: matplotlib leaves out a name that begins with an underscore."""
    return f" {label}" if label.startswith("_") else label


def _titles(recordings: Sequence[Recording], titles: Sequence[str] | None, share: float) -> list[str]:
    """Title each column: the recording over the first of its objects if there are several, and each object's name."""
    lines = []
    longest = share * LONGEST_TITLE * (CROWDED if len(recordings) > 1 else 1.0)
    for number, recording in enumerate(recordings):
        own = views([recording])
        title = titles[number] if titles is not None else _title(recording, int(len(own) * longest))
        if len(own) == 1:
            lines.append(title)
            continue
        names = [f"object {recording.layout.objects[view.number]}" for view in own]
        lines += [f"{title}\n{names[0]}", *names[1:]]
    return lines


def _title(recording: Recording, longest: int) -> str:
    """Write the scene, its gains, and the other settings of this run."""
    header = recording.header
    name = header.title or Path(header.scene).stem or "run"
    others = [f"{key} = {value}" for key, value in header.overrides.items() if key not in GAINS]
    settings = ", ".join([*_gains(header.scene_table), *(_plain(other) for other in others)])
    return "\n".join(fill(line, longest) for line in (_plain(name), settings)).rstrip()


def _plain(text: str) -> str:
    """Write text in which a dollar sign begins no formula."""
    return text.replace("$", r"\$")


def _gains(scene: Mapping[str, Any]) -> list[str]:
    coupling = scene.get("coupling", {})
    kep, kip = (coupling.get(share, {}).get("stiffness") for share in ("external", "internal"))
    if not isinstance(kep, int | float) or not isinstance(kip, int | float):
        return []
    if kep == kip:
        return [rf"$k_p$ = {kep:g} N/m"]
    return [rf"$k_{{ep}}$ = {kep:g}, $k_{{ip}}$ = {kip:g} N/m"]
