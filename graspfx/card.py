"""Short descriptions of public objects, for their `repr` and for tables in notebooks."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import NamedTuple

WIDTH = 110  # characters per line
MOST_LINES = 36
MOST_LETTERS = 1900
MOST_NAMES = 6  # names listed in a row
MOST_SETTING = 60  # letters of a list or table that is shown in full


class Card(NamedTuple):
    """Description of an object.

    Attributes:
        title: First line.
        rows: Pairs of a label and a text; a row with an empty text is not shown.
        calls: Useful attributes and methods of the object, as text.
    """

    title: str
    rows: Sequence[tuple[str, str]] = ()
    calls: str = ""

    def __str__(self) -> str:
        lines = [self.title]
        rows = [*self._rows()]
        room = max((len(label) for label, _ in rows), default=0)
        for label, text in rows:
            for k, line in enumerate(_lines(text, WIDTH - room - 4)):
                lines.append(f"  {label if k == 0 else '':<{room}}  {line}".rstrip())
        return _fitting(lines)

    def html(self) -> str:
        """Format the card as an HTML table; every text is escaped."""
        from html import escape

        cell = 'style="text-align: left; vertical-align: top; padding: 0.1em 0.8em 0.1em 0"'
        head = cell.replace("padding", "font-weight: normal; opacity: 0.65; white-space: nowrap; padding")
        wide = cell.replace("padding", "white-space: pre-wrap; padding")
        body = []
        for label, text in self._rows():
            lines = text.split("\n")
            if len(lines) > MOST_LINES:
                lines = [*lines[: MOST_LINES - 1], "..."]
            inside = "<br>".join(escape(line) for line in lines)
            body.append(f"<tr><th {head}>{escape(label)}</th><td {wide}>{inside}</td></tr>")
        breaks = "" if len(self.title) > WIDTH else "; white-space: nowrap"
        title = f'<caption style="text-align: left; font-weight: bold{breaks}">{escape(self.title)}</caption>'
        return f"<table>{title}<tbody>{''.join(body)}</tbody></table>"

    def _rows(self) -> Iterator[tuple[str, str]]:
        yield from ((label, text) for label, text in self.rows if text)
        if self.calls:
            yield "call", self.calls


class Carded:
    """Base class of objects that show a card as their `repr` and in notebooks, and list only public names in `dir`."""

    def _card(self) -> Card:
        raise NotImplementedError

    def __repr__(self) -> str:
        return str(self._card())

    def _repr_html_(self) -> str:
        return self._card().html()

    def __dir__(self) -> list[str]:
        return public_names(self)


def public_names(noun: object) -> list[str]:
    """List the attributes of an object that do not begin with an underscore."""
    return sorted(name for name in object.__dir__(noun) if not name.startswith("_"))


def listed(names: Iterable[object], most: int = MOST_NAMES) -> str:
    """Join names with commas. Of more than `most` names, only the first ones and the last are shown."""
    texts = [str(name) for name in names]
    if len(texts) > most:
        texts = [*texts[: most - 1], "...", texts[-1]]
    return ", ".join(texts)


def setting(key: str, value: object, form: Callable[[object], str] = repr) -> str:
    """Return `key = value`; of a long list or table, only the number of its entries."""
    text = form(value)
    if isinstance(value, list | tuple | Mapping) and len(text) > MOST_SETTING:
        text = f"({len(value)} {'entry' if len(value) == 1 else 'entries'})"
    return f"{key} = {text}"


def counted(number: int, noun: str) -> str:
    """Return a number with its noun in the singular or plural, such as `2 fingers`."""
    return f"{number} {noun}{'' if number == 1 else 's'}"


def span(values: Iterable[float], unit: str) -> str:
    """Return the range of values with a unit, such as `0.1 to 0.2 kg`, or one number if all values are equal."""
    numbers = sorted(float(value) for value in values)
    if not numbers:
        return ""
    low, high = numbers[0], numbers[-1]
    alike = low == high or high - low <= 1e-9 * max(abs(low), abs(high)) < math.inf
    return f"{high:.4g} {unit}" if alike else f"{low:.4g} to {high:.4g} {unit}"


def _lines(text: str, width: int) -> Iterator[str]:
    for line in text.split("\n"):
        yield from _folded(line, width)


def _folded(line: str, width: int) -> list[str]:
    if len(line) <= width:
        return [line]
    from textwrap import wrap

    indent = " " * (len(line) - len(line.lstrip()) + 2)
    return wrap(line, width, subsequent_indent=indent, drop_whitespace=True) or [""]


def _fitting(lines: list[str]) -> str:
    """Join lines. Lines that are too long, and texts with too many lines or characters, are cut."""
    lines = [line if len(line) <= 2 * WIDTH else f"{line[: 2 * WIDTH - 3]}..." for line in lines]
    fitting: list[str] = []
    letters = 0
    for line in lines:
        letters += len(line) + 1
        if len(fitting) == MOST_LINES or letters > MOST_LETTERS:
            return "\n".join([*fitting, "  ..."])
        fitting.append(line)
    return "\n".join(fitting)
