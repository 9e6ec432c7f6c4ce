"""The common style of all figures: widths, fonts, colours, panels and positions of text.

    with look("column"):
        sheet = figure([1.2, 0.9], width="column")          # two panels, heights in inches at screen width
        sheet.panels[0, 0].plot(x, y, color=EXTERNAL, label="external")
        panel(sheet.panels[0, 0], x="time [s]", y="force [N]")
        sheet.legend(0)                                      # above the row, outside the panel
        sheet.title("A scene")
    save(sheet, "figure.svg")

One colour is reserved for the external force, another for the internal force; displacements, gains and limits have the
colour of the force to which they belong. Each finger has a colour and a marker. The colours can be distinguished by
readers with colour vision deficiency.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from importlib import import_module
from os import PathLike, fspath
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Literal

from graspfx.errors import InputError, MissingPackageError
from graspfx.show.sheet import Sheet, Width

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

WidthName = Literal["screen", "page", "column"]


WIDTHS: dict[WidthName, Width] = {
    "screen": Width(6.4, 9.0, 1.0, 1.0, 150),
    "page": Width(7.2, 8.0, 0.85, 0.85, 300),  # two columns of a journal's page
    "column": Width(3.5, 7.0, 0.72, 0.7, 300),  # 88 mm
}
SCREENS = (6.4, 8.6, 10.0)  # widths for one, two and three columns of panels [inches]
FURTHER = 3.2  # additional width for each further column [inches]


def width_of(name: str, columns: int = 1) -> Width:
    """Return a width by its name; the width "screen" grows with the number of columns of panels.

    Raises:
        InputError: If no width has the given name.
    """
    if name not in list(WIDTHS):
        raise InputError("width", name, f"one of {', '.join(WIDTHS)}")
    if name != "screen":
        return WIDTHS[name]
    screen, last = WIDTHS["screen"], len(SCREENS)
    inches = SCREENS[columns - 1] if columns <= last else SCREENS[-1] + FURTHER * (columns - last)
    return Width(inches, screen.text, screen.share, screen.weight, screen.dpi)


EXTERNAL = "#d55e00"
"""Colour reserved for the external force."""
INTERNAL = "#0072b2"
"""Colour reserved for the internal force."""
FINGERS = ("#1b9e77", "#882255", "#00a5b5", "#7a5230", "#332288")
"""Colours of the fingers; finger i has colour i modulo the number of colours."""
MARKERS = ("o", "s", "^", "D", "v", "P", "X")
"""Markers of the fingers; finger i has marker i modulo the number of markers.

The numbers of markers and colours have no common factor, so that the first 35 fingers have different combinations.
"""
CONTACTS = {
    "free": "#b8b8b8",
    "touch": "#009e73",
    "stick": "#009e73",
    "slide": "#f0e442",
    "limit": "#cc79a7",
}
"""Colours of fingertips by the state of the contact; the state "touch" is a contact without friction."""
INK = "#1a1a1a"
"""Colour of axes and text."""
NOTE = "#444444"
"""Colour of notes below a figure."""
GRID = "#e4e4e4"
"""Colour of grid lines."""
NEUTRAL = "#7f7f7f"
"""Colour of curves that are neither forces nor fingers."""
PALE = "#b8b8b8"
"""Colour of curves and marks in the background."""
LINE = 1.3
"""Width of a curve [points]."""
THICK = 2.4
"""Width of an emphasised curve [points]."""
HAIR = 0.7
"""Width of a reference line [points]."""
BAND = 0.22
"""Opacity of the band between the smallest and the largest value of several fingers."""
AXES = ("-", (0.0, (5.0, 2.0)), (0.0, (1.2, 1.4)))
"""Line styles of the components of a quantity along or about x, y and z."""
FORMATS = ("png", "svg", "pdf")
COLOURS = 256
INLINE = 110  # resolution in a notebook [dpi]
UNDATED = {"svg": {"Date": None, "Creator": None}, "pdf": {"CreationDate": None}}


__all__ = [  # noqa: RUF022 (functions, then colours and other choices)
    "look",
    "figure",
    "panel",
    "save",
    "Sheet",
    "EXTERNAL",
    "INTERNAL",
    "FINGERS",
    "MARKERS",
    "CONTACTS",
    "INK",
    "NOTE",
    "GRID",
    "NEUTRAL",
    "PALE",
    "LINE",
    "THICK",
    "HAIR",
    "BAND",
    "AXES",
]


def __dir__() -> list[str]:
    return sorted(__all__)


class InlineSheet(Sheet):
    """A sheet that a notebook displays if it is the result of a cell."""

    def _repr_png_(self) -> bytes:
        return pixels(arranged(self), INLINE)


class Drawing:
    """A figure that a notebook displays if it is the result of a cell.

    Args:
        sheet: Panels and layout of the figure.
        notes: Messages about parts that are not drawn.
    """

    def __init__(self, sheet: Sheet, notes: Sequence[str] = ()) -> None:
        self.sheet, self.notes = sheet, tuple(notes)

    @property
    def figure(self) -> Figure:
        """Matplotlib's figure."""
        return arranged(self.sheet)

    def save(self, path: str | PathLike[str], form: str = "", dpi: int = 0) -> Path:
        """Write the figure to a file and return its path.

        Args:
            path: Path of the file.
            form: Format, such as "png", "svg" or "pdf"; by default the suffix of the path.
            dpi: Resolution [dpi]; by default the resolution for the figure's width.

        Raises:
            InputError: If the format is unknown, or the folder does not exist.
        """
        return save(self.sheet, path, form, dpi)

    def __repr__(self) -> str:
        width, height = self.figure.get_size_inches()
        return f"<Drawing of {width:.1f} x {height:.1f} inches; .save(path) writes it, .figure is matplotlib's>"

    def _repr_png_(self) -> bytes:
        return pixels(self.figure, INLINE)


def require_matplotlib() -> ModuleType:
    """Import matplotlib.

    Raises:
        MissingPackageError: If matplotlib is not installed.
    """
    try:
        return import_module("matplotlib")
    except ModuleNotFoundError as error:
        raise MissingPackageError("matplotlib", "a figure", "pip install matplotlib") from error


@contextmanager
def look(width: str = "screen") -> Iterator[Width]:
    """Apply the style within the `with` block; the user's settings of matplotlib are ignored.

    Raises:
        InputError: If the width is unknown.
        MissingPackageError: If matplotlib is not installed.
    """
    mpl = require_matplotlib()
    size = width_of(width)
    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update({
            "font.family": ["DejaVu Sans", "sans-serif"],  # the font that comes with matplotlib
            "font.size": size.text, "axes.titlesize": size.title, "axes.labelsize": size.text,
            "xtick.labelsize": size.text, "ytick.labelsize": size.text, "legend.fontsize": size.text,
            "legend.frameon": False, "legend.borderaxespad": 0.0, "legend.borderpad": 0.0, "legend.handlelength": 2.6,
            "axes.edgecolor": INK, "axes.labelcolor": INK, "text.color": INK, "xtick.color": INK, "ytick.color": INK,
            "axes.linewidth": 0.8, "axes.spines.top": False, "axes.spines.right": False, "axes.axisbelow": True,
            "axes.grid": True, "grid.color": GRID, "grid.linewidth": 0.6, "axes.xmargin": 0.0,
            "axes.formatter.useoffset": False, "axes.formatter.limits": (-4, 5), "axes.labelpad": 3.0,
            "xtick.major.size": 3.0, "ytick.major.size": 3.0, "xtick.minor.size": 1.5, "ytick.minor.size": 1.5,
            "lines.linewidth": size.weight * LINE, "lines.markersize": 4.5 * size.weight,
            "lines.dash_capstyle": "butt", "hatch.linewidth": 0.5,
            "svg.fonttype": "none", "pdf.fonttype": 42,  # text stays text
            "svg.hashsalt": "graspfx",  # for reproducible bytes
        })  # fmt: skip
        yield size


def figure(
    heights: list[float],
    columns: int = 1,
    *,
    width: str = "screen",
    share_x: bool = True,
    share_y: bool = True,
    widths: list[float] | None = None,
    bar: bool = False,
    inches: float = 0.0,
) -> Sheet:
    """Make a figure with panels in rows and columns.

    A notebook displays the figure if it is the result of a cell.

    Args:
        heights: Height of the panels of each row on a screen [inches]; on paper, the panels are lower.
        columns: Number of columns of panels.
        width: "screen", "page" (7.2 inches) or "column" (3.5 inches).
        share_x: Whether all panels share the x axis; its tick labels are below the last row.
        share_y: Whether the panels of a row share the y axis; its tick labels are on the left.
        widths: Relative widths of the columns; by default all columns have the same width.
        bar: Whether to add axes for a colour bar on the right (`sheet.bar`).
        inches: Width of the figure [inches] that replaces that of `width`; 0 for the width that `width` names.

    Raises:
        InputError: If the width is unknown.
    """
    paper = width_of(width, columns)
    paper = replace(paper, inches=inches) if inches else paper
    return InlineSheet(heights, columns, paper, share_x=share_x, share_y=share_y, widths=widths, bar=bar)


def panel(axes: Axes, *, x: str = "", y: str = "", title: str = "") -> None:
    """Set the labels of a panel's axes, which should include units, and the title above the panel."""
    if x:
        axes.set_xlabel(x)
    if y:
        axes.set_ylabel(y)
    if title:
        axes.set_title(title, loc="left", fontsize=axes.xaxis.label.get_fontsize(), pad=3.0)


def save(drawing: Sheet | Figure, path: str | PathLike[str], form: str = "", dpi: int = 0) -> Path:
    """Write a figure to a file and return its path.

    Files of equal figures are identical: they contain no date and no random identifiers.

    Args:
        drawing: Result of `figure`, or a figure of matplotlib.
        path: Path of the file.
        form: Format that matplotlib supports, such as "png", "svg" or "pdf"; by default the suffix of the path.
        dpi: Resolution [dpi]; by default the resolution for the figure's width.

    Raises:
        InputError: If the format is unknown, or the folder does not exist.
    """
    target = Path(fspath(path))
    if not target.parent.is_dir():
        raise InputError(
            "path", fspath(path), "a file in an existing folder", f"create the folder {target.parent} first"
        )
    form = form or target.suffix[1:].lower()
    sheet = drawing if isinstance(drawing, Sheet) else None
    dpi = dpi or (sheet.width if sheet is not None else WIDTHS["screen"]).dpi
    with look():
        require_form(form, path)
        picture = arranged(drawing)
        if form == "png":
            target.write_bytes(pixels(picture, dpi))
        else:
            picture.savefig(target, format=form, dpi=dpi, metadata=UNDATED.get(form))
    return target


def arranged(drawing: Sheet | Figure) -> Figure:
    """Compute the layout of a sheet, if this has not been done, and return matplotlib's figure."""
    if not isinstance(drawing, Sheet):
        return drawing
    if not drawing.arranged:
        with look():
            drawing.arrange()
    return drawing.figure


def pixels(picture: Figure, dpi: int) -> bytes:
    """Return a figure as the bytes of a PNG file with up to 256 colours, half the size of a file in full colour."""
    from io import BytesIO

    from PIL import Image

    raw, file = BytesIO(), BytesIO()
    with look():
        picture.savefig(raw, format="rgba", dpi=dpi)
    width, height = (int(inches * dpi) for inches in picture.get_size_inches())
    image = Image.frombuffer("RGBA", (width, height), raw.getvalue(), "raw", "RGBA", 0, 1).convert("RGB")
    palette = image.quantize(COLOURS, Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE)
    palette.save(file, format="PNG", dpi=(dpi, dpi))
    return file.getvalue()


def require_form(form: str, path: str | PathLike[str]) -> None:
    """Raise an error if matplotlib does not support a format.

    Raises:
        InputError: If the format is unknown; the error shows the path.
        MissingPackageError: If matplotlib is not installed.
    """
    require_matplotlib()
    from matplotlib.backend_bases import FigureCanvasBase

    forms = FigureCanvasBase.get_supported_filetypes()
    if form not in forms:
        raise InputError("path", fspath(path), f"a file that ends in .{', .'.join(sorted(forms))}")


def plain(text: str) -> str:
    """Escape dollar signs, which matplotlib would interpret as the start of a formula."""
    return text.replace("$", r"\$")


Dashes = tuple[float, tuple[float, ...]]  # offset, then on and off lengths, in line widths

ON, OFF = 5.0, 3.0


@dataclass(frozen=True)
class Stroke:
    """Style of a line.

    Attributes:
        colour: Colour of the line and its markers.
        width: Width of the line [points].
        dashes: Matplotlib's name of a line style; or offset, and lengths of dashes and gaps [line widths].
        marker: Matplotlib's name of a marker; empty for a line without markers.
        place: Position of the first marker, as a fraction of the distance between markers.
    """

    colour: str
    width: float = LINE
    dashes: str | Dashes = "-"
    marker: str = ""
    place: float = 0.0


OBJECT = Stroke(INK, THICK)  # wide enough to show on both sides of a finger's line
FINGERS_TOGETHER = Stroke(NEUTRAL, LINE, (0.0, (ON, OFF)))
SQUEEZE = Stroke(INTERNAL, 2.6)  # wide enough to show beneath a push of the same size
PUSHES = tuple(Stroke(EXTERNAL, LINE, dashes) for dashes in AXES)
MARGIN = Stroke(INK, LINE)
TURNS = tuple(Stroke(INK, LINE, dashes) for dashes in AXES)


def finger_strokes(groups: Iterable[Sequence[str]]) -> dict[str, Stroke]:
    """Return a line style with colour, marker and dashes for each finger name.

    In each column, the dashes of every second finger are offset, so that coinciding lines of neighbouring fingers are
    both visible.

    Args:
        groups: Names of the fingers in each column of a figure; a name in several columns has one style.
    """
    half: dict[str, int] = {}
    for names in groups:
        for i, name in enumerate(names):
            half.setdefault(name, i % 2)
    return {
        name: Stroke(
            FINGERS[k % len(FINGERS)],
            LINE,
            (half[name] * (ON + OFF) / 2.0, (ON, OFF)),
            MARKERS[k % len(MARKERS)],
            (k + 0.5) / len(half),
        )
        for k, name in enumerate(half)
    }
