"""The figure of a benchmark: one panel per case, time against error with the Pareto front, or bars where few err."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from graspfx.bench.measure import Row
from graspfx.bench.report.pareto import by_case, front
from graspfx.show.plot import GRID, SMALL, SMALLEST
from graspfx.show.strokes import COLOURS, MARKERS

if TYPE_CHECKING:
    from matplotlib.axes import Axes

ACROSS = 3
DECADES = 100.0
LEAST = 1e-17  # where an error of zero is drawn


def figure(rows: Sequence[Row], title: str, path: Path) -> None:
    """Draw one benchmark's rows."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    cases = {name: timed for name, each in by_case(rows).items() if (timed := [r for r in each if r.time_us])}
    names = list(dict.fromkeys(row.method for row in rows if row.time_us))
    looks = {name: (COLOURS[k % len(COLOURS)], MARKERS[k % len(MARKERS)]) for k, name in enumerate(names)}
    units = {row.unit for row in rows if row.unit}
    spread = any(row.quantiles for row in rows)
    wrong = [row for row in rows if (row.error or 0.0) > 0.0]
    errs, mixed = 2 * len(wrong) > len(rows) and not spread, len(units) > 1
    across = min(ACROSS, len(cases)) if errs else 1
    down = -(-len(cases) // across)
    height = 2.6 * down if errs else sum(0.7 + 0.28 * len(each) for each in cases.values())
    drawing = Figure(figsize=(3.1 * across + 2.6 if errs else 7.5, 0.6 + height), layout="constrained")
    FigureCanvasAgg(drawing)
    panels = drawing.subplots(
        down, across, squeeze=False, sharex=True, sharey=errs,
        height_ratios=None if errs else [0.7 + 0.28 * len(each) for each in cases.values()],
    ).ravel()  # fmt: skip
    for axes, (name, each) in zip(panels, cases.items(), strict=False):
        (_scatter if errs else _bars)(axes, each, looks)
        unit = next((row.unit for row in each if row.unit), "") if mixed else ""
        axes.set_title(f"{name} [{unit}]" if unit else name, loc="left", fontsize=SMALL)
        axes.tick_params(labelsize=SMALLEST)
        axes.spines[["top", "right"]].set_visible(False)
    for axes in panels[: len(cases)]:  # now that all of them, which may share an axis, are drawn
        _widen(axes)
    for axes in panels[len(cases) :]:
        axes.set_axis_off()
    drawing.suptitle(title, fontsize=SMALL + 1.0, fontweight="bold")
    drawing.supxlabel("time of one operation [µs]", fontsize=SMALL)
    if errs:
        drawing.supylabel("error" if mixed else f"error [{next(iter(units))}]", fontsize=SMALL)
        handles = [panels[0].plot([], [], looks[n][1], color=looks[n][0], label=n)[0] for n in names]
        drawing.legend(handles=handles, loc="outside right upper", frameon=False, fontsize=SMALLEST)
    path.parent.mkdir(parents=True, exist_ok=True)
    drawing.savefig(path, dpi=130)


def _widen(axes: Axes) -> None:
    """Widen the axis to at least two decades of time, so that some are named."""
    low, high = axes.get_xlim()
    by = max(1.0, DECADES / (high / low)) ** 0.5
    axes.set_xlim(low / by, high * by)
    axes.xaxis.set_minor_formatter("")


def _scatter(axes: Axes, rows: Sequence[Row], looks: Mapping[str, tuple[str, str]]) -> None:
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.grid(color=GRID, linewidth=0.6)
    axes.set_axisbelow(True)
    corners = [(row.time_us or 0.0, max(row.error or 0.0, LEAST)) for row in front(rows)]
    axes.step([t for t, _ in corners], [e for _, e in corners], where="post", color="#9a9a9a", linewidth=1.0)
    for row in rows:
        colour, marker = looks[row.method]
        axes.plot(row.time_us or 0.0, max(row.error or 0.0, LEAST), marker, color=colour, markersize=5.5)


def _bars(axes: Axes, rows: Sequence[Row], looks: Mapping[str, tuple[str, str]]) -> None:
    """Draw best times as bars; where the spread was measured, its quantiles as ticks to the right of them."""
    axes.set_xscale("log")
    axes.grid(axis="x", color=GRID, linewidth=0.6)
    axes.set_axisbelow(True)
    for k, row in enumerate(reversed(rows)):
        colour, _ = looks[row.method]
        spread = row.quantiles or {"median": row.median_us or 0.0}
        axes.plot([row.time_us or 0.0, max(spread.values())], [k, k], color=colour, linewidth=1.2)
        axes.plot([row.time_us or 0.0], [k], "o", color=colour, markersize=6.0)
        axes.plot(list(spread.values()), [k] * len(spread), "|", color=colour, markersize=9.0)
    axes.set_yticks(range(len(rows)), [row.method for row in reversed(rows)])
    axes.set_ylim(-0.6, len(rows) - 0.4)
