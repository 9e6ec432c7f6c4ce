"""Figures of certificates: stability limits over keys, loci of loops, Z-widths, and margins over operators."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from graspfx.show import style
from graspfx.show.conversions import unit_of
from graspfx.show.style import EXTERNAL, INK, INTERNAL, NEUTRAL, NOTE, PALE, Drawing, panel, plain

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.patheffects import AbstractPathEffect

    from graspfx.analysis.passivity.walls import ZWidth
    from graspfx.analysis.stability.loci import Loci
    from graspfx.certificate.certify_operators import OperatorCertificate, OperatorRegion
    from graspfx.certificate.limit_sweep import SweptLimits
    from graspfx.show.sheet import Sheet, Width

FloatArray = NDArray[np.float64]

NAMES = {
    "object.viscosity": "viscosity of the object $b_v$",
    "object.mass": "mass of the object $m_v$",
    "object.rotational_viscosity": "rotational viscosity of the object",
    "period": "sampling period $T$",
    "finger.*.device.mass": "mass of a device $m$",
    "finger.*.device.damping": "damping of a device $b$",
    "finger.*.device.friction": "damping of a device $b$",
    "finger.*.hand.stiffness": "stiffness of a finger",
    "finger.*.hand.damping": "damping of a finger",
    "coupling.external.damping": "$k_{ed}$",
    "coupling.internal.damping": "$k_{id}$",
}
LIMIT = "largest stable gain [N/m]"
HEIGHT, STACKED = 2.9, 2.2  # [inches]
MOST_CELLS = 400  # largest number of points along an axis of a map that a picture can resolve
LARGEST = 20.0  # largest end of an axis, as a multiple of the smallest limit
LEVELS = 9
EQUAL = "#ffffff"  # colour of the line where both limits are equal


def label_of(key: str) -> str:
    """Return the label of an axis for a key, with the key's unit if it is known."""
    name, unit = NAMES.get(key, plain(key)), unit_of(key)
    return f"{name} [{unit}]" if unit else name


def limits_sheet(limits: SweptLimits, title: str = "", *, width: str = "screen") -> Sheet:
    """Draw the stability limits of k_ep, k_ip and k_p = k_ep = k_ip over the keys of a sweep.

    With one key, the limits are curves. With two keys, they are maps, on which a line marks k_ep = k_ip.

    Raises:
        InputError: If `width` is unknown.
    """
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
        clip_on=bool((limits.external > top).any()),  # a mark at the frame is not clipped, one outside is omitted
        zorder=3,
        label="$k_{ep}$, external",
    )
    ax.set_ylim(0.0, 1.08 * top)
    if not positive.any():
        text = "stable with any gain" if np.isposinf(values).all() else "no limit is finite and above zero"
        ax.text(0.5, 0.5, text, transform=ax.transAxes, ha="center", color=NOTE)
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
    panel(panels[2 if stacked else 1], x=label_of(limits.sweeps[0].key))  # common abscissa of the three panels
    panel(panels[1 if stacked else 0], y=label_of(limits.sweeps[1].key))
    if equal:
        line = Line2D([], [], color=EQUAL, lw=2.0 * weight, label="$k_{ep} = k_{ip}$", path_effects=rim(weight))
        drawing.legend(0, [line])
    drawing.figure.colorbar(picture, cax=drawing.bar, extend="max", label=f"{LIMIT}; blank: none")
    return drawing


def _add_contours(ax: Axes, x: FloatArray, y: FloatArray, part: FloatArray, more: FloatArray, width: Width) -> bool:
    """Add contours of `part`, and the line on which the limits are equal (`more` is 0); return whether it exists."""
    if np.isfinite(part).any() and np.nanmin(part) < np.nanmax(part):
        drawn = ax.contour(x, y, part, levels=LEVELS, colors="white", linewidths=0.5 * width.weight)
        ax.clabel(drawn, fontsize=width.text - 1.0, fmt="%.4g")
    equal = bool(np.isfinite(more).any() and np.nanmin(more) < 0.0 < np.nanmax(more))
    if equal:
        lines = ax.contour(x, y, more, levels=[0.0], colors=EQUAL, linewidths=2.0 * width.weight)
        lines.set_path_effects(rim(width.weight))
    return equal


def rim(weight: float) -> list[AbstractPathEffect]:
    """Return a dark rim for a line, which makes a white line visible on any background."""
    from matplotlib.patheffects import Normal, Stroke

    return [Stroke(linewidth=3.5 * weight, foreground="black"), Normal()]


def _finite(values: FloatArray) -> FloatArray:
    return np.where(np.isfinite(values), values, np.nan)


LOW = 1e-3  # magnitudes below this are not drawn
SIDE = 1.9  # half the height of a Nyquist diagram, in its own units
BESIDE = 0.75  # approximate width of the margin beside a diagram [inches]
DECADES = 4  # number of decades of stiffness in a Z-width
STABLE, PASSIVE = "#1b9e77", "#882255"


def bode(loci: Loci, width: str = "screen", title: str = "") -> Drawing:
    """Draw a Bode diagram: magnitude and phase of the loci over frequency, with the stability margins."""
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
    """Draw the gain margin and the phase margin as distances from magnitude 1 and from phase -180 degrees."""
    marks = []
    if not math.isinf(loci.gain_margin):
        ends = [1.0 / loci.gain_margin, 1.0]
        f, text = [loci.gain_frequency] * 2, f"gain margin {loci.gain_margin:.3g}"
        marks += upper.plot(f, ends, color=PASSIVE, marker="o", clip_on=False, label=text)
    if not math.isinf(loci.phase_margin):
        f, text = [loci.phase_frequency] * 2, f"phase margin {loci.phase_margin:.3g}\N{DEGREE SIGN}"
        beyond = loci.phase[np.argmin(np.abs(loci.frequency - f[0]))] + 180.0  # each from -180 degrees
        nearest = float(beyond[np.argmin(np.abs(np.abs((beyond + 180.0) % 360.0 - 180.0) - loci.phase_margin))])
        turn = 360.0 * round(nearest / 360.0)
        ends = [turn - 180.0, turn - 180.0 + math.copysign(loci.phase_margin, nearest - turn)]
        marks += lower.plot(f, ends, color=STABLE, marker="s", label=text)
    if marks:
        sheet.legend(0, marks)


def nyquist(loci: Loci, width: str = "screen", title: str = "") -> Drawing:
    """Draw a Nyquist diagram near -1: solid lines for positive frequencies, pale lines for negative frequencies."""
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
        across = SIDE * (sheet.width.inches - BESIDE) / sheet.heights[0]
        ax.set_xlim(-across, across)
        ax.set_ylim(-SIDE, SIDE)
        ax.set_aspect("equal", adjustable="box")
        panel(ax, x="real part", y="imaginary part")
        sheet.legend(0, handles)
        sheet.title(title)
    return Drawing(sheet)


def z_width(region: ZWidth, width: str = "screen", title: str = "") -> Drawing:
    """Draw the Z-width: the largest passive and the largest stable stiffness of a wall over the wall's damping."""
    with style.look(width):
        sheet = style.figure([2.6], width=width)
        ax, B = sheet.panels[0, 0], region.wall_damping
        curves = [(region.passive, PASSIVE, "passive for every operator")]
        if region.stable is not None:
            curves.insert(0, (region.stable, STABLE, "stable without an operator"))
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


POINTS = 20  # number of points along a key
GAIN_POINTS = 30  # number of points along a gain
BEYOND = 1.25  # end of the axes of gains, relative to the largest gain with which half of the hands are stable
MOST_MARGIN = 4.0  # largest margin on the colour scale
MARGINS = (1.3, 2.0, 3.0)
SHARES = ("some hands", "half of the hands", "95 % of the hands", "all hands")
TONES = ("#f6ecc9", "#d8cb94", "#97967a", "#4d5a6b")  # colours of the shares, light to dark
COLOURS = {"internal": INTERNAL, "external": EXTERNAL}
DASHES = {"external translation": (0.0, (5.0, 2.0)), "external rotation": (0.0, (1.2, 1.4))}


def operators_sheet(answer: OperatorCertificate, width: str = "screen") -> Sheet:
    """Draw the smallest margin over the first key or the first two keys, and the distribution of the margins.

    The distribution is, for each mode, the share of hands over the margin that they have at least.
    """
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
    """Draw the share of hands with which each pair of gains is stable, and mark the gains of the scene."""
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
        for k, (limit, values) in enumerate(((ax.set_xlim, region.external), (ax.set_ylim, region.internal))):
            common = values[(region.share >= levels[1]).any(axis=1 - k)].max(initial=region.present[k])
            limit(values[0], min(BEYOND * common, values[-1]))
        panel(ax, x="$k_{ep}$, external [N/m]", y="$k_{ip}$, internal [N/m]")
        patches = [Patch(color=tone, label=f"stable in {name}") for name, tone in zip(SHARES, TONES, strict=True)]
        drawing.legend(0, [*reversed(patches), Line2D([], [], color="none", label=f"{region.hands} hands"), mark])
        drawing.title(plain(f"{answer.scene}: gains and hands"))
    return drawing


def _draw_region(ax: Axes, region: OperatorRegion, answer: OperatorCertificate, drawing: Sheet) -> None:
    """Draw the smallest margin as a curve over one key, or as a map over two keys with the contour of margin 1."""
    weight = drawing.width.weight
    margin = np.minimum(region.margin, MOST_MARGIN)
    keys = [each.key for each in region.ranges]
    if len(keys) == 1:
        ax.plot(region.values[0], margin, color=INK)
        ax.axhline(1.0, color=NEUTRAL, lw=0.8 * weight)
        ax.fill_between(region.values[0], 0.0, 1.0, color=NEUTRAL, alpha=style.BAND, lw=0.0)
        ax.set_ylim(0.0, 1.08 * float(margin.max()))
        panel(ax, x=label_of(keys[0]), y="least margin")
    else:
        x, y = region.values
        ax.contourf(
            x, y, margin.T, levels=np.linspace(0.0, MOST_MARGIN, 17), cmap="cividis", vmin=0.0, vmax=MOST_MARGIN
        )
        drawn = ax.contour(x, y, margin.T, levels=MARGINS, colors="white", linewidths=0.6 * weight)
        ax.clabel(drawn, fontsize=drawing.width.text - 1.0, fmt="%.3g")
        if (region.margin < 1.0).any():
            ax.contourf(x, y, margin.T, levels=[0.0, 1.0], colors="none", hatches=["///"])
            if (region.margin >= 1.0).any():
                ax.contour(x, y, margin.T, levels=[1.0], colors="white", linewidths=2.2 * weight)
        ax.plot(
            *(answer.worst.values[key] for key in keys), "v", color="white", mec=INK, ms=7.0 * weight, clip_on=False
        )
        title = "smallest margin; hatched: not stable; triangle: worst"
        panel(ax, x=label_of(keys[0]), y=label_of(keys[1]), title=title)
    for axis, each in zip((ax.set_xscale, ax.set_yscale), region.ranges, strict=False):
        if each.is_logarithmic:
            axis("log")
    _plain_ticks(ax, region)


def _plain_ticks(ax: Axes, region: OperatorRegion) -> None:
    """Set ticks at 1, 2 and 5 in every decade of logarithmic axes, with labels such as 200."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    for axis, each in zip((ax.xaxis, ax.yaxis), region.ranges, strict=False):
        if each.is_logarithmic:
            axis.set_major_locator(LogLocator(base=10.0, subs=(1.0, 2.0, 5.0)))
            axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
            axis.set_minor_formatter(NullFormatter())


def _draw_margins(ax: Axes, answer: OperatorCertificate, drawing: Sheet) -> None:
    """Draw, for each mode, the share of hands over the margin that they have at least."""
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
    panel(ax, x="margin", y="hands with at least that margin [%]")
