"""Replay: fingers move as they were recorded, and forces and objects are those of the recording to the bit."""

from __future__ import annotations

import shutil
import signal
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import graspfx as gx
from graspfx import environment, plugins
from graspfx.assembly.build import build
from graspfx.assembly.hardware import at_hardware
from graspfx.assembly.live import keys_of, numbered
from graspfx.assembly.provenance import header_of
from graspfx.assembly.replay_recording import Replay, replayed_with
from graspfx.assembly.resolve import resolve
from graspfx.assembly.steering import Steering
from graspfx.errors import InputError, RecordingError, SceneError
from graspfx.loop.realtime.pacing import decay_ticks
from graspfx.recording.recorder import Recorder
from tests.support.hardware import EVIL, SETTLING, Evil, Fake, VirtualClock, driver
from tests.support.servo_wires import BUSY, PRESSED, board, boards_scene, settled
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


# Runs of hardware that go wrong in many ways on a clock without a wall, with keys that change meanwhile

T = 0.005
CART: dict[str, Any] = {
    "dimensions": 1, "period": T, "duration": 1.5, "engine": "interpreted",
    "object": {"mass": 0.1, "viscosity": 0.8, "shape": {"kind": "box", "size": [0.05]}},
    "coupling": {
        "external": {"stiffness": 30.0, "damping": 0.1}, "internal": {"stiffness": 70.0, "damping": 0.2},
        "absent": "follow", "enter": "ramp", "passivity": "observe",
    },
    "safety": {"force": 0.3, "rate": 40.0, "soft_start": 0.2, "speed": 1.0},
}  # fmt: skip
BALL: dict[str, Any] = {
    "dimensions": 3, "period": T, "duration": 1.0, "engine": "interpreted",
    "object": {
        "mass": 0.1, "viscosity": 0.8, "rotational_viscosity": 0.001, "shape": {"kind": "sphere", "radius": 0.03},
    },
    "coupling": {
        "external": {"stiffness": 30.0}, "internal": {"stiffness": 70.0}, "friction": 0.6, "absent": "follow",
        "enter": "ramp",
    },
}  # fmt: skip
SLIDER = ("coupling.internal.stiffness", "coupling.external.stiffness")
TURNS = {120: {SLIDER[0]: 400.0}, 160: {SLIDER[1]: 15.0, SLIDER[0]: 90.0}, 190: {SLIDER[0]: 900.0}}

Deed = Callable[[Fake, int], float | None]  # of a fake at a tick: the time of its reading, None for that of the reading


def samples(deed: Deed, jam: int | None = None) -> Evil:
    """Make fingers that move, and a deed of theirs from the first tick on; from tick `jam` on no force is taken."""

    def read(fake: Fake, p: Any, v: Any, t: float) -> Any:
        k = fake.tick
        phase = 2.0 * np.pi * k * T
        position = p * (1.0 - 0.02 * (1.0 - np.cos(phase)))
        velocity = -p * 0.02 * 2.0 * np.pi * np.sin(phase)
        told = deed(fake, k) if k >= 0 else None
        return position, velocity, t if told is None else told

    def write(fake: Fake, forces: Any) -> None:
        if jam is not None and fake.tick >= jam:
            raise OSError("jammed")

    return Evil(read=read, write=write)


def hold(fake: Fake, k: int) -> float | None:
    """Bring no new sample three times in a row, and once five times, so that forces begin to decay."""
    held = k % 40 in (7, 8, 9) or 140 <= k < 145
    if not held:
        fake.new = k  # type: ignore[attr-defined]
        return None
    return (fake.new + SETTLING + 1) * fake.period  # type: ignore[attr-defined]


def skip(fake: Fake, k: int) -> None:
    """Take so long that periods are left out."""
    VirtualClock.time += {50: 2.4, 90: 1.3, 91: 3.1}.get(k, 0.0) * T


def both(fake: Fake, k: int) -> float | None:
    skip(fake, k)
    return hold(fake, k)


def watchdog(fake: Fake, k: int) -> float | None:
    VirtualClock.time += 9.5 * T if k == 200 else 0.0
    return both(fake, k)


def unplug(fake: Fake, k: int) -> float | None:
    if k == 210:
        raise OSError("unplugged")
    return both(fake, k)


def fall_silent(fake: Fake, k: int) -> float | None:
    """Bring no new sample any more."""
    return (200 + SETTLING) * fake.period if k >= 200 else both(fake, k)


DEEDS: dict[str, tuple[Evil, str]] = {  # with words of the fault
    "held samples, periods left out": (samples(both), ""),
    "a watchdog": (samples(watchdog), "successive periods of 0.005 s were skipped"),
    "an unplugged device": (samples(unplug), "cannot be read: OSError: unplugged"),
    "a jammed device": (samples(both, 205), "cannot be written: OSError: jammed"),
    "a device that falls silent": (samples(fall_silent), "no new reading"),
}


def disturb(monkeypatch: pytest.MonkeyPatch, deed: str) -> str:
    """Let the first fake of a scene do a deed, and the others move; give words of the fault, nothing for none."""
    monkeypatch.setenv(environment.VARIABLE, "1")  # as the driver is elsewhere than the scene
    monkeypatch.setattr(VirtualClock, "time", 0.0)
    monkeypatch.setitem(EVIL, "moving", samples(lambda fake, k: None))
    evil, words = DEEDS[deed]
    monkeypatch.setitem(EVIL, "disturbed", evil)
    return words


def cart(folder: Path, **changes: Any) -> gx.Scene:
    """Squeeze a cart between a fake and a simulated finger."""
    fake = {"start": [-0.03], "device": _fake(folder, [[-0.02]], "disturbed")}
    partner = {
        "start": [0.025], "device": {"name": "simulated", "mass": 0.15, "damping": 0.2},
        "hand": {"stiffness": 60.0, "damping": 0.5},
    }  # fmt: skip
    return gx.Scene(**{**CART, "finger": [fake, partner]}).replace(changes)


def ball(folder: Path, **changes: Any) -> gx.Scene:
    """Hold a ball between four fakes."""
    way = np.array([[1.0, 0.3, 0.1], [-1.0, 0.2, -0.1], [0.0, -1.0, 0.2], [0.1, 0.2, -1.0]])
    places = 0.0285 * way / np.linalg.norm(way, axis=1)[:, None]
    evil = ["disturbed", *3 * ["moving"]]
    fingers = [
        {"start": (1.1 * p).tolist(), "device": _fake(folder, [p.tolist()], each)}
        for p, each in zip(places, evil, strict=True)
    ]
    return gx.Scene(**{**BALL, "finger": fingers}).replace(changes)


def _fake(folder: Path, position: Any, evil: str) -> dict[str, Any]:
    return {"name": str(driver(folder)), "position": position, "evil": evil, "at": -SETTLING}


def steered(scene: gx.Scene, ticks: int, changes: Mapping[int, Mapping[str, Any]]) -> gx.Recording:
    """Run a scene's hardware with keys that change before ticks."""
    keys = [numbered(scene, key) for key in keys_of(SLIDER)]
    parts, left = resolve(scene), dict(changes)
    with ExitStack() as stack:
        servo = stack.enter_context(build(scene, live=keys, real_time=True))
        steering, now = Steering(servo, scene, keys), [scene]
        hardware = stack.enter_context(at_hardware(servo, parts, VirtualClock()))
        recorder = stack.enter_context(Recorder(servo.layout, hardware.header(header_of(parts, servo.objects))))

        def look() -> bool:
            values = left.pop(servo.ticks, None)
            if values is not None:
                now[0] = now[0].replace(values)
                servo.write(steering.update(now[0], values), recorder)
            return False

        hardware.run(ticks, recorder, look)
        return recorder.finish(engine=servo.engine.name, **hardware.outcome, **servo.coupling)


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
        tank = rec.objects["object"].tank
        assert make is ball or (tank is not None and tank.min() < 0.5 * tank.max())  # for a while it is empty
        replay = same(rec)
        assert replay.recording.faults == rec.faults
        assert replay.recording.rest == rec.rest


@pytest.mark.skipif(not hasattr(signal, "SIGHUP"), reason="processes of POSIX")
def test_a_session_with_hardware_in_a_process_of_its_own() -> None:
    """A 2DIY on its emulated line is pressed into a ball while the stiffness grows and falls."""
    key = "coupling.internal.stiffness"
    with board() as wire, settled(lambda: gx.open(boards_scene([wire], **BUSY), real_time=True, live=[key])) as session:
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


def test_overrides_are_an_open_loop() -> None:
    """Twice the stiffness on the same way: fingers move as before, and forces are others."""
    rec = gx.run("reference-1dof", duration=0.3)
    stiffness = rec.header.scene_table["coupling"]["internal"]["stiffness"]
    replay = replayed_with(rec, {"coupling.internal.stiffness": 2.0 * stiffness})
    assert replay.is_open_loop
    assert np.array_equal(replay.recording.finger_position, rec.finger_position)
    assert {each.column for each in replay.differences} >= {"finger_force"}
    assert np.abs(replay.recording.finger_force).max() > 1.2 * np.abs(rec.finger_force).max()
    with pytest.raises(InputError, match="do not change the recorded fingers, dimensions and period"):
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
    ({"record.every": 2}, "a replay needs every tick, but this recording has only one in 2"),
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
    with pytest.raises(RecordingError, match=r"cannot be restored; its paths are relative to .*there; .*mesh"):
        gx.replay(rec)
