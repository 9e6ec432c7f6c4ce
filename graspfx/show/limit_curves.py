"""The figure of limits over one or two keys of a scene, in the manner of Kawai and Yoshikawa, Fig. 15."""

from __future__ import annotations

from os import PathLike, fspath
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from graspfx.certificate.limit_sweep import SweptLimits

FloatArray = NDArray[np.float64]

UNITS = {
    "viscosity": "N s/m",
    "rotational_viscosity": "N m s/rad",
    "mass": "kg",
    "period": "s",
    "duration": "s",
    "stiffness": "N/m",
    "damping": "N s/m",
    "friction": "N s/m",
    "squeeze": "m",
    "radius": "m",
}
NAMES = {
    "object.viscosity": "Viscosity of the object $b_v$",
    "object.mass": "Mass of the object $m_v$",
    "object.rotational_viscosity": "Rotational viscosity of the object",
    "period": "Sampling period $T$",
    "finger.*.device.mass": "Mass of a device $m$",
    "finger.*.device.damping": "Damping of a device $b$",
    "finger.*.device.friction": "Damping of a device $b$",
    "finger.*.hand.stiffness": "Stiffness of a finger",
    "finger.*.hand.damping": "Damping of a finger",
    "coupling.external.damping": "$k_{ed}$",
    "coupling.internal.damping": "$k_{id}$",
}
EXTERNAL, INTERNAL, CONVENTIONAL = "#c1272d", "#0000a7", "#111111"
MOST_CELLS = 400  # along an axis of a map: more than a picture can show
LARGEST = 20.0  # times the smallest limit: where an axis ends that would otherwise be all about one end
LEVELS = 9


def limits_figure(limits: SweptLimits, path: str | PathLike[str], title: str = "") -> Path:
    """Draw curves of the three limits over one key; over two, maps of each, and where k_ep = k_ip."""
    from matplotlib.figure import Figure

    target = Path(fspath(path))
    if len(limits.sweeps) == 1:
        drawing = Figure(figsize=(4.6, 3.4), layout="constrained")
        _curves(drawing.add_subplot(), limits)
    else:
        drawing = Figure(figsize=(10.5, 3.5), layout="constrained")
        _maps(drawing, limits)
    if title:
        drawing.suptitle(title, fontsize=9)
    drawing.savefig(target, dpi=200)
    return target


def _curves(ax: Axes, limits: SweptLimits) -> None:
    x = limits.sweeps[0].values
    marked = "o" if len(x) <= 30 else ""
    values = np.concatenate([limits.internal, limits.external])
    positive = np.isfinite(values) & (values > 0.0)
    top = min(float(values[positive].max()), LARGEST * float(values[positive].min())) if positive.any() else 1.0
    ax.plot(x, _finite(limits.conventional), color="#b8b8b8", lw=6, solid_capstyle="round", label="$k_p$ conventional")
    ax.plot(x, _finite(limits.internal), color=INTERNAL, ls="--", lw=1.4, label="$k_{ip}$ internal")
    ax.plot(
        x,
        _finite(limits.external),
        color=EXTERNAL,
        lw=1.4,
        marker=marked,
        ms=3.5,
        clip_on=bool((limits.external > top).any()),  # a mark at the frame is whole, one beyond it is left out
        zorder=3,
        label="$k_{ep}$ external",
    )
    ax.set_ylim(0.0, 1.08 * top)
    if not positive.any():
        ax.text(0.5, 0.5, "no gain is too large", transform=ax.transAxes, ha="center")
    if len(x) > 1:
        ax.set_xlim(x[0], x[-1])
    ax.set_xlabel(_label(limits.sweeps[0].key), fontsize=9)
    ax.set_ylabel("Largest stable stiffness [N/m]", fontsize=9)
    ax.tick_params(direction="in", top=True, right=True, labelsize=8)
    ax.legend(fontsize=8, frameon=False, loc="lower right")


def _maps(drawing: object, limits: SweptLimits) -> None:
    from matplotlib.figure import Figure

    assert isinstance(drawing, Figure)
    steps = [max(1, -(-len(sweep.values) // MOST_CELLS)) for sweep in limits.sweeps]
    x, y = (sweep.values[::step] for sweep, step in zip(limits.sweeps, steps, strict=True))
    tiles = [
        np.where(np.isfinite(part), part, np.nan)[:: steps[0], :: steps[1]].T
        for part in (limits.external, limits.internal, limits.conventional)
    ]
    values = np.concatenate([part.ravel() for part in tiles])
    finite = values[np.isfinite(values)]
    top = float(np.quantile(finite, 0.98)) if len(finite) else 1.0
    axes = drawing.subplots(1, 3, sharex=True, sharey=True)
    names = ("$k_{ep}$ external", "$k_{ip}$ internal", "$k_p$ conventional")
    picture = None
    for ax, part, name in zip(axes, tiles, names, strict=True):
        picture = ax.pcolormesh(x, y, part, vmin=0.0, vmax=top, cmap="viridis", shading="nearest", rasterized=True)
        if min(part.shape) > 1:
            if np.isfinite(part).any() and np.nanmin(part) < np.nanmax(part):
                drawn = ax.contour(x, y, part, levels=LEVELS, colors="white", linewidths=0.5)
                ax.clabel(drawn, fontsize=6, fmt="%.4g")
            more = tiles[0] - tiles[1]
            if np.isfinite(more).any() and np.nanmin(more) < 0.0 < np.nanmax(more):
                ax.contour(x, y, more, levels=[0.0], colors=EXTERNAL, linewidths=1.6)
        ax.set_title(name, fontsize=9)
        ax.set_xlabel(_label(limits.sweeps[0].key), fontsize=8)
        ax.tick_params(labelsize=7)
    axes[0].set_ylabel(_label(limits.sweeps[1].key), fontsize=8)
    if picture is not None:
        bar = drawing.colorbar(picture, ax=list(axes), extend="max")
        bar.set_label("Largest stable stiffness [N/m]\nred: $k_{ep} = k_{ip}$; blank: no limit", fontsize=8)
        bar.ax.tick_params(labelsize=7)


def _finite(values: FloatArray) -> FloatArray:
    return np.where(np.isfinite(values), values, np.nan)


def _label(key: str) -> str:
    last = key.rsplit(".", 1)[-1]
    unit = f" [{UNITS[last]}]" if last in UNITS and key != "coupling.friction" else ""
    return f"{NAMES.get(key, key)}{unit}"
