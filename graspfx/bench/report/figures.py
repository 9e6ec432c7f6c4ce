"""The figure of a benchmark: one question, answered in at most three panels; all numbers stand in the tables."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from graspfx.bench.measure import Row
from graspfx.bench.report.questions import NAMES, Curves, Dots, Panel, Question, Savings, Scatter, Spread, question
from graspfx.show import style
from graspfx.show.style import FINGERS, INK, MARKERS, NEUTRAL, PALE, panel

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from graspfx.show.sheet import Sheet

COLOURS = (INK, *FINGERS, NEUTRAL)
LEAST = 1e-17  # where an error of zero is drawn
TALL, LINE, FRAME = 2.7, 0.2, 0.25  # [inches]: panels, and of those with a line for each method, the lines
ROOM, WORDS = 1.6, 4.0  # beyond the least and the greatest, on a logarithmic axis, for points and for words beside them


def figure(rows: Sequence[Row], name: str, title: str, path: Path, *, width: str = "screen") -> None:
    """Draw the answer to a benchmark's question from its rows; nothing if no method of it was timed."""
    query = question(name, title, rows)
    if not query.panels:
        return
    path.parent.mkdir(parents=True, exist_ok=True)
    style.save(sheet(rows, query, width=width), path)


def sheet(rows: Sequence[Row], query: Question, *, width: str = "screen") -> Sheet:
    """Draw what `figure` writes."""
    timed = [row for row in rows if row.time_us is not None]
    stacked = query.stacked or width == "column"
    heights = [max(_height(each, timed) for each in query.panels)]
    if stacked:
        heights = [_height(each, timed) for each in query.panels]
    lined = any(isinstance(each, Dots) for each in query.panels)
    shared = not stacked and _measures(query) == 1
    with style.look(width):
        drawing = style.figure(
            heights, 1 if stacked else len(query.panels), width=width, share_x=stacked and lined, share_y=shared
        )
        looks = _looks(query, timed)
        for axes, each in zip(drawing.panels.ravel(), query.panels, strict=True):
            _draw(axes, each, timed, looks, drawing.width.weight)
        for axes in drawing.panels.ravel()[: 1 if drawing.shares_x else None]:  # now that all is drawn
            _widen(axes, WORDS if any(isinstance(each, Savings) for each in query.panels) else ROOM)
        _label(drawing, query, timed, stacked)
        drawing.title(query.text)
        legends = [zip(*axes.get_legend_handles_labels(), strict=True) for axes in drawing.panels.ravel()]
        entries = {label: handle for each in reversed(legends) for handle, label in each}
        drawing.legend(0, [entries[name] for name in looks or entries])
    return drawing


def _height(each: Panel, rows: Sequence[Row]) -> float:
    if isinstance(each, Curves | Scatter):
        return TALL
    if isinstance(each, Dots):
        return FRAME + LINE * len({row.method for row in rows if row.case in each.cases})
    return FRAME + LINE * len({row.case for row in rows})


def _measures(query: Question) -> int:
    """Count the ordinates that the panels have."""
    return len({(type(each), each.y if isinstance(each, Curves) else "") for each in query.panels})


def _looks(query: Question, rows: Sequence[Row]) -> dict[str, tuple[str, str]]:
    """Give each method its colour and marker, the framework's own first."""
    names: list[str] = []
    for each in query.panels:
        if isinstance(each, Curves):
            points = each.points(rows)
            names += [name for name in each.methods.values() if name in points]
        elif isinstance(each, Scatter):
            drawn = {_name(each, row) for row in rows if row.case == each.case}
            names += [name for name in (each.methods.values() or (row.method for row in rows)) if name in drawn]
    own = sorted(dict.fromkeys(names), key=lambda name: not name.startswith("GraspFX"))
    return {name: (COLOURS[k % len(COLOURS)], MARKERS[k % len(MARKERS)]) for k, name in enumerate(own)}


def _name(each: Scatter, row: Row) -> str:
    return each.methods.get(row.method, "") if each.methods else row.method


def _draw(axes: Axes, each: Panel, rows: Sequence[Row], looks: dict[str, tuple[str, str]], weight: float) -> None:
    axes.set_xscale("log")
    if isinstance(each, Curves | Scatter):
        axes.set_yscale("log")
        lines = each.points(rows) if isinstance(each, Curves) else _lines(each, rows)
        for k, (name, (colour, marker)) in enumerate(looks.items()):
            if name in lines:  # the later, the smaller, so that none of those that coincide is hidden
                x, y = zip(*lines[name], strict=True)
                own = name.startswith("GraspFX")
                dashes, thick = ("-", max(1.2, 3.2 - 1.4 * k)) if own else ((0.0, (4.0, 1.5)), 1.2)
                axes.plot(
                    x, [max(value, LEAST) for value in y], color=colour, marker=marker, linestyle=dashes,
                    markersize=(8.0 - 0.8 * k) * weight, lw=thick * weight, label=name,
                )  # fmt: skip
    elif isinstance(each, Dots):
        _draw_dots(axes, each, rows, weight)
    elif isinstance(each, Spread):
        _draw_spread(axes, each, rows, weight)
    else:
        _draw_savings(axes, rows, weight)


def _lines(each: Scatter, rows: Sequence[Row]) -> dict[str, list[tuple[float, float]]]:
    lines: dict[str, list[tuple[float, float]]] = {}
    for row in rows:
        if row.case == each.case and _name(each, row):
            lines.setdefault(_name(each, row), []).append((row.time_us or 0.0, row.error or 0.0))
    return {name: sorted(points) for name, points in lines.items()}


def _draw_dots(axes: Axes, each: Dots, rows: Sequence[Row], weight: float) -> None:
    """Draw the case that is listed first as full dots, others as rings."""
    own = [row for row in rows if row.case in each.cases]
    best = {name: min(row.time_us or 0.0 for row in own if row.method == name) for name in {r.method for r in own}}
    names = sorted(best, key=best.__getitem__, reverse=True)
    for k, (case, label) in enumerate(each.cases.items()):
        times = {row.method: each.unit * (row.time_us or 0.0) for row in own if row.case == case}
        places = [i for i, name in enumerate(names) if name in times]
        face = (INK, "white", PALE)[k % 3]
        axes.plot(
            [times[names[i]] for i in places], places, MARKERS[k], color=INK, markerfacecolor=face,
            markersize=5.5 * weight, markeredgewidth=weight, label=label or "_", zorder=3 - 0.1 * k,
        )  # fmt: skip
    _name_lines(axes, names)


def _draw_spread(axes: Axes, each: Spread, rows: Sequence[Row], weight: float) -> None:
    methods = list(dict.fromkeys(row.method for row in rows))
    cases = list(reversed(dict.fromkeys(row.case for row in rows)))
    shift = 0.3 / max(1, len(methods) - 1)
    for k, method in enumerate(methods):
        own = {row.case: row.quantiles or {} for row in rows if row.method == method}
        places = [i + 0.15 - k * shift for i, case in enumerate(cases) if case in own]
        times = [[own[case].get(name, float("nan")) for case in cases if case in own] for name in each.quantiles]
        axes.hlines(places, times[0], times[-1], color=COLOURS[k], lw=weight)
        for marker, name, values in zip(("o", "|", "D"), each.quantiles, times, strict=True):
            label = f"{method}: {name}"
            axes.plot(
                values,
                places,
                marker,
                color=COLOURS[k],
                markersize=(5.0 if marker != "D" else 4.0) * weight,
                label=label,
            )
    _name_lines(axes, cases)


def _draw_savings(axes: Axes, rows: Sequence[Row], weight: float) -> None:
    """Draw a line from the quickest to the slowest of each case, and name both ends beside them."""
    cases = list(reversed(dict.fromkeys(row.case for row in rows)))
    for place, case in enumerate(cases):
        own = sorted((row.time_us or 0.0, row.method) for row in rows if row.case == case)
        axes.plot([time for time, _ in own], [place] * len(own), "-", color=PALE, lw=3.0 * weight, zorder=1)
        axes.plot([time for time, _ in own], [place] * len(own), "o", color=INK, markersize=5.0 * weight)
        ends = ((own[0], (-5.0, 0.0), "right"), (own[-1], (5.0, 0.0), "left"))
        for (time, method), offset, side in ends if len(own) > 1 else ():
            axes.annotate(
                method, (time, place), offset, textcoords="offset points", ha=side, va="center",
                fontsize="small",
            )  # fmt: skip
    _name_lines(axes, cases)


def _name_lines(axes: Axes, names: Sequence[str]) -> None:
    axes.set_yticks(range(len(names)), list(names))
    axes.set_ylim(-0.7, len(names) - 0.3)
    axes.tick_params(axis="y", length=0.0)


def _widen(axes: Axes, room: float) -> None:
    low, high = axes.get_xlim()
    axes.set_xlim(low / room, high * room)
    axes.xaxis.set_minor_formatter("")


def _label(drawing: Sheet, query: Question, rows: Sequence[Row], stacked: bool) -> None:
    """Name what panels share once, in the middle or on the left."""
    panels = list(drawing.panels.ravel())
    units = {row.unit for row in rows if row.unit}
    error = f"error [{next(iter(units))}]" if len(units) == 1 else "error"
    middle = len(panels) - 1 if stacked else len(panels) // 2 if len(panels) == 3 else None
    for k, (axes, each) in enumerate(zip(panels, query.panels, strict=True)):
        title, x, y = each.title, NAMES["time"] if isinstance(each, Scatter) else each.x, ""
        if isinstance(each, Curves | Scatter) and (stacked or k == 0 or _measures(query) > 1):
            y = NAMES["time"] if isinstance(each, Curves) and each.y == "time" else error
        if isinstance(each, Curves) and len(units) > 1 and title:
            unit = next(row.unit for row in rows if row.unit and re.fullmatch(each.cases, row.case))
            title = f"{title} [{unit}]"
        panel(axes, x=x if middle in (None, k) else "", y=y, title=title)
