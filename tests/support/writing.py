"""Words of a figure, and where they are: what may not overlap, leave the paper or cover data."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from matplotlib.axes import Axes
from matplotlib.axis import XAxis, YAxis
from matplotlib.figure import Figure
from matplotlib.text import Text
from matplotlib.transforms import Bbox

TOUCH = 1.0  # [pixels] by which boxes of letters may meet


def texts(picture: Figure) -> Iterator[tuple[str, Bbox]]:
    """Yield every text that is seen, with its box; the figure is drawn."""
    hidden = {id(text) for axes in picture.axes for text in _unseen_numbers(axes)}
    for text in picture.findobj(Text):
        assert isinstance(text, Text)
        if text.get_text().strip() and text.get_visible() and id(text) not in hidden:
            yield text.get_text(), text.get_window_extent()


def _unseen_numbers(axes: Axes) -> Iterator[Text]:
    """Numbers of ticks beyond an axis' ends, and of an axis that is not drawn."""
    for axis, ends in ((axes.xaxis, axes.get_xlim()), (axes.yaxis, axes.get_ylim())):
        assert isinstance(axis, XAxis | YAxis)
        if not axes.axison:
            yield axis.label
        for tick in (*axis.get_major_ticks(), *axis.get_minor_ticks()):
            if not axes.axison or not min(ends) <= tick.get_loc() <= max(ends):
                yield from (tick.label1, tick.label2)


def faults(picture: Figure) -> list[str]:
    """List words outside of the paper, over other words, or over a panel that they do not belong to."""
    picture.canvas.draw()
    page, all_texts = picture.bbox, list(texts(picture))
    found = [
        f"{text!r} leaves the paper"
        for text, box in all_texts
        if box.x0 < page.x0 - TOUCH or box.x1 > page.x1 + TOUCH or box.y0 < page.y0 - TOUCH or box.y1 > page.y1 + TOUCH
    ]
    for k, (text, box) in enumerate(all_texts):
        found += [f"{text!r} over {other!r}" for other, second in all_texts[:k] if _meet(box, second)]
    for legend in legends(picture):
        box = legend.get_window_extent()
        found += ["a legend over data" for axes in picture.axes if axes.axison and _meet(box, axes.get_window_extent())]
    for axes in picture.axes:
        found += [
            f"{text.get_text()!r} over data"
            for text in picture.texts
            if _meet(text.get_window_extent(), axes.get_window_extent())
        ]
    return found


def legends(picture: Figure) -> list[Any]:
    return [*picture.legends, *(axes.get_legend() for axes in picture.axes if axes.get_legend())]


def smallest(picture: Figure) -> float:
    """Smallest size of type [points]."""
    return min(float(text.get_fontsize()) for text in picture.findobj(Text) if text.get_text())


def _meet(a: Bbox, b: Bbox) -> bool:
    return min(a.x1, b.x1) - max(a.x0, b.x0) > TOUCH and min(a.y1, b.y1) - max(a.y0, b.y0) > TOUCH
