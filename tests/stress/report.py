"""Runs the stress tests in full and writes docs/stress.md: `python -m tests.stress.report [PAGE]`."""

from __future__ import annotations

import sys
import time
from importlib.metadata import version
from pathlib import Path

import pytest

from graspfx.recording.header import machine
from tests.support.families import FAMILIES, Family

PAGE = Path("docs/stress.md")

HEAD = """# Stress tests

This page lists the tested ranges, and the worst error of each family of cases with its bound. The command

```
python -m tests.stress.report
```

writes this page. It runs the tests of `tests/stress` in full, like `pytest -m stress`, and their short, seeded form,
which is part of every `pytest`. Bad input must be refused by an error of GraspFX: a non-finite number, a warning of
numpy or an exception of another package is a failure. Valid input must result in the correct number: errors are
relative unless a unit is stated, and "none" marks cases that pass or fail without a number.
"""

RANGES = """
| what | range |
|---|---|
| conditioning of contacts (offset from their common line over its length) | 1 to 1e-9 |
| ratio of external to internal gains | 1e-6 to 1e6 |
| masses | 1e-6 to 1e3 kg |
| periods | 0.05 to 20 ms |
| viscosity, b T/m | 0 to 1e3 |
| sizes | 1 um to 1 km |
| offsets from the origin | up to 1 km |
| speeds | up to 10 m/s |
| fingers | 1 to 100, some of them coincident |
"""


def table(families: list[Family]) -> str:
    """The families as a table, by name."""
    rows = ["| family | cases | worst error | bound | reference | worst case |", "|---|---|---|---|---|---|"]
    for each in sorted(families, key=lambda each: each.name):
        unit = "" if each.unit == "1" else f" {each.unit}"
        worst, bound = (f"{each.worst:.2g}{unit}", f"{each.bound:.2g}{unit}") if each.bound else ("none", "")
        cells = (each.name, str(each.cases), worst, bound, each.oracle, each.where)
        rows.append(" | ".join(["", *(cell.replace("|", "\\|") for cell in cells), ""]).strip())
    return "\n".join(rows)


def main(page: Path = PAGE) -> int:
    """Runs the tests; writes the page if all of them passed."""
    began = time.perf_counter()
    failed = int(pytest.main(["tests/stress", "-m", "not large", "-q", "--durations=12"]))
    seconds = time.perf_counter() - began
    if failed:
        return failed
    tried = [each for each in FAMILIES.values() if each.cases]
    on = machine()
    packages = ", ".join(f"{name} {version(name)}" for name in ("numpy", "scipy", "llvmlite", "mpmath", "hypothesis"))
    run = (
        f"\n{sum(each.cases for each in tried)} cases in {seconds:.0f} s on {on['platform']}, {on['implementation']}, "
        f"{packages}.\n\n"
    )
    page.write_text(HEAD + RANGES + run + table(tried) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main(*map(Path, sys.argv[1:2])))
