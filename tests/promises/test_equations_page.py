"""docs/explanation/equation-by-equation.md: every equation of the paper has its row."""

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


def test_each_equation_stands_in_the_code() -> None:
    """A second table leads to files, to functions in them, and to tests: each is there."""
    rows = [line for line in PAGE.read_text(encoding="utf-8").splitlines() if re.match(r"\| eqs?\. \(", line)]
    numbers: list[int] = []
    for row in rows:
        first, *cells = row.split("|")[1:-1]
        for a, b in re.findall(r"\((\d+)\)(?:-\((\d+)\))?", first):
            numbers += range(int(a), int(b or a) + 1)
        for file, names in re.findall(r"`([\w/]+\.py)`: ((?:`\w+`(?: \(\d+\))?(?:, )?)+)", " | ".join(cells)):
            text = (ROOT / file).read_text(encoding="utf-8")
            for name in re.findall(r"`(\w+)`", names):
                assert re.search(rf"^(?:def|class) {name}\b", text, re.MULTILINE), (file, name)
        assert re.search(r"`tests/[\w/]+\.py`: `test_\w+`", cells[-1]), row
    assert sorted(numbers) == list(range(1, EQUATIONS + 1))
