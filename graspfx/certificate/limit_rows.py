"""The limits of a certificate as lines of text: alike ones in one, many that nearly are as a range."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from graspfx.certificate.certificate import Limit

PUSHING = "pushing with "
MOST = 3  # lines about fingers that push alone: more become a range


def limit_lines(limits: Sequence[Limit]) -> Iterator[str]:
    """Write one line for each mode; modes with the same figures in one, of sets of fingers that push the weakest."""
    alike: dict[str, list[Limit]] = {}
    for row in _worth_saying(limits):
        alike.setdefault(figures(row), []).append(row)
    single = {text: rows for text, rows in alike.items() if all(_count(row) == 1 for row in rows)}
    folds = len(single) > MOST
    for text, rows in alike.items():
        if folds and text in single:
            if text == next(iter(single)):
                yield _range([row for each in single.values() for row in each])
            continue
        first, *others = (row.mode for row in rows)
        yield f"{' | '.join([first, *(name.removeprefix(PUSHING) for name in others)])} {text}"


def figures(row: Limit) -> str:
    """Write a mode's gain, limit, margin and the frequency at which it is lost."""
    return row.text


def _worth_saying(limits: Sequence[Limit]) -> Iterator[Limit]:
    """Select all but the sets of several fingers that push with more room than another set of as many."""
    weakest: dict[int, Limit] = {}
    for row in limits:
        count = max(_count(row), 1)
        if count == 1:
            yield row
        elif count not in weakest or row.margin < weakest[count].margin:
            weakest[count] = row
    yield from weakest.values()


def _count(row: Limit) -> int:
    """Count the fingers that push; 0 for a mode of the whole grasp."""
    return row.mode.count(", ") + 1 if row.mode.startswith(PUSHING) else 0


def _range(rows: Sequence[Limit]) -> str:
    weakest = min(rows, key=lambda row: row.margin)
    gains, limits, margins, lost = (
        _span([getattr(row, name) for row in rows], digits)
        for name, digits in (("gain", ".4g"), ("limit", ".4g"), ("margin", ".2f"), ("frequency", ".3g"))
    )
    name = weakest.mode.removeprefix(PUSHING)
    gain = f"{gains} N/m" if gains else "gains as they are"
    parts = [f"limit {limits}" if limits else "", f"margin {margins}" if margins else "no limit"]
    parts += [f"lost at {lost} Hz" if lost else "", f"the least with {name}" if margins else ""]
    return f"{PUSHING}one of {len(rows)} fingers {gain}: {', '.join(part for part in parts if part)}"


def _span(values: Sequence[float], digits: str) -> str:
    """Write the least and the largest of the finite numbers, as one number where they read the same."""
    finite = [value for value in values if math.isfinite(value)]
    if not finite:
        return ""
    ends = dict.fromkeys(f"{value:{digits}}" for value in (min(finite), max(finite)))
    return " ... ".join([*ends, *(["no limit"] if len(finite) < len(values) else [])])
