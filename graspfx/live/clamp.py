"""The largest gains that hardware gets: a share of each limit of a certificate, and never less room than asked for."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

from graspfx.assembly.live import GAINS
from graspfx.live.stability_verdict import MarginRow, Verdict
from graspfx.scene.keys import general

SHARE = 0.9  # of a limit: the most that hardware gets
INSIDE = 1e-3  # relative: how far below that a clamped gain is, as the rest that it leads to has another limit
SAME = 1e-6  # relative: a gain that is as large as before
MODES = {key: key.split(".")[1] for key in GAINS if key.endswith("stiffness")}  # external, internal


def shortfall(verdict: Verdict, present: Verdict) -> str:
    """Say why values are not for hardware; no text where they are.

    Each margin has to be 1/0.9 or more; one that is less now must not shrink.

    Args:
        verdict: in full, on the values.
        present: in full, on those that hardware has.
    """
    for row, needed in _short(verdict, present):
        text = f"{row.mode} margin {row.margin:.3f}" if math.isfinite(row.margin) else row.mode
        lost = "" if math.isnan(row.frequency) else f", beyond which it shakes at {row.frequency:.3g} Hz"
        return f"{text}, {needed:.3f} needed; limit {row.limit:.4g} N/m{lost}"
    if not verdict.is_stable:
        return f"not stable: spectral radius {verdict.spectral_radius:.6f}"
    return ""


def lower(values: Mapping[str, Any], verdict: Verdict, present: Verdict) -> dict[str, Any] | None:
    """Lower stiffness that is beyond 0.9 of its limit to that; None where none is left above that of now.

    Args:
        values: by live key, that fall short.
        verdict: in full, on them.
        present: in full, on those that hardware has.
    """
    less = dict(values)
    for key, value in values.items():
        mode = MODES.get(general(key))
        if mode is None or not isinstance(value, int | float):
            continue
        rows = [row for row in present.rows if row.mode == mode]
        now = min((row.gain for row in rows), default=0.0)
        most = min((SHARE * row.limit for row in rows), default=math.inf)  # near what hardware has
        if value <= max(most, now):
            short = [row.margin / needed for row, needed in _short(verdict, present) if _grows(row, mode)]
            if not short:
                continue
            most = float(value) * min(short)
        most *= 1.0 - INSIDE
        if value > most and not value > now >= most * (1.0 - SAME):
            less[key] = most
    return None if less == dict(values) else less


def _short(verdict: Verdict, present: Verdict) -> Iterator[tuple[MarginRow, float]]:
    """Give rows with too small a margin, and the one that they need."""
    for row in verdict.rows:
        before = min((each.margin for each in present.rows if _kind(each) == _kind(row)), default=math.inf)
        needed = min(1.0 / SHARE, before * (1.0 - SAME))
        if row.margin < needed:
            yield row, needed


def _kind(row: MarginRow) -> tuple[str, str]:
    """Name what a row is of: fingers that push are the weakest, whoever they are."""
    return row.name, row.mode if row.is_mode else "pushing"


def _grows(row: MarginRow, mode: str) -> bool:
    """Tell whether a row's gain is that of a mode, or all gains together."""
    return row.mode == mode or not row.mode.startswith(("external", "internal"))
