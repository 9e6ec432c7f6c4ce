"""Glossary: a table in the repository, and terms with links and search on the site."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from sphinx.application import Sphinx

PAGE = "glossary"
HEAD = re.compile(r"^\|(.*)\|\n\|(?:-+\|)+\n", re.MULTILINE)
CELLS = re.compile(r"(?<!\\)\|")


def as_terms(text: str) -> str:
    """Convert a page's table of words, meanings and excluded meanings to terms with definitions."""
    match = HEAD.search(text)
    if match is None:
        raise ValueError("the glossary has no table")
    rows, _, rest = text[match.end() :].partition("\n\n")
    lines = [line for row in rows.splitlines() for line in _term(row)]
    return "\n".join([text[: match.start()], "````{glossary}", *lines, "````", "", rest])


def _term(row: str) -> Iterator[str]:
    words, means, *others = (cell.strip() for cell in CELLS.split(row.strip().strip("|")))
    yield from (word.strip() for word in words.split(","))
    yield f"  {means[:1].upper()}{means[1:]}." if not means.endswith(".") else f"  {means}"
    if others and others[0]:
        yield f"\n  *Not:* {others[0]}."
    yield ""


def _read(app: Sphinx, name: str, content: list[str]) -> None:
    if name == PAGE:
        content[0] = as_terms(content[0])


def setup(app: Sphinx) -> dict[str, bool]:
    """Rewrite the page when it is read."""
    app.connect("source-read", _read)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
