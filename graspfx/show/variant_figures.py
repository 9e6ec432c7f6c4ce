"""Figures of a sweep's measures over the swept keys: curves, maps, slices and scatter plots.

A variant without a number, because it failed or has a fault, is marked by a cross.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from graspfx.errors import InputError
from graspfx.show import style
from graspfx.show.certificate_figures import label_of, rim
from graspfx.show.style import CONTACTS, INK, NEUTRAL, NOTE, panel, plain

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.colors import Normalize

    from graspfx.show.sheet import Sheet

FloatArray = NDArray[np.float64]

CURVE, MAP, SCATTER = 1.5, 2.6, 1.4  # heights [inches]
MOST_CELLS = 400  # largest number of points along an axis of a map that a picture can resolve
MOST_POINTS = 4000
LEVELS = 7
MANY = 50.0  # ratio of largest to smallest number up to which an axis is linear
ROUNDING = 1e-6  # smallest relative change that is drawn
SPREAD = 0.02  # fraction of outliers at either end that may exceed the colour scale or ordinate
BAD = CONTACTS["limit"]
EDGE = "runs grow beyond this line"
LIMIT = "certificate: margin 1"
UNJUDGED = "not judged by the certificate"
DASHES = (0.0, (3.0, 1.5))
LEAST = 1e-3  # smallest distinguishable difference of margins
CROSSES = "no number: a failure or a fault"
WORDS = {  # names of quantities in labels; in other names, underscores become spaces
    "finger_position": "finger position", "finger_force": "finger force", "object_position": "object position",
}  # fmt: skip


class Surface(NamedTuple):
    """A measure of the variants of a sweep.

    Attributes:
        name: Name of the measure, such as `finger_force.peak`.
        unit: Unit of the values.
        values: Value for each variant, array in the shape of the grid.
        unstable: Mask of the variants whose runs grow, in the shape of the grid; None if unknown.
    """

    name: str
    unit: str
    values: FloatArray
    unstable: NDArray[np.bool_] | None = None

    @property
    def grows(self) -> bool:
        """Whether the measure is a growth factor, which is above 1 for growing and below 1 for decaying runs."""
        return self.name.endswith(".growth")

    @property
    def label(self) -> str:
        """Label of the measure, with its unit."""
        quantity, _, statistic = self.name.rpartition(".")
        words = WORDS.get(quantity, quantity.replace("_", " "))
        return f"{words},\n{statistic}{f' [{self.unit}]' if self.unit not in ('', '1') else ''}"


class Margins(NamedTuple):
    """Margins of stability certificates at selected points of the drawn maps.

    Attributes:
        places: For each of the first two keys, the indices of the values with a certificate.
        values: Smallest margin for each selected value of the first key, of the second key, and each map (x, y, maps);
            NaN for points without a certificate.
    """

    places: tuple[list[int], ...]
    values: FloatArray


class Axis(NamedTuple):
    """Values of a key along an axis.

    Attributes:
        label: Label of the axis.
        places: Values of the key; if the key's values are not numbers, their positions 0, 1, ... on the axis.
        words: Values that are not numbers, as texts in the order of their positions; empty for numbers.
    """

    label: str
    places: FloatArray
    words: tuple[str, ...] = ()


def variants_sheet(
    values: Mapping[str, NDArray[Any]],
    surfaces: Sequence[Surface],
    bad: NDArray[np.bool_],
    title: str,
    width: str = "screen",
    slices: int = 3,
    *,
    together: bool = False,
    margins: Margins | None = None,
) -> Sheet:
    """Draw measures of a sweep over the swept keys.

    The figure contains curves for one key, maps for more keys, and scatter plots over each key if `together` is True.

    Args:
        values: For each key, its value in each variant, array in the shape of the grid.
        surfaces: Measures to draw; maps show only the first measure.
        bad: Mask of the variants without a valid number, in the shape of the grid.
        title: Title of the figure.
        width: "screen", "page" or "column".
        slices: Number of maps, for different values of a third key.
        together: Whether the keys vary together, so that the variants do not form a grid.
        margins: Margins of certificates, to draw the line of margin 1 over maps; None for no line.

    Raises:
        InputError: If the width is unknown, or there is nothing to draw.
    """
    if not surfaces or not bad.size:
        raise InputError("measures", len(surfaces), "at least one measure and one variant")
    clean = [each._replace(values=np.where(bad, np.nan, each.values)) for each in surfaces]
    with style.look(width):
        if len(values) == 1 and not together:
            drawing = _curves(values, clean, bad, width)
        elif together:
            drawing = _marginals(values, clean, bad, width)
        else:
            drawing = _maps(values, clean[0], bad, width, slices, margins)
        drawing.title(plain(title) if together else f"{plain(title)}{_rest(values)}")
    return drawing


def _curves(values: Mapping[str, Any], surfaces: Sequence[Surface], bad: NDArray[np.bool_], width: str) -> Sheet:
    [(key, items)] = values.items()
    axis = _axis(key, items)
    order = np.argsort(axis.places, kind="stable")
    drawing = style.figure([CURVE] * len(surfaces), width=width)
    for ax, surface in zip(drawing.panels[:, 0], surfaces, strict=True):
        y = surface.values[order]
        ax.plot(axis.places[order], y, color=INK, marker="o" if len(y) <= 40 else "", ms=3.5)
        _frame(ax, surface, y, axis.places[bad])
        panel(ax, y=surface.label)
    _along(drawing.panels[-1, 0], axis, "x")
    _pad(drawing, axis.places)
    if bad.any():
        drawing.legend(0, [_bad_mark()])
    drawing.letters()
    return drawing


def _maps(
    values: Mapping[str, Any],
    surface: Surface,
    bad: NDArray[np.bool_],
    width: str,
    slices: int,
    margins: Margins | None,
) -> Sheet:
    """Draw a measure over two keys; with a third key, draw a map for each of up to `slices` of its values.

    Further keys have the middle value of their lists. Maps are side by side, or stacked if the width is "column".
    """
    keys = list(values)
    x, y = _axis(keys[0], _line(values[keys[0]], 0)), _axis(keys[1], _line(values[keys[1]], 1))
    third = _line(values[keys[2]], 2) if len(keys) > 2 else None
    picks, rest = drawn_maps(bad.shape, slices)
    across = 1 if width == "column" else len(picks)
    drawing = style.figure([MAP] * (len(picks) // across), columns=across, width=width, bar=True)
    shades = _shades(surface)
    limited = False
    for k, (ax, pick) in enumerate(zip(drawing.panels.ravel(), picks, strict=True)):
        where = (slice(None), slice(None)) + (() if third is None else (pick, *rest))
        picture = _map(ax, x, y, surface.values[where], bad[where], shades, grows=surface.grows)
        if surface.unstable is not None:
            _edge(ax, x, y, surface.unstable[where])
        if margins is not None:
            limited = _limit_line(ax, x, y, margins.places, margins.values[..., k]) or limited
        if third is not None:
            panel(ax, title=f"{_short(keys[2])} = {plain(_number(third[pick]))}")
    for ax in drawing.panels[:, 0]:
        _along(ax, y, "y")
    for ax in drawing.panels[-1]:
        _words(ax, x, "x")
    panel(drawing.panels[-1, across // 2], x=x.label)
    drawing.figure.colorbar(picture, cax=drawing.bar, extend=_extension(surface.values, shades), label=surface.label)
    edged = surface.unstable is not None and surface.unstable.any() and not surface.unstable.all()
    marks = [_bad_mark()] if bad.any() else []
    if edged:
        marks.append(_mark(EDGE, color=BAD, lw=1.4))
    if limited:
        marks.append(_mark(LIMIT, color="white", lw=1.4, ls=DASHES, path_effects=rim(1.0)))
    if margins is not None and np.isnan(margins.values).any():
        marks.append(_mark(UNJUDGED, ls="", marker="$?$", ms=4.0, color=BAD))
    if marks:
        drawing.legend(0, marks)
    return drawing


def _extension(values: FloatArray, shades: Normalize) -> str:
    finite = values[np.isfinite(values)]
    low, high = _ends(shades)
    below, above = bool((finite < low).any()), bool((finite > high).any())
    return "both" if below and above else "min" if below else "max" if above else "neither"


def _map(
    ax: Axes, x: Axis, y: Axis, values: FloatArray, bad: NDArray[np.bool_], shades: Normalize, *, grows: bool
) -> Any:
    """Draw a map with contours; if `grows` is True, the only contour is that of growth 1, the limit of stability."""
    steps = [max(1, -(-size // MOST_CELLS)) for size in values.shape]
    cells = values[:: steps[0], :: steps[1]].T
    across, up = x.places[:: steps[0]], y.places[:: steps[1]]
    picture = ax.pcolormesh(across, up, cells, norm=shades, cmap="cividis", shading="nearest", rasterized=True)
    finite = cells[np.isfinite(cells)]
    if min(cells.shape) > 2 and finite.size > 8 and finite.min() < finite.max():
        levels = LEVELS if not grows else [1.0] if finite.min() < 1.0 < finite.max() else []
        drawn = ax.contour(across, up, np.clip(cells, *_ends(shades)), levels=levels, colors="white", linewidths=0.6)
        ax.clabel(drawn, fontsize=6.0, fmt="%.4g")
    i, j = np.nonzero(bad)
    ax.plot(x.places[i], y.places[j], ls="", marker="x", ms=3.0, color=BAD)
    ax.grid(visible=False)
    return picture


def _edge(ax: Axes, x: Axis, y: Axis, unstable: NDArray[np.bool_]) -> None:
    """Draw the boundary between decaying and growing runs over a map of any measure."""
    if min(unstable.shape) > 1 and unstable.any() and not unstable.all():
        ax.contour(x.places, y.places, unstable.T.astype(float), levels=[0.5], colors=[BAD], linewidths=1.4)


def _limit_line(ax: Axes, x: Axis, y: Axis, places: Sequence[list[int]], margins: FloatArray) -> bool:
    """Draw the line of margin 1, and mark points without a certificate; return whether the line exists.

    The reciprocal of the margin is interpolated, since it is proportional to the gain, and is zero if the margin is
    infinite.
    """
    across, up = (axis.places[picks] for axis, picks in zip((x, y), places, strict=True))
    i, j = np.nonzero(np.isnan(margins))
    ax.plot(across[i], up[j], ls="", marker="$?$", ms=4.0, color=BAD)
    if min(margins.shape) < 2:
        return False
    rows, columns = np.argsort(across, kind="stable"), np.argsort(up, kind="stable")
    share = 1.0 / np.maximum(margins[np.ix_(rows, columns)].T, LEAST)
    if not np.nanmin(share, initial=np.inf) <= 1.0 < np.nanmax(share, initial=-np.inf):
        return False
    lines = ax.contour(across[rows], up[columns], share, levels=[1.0], colors=["white"], linewidths=1.4)
    lines.set(linestyle=DASHES, path_effects=rim(1.0), label=LIMIT)
    return any(np.size(path.vertices) for path in lines.get_paths())


def _marginals(values: Mapping[str, Any], surfaces: Sequence[Surface], bad: NDArray[np.bool_], width: str) -> Sheet:
    drawing = style.figure([SCATTER] * len(surfaces), columns=len(values), width=width, share_x=False)
    some = np.unique(np.linspace(0, bad.size - 1, min(bad.size, MOST_POINTS)).astype(int))
    for column, (key, items) in enumerate(values.items()):
        axis = _axis(key, items)
        for row, surface in enumerate(surfaces):
            ax = drawing.panels[row, column]
            x, y = axis.places.ravel()[some], surface.values.ravel()[some]
            ax.plot(x, y, ls="", marker="o", ms=2.0, color=NEUTRAL, alpha=0.6, mew=0.0)
            for middle, median in _medians(x, y):
                ax.plot(middle, median, ls="", marker="_", ms=9.0, mew=1.6, color=INK)
            _frame(ax, surface, y, axis.places.ravel()[bad.ravel()])
            if not column:
                panel(ax, y=surface.label)
            if row + 1 < len(surfaces):
                ax.tick_params(labelbottom=False)
            else:
                _along(ax, axis, "x")
            low, high = float(axis.places.min()), float(axis.places.max())
            ax.set_xlim(low - 0.03 * (high - low or 1.0), high + 0.03 * (high - low or 1.0))
    if bad.any():
        drawing.legend(0, [_bad_mark()])
    drawing.letters()
    return drawing


def _medians(x: FloatArray, y: FloatArray) -> list[tuple[float, float]]:
    """Compute medians of y in eight equal bands of x; return the middle and the median of each band.

    Bands with fewer than three points are omitted; there are none for fewer than 20 points.
    """
    good = np.isfinite(y)
    if good.sum() < 20:
        return []
    edges = np.linspace(x[good].min(), x[good].max(), 9)
    bands = [(good & (x >= a) & (x <= b), 0.5 * (a + b)) for a, b in pairwise(edges)]
    return [(float(middle), float(np.median(y[band]))) for band, middle in bands if band.sum() >= 3]


# Axes -----------------------------------------------------------------------------------------------------------------


def _axis(key: str, items: NDArray[Any]) -> Axis:
    if items.dtype.kind == "f":
        return Axis(label_of(key), np.asarray(items, dtype=float))
    texts = [_number(each) for each in items.ravel()]
    words = tuple(dict.fromkeys(texts))
    places = np.array([float(words.index(text)) for text in texts]).reshape(items.shape)
    return Axis(label_of(key), places, words)


def _line(values: NDArray[Any], axis: int) -> NDArray[Any]:
    """Return the values (k,) of a key that varies along the given axis of the grid only."""
    return np.moveaxis(values, axis, 0).reshape(values.shape[axis], -1)[:, 0]


def picks_of(count: int, most: int) -> list[int]:
    """Return up to `most` evenly spaced indices from 0 to `count` - 1, including both ends."""
    return sorted({int(k) for k in np.round(np.linspace(0, count - 1, min(most, count)))})


def drawn_maps(shape: Sequence[int], slices: int) -> tuple[list[int], tuple[int, ...]]:
    """Return the indices of the third key's values that have a map, and the index of each further key's value."""
    return picks_of(shape[2], max(1, slices)) if len(shape) > 2 else [0], tuple(size // 2 for size in shape[3:])


def _along(ax: Axes, axis: Axis, name: str) -> None:
    panel(ax, **{name: axis.label})
    _words(ax, axis, name)


def _words(ax: Axes, axis: Axis, name: str) -> None:
    """Label the ticks with words, or make the axis logarithmic if its numbers differ by more than a factor `MANY`."""
    if not axis.words and _goes_over_many(float(axis.places.min()), float(axis.places.max())):
        (ax.set_xscale if name == "x" else ax.set_yscale)("log")
    if axis.words:
        numbers = range(len(axis.words))
        (ax.set_xticks if name == "x" else ax.set_yticks)(list(numbers), [word[:24] for word in axis.words])


def _pad(drawing: Sheet, places: FloatArray) -> None:
    low, high = float(places.min()), float(places.max())
    if high > low:
        drawing.panels[0, 0].set_xlim(low - 0.02 * (high - low), high + 0.02 * (high - low))


def _frame(ax: Axes, surface: Surface, y: FloatArray, missing: FloatArray) -> None:
    """Set the range of the y axis; draw crosses for variants without a number, and a line at 1 for growth factors."""
    _range(ax, y, grows=surface.grows)
    crosses = ax.get_xaxis_transform()
    ax.plot(missing, np.full(len(missing), 0.03), ls="", marker="x", ms=3.5, color=BAD, transform=crosses)
    if surface.grows:
        ax.axhline(1.0, color=NOTE, lw=0.8, ls=(0.0, (4.0, 3.0)))


def _range(ax: Axes, values: FloatArray, *, grows: bool) -> None:
    """Set the range of the y axis so that it contains all values but a few outliers.

    Growth factors that differ by more than a factor `MANY` have a logarithmic axis for all values.
    """
    finite = values[np.isfinite(values)]
    if not finite.size:
        ax.text(0.5, 0.5, "no number", transform=ax.transAxes, ha="center", color=NOTE)
        return
    low, high = float(finite.min()), float(finite.max())
    if grows and _goes_over_many(low, high):
        ax.set_yscale("log")
        ax.set_ylim(low / (high / low) ** 0.06, high * (high / low) ** 0.06)
        return
    low, high = _colours(values)
    room = max(0.06 * (high - low), ROUNDING * abs(high)) or 1.0
    ax.set_ylim(low - room, high + room)


def _goes_over_many(low: float, high: float) -> bool:
    """Return whether numbers from `low` to `high` need a logarithmic scale."""
    return low > 0.0 and high > MANY * low


def _shades(surface: Surface) -> Normalize:
    """Return the colour scale, logarithmic for growth factors that differ by more than a factor `MANY`."""
    from matplotlib.colors import LogNorm, Normalize

    finite = surface.values[np.isfinite(surface.values)]
    if surface.grows and finite.size and _goes_over_many(float(finite.min()), float(finite.max())):
        return LogNorm(float(finite.min()), float(finite.max()))
    return Normalize(*_colours(surface.values))


def _ends(shades: Normalize) -> tuple[float, float]:
    assert shades.vmin is not None and shades.vmax is not None
    return shades.vmin, shades.vmax


def _colours(values: FloatArray) -> tuple[float, float]:
    finite = values[np.isfinite(values)]
    if not finite.size:
        return 0.0, 1.0
    low, high = float(finite.min()), float(finite.max())
    inner = np.quantile(finite, [SPREAD, 1.0 - SPREAD])
    if high - low > 4.0 * (inner[1] - inner[0]) > 0.0:
        low, high = max(low, float(2.0 * inner[0] - inner[1])), float(2.0 * inner[1] - inner[0])
    return (low, high) if high > low else (low - 0.5, high + 0.5)


def _mark(label: str, **look: Any) -> Any:
    """Return a handle for a legend."""
    from matplotlib.lines import Line2D

    return Line2D([], [], label=label, **look)


def _bad_mark() -> Any:
    return _mark(CROSSES, ls="", marker="x", ms=4.0, color=BAD)


def _rest(values: Mapping[str, Any]) -> str:
    """Return a text with the values of the keys beyond the third, which have no axis and no maps."""
    keys = list(values)[3:]
    texts = []
    for k, key in enumerate(keys, start=3):
        line = _line(values[key], k)
        texts.append(f"{_short(key)} = {plain(_number(line[len(line) // 2]))}")
    return f"; {', '.join(texts)}" if texts else ""


def _short(key: str) -> str:
    return label_of(key).split(" [")[0]


def _number(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)
