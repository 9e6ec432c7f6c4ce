"""Line of each key in a TOML file; computed only if there is a fault to report."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

from graspfx.scene.budget import outline
from graspfx.scene.keys import Key

if TYPE_CHECKING:
    from tree_sitter import Node


KEYS = ("bare_key", "quoted_key", "dotted_key")


class KeyLines:
    """Lines by key: `KeyLines(text)[("finger", 0, "start")]`; a missing key has the line of its table.

    Every part of a very long value has the line of the value.
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
        *path, last = _parts(name)
        at = self._open((), path, name)
        if node.type == "table_array_element":
            self._mark((*at, last), name)
            self._last[(*at, last)] = self._last.get((*at, last), -1) + 1
        at = self._open(at, [last], name)
        for pair in rest:
            if pair.type == "pair":
                self._pair(at, pair)

    def _open(self, at: Key, path: Sequence[str], name: Node) -> Key:
        """Open the key of a table, through arrays of tables to their last table; create implied tables."""
        for part in path:
            at = (*at, part)
            if at in self._last:
                at = (*at, self._last[at])
            self._mark(at, name)
        return at

    def _pair(self, at: Key, node: Node) -> None:
        name, value = (child for child in node.named_children if child.type != "comment")
        for part in _parts(name):
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


def _parts(node: Node) -> Iterator[str]:
    if node.type == "dotted_key":
        for child in node.named_children:
            yield from _parts(child)
    elif node.type in KEYS:
        yield _unquoted((node.text or b"").decode())


def _unquoted(key: str) -> str:
    if key[:1] not in ("'", '"'):
        return key
    table: Mapping[str, object] = tomllib.loads(f"{key} = 0")
    return next(iter(table))
