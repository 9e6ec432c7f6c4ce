"""A session is a run: stepped in any way it has the same bits, and all of it can be looked at on the way."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import graspfx as gx
from graspfx.errors import InputError, RecordingError, UnknownNameError
from graspfx.recording.files import NAME

ENGINES = ("interpreted", "compiled", "auto")
LINE = "reference-1dof"


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("steps", [[200], [1] * 20 + [80, 100], [16, 1, 83, 7, 93]], ids=["one", "single", "uneven"])
def test_a_session_has_the_bits_of_a_run(engine: str, steps: list[int]) -> None:
    changes = {"engine": engine, "coupling.internal.damping": 0.1}
    with gx.open(LINE, changes) as session:
        for count in steps:
            session.step(count)
    whole = gx.run(gx.load(LINE, changes), duration=1.0)
    assert session.recording.rows.tobytes() == whole.rows.tobytes()
    assert session.recording.outcome.complete and session.recording.header.scene == LINE


def test_a_scene_a_name_and_a_path_open_the_same() -> None:
    scene = gx.load(LINE)
    assert scene.source.path is not None
    sessions = [gx.open(scene), gx.open(LINE), gx.open(scene.source.path)]
    for session in sessions:
        session.step(3)
        session.close()
    assert len({session.recording.rows.tobytes() for session in sessions}) == 1
    with pytest.raises(InputError, match="expected a scene"):
        gx.open(3.0)  # type: ignore[call-overload]
    with pytest.raises(UnknownNameError, match="unknown scene 'reference-2dof'"):
        gx.open("reference-2dof")


def test_what_is_seen_is_the_last_row() -> None:
    with gx.open("paper-waving", {"engine": "interpreted"}) as session:
        start = np.array([finger.start for finger in session.scene.finger])
        assert np.array_equal(session.position, start) and not session.force.any() and not session.touching.any()
        assert (session.tick, session.time, session.fault) == (0, 0.0, None)
        assert session.objects["object"].orientation == 0.0 and not session.objects["object"].wrench.any()
        for _ in range(3):
            session.step(25)
            so_far = session.recording
            assert len(so_far) == session.tick and not so_far.outcome.complete
            assert np.array_equal(session.position, so_far.finger_position[-1])
            assert np.array_equal(session.velocity, so_far.finger_velocity[-1])
            assert np.array_equal(session.force, so_far.finger_force[-1])
            assert np.array_equal(session.touching, so_far.touching[-1])
            seen, motion = session.objects["object"], so_far.objects["object"]
            assert motion.orientation is not None and motion.angular_velocity is not None
            assert np.array_equal(seen.position, motion.position[-1])
            assert np.array_equal(seen.velocity, motion.velocity[-1])
            assert (seen.orientation, seen.angular_velocity) == (motion.orientation[-1], motion.angular_velocity[-1])
            assert np.array_equal(seen.wrench, motion.wrench[-1])
        assert session.recording is so_far  # not put together again
        assert (session.tick, session.time) == (75, 75 * 0.005)


@pytest.mark.parametrize(("name", "shape"), [(LINE, None), ("sphere-three-fingers", (4,))])
def test_orientations_are_those_of_the_dimensions(name: str, shape: tuple[int, ...] | None) -> None:
    with gx.open(name, {"engine": "interpreted"}) as session:
        for _ in range(2):
            [thing] = session.objects.values()
            assert getattr(thing.orientation, "shape", None) == shape
            assert getattr(thing.angular_velocity, "shape", None) == (None if shape is None else (3,))
            session.step()


def test_a_view_is_not_the_run() -> None:
    with gx.open(LINE, {"engine": "interpreted"}) as session:
        session.step(5)
        seen = session.force
        seen[:] = 99.0
        session.objects["object"].position[:] = 99.0
        assert session.force.max() < 99.0 and session.objects["object"].position.max() < 99.0


def test_a_session_says_what_it_is() -> None:
    with gx.open(LINE, live=["coupling.internal.stiffness"]) as session:
        session.step(4)
        assert repr(session) == (
            "<Session of reference-1dof, open: 4 ticks, 0.02 s, live: coupling.internal.stiffness>"
        )
    assert "closed" in repr(session)


def test_a_block_that_breaks_off_leaves_devices_closed_and_the_recording() -> None:
    session = gx.open(LINE)

    def break_off() -> None:
        with session:
            session.step(7)
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        break_off()
    assert len(session.recording) == 7 and not session.recording.outcome.complete
    assert session.recording.wall_time is None
    with pytest.raises(Exception, match="not open"):
        session.servo.stations[0].device.read()
    with pytest.raises(InputError, match="closed"):
        session.step()
    with pytest.raises(InputError, match="expected an open session; this session is closed"), session:
        pass
    session.close()  # a second time nothing happens
    assert not session.recording.outcome.complete


@pytest.mark.parametrize("ticks", [0, -1, 1.5, True - 1, True, np.True_, "one", None, float("nan"), 10**30])
def test_steps_that_are_none(ticks: object) -> None:
    with gx.open(LINE) as session:
        with pytest.raises(InputError, match=r"ticks|periods"):
            session.step(ticks)  # type: ignore[arg-type]
        assert session.tick == 0


def test_a_session_is_written_like_a_run(tmp_path: Path) -> None:
    with gx.open(LINE, out=tmp_path / "a") as session:
        session.step(300)
        assert len(session.recording) == 300  # what was asked for is on the disk
        part = gx.Recording.load(tmp_path / "a")
        assert len(part) == 300 and not part.outcome.complete
    written = gx.Recording.load(tmp_path / "a")
    assert written.rows.tobytes() == session.recording.rows.tobytes()
    assert (written.header, written.outcome) == (session.recording.header, session.recording.outcome)
    with pytest.raises(RecordingError, match="already"):
        gx.open(LINE, out=tmp_path / "a")
    with gx.open(LINE, out=tmp_path / "a", overwrite=True) as session:
        session.step(2)
    assert len(gx.Recording.load(tmp_path / "a" / NAME)) == 2
    with pytest.raises(InputError, match="the path of a folder"):
        gx.open(LINE, out=3)  # type: ignore[call-overload]


def test_a_session_that_never_ticks(tmp_path: Path) -> None:
    with gx.open(LINE, out=tmp_path / "a") as session:
        assert len(session.recording) == 0
    assert len(gx.Recording.load(tmp_path / "a")) == len(session.recording) == 0


def test_a_fault_is_told_and_the_session_goes_on() -> None:
    scene = gx.load(LINE, {"finger.0.device.workspace": [[-0.1], [0.0021]], "finger.0.hand.rest": [0.1]})
    with gx.open(scene) as session:
        session.step(200)
        assert session.fault is not None and "workspace" in session.fault.message
        assert "fault at tick" in repr(session)
        assert not session.force.any()
    assert session.recording.faults == (session.fault,)
    assert session.recording.rows.tobytes() == gx.run(scene, duration=1.0).rows.tobytes()


def test_an_object_that_is_none_is_told_with_those_that_are() -> None:
    pytest.importorskip("pybullet", reason="pybullet has no wheel for this Python or platform")
    with gx.open("two-objects", {"engine": "interpreted"}) as session:
        session.step()
        for objects in (session.objects, session.recording.objects):
            with pytest.raises(
                UnknownNameError, match=r"^unknown object 'blok'; did you mean 'block'\? \(known: base, bl"
            ):
                objects["blok"]
            with pytest.raises(KeyError):
                objects["cube"]
            assert "cube" not in objects and objects.get("cube") is None
            assert list(objects) == ["base", "block"]
            with pytest.raises(TypeError):
                objects["cube"] = objects["base"]  # type: ignore[index]
