"""docs/examples: a ladder without gaps, whose cells run as plain code, each with a number that stands elsewhere too."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.support.cells import cells, run

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "docs" / "examples"
PAGES = sorted(FOLDER.glob("[0-9]*.md"))


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_the_cells_of_the_example_run(page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Run the cells in an empty folder; what a cell ends with can be output, a figure as PNG."""
    monkeypatch.chdir(tmp_path)
    for output in run(page):
        picture = getattr(output, "_repr_png_", None)
        assert picture is None or picture().startswith(b"\x89PNG")
        assert isinstance(repr(output), str)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_the_example_pins_a_number(page: Path) -> None:
    code = "".join(source for _, source in cells(page))
    assert re.search(r"^assert .*(<|==|allclose)", code, re.MULTILINE)


def test_the_ladder_has_twenty_rungs_and_each_its_line_in_the_list() -> None:
    assert [int(page.name[:2]) for page in PAGES] == list(range(1, 21))
    list_of_examples = (FOLDER / "README.md").read_text(encoding="utf-8")
    for page in PAGES:
        heading = re.search(r"^# (.*)$", page.read_text(encoding="utf-8"), re.MULTILINE)
        assert heading is not None and heading[1].startswith(f"{page.name[:2]} ")
        assert f"]({page.name})" in list_of_examples
