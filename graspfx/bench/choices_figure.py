"""Figure of a scene's choices: error over the time per simulated second, with the Pareto front marked."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from graspfx.bench.scene_choices import Tradeoff
from graspfx.show import style
from graspfx.show.style import FINGERS, INK, MARKERS, NEUTRAL, NOTE, PALE, panel

if TYPE_CHECKING:
    from graspfx.bench.timing import Row
    from graspfx.show.sheet import Sheet

TALL = 2.9  # [inches]
LEAST = 1e-17  # plotted value of an error of zero
COLOURS = (INK, *FINGERS, NEUTRAL)
BEFORE, BEYOND = 2.5, 1.6  # factors of space for labels before the smallest time and beyond the largest time


def tradeoff_sheet(tradeoff: Tradeoff, *, width: str = "screen") -> Sheet:
    """Draw a line for each integrator or engine over its periods, and the reference's error."""
    sound = [each for each in tradeoff.outcomes if each.row.time_us is not None and each.row.error is not None]
    names = list(dict.fromkeys(each.choice.name for each in sound))
    with style.look(width):
        drawing = style.figure([TALL], width=width)
        [axes] = drawing.panels[0]
        weight = drawing.width.weight
        axes.set_xscale("log")
        axes.set_yscale("log")
        for k, name in enumerate(names):
            own = sorted((each for each in sound if each.choice.name == name), key=lambda each: each.choice.period)
            axes.plot(
                *_places(each.row for each in own),
                color=COLOURS[k % len(COLOURS)], marker=MARKERS[k % len(MARKERS)], lw=1.2 * weight,
                markersize=(6.5 - 0.5 * k) * weight, label=name,
            )  # fmt: skip
        best = tradeoff.best
        axes.plot(
            *_places(best), "o", color=INK, markerfacecolor="none", markersize=11.0 * weight,
            label="Pareto front: no other choice is as fast and as accurate",
        )  # fmt: skip
        for each in sound:
            if each.row in best:  # no other choice is both faster and more accurate
                axes.annotate(
                    f"{1e3 * each.choice.period:.3g} ms", _place(each.row), (-7.0, -4.0),
                    textcoords="offset points", ha="right", va="top", color=NOTE, fontsize="small",
                )  # fmt: skip
        if 0.0 < tradeoff.reference.error < float("inf"):
            axes.axhline(
                tradeoff.reference.error, color=PALE, lw=1.2 * weight, ls="--", zorder=1.0,
                label="error of the reference",
            )  # fmt: skip
        low, high = axes.get_xlim()
        axes.set_xlim(low / BEFORE, high * BEYOND)
        panel(axes, x="run time per simulated second [s]", y="error [m]")
        drawing.legend(0)
        drawing.title(f"{style.plain(tradeoff.scene)}: speed and accuracy of its choices")
    return drawing


def _place(row: Row) -> tuple[float, float]:
    """Return the position of a choice in the figure: time per simulated second [s], and error."""
    return 1e-6 * (row.time_us or 0.0), max(row.error or 0.0, LEAST)


def _places(rows: Iterable[Row]) -> tuple[list[float], list[float]]:
    places = [_place(row) for row in rows]
    return [x for x, _ in places], [y for _, y in places]
