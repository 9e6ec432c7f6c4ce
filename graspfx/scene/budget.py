"""Limits on the text of a scene before it is parsed: nesting, keys, values, length of numbers, size of the file."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from graspfx.errors import Fault, InputError

LARGEST_FILE = 4_000_000  # size of a file [bytes]
MOST_KEYS = 40_000
MOST_VALUES = 200_000  # a mesh of 20 000 vertices with its faces
DEEPEST = 32  # levels of nested tables and lists, and parts of a key
LONGEST_WORD = 400  # letters of a number, a date or a bare key
LONG = 10_000  # letters of a value above which the lines of its parts are not distinguished
LONGEST_KEY = 2_000  # letters of a whole key, bare or quoted

TOKEN = re.compile(
    r'''(?P<numbers>(?:[-+0-9.eE_]{1,40}\s*+,\s*+)++)      # parts of long lists
    |(?P<word>[^\s\[\]{}"'#=,]++)
    |(?P<equals>=)|(?P<comma>,)|(?P<line>\n\s*+(?:\#[^\n]*+\n\s*+)*+)
    |(?P<open>[\[{])|(?P<close>[\]}])
    |(?P<text>"""(?:[^"\\]++|\\.|"(?!""))*+"{3,5}|\'\'\'(?:[^']++|'(?!''))*+'{3,5}|"(?:[^"\\\n]++|\\.)*+"|'[^'\n]*+')
    |\#[^\n]*+
    |(?P<broken>["'])''',
    re.VERBOSE | re.DOTALL,
)


def excess(text: str) -> Fault | None:
    """Find where TOML text exceeds the limits; None for text within the limits, and for text that is not TOML.

    The computing time is proportional to the length of the text, unlike the time of a parser for some texts.
    """
    depth = parts = keys = values = start = 0
    in_value = False

    def fault(message: str, at: int) -> Fault:
        return Fault("", message, text.count("\n", 0, at) + 1)

    for token in TOKEN.finditer(text):
        kind, at = token.lastgroup, token.start()
        if kind == "numbers":
            values += text.count(",", at, token.end())
            parts, start = 0, token.end()
        elif kind == "word":
            length = token.end() - at
            dots = text.count(".", at, token.end())
            parts += dots
            if parts >= DEEPEST:
                return fault(f"a key of more than {DEEPEST} parts", at)
            if length - dots > LONGEST_WORD:
                return fault(f"a word or number of {length} characters; expected at most {LONGEST_WORD}", at)
        elif kind == "equals":
            keys, values = keys + 1, values + 1
            if at - start > LONGEST_KEY:
                return fault(f"a key of {at - start} characters; expected at most {LONGEST_KEY}", at)
            parts, start, in_value = 0, token.end(), True
        elif kind in ("comma", "line"):
            values += kind == "comma"
            parts, start, in_value = 0, token.end(), in_value and depth > 0
        elif kind == "open":
            keys += depth == 0 and not in_value  # header of a table
            depth, parts, start = depth + 1, 0, token.end()
            if depth > DEEPEST:
                return fault(f"tables or lists nested more than {DEEPEST} levels deep", at)
        elif kind == "close":
            depth, parts, start = max(depth - 1, 0), 0, token.end()
        elif kind == "broken":
            break  # the parser reports the error, with the line
        if keys > MOST_KEYS:
            return fault(f"more than {MOST_KEYS} keys", at)
        if values > MOST_VALUES:
            return fault(f"more than {MOST_VALUES} values; store a mesh or a path in a separate file", at)
    return None


def outline(text: str) -> str:
    """Replace long values in TOML by 0, so that the text is quick to search; keys keep their lines."""
    pieces, last, depth, value = [], 0, 0, -1
    for token in TOKEN.finditer(text):
        kind, at = token.lastgroup, token.start()
        if kind == "equals" and depth == 0 and value < 0:
            value = token.end()
        elif kind == "line" and depth == 0:
            if value >= 0 and at - value > LONG:
                pieces += [text[last:value], " 0", "\n" * text.count("\n", value, at)]
                last = at
            value = -1
        elif kind == "open":
            depth += 1
        elif kind == "close":
            depth -= 1
    return "".join([*pieces, text[last:]])


def too_deep(data: Any) -> Fault | None:
    """Find where tables and lists are nested more than DEEPEST levels deep, or a table contains itself."""
    holders = [data]
    for _ in range(DEEPEST + 1):
        holders = [value for holder in holders for _, value in _parts(holder)]
        if not holders:
            return None
    level: list[tuple[str, Any]] = [("", data)]
    for _ in range(DEEPEST + 1):
        level = [(f"{key}.{name}", value) for key, holder in level for name, value in _parts(holder)]
    return Fault(level[0][0].strip("."), f"tables or lists nested more than {DEEPEST} levels deep")


def _parts(holder: Any) -> list[tuple[Any, Any]]:
    """List the items of a table or list that are tables or lists."""
    items: Iterable[tuple[Any, Any]] = holder.items() if isinstance(holder, Mapping) else ()
    if isinstance(holder, list | tuple):
        items = enumerate(holder)
    return [(name, value) for name, value in items if isinstance(value, Mapping | list | tuple)]


def read_bytes(path: Path, name: str) -> bytes:
    """Read a scene's file, if it is not too large.

    Raises:
        InputError: If the file is too large, or cannot be read.
    """
    try:
        with path.open("rb") as file:
            data = file.read(LARGEST_FILE + 1)
    except OSError as error:
        raise InputError("scene", name, "a file that can be read", str(error.strerror)) from error
    if len(data) > LARGEST_FILE:
        most = f"a file of at most {LARGEST_FILE / 1e6:g} MB"
        raise InputError("scene", name, most, "store a mesh or a path in a separate file")
    return data
