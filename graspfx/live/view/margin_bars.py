"""Stability results as data of a page: a summary, and each margin as a bar with a mark at the stability limit."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from graspfx.live.stability_verdict import MarginRow, Verdict

FULL_BAR = 10.0  # margin of a full bar; bars are logarithmic
EMPTY_BAR = 0.5
AMPLE = 1.5  # margin below which a bar is a warning


def margin_bars(verdict: Verdict | None, loose: Mapping[str, float]) -> dict[str, Any]:
    """Return the boxes and the bars of a stability result.

    Args:
        verdict: Result for the grasp as held by its hands; None before the first.
        loose: Objects that are not held, with the gap to the nearest finger [m], from `Frames.loose`; they are never
            green.
    """
    boxes = []
    if loose:
        apart = ", ".join(_apart(*each) for each in loose.items())
        boxes.append(_box("amber", f"NOT HELD: no finger touches {apart}", "touch it from both sides"))
    rows: list[dict[str, Any]] = []
    if verdict is None:
        boxes.append(_box("grey", "Stability is being computed"))
    elif verdict.is_stable is None:
        boxes.append(_box("grey", "Stability is not known", verdict.error))
    else:
        kind = "red" if not verdict.is_stable else "grey" if loose else "green"
        words = "UNSTABLE: it will shake" if not verdict.is_stable else "stable once it is held" if loose else "stable"
        how = "provisional, the full result is being computed" if verdict.is_provisional else "full"
        boxes.append(_box(kind, words, f"{how}; spectral radius {verdict.spectral_radius:.5f}"))
        rows = [_row(row, "grey" if row.name in loose else "green") for row in verdict.rows]
    faint = verdict is not None and verdict.is_provisional
    return {"boxes": boxes, "rows": rows, "faint": faint, "mark": _share(1.0)}


def _box(kind: str, words: str, note: str = "") -> dict[str, str]:
    return {"kind": kind, "words": words, "note": note}


def _apart(name: str, gap: float) -> str:
    """Return the name of an object, with the distance of the nearest finger [m] if known."""
    away = f"{gap:.3g} m" if gap >= 1.0 else f"{1e3 * max(gap, 0.0):.3g} mm"
    return name + (f" (the nearest is {away} away)" if math.isfinite(gap) else "")


def _row(row: MarginRow, ample: str) -> dict[str, Any]:
    margin, has_limit = row.margin, math.isfinite(row.margin)
    where = f", lost at {row.frequency:.3g} Hz" if math.isfinite(row.frequency) else ""
    return {
        "name": row.mode, "margin": f"{margin:.2f} ×" if has_limit else "no limit",
        "share": _share(margin) if has_limit else 1.0,
        "kind": "red" if margin < 1.0 else "amber" if margin < AMPLE else ample,
        "words": f"limit {row.limit:.4g} N/m{where}" if math.isfinite(row.limit) else "",
    }  # fmt: skip


def _share(margin: float) -> float:
    least, most = math.log(EMPTY_BAR), math.log(FULL_BAR)
    return min(1.0, max(0.02, (math.log(max(margin, 1e-9)) - least) / (most - least)))
