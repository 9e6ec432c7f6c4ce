"""The end of a run with hardware: forces decay over 20 ms where ticks still run, and are zero at once elsewhere."""

from __future__ import annotations

import signal
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import graspfx as gx
from graspfx.assembly import run_scene as whole_run
from graspfx.loop.realtime.pacing import decay_ticks
from graspfx.loop.realtime.process import Exits, Interruption
from tests.support.hardware import EVIL, Evil, VirtualClock, driver, fakes

PRESSED: dict[str, Any] = {
    "dimensions": 1, "period": 0.001, "duration": 0.7, "engine": "interpreted",
    "object": {"mass": 0.1, "viscosity": 0.8, "shape": {"kind": "box", "size": [0.05]}, "free": [False]},
    "coupling": {"external": {"stiffness": 30.0}, "internal": {"stiffness": 70.0}, "absent": "follow", "enter": "ramp"},
}  # fmt: skip
SETTLED = 200  # writings before the first tick, at a period of 1 ms


@pytest.fixture(autouse=True)
def clock(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(whole_run, "WallClock", VirtualClock)


def pressed(file: Path, **changes: Any) -> gx.Scene:
    """Put a finger 4 mm inside a cart that does not move."""
    finger = {"start": [-0.03], "device": {"name": str(file), "position": [[-0.021]]}}
    return gx.Scene(**{**PRESSED, "finger": [finger]}).replace(changes)


def sizes(rec: gx.Recording) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Give the size of the only force, tick by tick."""
    return np.abs(rec.displayed_force[:, 0, 0])


@pytest.mark.parametrize(("period", "ticks"), [(0.001, 20), (0.005, 4), (0.0003, 67), (0.02, 1), (0.1, 1)])
def test_forces_decay_in_20_ms(period: float, ticks: int) -> None:
    assert decay_ticks(period) == ticks


def test_the_last_20_ms_of_a_run_are_its_decay(tmp_path: Path) -> None:
    """It has as many ticks as it was asked for; all of the force is there until then, and the last one is zero."""
    rec = gx.run(pressed(driver(tmp_path)), real_time=True)
    force = sizes(rec)
    assert len(rec) == 700
    assert rec.outcome.complete
    assert not rec.faults
    assert force[679] == pytest.approx(force[600], rel=1e-12)
    assert force[679] > 0.2
    assert force[680:] == pytest.approx(force[679] * np.arange(19, -1, -1) / 20, abs=1e-12)
    assert force[-1] == 0.0
    assert rec.changes == ()
    assert [(change.tick, change.value) for change in rec.outcome.changes] == [(680, "end")]
    assert rec.rest == 680
    assert [what for _, what in fakes(tmp_path / "fakes.py")[-1].log if isinstance(what, str)][-2:] == ["stop", "close"]


def test_a_run_that_is_stopped_has_20_ms_more(tmp_path: Path) -> None:
    """Both sides feel the same gain; the object takes what is displayed."""
    file = driver(tmp_path)

    def stop() -> bool:
        return len(fakes(file)[-1].forces) >= 600 + SETTLED

    rec = gx.run(pressed(file), real_time=True, stop=stop)
    assert (rec.rest, len(rec)) == (600, 620)
    assert not rec.outcome.complete
    force = sizes(rec)
    assert (np.diff(force[599:]) < 0.0).all()
    assert force[-1] == 0.0
    assert np.array_equal(rec.finger_force, -rec.displayed_force)


def test_a_run_without_force_ends_as_it_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """After a fault there is nothing to decay: stop ends it at once."""

    def read(fake: Any, p: Any, v: Any, t: float) -> Any:
        raise OSError("gone")

    monkeypatch.setitem(EVIL, "gone", Evil(read=read))
    file = driver(tmp_path)
    scene = pressed(file, **{"finger.0.device.evil": "gone", "finger.0.device.at": 300})
    ticks = iter(range(10_000))
    rec = gx.run(scene, real_time=True, stop=lambda: next(ticks) > 500)
    assert rec.faults
    assert rec.rest is None
    assert sizes(rec)[-1] == 0.0


def test_simulations_end_as_ever() -> None:
    """Paced or not, with a chain or without: all of the force is there in the last tick."""
    scene = gx.load("reference-1dof", {"safety.soft_start": 0.01})
    free, paced = gx.run(scene, duration=0.1), gx.run(scene, duration=0.1, real_time=True)
    assert np.array_equal(free.finger_force, paced.finger_force)
    assert np.abs(paced.finger_force[-1]).min() > 0.0
    assert paced.rest is None


def test_a_second_signal_ends_the_decay() -> None:
    """The first one between two calls of drivers is noted; after the second no force is written."""
    exits, hanging = Exits(), Exits()
    exits.ask(signal.SIGINT, None)
    states = [exits.at_once]
    exits.ask(signal.SIGINT, None)
    assert [*states, exits.at_once] == [False, True]
    hanging.inside = True
    with pytest.raises(Interruption):
        hanging.ask(signal.SIGTERM, None)
    assert hanging.at_once
