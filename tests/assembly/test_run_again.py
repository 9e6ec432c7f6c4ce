"""Runs of a scene that has run before: they begin with the memory of that run, put back, and nothing else of it."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import count
from threading import Thread
from typing import Any

import numpy as np
import pytest

import graspfx as gx
from graspfx.assembly.resolve import resolve
from graspfx.loop.arena import Arena

SCENES: dict[str, tuple[str, Mapping[str, Any]]] = {
    "line": ("reference-1dof", {}),
    "ledger": ("paper-waving", {"coupling.passivity": "control"}),
    "safety": ("paper-waving", {"safety": {}}),
    "fault": ("reference-1dof", {"coupling.force_bound": 0.05}),
    "implicit": ("sphere-three-fingers", {"object.integrator": "implicit"}),
    "every third": ("sphere-three-fingers", {"record": {"every": 3, "columns": ["gap"]}}),
    "guided": ("reference-1dof", {"finger.*.hand.guide": {"lag": 0.05}}),
}
TICKS = 60


@pytest.mark.parametrize("case", SCENES)
def test_a_second_run_has_the_bits_of_the_first(case: str, monkeypatch: pytest.MonkeyPatch) -> None:
    name, overrides = SCENES[case]
    scene, laid = gx.load(name, overrides), count()
    make = Arena.__init__

    def counted(*arguments: Any, **more: Any) -> None:
        next(laid)
        make(*arguments, **more)

    monkeypatch.setattr(Arena, "__init__", counted)
    duration = TICKS * scene.period
    first = gx.run(scene, duration=duration)
    kept = first.rows.copy()
    asked = count()
    stopped = gx.run(scene, duration=duration, stop=lambda: next(asked) > 0)
    second = gx.run(scene, duration=duration)
    assert next(laid) == 1, "the scene was laid out again"
    assert second.rows.tobytes() == kept.tobytes() == first.rows.tobytes()
    assert second.faults == first.faults
    assert bool(first.faults) is (case == "fault")
    assert not stopped.outcome.complete or stopped.ticks == TICKS
    assert second.outcome.complete
    again = gx.run(gx.load(name, overrides), duration=duration)
    assert again.rows.tobytes() == kept.tobytes()


def test_a_run_beside_another_has_parts_of_its_own() -> None:
    """A run that begins while another goes on, as in another thread, takes no servo from it."""
    scene = gx.load("reference-1dof")
    alone = gx.run(scene, duration=0.2)
    inner: list[gx.Recording] = []

    def stop() -> bool:
        if not inner:
            thread = Thread(target=lambda: inner.append(gx.run(scene, duration=0.2)))
            thread.start()
            thread.join()
        return False

    outer = gx.run(scene, duration=0.2, stop=stop)
    assert outer.rows.tobytes() == inner[0].rows.tobytes() == alone.rows.tobytes()


def test_a_session_keeps_its_servo_to_itself() -> None:
    scene = gx.load("reference-1dof")
    gx.run(scene, duration=0.1)
    with gx.open(scene) as session:
        session.step(20)
    position = session.position
    gx.run(scene, duration=0.1)
    assert np.array_equal(session.position, position)


def test_a_run_that_raises_leaves_no_servo_behind() -> None:
    scene = gx.load("reference-1dof")
    gx.run(scene, duration=0.1)

    def stop() -> bool:
        raise RuntimeError("broken off")

    with pytest.raises(RuntimeError, match="broken off"):
        gx.run(scene, duration=0.1, stop=stop)
    assert resolve(scene).stock.built is None
    gx.run(scene, duration=0.1)
    assert resolve(scene).stock.built is not None
