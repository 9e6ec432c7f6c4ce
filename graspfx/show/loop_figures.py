"""Figures of loops: Bode and Nyquist diagrams of characteristic loci, and the Z-width of a display."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from graspfx.show import style
from graspfx.show.drawing import Drawing
from graspfx.show.style import INK, NEUTRAL, NOTE, PALE, panel

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from graspfx.analysis.passivity.walls import ZWidth
    from graspfx.analysis.stability.loci import Loci
    from graspfx.show.sheet import Sheet

LOW = 1e-3  # magnitudes below this are not drawn
SIDE = 1.9  # half the height of a Nyquist diagram
MARGINS = 0.75  # [inches] of paper beside it, about
DECADES = 4  # of stiffness in a Z-width, at most
STABLE, PASSIVE = "#1b9e77", "#882255"


def bode(loci: Loci, width: str = "screen", title: str = "") -> Drawing:
    """Draw magnitude and phase of the loci over frequency, with the margins."""
    with style.look(width):
        sheet = style.figure([1.9, 1.6], width=width)
        upper, lower = sheet.panels[:, 0]
        for magnitude, phase in zip(loci.magnitude.T, loci.phase.T, strict=True):
            visible = magnitude > LOW
            upper.plot(loci.frequency, magnitude, color=INK)
            lower.plot(loci.frequency, np.where(visible, phase, np.nan), color=INK)
        upper.set_yscale("log")
        upper.set_xscale("log")
        upper.set_ylim(bottom=max(LOW, 0.5 * float(loci.magnitude[loci.magnitude > 0.0].min())))
        upper.axhline(1.0, color=NEUTRAL, dashes=(4.0, 3.0))
        visible = loci.phase[loci.magnitude > LOW]
        low, high = np.floor(visible.min() / 90.0), np.ceil(visible.max() / 90.0)
        lower.set_yticks(90.0 * np.arange(low, high + 1, max(1, (high - low) // 5)))
        lower.axhline(-180.0, color=NEUTRAL, dashes=(4.0, 3.0))
        _mark(loci, upper, lower, sheet)
        upper.set_xlim(loci.frequency[0], loci.frequency[-1])
        panel(upper, y="magnitude")
        panel(lower, x="frequency [Hz]", y="phase [degrees]")
        sheet.title(title)
    return Drawing(sheet)


def _mark(loci: Loci, upper: Axes, lower: Axes, sheet: Sheet) -> None:
    """Draw the margins as what is left to the lines of -1."""
    marks = []
    if not math.isinf(loci.gain_margin):
        ends = [1.0 / loci.gain_margin, 1.0]
        f, text = [loci.gain_frequency] * 2, f"gain margin {loci.gain_margin:.3g}"
        marks += upper.plot(f, ends, color=PASSIVE, marker="o", clip_on=False, label=text)
    if not math.isinf(loci.phase_margin):
        f, text = [loci.phase_frequency] * 2, f"phase margin {loci.phase_margin:.3g}\N{DEGREE SIGN}"
        beyond = loci.phase[np.argmin(np.abs(loci.frequency - f[0]))] + 180.0  # of each locus, from -180 degrees
        nearest = float(beyond[np.argmin(np.abs(np.abs((beyond + 180.0) % 360.0 - 180.0) - loci.phase_margin))])
        turn = 360.0 * round(nearest / 360.0)
        ends = [turn - 180.0, turn - 180.0 + math.copysign(loci.phase_margin, nearest - turn)]
        marks += lower.plot(f, ends, color=STABLE, marker="s", label=text)
    if marks:
        sheet.legend(0, marks)


def nyquist(loci: Loci, width: str = "screen", title: str = "") -> Drawing:
    """Draw the loci about -1, for positive frequencies in full, mirrored for negative ones."""
    with style.look(width):
        sheet = style.figure([3.4], width=width)
        ax = sheet.panels[0, 0]
        for locus in loci.response.T:
            ax.plot(locus.real, -locus.imag, color=PALE, zorder=1)
            ax.plot(locus.real, locus.imag, color=INK, zorder=2)
        turn = np.linspace(0.0, 2.0 * math.pi, 200)
        ax.plot(np.cos(turn), np.sin(turn), color=NEUTRAL, dashes=(4.0, 3.0), label="unit circle")
        ax.plot([-1.0], [0.0], color=PASSIVE, marker="P", ls="none", label="-1")
        handles = ax.get_legend_handles_labels()[0]
        if not math.isinf(loci.gain_margin):
            text = f"gain margin {loci.gain_margin:.3g}"
            handles += ax.plot([-1.0 / loci.gain_margin], [0.0], color=STABLE, marker="o", ls="none", label=text)
        across = SIDE * (sheet.width.inches - MARGINS) / sheet.heights[0]
        ax.set_xlim(-across, across)
        ax.set_ylim(-SIDE, SIDE)
        ax.set_aspect("equal", adjustable="box")
        panel(ax, x="real part", y="imaginary part")
        sheet.legend(0, handles)
        sheet.title(title)
    return Drawing(sheet)


def z_width(region: ZWidth, width: str = "screen", title: str = "") -> Drawing:
    """Draw the stiffness of a wall over its damping, up to which it is passive, and stable."""
    with style.look(width):
        sheet = style.figure([2.6], width=width)
        ax, B = sheet.panels[0, 0], region.wall_damping
        curves = [(region.passive, PASSIVE, "passive to every operator")]
        if region.stable is not None:
            curves.insert(0, (region.stable, STABLE, "stable when nobody holds it"))
        top = max(float(values.max()) for values, _, _ in curves)
        wide = region.stable is not None and B[0] > 0.0
        if wide:
            ax.set_xscale("log")
            ax.set_yscale("log")
        bottom = top * 10.0**-DECADES if wide else 0.0
        for values, colour, label in curves:
            height = np.maximum(values, bottom)
            ax.fill_between(B, bottom, height, color=colour, alpha=style.BAND, lw=0.0)
            ax.plot(B, height, color=colour, label=label)
        ax.set_xlim(B[0], B[-1])
        ax.set_ylim(bottom, 1.5 * top if wide else 1.08 * top)
        if not top > 0.0:
            ax.text(0.5, 0.5, "no wall is passive", transform=ax.transAxes, ha="center", color=NOTE)
        panel(ax, x="damping of the wall $B$ [N s/m]", y="stiffness $K$ [N/m]")
        sheet.legend(0)
        sheet.title(title)
    return Drawing(sheet)
