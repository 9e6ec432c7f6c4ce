"""The plan says what the safety chain does and skips, in the order of its steps."""

from __future__ import annotations

from typing import Any

import pytest

from graspfx.assembly.build import build
from graspfx.certificate.plan import PlanRow, plan
from graspfx.loop.tick_listing import used
from graspfx.scene.load import load
from graspfx.scene.model import Scene

STEPS = ("safety", "soft start", "stale readings", "tank", "rate", "workspace", "over speed", "clamp", "watchdog")


def scene(**safety: Any) -> Scene:
    """The reference scene with a chain, or without one where nothing is said."""
    changes = {f"safety.{key}": value for key, value in safety.items()}
    return load("reference-1dof", changes)


def rows(made: Scene) -> list[PlanRow]:
    return [row for row in plan(made) if row.step in STEPS]


def test_a_scene_without_the_table_has_no_chain() -> None:
    [row] = rows(scene())
    assert (row.step, row.runs) == ("safety", False)
    with build(scene()) as servo:
        assert not {"restrain", "soften", "keep_pace"} & used(servo, 2).kernels


CASES: list[tuple[dict[str, Any], str, bool, str]] = [
    ({"force": 2.0}, "clamp", True, "2 N, applied last"),
    ({"hold": 5}, "clamp", True, "3 N, applied last"),
    ({"force": 2.0}, "limit", True, "2 N by [safety]"),
    ({"hold": 5}, "stale readings", True, "after 5 consecutive samples"),
    ({"force": 2.0}, "soft start", True, "grow over 0.5 s"),
    ({"soft_start": 0.0}, "soft start", False, "have their values from the first tick"),
    ({"rate": 20.0}, "rate", True, "20 N/s of growth"),
    ({"force": 2.0}, "rate", False, "no safety.rate"),
    ({"speed": 1.5}, "over speed", True, "1.5 m/s, beyond which"),
    ({"workspace": [[-0.1], [0.1]]}, "workspace", True, "2 of 2 fingers"),
    ({"workspace": "none"}, "workspace", False, "no box"),
    ({"watchdog": 0.5}, "watchdog", False, "simulated time is never late"),
]


@pytest.mark.parametrize(("safety", "step", "runs", "why"), CASES)
def test_steps(safety: dict[str, Any], step: str, runs: bool, why: str) -> None:
    made = scene(**safety)
    assert tuple(row.step for row in rows(made)) == STEPS
    [row] = [row for row in plan(made) if row.step == step]
    assert row.runs is runs
    assert why in row.why


def test_ticks_run_the_steps_that_the_plan_says() -> None:
    with build(scene(force=2.0)) as servo:
        assert {"restrain", "soften", "keep_pace", "apply_gain"} <= used(servo, 2).kernels
