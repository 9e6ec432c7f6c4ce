"""docs/examples: a ladder without gaps, whose cells run as plain code, each with a number that stands elsewhere too."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "docs" / "examples"
PAGES = sorted(FOLDER.glob("[0-9]*.md"))
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


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_the_cells_of_the_example_run_and_pin_a_number(
    page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Run the cells in an empty folder; what a cell ends with can be output, a figure as PNG."""
    monkeypatch.chdir(tmp_path)
    assert re.search(r"^assert .*(<|==|allclose)", "".join(source for _, source in cells(page)), re.MULTILINE)
    for output in run(page):
        picture = getattr(output, "_repr_png_", None)
        assert picture is None or picture().startswith(b"\x89PNG")
        assert isinstance(repr(output), str)


def test_each_rung_of_the_ladder_has_its_line_in_the_list() -> None:
    assert [int(page.name[:2]) for page in PAGES] == list(range(1, len(PAGES) + 1))
    list_of_examples = (FOLDER / "README.md").read_text(encoding="utf-8")
    for page in PAGES:
        heading = re.search(r"^# (.*)$", page.read_text(encoding="utf-8"), re.MULTILINE)
        assert heading is not None and heading[1].startswith(f"{page.name[:2]} ")
        assert f"]({page.name})" in list_of_examples
