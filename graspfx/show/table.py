"""A table in plain text, folded to the width of a terminal."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

BOLD, PLAIN = "\033[1m", "\033[0m"
RULES = "┃│━╇"  # between the cells of the head, between those of a row, the line below the head, its crossings
ASCII = "||-+"


class Column(NamedTuple):
    """A title and the cells below it, on the left or the right of their column, which may be folded or not."""

    title: str
    cells: Sequence[str]
    right: bool = False
    folds: bool = False


def lines(columns: Sequence[Column], width: int, *, rules: str = RULES, bold: bool = False) -> Iterator[str]:
    """Yield the table line by line.

    Args:
        columns: with as many cells each.
        width: of the terminal. Columns that fold share what the others leave of it; cells are folded between words
            only, so that lines may be longer.
        rules: as RULES.
        bold: the head in bold type.
    """
    fixed = sum(_widest([each.title, *each.cells]) for each in columns if not each.folds)
    rest = width - fixed - 3 * (len(columns) - 1)  # a rule with a blank on either side
    share = rest // max(1, sum(each.folds for each in columns))
    widths = [_width(each, share) for each in columns]
    head, row, below, crossing = tuple(rules)
    titles = [_folded(each.title, size) for each, size in zip(columns, widths, strict=True)]
    height = max(map(len, titles))
    for line in _row([[""] * (height - len(each)) + each for each in titles], columns, widths, head):
        yield f"{BOLD}{line}{PLAIN}" if bold else line
    yield f"{below}{crossing}{below}".join(below * size for size in widths)
    for cells in zip(*(each.cells for each in columns), strict=True):
        yield from _row([_folded(*each) for each in zip(cells, widths, strict=True)], columns, widths, row)


def _row(cells: Sequence[list[str]], columns: Sequence[Column], widths: Sequence[int], rule: str) -> Iterator[str]:
    for part in range(max(map(len, cells))):
        texts = [cell[part] if part < len(cell) else "" for cell in cells]
        blanks = [" " * (size - _size(text)) for text, size in zip(texts, widths, strict=True)]
        parts = zip(texts, blanks, columns, strict=True)
        yield f" {rule} ".join(blank + text if each.right else text + blank for text, blank, each in parts)


def _width(column: Column, share: int) -> int:
    width = _widest([column.title, *column.cells])
    if not column.folds or width <= share:
        return width
    return max(share, _widest(word for text in (column.title, *column.cells) for word in text.split()))


def _widest(texts: Iterable[str]) -> int:
    return max((_size(line) for text in texts for line in text.split("\n")), default=0)


def _folded(text: str, width: int) -> list[str]:
    """Fold into lines of at most `width`, broken between words, and within a word only where it is longer."""
    lines = []
    for line in text.split("\n"):
        full = ""
        for word in line.split(" "):
            joined = f"{full} {word}" if full else word
            if full and _size(joined) > width:
                lines.append(full.rstrip())
                joined = word
            while _size(joined) > width:
                cut = max(1, next(i for i in range(len(joined) + 1) if _size(joined[:i]) > width) - 1)
                lines.append(joined[:cut])
                joined = joined[cut:]
            full = joined
        lines.append(full)
    return lines


def _size(text: str) -> int:
    """Count the terminal columns of a text: two for a wide letter, none for an accent on the letter before it."""
    if text.isascii():
        return len(text)
    from unicodedata import combining, east_asian_width

    return sum(0 if combining(letter) else 1 + (east_asian_width(letter) in "WF") for letter in text)
