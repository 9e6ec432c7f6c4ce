"""Widths of figures on paper and on screen, and the size of type that is legible there."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from graspfx.errors import InputError

WidthName = Literal["screen", "page", "column"]


@dataclass(frozen=True)
class Width:
    """A size on paper or screen, and the type that is legible there at its own size.

    Attributes:
        inches: of the figure; on a screen it grows with the number of columns.
        text: size of labels, names and numbers [points].
        share: of a panel's height on a screen.
        weight: share of the width of lines, and of markers, on a screen.
        dpi: of a picture in pixels.
    """

    inches: float
    text: float
    share: float
    weight: float
    dpi: int

    @property
    def title(self) -> float:
        """Size of titles [points]."""
        return self.text + 1.0


WIDTHS: dict[WidthName, Width] = {
    "screen": Width(6.4, 9.0, 1.0, 1.0, 150),
    "page": Width(7.2, 8.0, 0.85, 0.85, 300),  # both columns of a journal's page
    "column": Width(3.5, 7.0, 0.72, 0.7, 300),  # 88 mm
}
SCREENS = (6.4, 8.6, 10.0)  # [inches], with one, two and three columns of panels
FURTHER = 3.2  # with each more


def width_of(name: str, columns: int = 1) -> Width:
    """Look a width up by its name.

    Raises:
        InputError: no such width.
    """
    if name not in WIDTHS:
        raise InputError("width", name, f"one of {', '.join(WIDTHS)}")
    if name != "screen":
        return WIDTHS[name]
    screen, last = WIDTHS["screen"], len(SCREENS)
    inches = SCREENS[columns - 1] if columns <= last else SCREENS[-1] + FURTHER * (columns - last)
    return Width(inches, screen.text, screen.share, screen.weight, screen.dpi)
