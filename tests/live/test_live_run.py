"""A live run: rows of now, values and goals that are posted from outside, pauses, new runs, and its end."""

from __future__ import annotations

import signal
import time
from itertools import groupby
from pathlib import Path

import numpy as np
import pytest

import graspfx as gx
from graspfx.live.guides import guided_scene
from graspfx.live.live_run import LiveRun
from graspfx.loop.recording.record import Recording
from graspfx.scene.model import Scene

pytestmark = pytest.mark.skipif(not hasattr(signal, "SIGHUP"), reason="processes of POSIX")

SPHERE, WAVING = "sphere-three-fingers", "paper-waving"
STIFFNESS = "coupling.external.stiffness"


def steered_again(rec: Recording, scene: Scene) -> Recording:
    """Run a scene step by step, with the changes of a recording at their ticks."""
    keys = list(dict.fromkeys(change.key for change in rec.changes))
    with gx.open(scene, live=keys) as session:
        for tick, changes in groupby(sorted(rec.changes, key=lambda change: change.tick), lambda change: change.tick):
            if tick > session.tick:
                session.step(tick - session.tick)
            session.set({change.key: change.value for change in changes})
        session.step(len(rec) - session.tick)
    return session.recording


def require_same(one: Recording, other: Recording) -> None:
    assert len(one) == len(other) > 0
    for name in ("finger_position", "finger_velocity", "finger_force", "object_position", "true_position"):
        assert np.array_equal(getattr(one, name), getattr(other, name)), name


@pytest.mark.parametrize("name", [SPHERE, WAVING])
def test_a_guided_run_is_the_run_that_its_recording_says(name: str, tmp_path: Path) -> None:
    """Goals come at any time, several between two ticks; stepped with the recorded changes the bits are the same."""
    scene, rng = gx.load(name), np.random.default_rng(3)
    with LiveRun(scene, live=[STIFFNESS], out=tmp_path, guide="hands") as run:
        d = run.layout.dimensions
        assert run.await_row(0, 5.0)
        for k in range(60):
            number = k % len(run.guides)
            run.guide(number, 0.004 * rng.standard_normal(d), 0.001 * float(rng.standard_normal()))
            if k == 20:
                future = run.set({STIFFNESS: 45.0})
            time.sleep(0.004 * float(rng.random()))
        future.result(10.0)
        assert run.scene.coupling.external.stiffness == 45.0
        time.sleep(0.1)
    rec = Recording.load(tmp_path / "recording.h5")
    goals = [change for change in rec.changes if ".guide." in change.key]
    assert len(goals) > 20
    assert not rec.outcome.lost
    require_same(rec, steered_again(rec, guided_scene(scene)))
    require_same(rec, gx.replay(rec))
    plain = gx.run(scene, duration=len(rec) * rec.header.period)
    assert np.abs(rec.finger_position - plain.finger_position).max() > 1e-3
