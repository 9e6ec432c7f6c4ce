"""A live run: rows of now, values and goals that are posted from outside, pauses, new runs, and its end."""

from __future__ import annotations

import os
import signal
import time
from itertools import groupby
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Literal

import numpy as np
import pytest

import graspfx as gx
from graspfx.assembly.process.orders import PausingPacer
from graspfx.errors import InputError, RecordingError, SceneError
from graspfx.live.guides import guided_scene
from graspfx.live.live_run import LiveRun
from graspfx.recording.record import Recording
from graspfx.scene.model import Scene
from tests.support.hardware import VirtualClock
from tests.support.parts import script
from tests.support.servo_wires import BUSY, PATIENT, board, boards_scene, servo_of, settled
from tests.support.waiting import wait_until

pytestmark = pytest.mark.skipif(not hasattr(signal, "SIGHUP"), reason="processes of POSIX")

PATIENCE = 60.0  # [s]
PLAIN = {"engine": "interpreted"}  # no program has to be compiled
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


def go(run: LiveRun, ticks: int) -> None:
    """Let a run that is paused go on by some ticks."""
    last = run.tick + ticks
    run.step(ticks)
    wait_until(lambda: run.tick == last)


@pytest.mark.parametrize("name", [SPHERE, WAVING])
def test_a_guided_run_is_the_run_that_its_recording_says(name: str, tmp_path: Path) -> None:
    """Goals come at any time, several between two ticks; stepped with the recorded changes the bits are the same."""
    scene = gx.load(name, PLAIN if name == SPHERE else {})  # one of them as users run it
    rng = np.random.default_rng(3)
    with LiveRun(scene, live=[STIFFNESS], out=tmp_path, guide="hands", paused=True) as run:
        d = run.layout.dimensions
        for k in range(60):
            number = k % len(run.guides)
            run.guide(number, 0.004 * rng.standard_normal(d), 0.001 * float(rng.standard_normal()))
            if k == 20:
                future = run.set({STIFFNESS: 45.0})
            if rng.random() < 0.7:
                go(run, int(rng.integers(1, 5)))
        go(run, 20)
        future.result(PATIENCE)
        assert run.scene.coupling.external.stiffness == 45.0
    rec = Recording.load(tmp_path / "recording.h5")
    goals = [change for change in rec.changes if ".guide." in change.key]
    assert len(goals) > 20
    assert not rec.outcome.lost
    require_same(rec, steered_again(rec, guided_scene(scene)))
    require_same(rec, gx.replay(rec))
    plain = gx.run(scene, duration=len(rec) * rec.header.period)
    assert np.abs(rec.finger_position - plain.finger_position).max() > 1e-3


def column(run: LiveRun, rows: np.ndarray[Any, np.dtype[np.float64]], name: str) -> Any:
    own = run.layout.columns[name]
    return rows[:, own.where].reshape(len(rows), *own.shape)


def test_values_before_the_first_tick_are_those_that_it_is_built_with() -> None:
    """Equal gains and no damping are special values; a run that begins with them is poked, paused and stepped."""
    keys = [
        f"coupling.{share}.{quantity}" for share in ("external", "internal") for quantity in ("stiffness", "damping")
    ]
    begin = gx.load(WAVING).replace(dict(zip(keys, (50.0, 0.0, 50.0, 0.0), strict=True)) | {"object.viscosity": 0.0})
    values = dict(zip(keys, (35.0, 0.2, 55.0, 0.3), strict=True)) | {"object.viscosity": 1.1}
    with LiveRun(begin, live=list(values), guide="hands", paused=True) as run:
        assert (run.state, run.tick, run.row(), run.rows(0)[1].shape[0]) == ("paused", -1, None, 0)
        change = run.set(values)
        go(run, 30)
        change.result(PATIENCE)
        time.sleep(1.3)  # longer than a servo without a tick may take
        assert (run.state, run.tick, run.cause) == ("paused", 29, "")
        go(run, 2)
        run.resume()
        wait_until(lambda: run.tick > 160)
        first, rows = run.rows(-5)
        assert first == 0
        row = run.row()
        assert row is not None
        assert row.shape == (run.layout.width,)
        assert run.rows(150)[0] == 150
        assert run.rows(10**9)[1].shape == (0, run.layout.width)
    built = gx.run(begin.replace(values), duration=len(rows) * run.period)
    for name in ("finger_position", "finger_force", "true_position"):
        assert np.array_equal(column(run, rows, name), getattr(built, name)), name
    assert run.state == "ended"
    with pytest.raises(InputError, match="it was closed"):
        run.set(values).result(PATIENCE)


def test_a_pause_is_not_late() -> None:
    """Periods of 5 ms; the time of a pause is no lateness, and its end begins a new grid of deadlines."""
    clock = VirtualClock()
    pacer = PausingPacer(0.005, clock)
    orders: Any = SimpleNamespace(is_paused=False)
    begin, pacer.orders = clock.now(), orders
    assert [pacer.wait() for _ in range(3)] == [0, 0, 0] and clock.now() - begin == pytest.approx(0.01)
    orders.is_paused = True
    assert pacer.wait(lambda: clock.now() - begin > 1.3) == 0
    orders.is_paused = False
    resumed = clock.now()
    assert [pacer.wait() for _ in range(2)] == [0, 0] and clock.now() - resumed == pytest.approx(0.01)
    clock.sleep(0.0125)
    assert pacer.wait() == 1  # what takes too long outside of a pause is late
    assert pacer.skipped == 1


def test_values_of_now_hold_or_are_refused_and_a_new_run_has_them(tmp_path: Path) -> None:
    with LiveRun(gx.load(WAVING, PLAIN), live=[STIFFNESS], guide="fingers") as run:
        assert [guide.name for guide in run.guides] == ["thumb", "forefinger"]
        assert [guide.position.tolist() for guide in run.guides] == [[-0.025, 0.0], [0.025, 0.0]]
        assert (run.has_hardware, run.run_number) == (False, 0)
        with pytest.raises(SceneError):
            run.set({STIFFNESS: -1.0}).result(PATIENCE)
        with pytest.raises(InputError, match="a live key"):
            run.set({"coupling.internal.stiffness": 1.0}).result(PATIENCE)
        for bad in ([np.nan, 0.0], [0.0, 1.5], [0.0], "here", [[0.0, 0.0]] * 3):
            with pytest.raises(InputError):
                run.guide(0, bad)
        with pytest.raises(InputError, match="a finite distance"):
            run.guide(0, None, np.inf)
        with pytest.raises(InputError, match="a guide, 0 to 1"):
            run.guide(2, [0.0, 0.0])
        futures = [run.set({STIFFNESS: 30.0 + k}) for k in range(20)]
        for future in futures:
            future.result(PATIENCE)
        assert run.scene.coupling.external.stiffness == 49.0
        with pytest.raises(InputError, match="a recorded run"):
            run.stop_recording()
        run.record(tmp_path)
        assert (run.run_number, run.state) == (1, "running")
        run.guide(1, [0.002, 0.001])
        assert run.await_row(40, PATIENCE)
        file = run.stop_recording()
        assert (run.run_number, file) == (2, tmp_path / "recording.h5")
        assert run.await_row(-1, PATIENCE)
        with pytest.raises(RecordingError, match="already"):
            run.record(tmp_path)
        assert run.await_row(run.tick + 5, PATIENCE), "it goes on"
        assert run._session._recorder.changes == []
    rec = Recording.load(file)
    assert rec.header.scene_table["coupling"]["external"]["stiffness"] == 49.0
    assert rec.changes
    require_same(rec, gx.replay(rec))


@pytest.mark.parametrize(("name", "kind", "settled"), [(WAVING, "fingers", 0.8), (SPHERE, "hands", 0.7)])
def test_a_guide_lets_go_smoothly_and_stays_away(name: str, kind: Literal["hands", "fingers"], settled: float) -> None:
    """The force falls to zero within 0.15 s without a step up; the finger may meet its object again, and leaves it."""
    scene = gx.load(name, PLAIN).replace({"finger.*.hand.motion": {"kind": "rest"}} if name == WAVING else {})
    with LiveRun(scene, guide=kind, paused=True) as run:
        go(run, round(settled / run.period))  # the same ticks every time
        begin = run.tick
        run.let_go(0)
        while run.time < settled + 2.5:  # in pieces: what looks after the guide keeps up with the ticks
            go(run, round(0.05 / run.period))
        _, rows = run.rows(begin)
        fingers = run.guides[0].fingers
        force = np.linalg.norm(column(run, rows, "finger_force"), axis=-1)[:, fingers].max(axis=1)
        assert force[0] > 0.2
        gone = int(np.argmin(force > 0.0))
        assert 0 < gone * run.period < 0.15
        assert np.diff(force[1:gone]).max() < 1e-3 * force[0]  # a goal moves a finger after the tick that takes it
        assert force[gone:].max() < force[0]
        assert not force[-round(0.3 / run.period) :].any()
        offsets = run._session.goals.values(0)[0].copy()
        run.guide(0, np.zeros(run.layout.dimensions))
        assert not np.array_equal(run._session.goals.values(0)[0], offsets)


def test_a_finger_that_is_let_go_on_its_way_leaves_the_object_that_it_meets() -> None:
    """It is free when it is let go, and its goal is inside the object: what looks after it withdraws it later."""
    scene = gx.load(WAVING, PLAIN).replace({"finger.*.hand.motion": {"kind": "rest"}, "finger.*.hand.squeeze": 0.0})
    with LiveRun(scene, guide="fingers", paused=True) as run:
        run.guide(0, [-0.01, 0.0])
        go(run, round(0.5 / run.period))
        run.guide(0, [0.01, 0.0])
        go(run, 2)
        run.let_go(0)
        begin = run.tick
        for _ in range(50):
            go(run, round(0.05 / run.period))
        _, rows = run.rows(begin)
        force = np.linalg.norm(column(run, rows, "finger_force"), axis=-1)[:, 0]
        assert force[0] == 0.0 and force.max() > 0.1
        assert not force[-round(0.3 / run.period) :].any()


def test_a_servo_that_dies_ends_its_run_and_a_reset_begins_another() -> None:
    with LiveRun(gx.load(WAVING, PLAIN), live=[STIFFNESS], guide="hands") as run:
        assert run.await_row(3, PATIENCE)
        run.pause()
        wait_until(lambda: run.state == "paused")
        os.kill(servo_of(os.getpid()), signal.SIGKILL)
        wait_until(lambda: run.state == "ended")
        wait_until(lambda: bool(run.cause))
        assert run.cause == "the servo's process was ended by SIGKILL"
        with pytest.raises(InputError, match="this run has ended: the servo's process was ended by SIGKILL"):
            run.set({STIFFNESS: 40.0}).result(PATIENCE)
        run.guide(0, [0.0, 0.0])
        run.let_go(0)
        assert not run.await_row(run.tick, PATIENCE)
        assert run.row() is not None
        run.reset()
        assert run.await_row(3, PATIENCE)
        assert (run.state, run.cause, run.run_number) == ("running", "", 1)
    run.close()


def test_a_step_of_no_number_of_ticks_is_refused() -> None:
    with LiveRun(gx.load(WAVING, PLAIN), paused=True) as run:
        for ticks in (0, -1, 1.5, float("nan"), float("inf"), "a", None, True, [1]):
            with pytest.raises(InputError, match=r"^ticks: given .*, expected a whole number, 1 or more"):
                run.step(ticks)  # type: ignore[arg-type]
        assert run.tick == -1
        run.step(np.int64(2))  # type: ignore[arg-type]
        wait_until(lambda: run.tick == 1)


PAUSED = """
import os, sys, time
import graspfx as gx
from graspfx.live.live_run import LiveRun
from tests.support.servo_wires import servo_of

run = LiveRun(gx.load("paper-waving", {"engine": "interpreted"}))
run.await_row(3, 60.0)
run.pause()
while run.state != "paused":
    time.sleep(0.01)
print(servo_of(os.getpid()))
sys.stdout.flush()
os._exit(0)
"""


def test_a_paused_servo_ends_with_its_parent(tmp_path: Path) -> None:
    servo = script(PAUSED, tmp_path)
    wait_until(lambda: not Path(f"/proc/{servo}").exists())


@pytest.mark.alone
def test_hardware_pauses_for_nobody_and_no_button_arms_it_again_after_a_fault(tmp_path: Path) -> None:
    """A fault is for whoever holds the device to look at: neither a recording nor its end begins a new run."""
    with board() as wire:
        scene = boards_scene([wire], PATIENT, **PLAIN, **BUSY)
        with settled(lambda: LiveRun(scene, live=["coupling.internal.stiffness"], guide="hands")) as run:
            assert run.has_hardware
            assert not run.guides
            for act in (run.pause, run.resume, run.step):
                with pytest.raises(InputError, match="a scene with simulated devices only"):
                    act()
            run.set({"coupling.internal.stiffness": 60.0}).result(PATIENCE)
            assert run.await_row(0, PATIENCE)
            run._session._relay.note_fault(run.tick, "the finger was too fast")
            session = run._session
            for again in (lambda: run.record(tmp_path), run.reset):
                with pytest.raises(InputError, match="hardware that has ended: the finger was too fast"):
                    again()
            assert run._session is session
            assert run.run_number == 0
            assert not list(tmp_path.iterdir())
            run.rest()
            assert run.state == "ended"
