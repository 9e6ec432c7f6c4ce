"""Stability results of a scene with given values: first provisional, then full."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

LEAST_ROOM = 1.0  # margin below which a gain exceeds its limit


class MarginRow(NamedTuple):
    """Stability margin of one gain of an object's grasp.

    Attributes:
        mode: "internal", "external", "external translation", "external rotation", "standing on ..." or "pushing with
            ..."; for pushing fingers, the weakest set.
        name: Name of the object.
        gain: Gain in the scene [N/m]; NaN for matrices.
        limit: Stability limit with the other gains fixed [N/m]; infinite if there is none.
        margin: Limit divided by gain.
        frequency: Frequency at which stability is lost [Hz]; NaN without a limit.
    """

    mode: str
    name: str
    gain: float
    limit: float
    margin: float
    frequency: float

    @property
    def is_mode(self) -> bool:
        """Whether the row belongs to the whole grasp, which must be stable, and not to single pushing fingers."""
        return not self.mode.startswith("pushing with ")


@dataclass(frozen=True)
class Verdict:
    """Stability of a scene.

    Attributes:
        values: Changed values by live key; other keys have the scene's values.
        is_provisional: Whether a full result will follow.
        is_stable: Whether the loops of all objects are stable; None if unknown (see `error`).
        spectral_radius: Largest spectral radius of the loops; NaN after an error.
        rows: Limits of all objects.
        error: Reason why there is no certificate; empty with a certificate.
        seconds: Time from the request to the result [s].
        number: Number of the request.
        stage: 0 from the last linearisation, 1 from a new one without pushing fingers, 2 full.
        at: Configuration of the linearisation: "squeezed", or "start" if no equilibrium was reached.
    """

    values: Mapping[str, Any] = field(default_factory=dict)
    is_provisional: bool = True
    is_stable: bool | None = None
    spectral_radius: float = math.nan
    rows: tuple[MarginRow, ...] = ()
    error: str = ""
    seconds: float = math.nan
    number: int = 0
    stage: int = 0
    at: str = ""

    @property
    def text(self) -> str:
        """One-line summary: stable or not, provisional or not, smallest margin of the whole grasp."""
        if self.is_stable is None:
            return f"not judged: {self.error}" if self.error else "not judged yet"
        text = "stable" if self.is_stable else "NOT STABLE"
        if self.is_provisional:
            text += " (provisional)"
        modes = [row for row in self.rows if row.is_mode and math.isfinite(row.margin)]
        if modes:
            least = min(modes, key=lambda row: row.margin)
            text += f": {least.mode} margin {least.margin:.2f}"
        return text
