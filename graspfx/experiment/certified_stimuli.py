"""Certification of stimuli for hardware: all are certified before the session, with a safety margin."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

from graspfx.certificate.report import check
from graspfx.errors import InputError
from graspfx.experiment.experiment_table import Study
from graspfx.live.hardware_clamp import SHARE
from graspfx.progress import waiting

if TYPE_CHECKING:
    from graspfx.experiment.session_plan import SessionPlan


def require_certified(experiment: Study, plan: SessionPlan) -> None:
    """Require that every stimulus of a session has the margin that hardware needs: at least 1/0.9.

    Raises:
        InputError: A stimulus is not stable, is too close to a limit, or cannot be judged.
    """
    stimuli = list(_stimuli(plan))
    judged: list[Mapping[str, Any]] = []
    with waiting(f"certifying {len(stimuli)} stimuli", len(stimuli), "stimuli", lambda: len(judged)):
        for values in stimuli:
            _require(experiment, values)
            judged.append(values)


def _require(experiment: Study, values: Mapping[str, Any]) -> None:
    text = ", ".join(f"{key} = {value}" for key, value in values.items())
    report = check(experiment.scene, values)
    if not report.ok:
        raise InputError("stimulus", text, "values that are certified for hardware", report.verdict)
    for certificate in report.certificates:
        for row in certificate.limits:
            if row.margin < 1.0 / SHARE:
                why = f"{row.mode} margin {row.margin:.3f}, {1.0 / SHARE:.3f} needed; limit {row.limit:.4g} N/m"
                raise InputError("stimulus", text, "values with room for hardware", why)


def _stimuli(plan: SessionPlan) -> Iterator[Mapping[str, Any]]:
    """List all distinct values of intervals, including every increment that a staircase may choose."""
    seen: list[Mapping[str, Any]] = []
    for slot in plan.slots:
        increments = plan.stairs[slot.cell.condition].increments.tolist() if slot.cell.is_adaptive else [math.nan]
        if plan.easy is not None and slot.cell.is_adaptive:
            increments = [*increments, plan.easy]
        for increment in increments:
            for values in slot.cell.trial(1, 1, 0, increment).intervals:
                if values not in seen:
                    seen.append(values)
                    yield values
