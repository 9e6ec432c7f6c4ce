"""Cells of a page that is a notebook in Markdown: parsed, and run in one namespace as plain code."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

CELL = re.compile(r"^```\{code-cell\}[^\n]*\n(?P<source>.*?)^```$", re.MULTILINE | re.DOTALL)


def cells(page: Path) -> Iterator[tuple[int, str]]:
    """Read the cells of a page in order, each with the line of the page that its first line is."""
    text = page.read_text(encoding="utf-8")
    for each in CELL.finditer(text):
        yield text.count("\n", 0, each.start("source")) + 1, each["source"]


def run(page: Path) -> list[Any]:
    """Run a page's cells in order, in one namespace; return what each shows, which its last expression is, or None.

    A fault's traceback names the page and its line.
    """
    space: dict[str, Any] = {"__name__": "__main__"}
    results = []
    for line, source in cells(page):
        tree = ast.increment_lineno(ast.parse(source, str(page)), line - 1)
        end = tree.body[-1]
        shows = isinstance(end, ast.Expr)
        if isinstance(end, ast.Expr):
            tree.body[-1] = ast.copy_location(ast.Assign([ast.Name("_", ast.Store())], end.value), end)
        exec(compile(ast.fix_missing_locations(tree), str(page), "exec"), space)
        results.append(space["_"] if shows else None)
    return results
