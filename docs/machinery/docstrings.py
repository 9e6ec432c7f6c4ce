"""Docstrings converted to reST from plain text as `help()` shows it, with backticks and Google's sections."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import takewhile
from textwrap import dedent

SECTIONS = ("Args:", "Attributes:", "Raises:")
ENTRY = re.compile(r"    \w+(, \w+)+: ")
HAZARDS = re.compile(r"`(?P<code>[^`]+)`|[\\*|]|_(?!\w)")  # what reST would read


def as_rest(lines: Sequence[str], places: Mapping[str, str]) -> list[str]:
    """Convert a docstring to reST; napoleon converts its sections."""
    return list(_escaped(_one_each(lines), places))


def plain(text: str, places: Mapping[str, str]) -> str:
    """Convert plain text to reST; only backticks have a meaning in it.

    Args:
        text: Text of one line.
        places: Place of each public name in the index; the names become links.
    """

    def one(match: re.Match[str]) -> str:
        if not match["code"]:
            return f"\\{match[0]}"
        place = places.get(match["code"])
        return f":py:obj:`{match['code']} <{place}>`" if place else f"``{match['code']}``"

    return HAZARDS.sub(one, text)


def _one_each(lines: Sequence[str]) -> list[str]:
    """Divide an entry with several names, such as `width, height: Size of the window`, into one entry per name."""
    written: list[str] = []
    section, entry = "", []
    for line in [*lines, "end"]:
        begins = not line.startswith("     ")
        if begins and entry:
            names, _, text = entry[0].strip().partition(": ")
            written += [each for name in names.split(", ") for each in (f"    {name}: {text}", *entry[1:])]
            entry = []
        if not line.startswith("    "):
            section = line.strip() if line.strip() in SECTIONS or not line.strip() else ""
        if begins and section in SECTIONS and ENTRY.match(line):
            entry = [line]
        elif entry:
            entry.append(line)
        else:
            written.append(line)
    return written[:-1]


def _escaped(lines: Sequence[str], places: Mapping[str, str]) -> Iterator[str]:
    """Convert plain lines to reST; formulas and code, indented after an empty line, are not changed."""
    as_it_is = False
    for i, (before, line) in enumerate(zip(["", *lines], lines, strict=False)):
        if line and not line.startswith("    "):
            as_it_is = False
        elif line and not before and not as_it_is:
            as_it_is = True
            block = takewhile(lambda each: not each or each.startswith("    "), lines[i:])
            yield from (f".. code-block:: {_language(block)}", "")
        yield line if as_it_is else plain(line, places)


def _language(block: Iterable[str]) -> str:
    """Tell code from formulas."""
    try:
        ast.parse(dedent("\n".join(block)))
    except SyntaxError:
        return "text"
    return "python"
