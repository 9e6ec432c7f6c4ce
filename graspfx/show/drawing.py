"""Figures of recordings in Python, which notebooks display and which can be saved."""

from __future__ import annotations

from collections.abc import Sequence
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING

from graspfx.show import style

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from graspfx.recording.record import Recording
    from graspfx.show.picture.portrait import Forces
    from graspfx.show.sheet import Sheet


class Drawing:
    """A figure that notebooks display without pyplot. `figure` is matplotlib's figure, and `save` writes it.

    Args:
        sheet: Panels of the figure.
        notes: Reasons for omitted parts.
    """

    def __init__(self, sheet: Sheet, notes: Sequence[str] = ()) -> None:
        self.sheet, self.notes = sheet, tuple(notes)

    @property
    def figure(self) -> Figure:
        """Matplotlib's figure."""
        return style.arranged(self.sheet)

    def save(self, path: str | PathLike[str], form: str = "", dpi: int = 0) -> Path:
        """Write the figure. The path's suffix selects the format, unless `form` is "png", "svg" or "pdf".

        Raises:
            InputError: If the suffix has no known format.
        """
        return style.save(self.sheet, path, form, dpi)

    def __repr__(self) -> str:
        width, height = self.figure.get_size_inches()
        return f"<Drawing of {width:.1f} x {height:.1f} inches; .save(path) writes it, .figure is matplotlib's>"

    def _repr_png_(self) -> bytes:
        return style.pixels(self.figure, style.INLINE)


def picture(
    recording: Recording,
    time: float | None = None,
    *,
    view: tuple[float, float] | None = None,
    forces: Forces = "two",
    width: str = "screen",
) -> Drawing:
    """Draw one instant of a recording; see `graspfx.show.picture.portrait.picture`."""
    from graspfx.show.picture.portrait import portrait

    return Drawing(*portrait(recording, time, view=view, forces=forces, width=width))


def plot(
    recording: Recording, *others: Recording, titles: Sequence[str] | None = None, width: str = "screen"
) -> Drawing:
    """Draw a recording over time, side by side with any others; see `graspfx.show.run_figures.sheet`."""
    from graspfx.show.run_figures import sheet

    return Drawing(sheet([recording, *others], titles, width=width))
