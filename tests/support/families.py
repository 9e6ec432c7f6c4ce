"""Report of the stress tests: what was tried in each family, the worst error, and where."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import pytest


@dataclass
class Family:
    """One row of the report: a quantity, the bound that it must keep to, and what it came to.

    Attributes:
        name: of the family, and of the quantity in it.
        oracle: what the errors are measured against.
        unit: of the errors.
        cases: tried so far.
        worst: error so far, as a share of its bound and as it is.
        where: the worst was found.
    """

    name: str
    oracle: str
    unit: str = "1"
    cases: int = 0
    share: float = 0.0
    worst: float = 0.0
    bound: float = 0.0
    where: str = ""

    def tried(self, count: int = 1) -> None:
        """Cases that either pass or fail, without a figure."""
        self.cases += count

    def check(self, error: float, bound: float, where: object) -> None:
        """One case whose error must not exceed its bound; NaN does."""
        self.cases += 1
        share = float(error) / bound if bound > 0.0 else (0.0 if error == 0.0 else float("inf"))
        if not share <= self.share:
            self.share, self.worst, self.bound, self.where = share, float(error), float(bound), str(where)
        assert error <= bound, f"{self.name}: {error:.3g} {self.unit}, above {bound:.3g}, for {where}"


FAMILIES: dict[str, Family] = {}


def family(name: str, oracle: str, unit: str = "1") -> Family:
    """A family's row, made when its tests are collected."""
    return FAMILIES.setdefault(name, Family(name, oracle, unit))


def efforts(*, short: int, full: int, asked: str = "stress") -> Any:
    """Give the number of cases as the argument `cases`: the short form always, the full one with -m `asked`."""
    return pytest.mark.parametrize(
        "cases", [pytest.param(short, id="short"), pytest.param(full, id="full", marks=getattr(pytest.mark, asked))]
    )
