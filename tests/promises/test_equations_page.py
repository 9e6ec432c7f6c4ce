"""docs/explanation/equation-by-equation.md: every equation of the paper has its row, and readers find the page."""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "explanation" / "equation-by-equation.md"
EQUATIONS = 27  # in the paper


def test_each_equation_has_one_row_with_its_figure() -> None:
    rows = [line.split("|")[1:-1] for line in PAGE.read_text(encoding="utf-8").splitlines() if line.startswith("| (")]
    numbers: list[int] = []
    for first, *_, figure in rows:
        assert figure.strip(), first
        spans = re.findall(r"\((\d+)\)(?:-\((\d+)\))?", first)
        numbers += [n for a, b in spans for n in range(int(a), int(b or a) + 1)]
    assert numbers == list(range(1, EQUATIONS + 1))


def test_readers_find_the_page() -> None:
    assert "(docs/explanation/equation-by-equation.md)" in (ROOT / "README.md").read_text(encoding="utf-8")
    assert "(equation-by-equation.md)" in (PAGE.parent / "coupling.md").read_text(encoding="utf-8")
