"""Replay: fingers move as they were recorded, and forces and objects are those of the recording to the bit."""

from __future__ import annotations

import shutil
import signal
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import graspfx as gx
from graspfx import environment, plugins
from graspfx.build.replay import Replay, replayed_with
from graspfx.errors import InputError, RecordingError, SceneError
from graspfx.loop.realtime.soft_end import decay_ticks
from tests.support.disturbed import DEEDS, TURNS, ball, cart, disturb, steered
from tests.support.servo_wires import PRESSED, board, boards_scene, settled
from tests.support.waiting import wait_until

SHELF = sorted(p.stem.replace("_", "-") for p in plugins.shelf("scenes").iterdir() if p.suffix in (".toml", ".py"))
OF_THE_LOOP = {"wall", "late", "io", "skipped", "fresh", "largest_force", "switches"}


def same(rec: gx.Recording, **overrides: Any) -> Replay:
    """Replay a recording, and require every column of it that follows from the fingers' motion to the bit."""
    replay = replayed_with(rec, overrides)
    assert [str(each) for each in replay.differences] == []
    assert not replay.is_open_loop
    missing = rec.layout.columns.keys() - replay.recording.layout.columns.keys()
    assert {name for name in missing if not name.startswith("raw/")} <= OF_THE_LOOP
    assert len(replay.recording) == len(rec)
    return replay


@pytest.mark.parametrize("name", SHELF)
def test_scenes_of_the_shelf(name: str) -> None:
    """Each is recorded for a moment in which its fingers touch, and has the same forces, objects and energies again.

    Interpreted, as there are many; engines compute the same.
    """
    rec = gx.run(name, {"engine": "interpreted"}, duration=0.3)
    same(rec)
    assert np.abs(rec.finger_force).max() > 0.0


def test_engines_of_run_and_replay() -> None:
    """A compiled run is replayed interpreted, and the other way round; steered, and from a file."""
    for one, other in (("compiled", "interpreted"), ("interpreted", "compiled")):
        rec = gx.run("reference-1dof", {"engine": one}, duration=0.2)
        assert rec.outcome.engine == one
        assert same(rec, engine=other).recording.outcome.engine == other


def test_a_session_that_was_steered(tmp_path: Path) -> None:
    """A gain, friction and the object's mass changed in mid-run; the replay has their changes too."""
    live = ["coupling.internal.stiffness", "coupling.friction", "object.0.mass"]
    start = {"coupling.friction": 0.4, "engine": "interpreted"}
    with gx.open("sphere-three-fingers", start, live=live, out=tmp_path) as session:
        session.step(20)
        session.set({"coupling.internal.stiffness": 90.0, "coupling.friction": 0.7})
        session.step(20)
        session.set("object.0.mass", 0.2)
        session.step(30)
    rec = gx.Recording.load(tmp_path)
    assert [change.tick for change in rec.changes] == [20, 20, 40]
    assert same(rec).recording.changes == rec.changes


@pytest.mark.parametrize("deed", DEEDS)
def test_a_disturbed_run(deed: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Held samples, periods left out, a decay, gains that change under load, an entry, and each kind of fault.

    The cart has a ledger, a tank that does not pay for all at once, a rate, and a simulated partner; the ball has four
    devices, friction, and the chain that hardware is never without.
    """
    for make in (cart, ball):
        words = disturb(monkeypatch, deed)
        rec = steered(make(tmp_path), 250, TURNS)
        assert rec.skipped is not None
        assert rec.skipped.sum() >= 3
        assert rec.fresh is not None
        assert 0.02 < 1.0 - rec.fresh[:, 0].mean() < 0.4
        assert [words in fault.message for fault in rec.faults] == ([True] if words else [])
        assert [change.tick for change in rec.changes] == [120, 160, 160, 190]
        scale = rec.objects["object"].scale
        assert scale is not None
        assert scale[100:200, 1].min() < 1.0
        assert np.abs(rec.displayed_force[100:]).max() > 0.01
        replay = same(rec)
        assert replay.recording.faults == rec.faults
        assert replay.recording.rest == rec.rest


@pytest.mark.skipif(not hasattr(signal, "SIGHUP"), reason="processes of POSIX")
def test_a_session_with_hardware_in_a_process_of_its_own() -> None:
    """A 2DIY on its emulated line is pressed into a ball while the stiffness grows and falls."""
    key = "coupling.internal.stiffness"
    with board() as wire, settled(lambda: gx.open(boards_scene([wire]), real_time=True, live=[key])) as session:
        wire.place(np.array(PRESSED))
        wait_until(lambda: bool(np.abs(wire.torque).max() > 1e-3))
        session.set(key, 100.0)
        session.wait(0.1)
        session.set(key, 20.0)
        session.wait(0.1)
    rec = session.recording
    assert [change.value for change in rec.changes] == [100.0, 20.0]
    assert rec.faults or rec.rest == len(rec) - decay_ticks(rec.period)  # a machine that is too late is a fault
    assert same(rec).recording.changes == rec.changes
    angles = rec.raw["finger0"]  # what the board answered
    assert angles.shape == (len(rec), 2)
    assert np.rad2deg(angles[-1]) == pytest.approx(PRESSED, abs=0.1)


def test_tank_of_the_disturbed_run_is_empty_for_a_while(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    disturb(monkeypatch, "held samples, periods left out")
    tank = steered(cart(tmp_path), 250, TURNS).objects["object"].tank
    assert tank is not None
    assert tank.min() < 0.5 * tank.max()


def test_overrides_are_an_open_loop() -> None:
    """Twice the stiffness on the same way: fingers move as before, and forces are others."""
    rec = gx.run("reference-1dof", duration=0.3)
    stiffness = rec.header.scene_table["coupling"]["internal"]["stiffness"]
    replay = replayed_with(rec, {"coupling.internal.stiffness": 2.0 * stiffness})
    assert replay.is_open_loop
    assert np.array_equal(replay.recording.finger_position, rec.finger_position)
    assert {each.column for each in replay.differences} >= {"finger_force"}
    assert np.abs(replay.recording.finger_force).max() > 1.2 * np.abs(rec.finger_force).max()
    with pytest.raises(InputError, match="leave fingers, dimensions and period"):
        gx.replay(rec, {"period": 0.001})
    with pytest.raises(SceneError, match=r"coupling\.internal\.stifness"):
        gx.replay(rec, {"coupling.internal.stifness": 50.0})


def test_a_replay_says_what_it_is(tmp_path: Path) -> None:
    """It can be written, loaded and replayed itself."""
    rec = gx.run("paper-waving", duration=0.1, out=tmp_path / "run")
    again = gx.replay(tmp_path / "run", out=tmp_path / "again")
    stored = gx.Recording.load(tmp_path / "again")
    assert stored.header.replays == f"paper-waving, recorded {rec.header.created}"
    assert np.array_equal(stored.rows, again.rows)
    assert rec.header.replays == ""
    same(stored)
    with pytest.raises(RecordingError, match="already"):
        gx.replay(rec, out=tmp_path / "again")


def test_largest_forces_that_move_with_the_arm() -> None:
    """They are no column of a simulation: it is run once more for them, and the limit bites."""
    scene = gx.load("paper-spring-arms", {"finger.*.device.drive": "elbow", "coupling.internal.stiffness": 900.0})
    rec = gx.run(scene, {"finger.*.device.torque_limit": 0.001}, duration=0.3)
    assert "largest_force" not in rec.layout.columns
    assert rec.saturated is not None
    assert rec.saturated.mean() > 0.1
    size = np.linalg.norm(rec.displayed_force, axis=2)[rec.saturated]
    assert np.ptp(size) > 1e-6
    same(rec)


REFUSED: list[tuple[dict[str, Any], str]] = [
    ({"record.every": 2}, "a replay needs every tick, and this recording has one in 2"),
    ({"record.columns": ["finger_force"]}, "a replay needs finger_position, finger_velocity, which .*record.columns"),
]


@pytest.mark.parametrize(("record", "words"), REFUSED)
def test_recordings_that_lack_something_are_refused(record: dict[str, Any], words: str) -> None:
    rec = gx.run("reference-1dof", record, duration=0.1)
    with pytest.raises(RecordingError, match=words):
        gx.replay(rec)


def test_columns_that_suffice() -> None:
    """Columns that are not recorded are not compared."""
    same_columns = ["finger_position", "finger_velocity", "finger_force"]
    rec = gx.run("reference-1dof", {"record.columns": same_columns}, duration=0.1)
    replay = replayed_with(rec, {})
    assert not replay.differences
    assert replay.recording.objects["object"].position.shape == (20, 1)


def test_a_mesh_that_moved(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its file is looked for where the scene was; another place can be told, and another mesh is seen."""
    monkeypatch.setenv(environment.VARIABLE, "1")
    shelf = plugins.shelf("scenes")
    (tmp_path / "there").mkdir()
    shutil.copytree(shelf / "meshes", tmp_path / "there" / "meshes")
    scene = (shelf / "mug.toml").read_text()
    (tmp_path / "there" / "mug.toml").write_text(scene)
    rec = gx.run(tmp_path / "there" / "mug.toml", duration=0.05)
    same(rec)
    (tmp_path / "there").rename(tmp_path / "here")
    with pytest.raises(RecordingError, match=r"cannot be made again; its paths start in .*there; .*mesh"):
        gx.replay(rec)
