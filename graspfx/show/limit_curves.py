"""The figure of limits over one or two keys of a scene, in the manner of Kawai and Yoshikawa, Fig. 15."""

from __future__ import annotations

from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from graspfx.show import style
from graspfx.show.key_names import label_of
from graspfx.show.style import EXTERNAL, INTERNAL, NOTE, PALE, panel, plain

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.patheffects import AbstractPathEffect

    from graspfx.certificate.limit_sweep import SweptLimits
    from graspfx.show.sheet import Sheet
    from graspfx.show.widths import Width

FloatArray = NDArray[np.float64]

LIMIT = "largest stable gain [N/m]"
HEIGHT, STACKED = 2.9, 2.2  # [inches]
MOST_CELLS = 400  # along an axis of a map: more than a picture can show
LARGEST = 20.0  # times the smallest limit: where an axis ends that would otherwise be all about one end
LEVELS = 9
EQUAL = "#ffffff"  # line where both limits are equal


def limits_figure(
    limits: SweptLimits, path: str | PathLike[str], title: str = "", *, width: str = "screen", form: str = ""
) -> Path:
    """Draw curves of the three limits over one key; over two, maps of each, and where k_ep = k_ip.

    Raises:
        InputError: no such width or format.
    """
    return style.save(limits_sheet(limits, title, width=width), path, form)


def limits_sheet(limits: SweptLimits, title: str = "", *, width: str = "screen") -> Sheet:
    """Draw what `limits_figure` writes."""
    with style.look(width):
        drawing = _curves(limits, width) if len(limits.sweeps) == 1 else _maps(limits, width)
        drawing.title(plain(title))
    return drawing


def _curves(limits: SweptLimits, width: str) -> Sheet:
    drawing = style.figure([HEIGHT], width=width)
    ax, weight, x = drawing.panels[0, 0], drawing.width.weight, limits.sweeps[0].values
    marked = "o" if len(x) <= 30 else ""
    values = np.concatenate([limits.internal, limits.external])
    positive = np.isfinite(values) & (values > 0.0)
    top = min(float(values[positive].max()), LARGEST * float(values[positive].min())) if positive.any() else 1.0
    ax.plot(x, _finite(limits.conventional), color=PALE, lw=6 * weight, label="$k_p$, equal gains")
    ax.plot(x, _finite(limits.internal), color=INTERNAL, ls="--", lw=1.5 * weight, label="$k_{ip}$, internal")
    ax.plot(
        x,
        _finite(limits.external),
        color=EXTERNAL,
        lw=1.5 * weight,
        marker=marked,
        ms=4.0 * weight,
        clip_on=bool((limits.external > top).any()),  # a mark at the frame is whole, one beyond it is left out
        zorder=3,
        label="$k_{ep}$, external",
    )
    ax.set_ylim(0.0, 1.08 * top)
    if not positive.any():
        ax.text(0.5, 0.5, "no gain is too large", transform=ax.transAxes, ha="center", color=NOTE)
    if len(x) > 1:
        ax.set_xlim(x[0], x[-1])
    panel(ax, x=label_of(limits.sweeps[0].key), y=LIMIT)
    drawing.legend(0)
    return drawing


def _maps(limits: SweptLimits, width: str) -> Sheet:
    from matplotlib.lines import Line2D

    steps = [max(1, -(-len(sweep.values) // MOST_CELLS)) for sweep in limits.sweeps]
    x, y = (sweep.values[::step] for sweep, step in zip(limits.sweeps, steps, strict=True))
    tiles = [
        np.where(np.isfinite(part), part, np.nan)[:: steps[0], :: steps[1]].T
        for part in (limits.external, limits.internal, limits.conventional)
    ]
    values = np.concatenate([part.ravel() for part in tiles])
    finite = values[np.isfinite(values)]
    top = float(np.quantile(finite, 0.98)) if len(finite) else 1.0
    stacked = width == "column"
    drawing = style.figure([STACKED] * 3 if stacked else [HEIGHT], columns=1 if stacked else 3, width=width, bar=True)
    panels, weight, equal = list(drawing.panels.ravel()), drawing.width.weight, False
    names = ("$k_{ep}$, external", "$k_{ip}$, internal", "$k_p$, equal gains")
    for ax, part, name in zip(panels, tiles, names, strict=True):
        picture = ax.pcolormesh(x, y, part, vmin=0.0, vmax=top, cmap="cividis", shading="nearest", rasterized=True)
        if min(part.shape) > 1:
            equal = _add_contours(ax, x, y, part, tiles[0] - tiles[1], drawing.width) or equal
        panel(ax, title=name)
    panel(panels[2 if stacked else 1], x=label_of(limits.sweeps[0].key))  # one for all three
    panel(panels[1 if stacked else 0], y=label_of(limits.sweeps[1].key))
    if equal:
        line = Line2D([], [], color=EQUAL, lw=2.0 * weight, label="$k_{ep} = k_{ip}$", path_effects=rim(weight))
        drawing.legend(0, [line])
    drawing.figure.colorbar(picture, cax=drawing.bar, extend="max", label=f"{LIMIT}; blank: none")
    return drawing


def _add_contours(ax: Axes, x: FloatArray, y: FloatArray, part: FloatArray, more: FloatArray, width: Width) -> bool:
    """Add lines of equal limits, and the one where two are equal; tell whether there is one."""
    if np.isfinite(part).any() and np.nanmin(part) < np.nanmax(part):
        drawn = ax.contour(x, y, part, levels=LEVELS, colors="white", linewidths=0.5 * width.weight)
        ax.clabel(drawn, fontsize=width.text - 1.0, fmt="%.4g")
    equal = bool(np.isfinite(more).any() and np.nanmin(more) < 0.0 < np.nanmax(more))
    if equal:
        lines = ax.contour(x, y, more, levels=[0.0], colors=EQUAL, linewidths=2.0 * width.weight)
        lines.set_path_effects(rim(width.weight))
    return equal


def rim(weight: float) -> list[AbstractPathEffect]:
    """Give a white line a dark rim, by which it is seen on any ground."""
    from matplotlib.patheffects import Normal, Stroke

    return [Stroke(linewidth=3.5 * weight, foreground="black"), Normal()]


def _finite(values: FloatArray) -> FloatArray:
    return np.where(np.isfinite(values), values, np.nan)
