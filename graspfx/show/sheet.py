"""Layout of a figure on a grid of panels: titles, legends and labels have measured strips outside the panels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.legend import Legend
    from matplotlib.transforms import Bbox

EDGE = 0.06  # margin of the paper [inches]
GAP = 0.11  # distance between panels [inches]
LEAD = 0.05  # gap between a strip and its panel [inches]
BAR = 0.13  # width of a colour bar [inches]
WIDE = 1.2  # widest left margin at which titles and legends begin at the panels [inches]
MOST_LINES = 3  # largest number of lines of a title
STEPS = (1.0, 2.0, 2.5, 5.0, 10.0)  # possible distances of ticks along an ordinate, times a power of ten
STEP = 2.0  # step by which labels are moved apart [points]
PITCH = 1.32  # line spacing, in font sizes


@dataclass(frozen=True)
class Width:
    """Width of a figure on paper or screen, and sizes of text and lines for this width.

    Attributes:
        inches: Width of the figure [inches]; on a screen, the width of a figure with one column of panels.
        text: Font size of labels, names and numbers [points].
        share: Ratio of panel heights to those on a screen.
        weight: Ratio of line widths and marker sizes to those on a screen.
        dpi: Resolution of raster images [dpi].
    """

    inches: float
    text: float
    share: float
    weight: float
    dpi: int

    @property
    def title(self) -> float:
        """Font size of titles [points]."""
        return self.text + 1.0


class Sheet:
    """Figure of panels in rows and columns, with a strip above each row for a letter and a legend.

    Attributes:
        figure: Matplotlib's figure.
        panels: Matplotlib's axes, array (rows, columns).
        bar: Axes for a colour bar; None if the figure has no colour bar.
        width: Width of the figure, and sizes of text and lines.
        arranged: Whether `arrange` has computed the layout.
        shares_x: Whether all panels share the x axis.
    """

    def __init__(
        self,
        heights: Sequence[float],
        columns: int,
        width: Width,
        *,
        share_x: bool,
        share_y: bool,
        widths: Sequence[float] | None,
        bar: bool,
    ) -> None:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
        from matplotlib.ticker import MaxNLocator

        self.figure: Figure = Figure(figsize=(width.inches, 4.0), dpi=width.dpi)
        FigureCanvasAgg(self.figure)
        self.width = width
        self.heights = [width.share * height for height in heights]
        self._shares = np.array(widths or [1.0] * columns) / sum(widths or [1.0] * columns)
        self._share = share_x, share_y
        self._title = ""
        self._titles = [""] * columns
        self._letters = [""] * len(heights)
        self._legends: dict[int, list[Artist]] = {}
        self._strips: list[Any] = []
        self.arranged, self.shares_x = False, share_x
        self.panels: NDArray[Any] = np.empty((len(heights), columns), dtype=object)
        for r in range(len(heights)):
            for c in range(columns):
                self.panels[r, c] = self.figure.add_axes(
                    (0.2, 0.2, 0.6, 0.6),
                    label=f"{r},{c}",
                    sharex=self.panels[0, 0] if share_x and (r or c) else None,
                    sharey=self.panels[r, 0] if share_y and c else None,
                )
                if not (share_y and c):
                    self.panels[r, c].yaxis.set_major_locator(MaxNLocator("auto", steps=STEPS, min_n_ticks=3))
                if share_x and r + 1 < len(heights):
                    self.panels[r, c].tick_params(labelbottom=False)
                if share_y and c:
                    self.panels[r, c].tick_params(labelleft=False)
        self.bar: Axes | None = self.figure.add_axes((0.9, 0.2, 0.05, 0.6), label="bar") if bar else None

    def title(self, text: str, column: int | None = None) -> None:
        """Set the title above a column, or above the figure if `column` is None; long titles are wrapped."""
        if column is None:
            self._title = text
        else:
            self._titles[column] = text

    def letters(self, rows: Sequence[int] | None = None) -> None:
        """Label the rows with the given indices, by default all rows, (a), (b), ...; a single row is not labelled."""
        lettered = list(range(len(self.heights))) if rows is None else list(rows)
        if len(lettered) > 1:
            for letter, row in zip("abcdefghijklmnopqrstuvwxyz", lettered, strict=False):
                self._letters[row] = f"({letter})"

    def legend(self, row: int, handles: Sequence[Artist] | None = None) -> None:
        """Add a legend above a row, with the given handles or, by default, one handle for each label in the row."""
        if handles is None:
            entries: dict[str, Artist] = {}
            for axes in self.panels[row]:
                for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
                    entries.setdefault(label, handle)
            handles = list(entries.values())
        self._legends[row] = list(handles)

    def arrange(self) -> Figure:
        """Measure all texts, place the panels and texts, and set the size of the figure."""
        for each in self._strips:
            each.remove()
        self._strips = []
        self.figure.align_ylabels(list(self.panels[:, 0]))
        rows = len(self.heights)
        left, right, between = 0.75, self.width.inches - 0.3, GAP
        above, below, head = [0.3] * rows, [0.3] * rows, 0.3
        for _ in range(2 if any(axes.texts for axes in self.panels.ravel()) else 1):  # texts may move with their panel
            self._place(left, right, above, below, head, between)
            boxes = [[self._overhang(axes) for axes in row] for row in self.panels]
            left = EDGE + max(row[0][0] for row in boxes)
            right = self.width.inches - EDGE - max(row[-1][2] for row in boxes)
            if self.bar is not None:
                right -= BAR + 2.0 * GAP + self._overhang(self.bar)[2] - max(row[-1][2] for row in boxes)
            between = max([GAP, *(GAP + row[c][0] + row[c - 1][2] for row in boxes for c in range(1, len(row)))])
            below = [GAP + max(box[1] for box in row) for row in boxes]
            below[-1] = EDGE + max(box[1] for box in boxes[-1])
            titled = [max(box[3] for box in row) for row in boxes]
            wide = [share * (right - left - between * (len(self._shares) - 1)) for share in self._shares]
        start = left if left < WIDE or any(self._letters) else EDGE  # long line names: strips begin at the edge
        head, heads = self._write(left, right, wide, between, start)
        above = [strip[0] + title for strip, title in zip(heads, titled, strict=True)]
        tall = self._place(left, right, above, below, head, between)
        self._set(heads, titled, tall, start)
        for axes in self.panels.ravel():
            _part(axes)
        self.arranged = True
        return self.figure

    def _place(
        self, left: float, right: float, above: Sequence[float], below: Sequence[float], head: float, between: float
    ) -> float:
        """Set the positions of all panels; return the figure's height [inches].

        Args:
            left, right: Left end of the first and right end of the last column [inches].
            above, below: Space above and below the panels of each row [inches].
            head: Height of the titles at the top of the figure [inches].
            between: Distance between columns [inches].
        """
        width = self.width.inches
        tall = head + sum(above) + sum(below) + sum(self.heights)
        self.figure.set_size_inches(width, tall)
        y = tall - head
        across = right - left - between * (len(self._shares) - 1)
        for row, height, over, under in zip(self.panels, self.heights, above, below, strict=True):
            y -= over + height
            x = left
            for axes, share in zip(row, self._shares, strict=True):
                axes.set_position((x / width, y / tall, share * across / width, height / tall))
                x += share * across + between
            y -= under
        if self.bar is not None:
            bottom = sum(below[-1:])
            top = tall - head - above[0]
            self.bar.set_position((
                (right + 2.0 * GAP) / width, bottom / tall, BAR / width, (top - bottom) / tall
            ))  # fmt: skip
        return tall

    def _overhang(self, axes: Axes) -> tuple[float, float, float, float]:
        """Measure how far a panel's labels extend beyond its frame: left, below, right, above [inches]."""
        box, frame = axes.get_tightbbox(), axes.get_window_extent()
        assert box is not None
        dpi = self.figure.dpi
        sides = (frame.x0 - box.x0, frame.y0 - box.y0, box.x1 - frame.x1, box.y1 - frame.y1)
        return tuple(max(0.0, side / dpi) for side in sides)

    def _write(
        self, left: float, right: float, wide: Sequence[float], between: float, start: float
    ) -> tuple[float, list[tuple[float, Legend | None]]]:
        """Draw titles and legends.

        Returns:
            Height of the titles [inches]; and, for each row, height of the strip [inches] and legend or None.
        """
        size, inch = self.width.title, self.figure.dpi_scale_trans
        pitch = PITCH * size / 72.0
        whole = self._folded(self._title, self.width.inches - start - EDGE, size)
        each = [self._folded(text, room, size) for text, room in zip(self._titles, wide, strict=True)]
        lines = max(len(text) for text in each)
        head = EDGE + pitch * (len(whole) + lines) + (LEAD if whole or lines else 0.0)
        x = left
        marks = [(start, 0.0, whole)]
        for text, room in zip(each, wide, strict=True):
            marks.append((x, pitch * len(whole), text))
            x += room + between
        for x, down, text in marks:
            for k, line in enumerate(text):
                self._strips.append(self.figure.text(
                    x, -EDGE - down - pitch * k, line, transform=inch, fontweight="bold", fontsize=size, va="top"
                ))  # fmt: skip
        heads = [self._strip(r, start, right) for r in range(len(self.heights))]
        return head, heads

    def _strip(self, row: int, left: float, right: float) -> tuple[float, Legend | None]:
        """Make a row's legend with as many columns as fit.

        Returns:
            Height of the strip above the row [inches], and the legend, or None if the row has no legend.
        """
        handles = self._legends.get(row, [])
        plain = PITCH * self.width.text / 72.0 + LEAD if self._letters[row] else 0.0
        room = right - left
        for columns in range(len(handles), 0, -1):
            down = [handle for k in range(columns) for handle in handles[k::columns]]  # so that rows are read in order
            legend = self.figure.legend(
                handles=down, loc="upper left", bbox_to_anchor=(left, 0.0), ncols=columns, columnspacing=1.4,
                bbox_transform=self.figure.dpi_scale_trans, handletextpad=0.5, labelspacing=0.25,
                fontsize=self.width.text,
            )  # fmt: skip
            box = legend.get_window_extent()
            if box.width / self.figure.dpi <= room or columns == 1:
                self._strips.append(legend)
                return max(plain, box.height / self.figure.dpi + LEAD), legend
            legend.remove()
        return plain, None

    def _set(
        self, heads: Sequence[tuple[float, Legend | None]], titled: Sequence[float], tall: float, left: float
    ) -> None:
        """Set the positions of titles at the top of the figure, and of legends and letters above their rows."""
        from matplotlib.text import Text

        for each in self._strips:
            if isinstance(each, Text):
                each.set_y(tall + each.get_position()[1])
        for row, (height, legend), title, letter in zip(self.panels, heads, titled, self._letters, strict=True):
            top = row[0].get_position().y1 * tall + title + height
            if legend is not None:
                legend.set_bbox_to_anchor((left, top), transform=self.figure.dpi_scale_trans)
            if letter:
                self._strips.append(self.figure.text(
                    EDGE, top, letter, transform=self.figure.dpi_scale_trans, fontweight="bold", va="top",
                    fontsize=self.width.text,
                ))  # fmt: skip

    def _folded(self, text: str, room: float, size: float) -> list[str]:
        """Wrap a text to the width `room` [inches] at font size `size` [points].

        After `MOST_LINES` lines, the rest of the text is replaced by an ellipsis.
        """
        lines: list[str] = []
        for paragraph in filter(None, text.split("\n")):
            full = ""
            for word in paragraph.split(" "):
                for piece in self._pieces(word, room, size):
                    joined = f"{full} {piece}" if full else piece
                    if full and self._length(joined, size) > room:
                        lines.append(full)
                        joined = piece
                    full = joined
            lines.append(full)
        if len(lines) > MOST_LINES:
            lines = [*lines[: MOST_LINES - 1], f"{lines[MOST_LINES - 1].rstrip()} …"]
            while self._length(lines[-1], size) > room and " " in lines[-1]:
                lines[-1] = f"{lines[-1][:-1].rstrip().rpartition(' ')[0]} …"
        return lines

    def _pieces(self, word: str, room: float, size: float) -> list[str]:
        """Split a word that is wider than `room` [inches], such as a path, unless the word contains a formula."""
        if "$" in word or self._length(word, size) <= room:
            return [word]
        cut = next(k for k in range(len(word), 0, -1) if k == 1 or self._length(word[:k], size) <= room)
        return [word[:cut], *self._pieces(word[cut:], room, size)] if cut < len(word) else [word]

    def _length(self, text: str, size: float) -> float:
        mark = self.figure.text(0.0, 0.0, text, fontsize=size, fontweight="bold")
        length = mark.get_window_extent().width / self.figure.dpi
        mark.remove()
        return float(length)


def _part(axes: Axes) -> None:
    """Move the labels of data points vertically, away from the points, until no labels overlap."""
    from matplotlib.text import Annotation

    labels = [text for text in axes.texts if isinstance(text, Annotation) and text.anncoords == "offset points"]
    boxes: list[Bbox] = []
    for step in (STEP, -STEP):
        way = [label for label in labels if (label.xyann[1] >= 0.0) == (step > 0.0)]
        for label in sorted(way, key=lambda each: each.get_window_extent().y0 * step):
            while any(label.get_window_extent().overlaps(box) for box in boxes):
                x, y = label.xyann
                label.xyann = (x, y + step)
            boxes.append(label.get_window_extent())
