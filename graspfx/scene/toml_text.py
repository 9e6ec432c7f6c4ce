"""Text of TOML files: limits of size that are checked before parsing, and the line of each key for fault messages."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from graspfx.errors import Fault, InputError
from graspfx.scene.keys import Key

if TYPE_CHECKING:
    from tree_sitter import Node

LARGEST_FILE = 4_000_000  # size of a file [bytes]
MOST_KEYS = 40_000
MOST_VALUES = 200_000  # a mesh of 20 000 vertices with its faces
DEEPEST = 32  # levels of nested tables and lists, and parts of a key
LONGEST_WORD = 400  # letters of a number, a date or a bare key
LONG = 10_000  # letters of a value above which the lines of its parts are not distinguished
LONGEST_KEY = 2_000  # letters of a whole key, bare or quoted

KEYS = ("bare_key", "quoted_key", "dotted_key")  # nodes of the syntax tree

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
    """Return a fault if a TOML text exceeds the limits of size; None if it does not.

    The text after an unclosed quote is not checked, because the parser refuses it. The computing time is proportional
    to the length of the text; a parser can take longer for some texts.
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
    """Return a TOML text with long values replaced by 0, which is parsed quickly; the keys keep their lines."""
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
    """Return a fault if tables and lists are nested more than DEEPEST levels deep, as is one that contains itself."""
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
    """Return the items of a table or list that are tables or lists, each with its key or index."""
    items: Iterable[tuple[Any, Any]] = holder.items() if isinstance(holder, Mapping) else ()
    if isinstance(holder, list | tuple):
        items = enumerate(holder)
    return [(name, value) for name, value in items if isinstance(value, Mapping | list | tuple)]


def read_bytes(path: Path, name: str) -> bytes:
    """Return the content of a scene's file, if its size is at most LARGEST_FILE; `name` is its name in messages.

    Raises:
        InputError: If the file is too large or cannot be read.
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


# Line of each key; computed only if there is a fault to report --------------------------------------------------------


class KeyLines:
    """Line number of each key in a TOML text: `KeyLines(text)[("finger", 0, "start")]`.

    A key that does not exist has the line of the table in which it would be. All parts of a very long value have the
    line of the value.
    """

    def __init__(self, text: str) -> None:
        import tree_sitter_toml
        from tree_sitter import Language, Parser

        tree = Parser(Language(tree_sitter_toml.language())).parse(outline(text).encode())
        self._lines: dict[Key, int] = {}
        self._last: dict[Key, int] = {}  # index of the current table of each array of tables
        for node in tree.root_node.named_children:
            if node.type == "pair":
                self._pair((), node)
            elif node.type in ("table", "table_array_element"):
                self._table(node)

    def __getitem__(self, key: Sequence[str | int]) -> int | None:
        target = tuple(key)
        while target and target not in self._lines:
            target = target[:-1]
        return self._lines.get(target)

    def _table(self, node: Node) -> None:
        name, *rest = node.named_children
        *path, last = _key_parts(name)
        at = self._open((), path, name)
        if node.type == "table_array_element":
            self._mark((*at, last), name)
            self._last[(*at, last)] = self._last.get((*at, last), -1) + 1
        at = self._open(at, [last], name)
        for pair in rest:
            if pair.type == "pair":
                self._pair(at, pair)

    def _open(self, at: Key, path: Sequence[str], name: Node) -> Key:
        """Return the key of a table, with an index of the last table for each array of tables; mark implied tables."""
        for part in path:
            at = (*at, part)
            if at in self._last:
                at = (*at, self._last[at])
            self._mark(at, name)
        return at

    def _pair(self, at: Key, node: Node) -> None:
        name, value = (child for child in node.named_children if child.type != "comment")
        for part in _key_parts(name):
            at = (*at, part)
            self._mark(at, name)
        self._value(at, value)

    def _value(self, at: Key, node: Node) -> None:
        if node.type == "inline_table":
            for pair in node.named_children:
                if pair.type == "pair":
                    self._pair(at, pair)
        elif node.type == "array":
            items = [item for item in node.named_children if item.type != "comment"]
            for i, item in enumerate(items):
                self._mark((*at, i), item)
                self._value((*at, i), item)

    def _mark(self, key: Key, node: Node) -> None:
        self._lines.setdefault(key, node.start_point.row + 1)


def _key_parts(node: Node) -> Iterator[str]:
    if node.type == "dotted_key":
        for child in node.named_children:
            yield from _key_parts(child)
    elif node.type in KEYS:
        yield _unquoted((node.text or b"").decode())


def _unquoted(key: str) -> str:
    if key[:1] not in ("'", '"'):
        return key
    table: Mapping[str, object] = tomllib.loads(f"{key} = 0")
    return next(iter(table))
