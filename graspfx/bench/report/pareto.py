"""Which methods no other beats in time and in error at once."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from graspfx.bench.measure import TIMED, Row


def by_case(rows: Sequence[Row]) -> dict[str, list[Row]]:
    """Group rows by case, in the cases' order, the quickest first and those that were not timed last."""
    cases: dict[str, list[Row]] = {}
    for row in rows:
        cases.setdefault(row.case, []).append(row)
    return {case: sorted(each, key=_time) for case, each in cases.items()}


def front(rows: Sequence[Row]) -> list[Row]:
    """Find the rows of one case on the Pareto front, the quickest first; without errors, the quickest."""
    return list(_front(sorted((row for row in rows if row.state == TIMED), key=_time)))


def _front(rows: Sequence[Row]) -> Iterator[Row]:
    least = float("inf")
    for row in rows:
        error = row.error if row.error is not None else 0.0
        if error < least:
            least = error
            yield row


def _time(row: Row) -> float:
    return row.time_us if row.time_us is not None else float("inf")
