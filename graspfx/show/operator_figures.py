"""Figures of a certificate over operators: the region of hands, the margins' distribution, the map of gains."""

from __future__ import annotations

from os import PathLike
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from graspfx.show import style
from graspfx.show.key_names import NAMES, unit_of
from graspfx.show.style import EXTERNAL, INK, INTERNAL, NEUTRAL, NOTE, panel, plain

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from graspfx.certificate.certify_operators import OperatorCertificate, OperatorRegion
    from graspfx.show.sheet import Sheet

FloatArray = NDArray[np.float64]

HEIGHT = 2.9  # [inches]
POINTS = 20  # along a key
GAIN_POINTS = 30  # along a gain
LARGEST = 4.0  # margin at which colours end
LEVELS = (1.3, 2.0, 3.0)
SHARES = ("some hands", "half of the hands", "95 % of the hands", "all hands")
TONES = ("#f6ecc9", "#d8cb94", "#97967a", "#4d5a6b")  # of those, light to dark
COLOURS = {"internal": INTERNAL, "external": EXTERNAL}
DASHES = {"external translation": (0.0, (5.0, 2.0)), "external rotation": (0.0, (1.2, 1.4))}


def plot(answer: OperatorCertificate, path: str | PathLike[str] | None = None, width: str = "screen") -> Sheet:
    """Draw `operators_sheet`, and write it where a path is given."""
    drawing = operators_sheet(answer, width)
    if path is not None:
        style.save(drawing, path)
    return drawing


def operators_sheet(answer: OperatorCertificate, width: str = "screen") -> Sheet:
    """Draw the region of hands over the first two keys, or one, and beside it the share of hands above each margin."""
    region = answer.region(answer.operators.keys[:2], POINTS)
    with style.look(width):
        stacked = width == "column"
        drawing = style.figure(
            [HEIGHT, HEIGHT] if stacked else [HEIGHT], columns=1 if stacked else 2, width=width, share_x=False,
            share_y=False,
        )  # fmt: skip
        first, second = drawing.panels.ravel()
        _draw_region(first, region, answer, drawing)
        _draw_margins(second, answer, drawing)
        drawing.legend(1 if stacked else 0)
        drawing.title(plain(f"{answer.scene}: stable in {answer.share.count} of {answer.share.total} hands drawn"))
    return drawing


def gains_sheet(answer: OperatorCertificate, width: str = "screen") -> Sheet:
    """Draw in how many hands each pair of gains is stable, and where the scene's own are."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    region = answer.gains(GAIN_POINTS)
    with style.look(width):
        drawing = style.figure([HEIGHT * 1.15], width=width)
        ax, weight = drawing.panels[0, 0], drawing.width.weight
        half = 0.5 / max(region.hands, 1)
        levels = [half, 0.5, max(min(0.95, 1.0 - 2.0 * half), 0.6), 1.0 - half]
        ax.contourf(region.external, region.internal, region.share.T, levels=[*levels, 2.0], colors=TONES)
        lines = ax.contour(
            region.external, region.internal, region.share.T, levels=levels, colors=INK, linewidths=0.8 * weight
        )
        lines.set_linestyle("solid")
        (mark,) = ax.plot(*region.present, "o", color=INK, mfc="white", ms=6.0 * weight, ls="none", label="the scene's")
        panel(ax, x="$k_{ep}$, external [N/m]", y="$k_{ip}$, internal [N/m]")
        patches = [Patch(color=tone, label=f"stable in {name}") for name, tone in zip(SHARES, TONES, strict=True)]
        drawing.legend(0, [*reversed(patches), Line2D([], [], color="none", label=f"{region.hands} hands"), mark])
        drawing.title(plain(f"{answer.scene}: gains and hands"))
    return drawing


def _draw_region(ax: Axes, region: OperatorRegion, answer: OperatorCertificate, drawing: Sheet) -> None:
    """Draw margins over two keys as a map with the limit's contour, over one as a curve."""
    weight = drawing.width.weight
    margin = np.minimum(region.margin, LARGEST)
    keys = [each.key for each in region.ranges]
    if len(keys) == 1:
        ax.plot(region.values[0], margin, color=INK)
        ax.axhline(1.0, color=NEUTRAL, lw=0.8 * weight)
        ax.fill_between(region.values[0], 0.0, 1.0, color=NEUTRAL, alpha=style.BAND, lw=0.0)
        ax.set_ylim(0.0, 1.08 * float(margin.max()))
        panel(ax, x=label(keys[0]), y="least margin")
    else:
        x, y = region.values
        ax.contourf(x, y, margin.T, levels=np.linspace(0.0, LARGEST, 17), cmap="cividis", vmin=0.0, vmax=LARGEST)
        drawn = ax.contour(x, y, margin.T, levels=LEVELS, colors="white", linewidths=0.6 * weight)
        ax.clabel(drawn, fontsize=drawing.width.text - 1.0, fmt="%.3g")
        if (region.margin < 1.0).any():
            ax.contourf(x, y, margin.T, levels=[0.0, 1.0], colors="none", hatches=["///"])
            if (region.margin >= 1.0).any():
                ax.contour(x, y, margin.T, levels=[1.0], colors="white", linewidths=2.2 * weight)
        ax.plot(
            *(answer.worst.values[key] for key in keys), "v", color="white", mec=INK, ms=7.0 * weight, clip_on=False
        )
        panel(ax, x=label(keys[0]), y=label(keys[1]), title="least margin; hatched: not stable; triangle: worst")
    for axis, each in zip((ax.set_xscale, ax.set_yscale), region.ranges, strict=False):
        if each.is_logarithmic:
            axis("log")
    _plain_ticks(ax, region)


def _plain_ticks(ax: Axes, region: OperatorRegion) -> None:
    """Number logarithmic axes of less than two decades by plain numbers."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    for axis, each in zip((ax.xaxis, ax.yaxis), region.ranges, strict=False):
        if each.is_logarithmic:
            axis.set_major_locator(LogLocator(base=10.0, subs=(1.0, 2.0, 5.0)))
            axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
            axis.set_minor_formatter(NullFormatter())


def _draw_margins(ax: Axes, answer: OperatorCertificate, drawing: Sheet) -> None:
    """Draw the share of hands whose margin is at least what the abscissa says, mode by mode."""
    weight = drawing.width.weight
    most = 1.0
    for mode in answer.modes:
        margins = np.sort(answer.margins(mode))
        finite = margins[np.isfinite(margins)]
        if not finite.size:
            continue
        most = max(most, float(np.quantile(finite, 0.9)))
        share = 100.0 * (1.0 - np.arange(len(margins)) / len(margins))
        colour = COLOURS.get(mode.split()[0], NOTE)
        ax.step(margins, share, where="pre", color=colour, ls=DASHES.get(mode, "-"), label=mode)
    ax.axvline(1.0, color=NEUTRAL, lw=0.8 * weight)
    ax.set_xlim(0.0, min(1.1 * most, 20.0))
    ax.set_ylim(0.0, 103.0)
    panel(ax, x="margin", y="hands with that margin or more [%]")


def label(key: str) -> str:
    """Write a key with its unit, in words where it has some."""
    name, unit = NAMES.get(key, plain(key)), unit_of(key)
    return f"{name} [{unit}]" if unit else name
