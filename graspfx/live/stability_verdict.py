"""Verdicts on the stability of a scene with some values: provisional at once, in full as they come."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

LEAST_ROOM = 1.0  # margin below which a gain is beyond its limit


class MarginRow(NamedTuple):
    """The room that one gain of one object's grasp has.

    Attributes:
        mode: "internal", "external", "external translation", "external rotation", "standing on ..." or "pushing with
            ..."; of sets of fingers that push the weakest one.
        name: of the object.
        gain: in the scene [N/m]; nan for matrices.
        limit: of it with the others as they are [N/m]; inf where none is too large.
        margin: limit over gain.
        frequency: at which stability is lost [Hz]; nan without a limit.
    """

    mode: str
    name: str
    gain: float
    limit: float
    margin: float
    frequency: float

    @property
    def is_mode(self) -> bool:
        """Whether it is one of the whole grasp, which has to be stable; fingers that push alone may lose it."""
        return not self.mode.startswith("pushing with ")


@dataclass(frozen=True)
class Verdict:
    """A judgement of a scene's stability.

    Attributes:
        values: by live key, that it is of; the scene's own for all others.
        is_provisional: from the last linearisation, or without all of the limits: the full one follows.
        is_stable: whether each object's loop is; None where `error` says why nobody knows.
        spectral_radius: of the loop that is nearest to instability; nan with an error.
        rows: limits of all objects.
        error: why there is no certificate, in words; empty where there is one.
        seconds: from the request to the answer.
        number: of the request.
        stage: 0 from the last linearisation, 1 from its own, without fingers that push; 2 in full.
        at: where the grasp was linearised: "squeezed", or "start" where no rest was reached.
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
        """One line for a page: stable or not, provisional or not, the least margin of the whole grasp."""
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
