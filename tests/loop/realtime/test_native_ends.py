"""The loop without Python where it ends badly and where devices stand askew: zero is last, and all as in Python."""

from __future__ import annotations

import ctypes
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import graspfx as gx
from graspfx.assembly import run_scene as whole_run
from graspfx.assembly.replay_recording import replayed_with
from graspfx.commands.output import say_faults
from graspfx.environment import granted
from graspfx.errors import DeviceError
from graspfx.loop.device import Calls
from graspfx.loop.realtime import native_loop
from graspfx.loop.realtime.ring import Word
from tests.support.native_runs import COLUMNS, Session, both, driver, scene
from tests.support.optional import require
from tests.support.scripted_devices import Scripted

require("llvmlite")
if not sys.platform.startswith("linux"):
    pytest.skip("Python's loop runs elsewhere", allow_module_level=True)

TICKS = 260
SETTLING = 101  # readings before a run's first tick
HANG = 150  # a tick in which the fingers press
TILT = [[0.6, -0.8, 0.0], [0.48, 0.36, -0.8], [0.64, 0.48, 0.6]]


KIND = ctypes.CFUNCTYPE(ctypes.c_int64, ctypes.c_void_p, ctypes.c_void_p)


def hang_in(
    role: str, monkeypatch: pytest.MonkeyPatch, is_it: Callable[[Scripted], bool], at: int = HANG
) -> threading.Event:
    """Let a function of those devices wait, when it is called for that time, until the event is set."""
    release, real, count = threading.Event(), vars(Scripted)["calls"].fget, [0]

    def calls(device: Scripted) -> Calls:
        own: Calls = real(device)
        function = KIND(getattr(own, role)) if getattr(own, role) else lambda *_: 0

        @KIND
        def hang(context: int, block: int) -> int:
            count[0] += 1
            if count[0] == at:
                release.wait(60.0)
            return int(function(context, block))

        place = ctypes.cast(hang, ctypes.c_void_p).value
        assert place is not None
        return own._replace(**{role: place}, keep=(own.keep, hang)) if is_it(device) else own

    monkeypatch.setattr(Scripted, "calls", property(calls))
    return release


@pytest.mark.parametrize("role", ["ask", "read", "write"])
def test_a_function_that_returns_after_the_stop_brings_no_force_back(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, role: str
) -> None:
    """Python has stopped the devices beside it; the rest of its tick writes nothing, and stops them once more."""
    session = Session(scene(driver(tmp_path), TICKS, native=True))
    first, second = session.stations
    release, told = hang_in(role, monkeypatch, lambda device: device is first), list[Any]()

    def fault(k: int, text: str) -> None:
        told.append((k, text, [each.stops for each in (first, second)]))

    monkeypatch.setattr(session.recorder, "fault", fault)
    session.run(TICKS)
    [(tick, text, stops)] = told
    assert text == f"`{role}` of the device of finger0 (Scripted) has not returned for 0.1 s; all forces are zero"
    assert tick == HANG - 1 == len(session.recorder.recording())
    assert stops == [1, 1]  # before it was told
    before = [np.isfinite(each.written).all(axis=(1, 2)).sum() for each in (first, second)]
    stops = [each.stops for each in (first, second)]
    assert np.abs(second.written[: HANG - 1]).max() > 0.0
    release.set()
    lost: list[Any] = [*native_loop._LOST]
    [worker] = [each[-1] for each in lost if each[0] is session.native]
    assert worker.end(5.0)
    late = [np.isfinite(each.written).all(axis=(1, 2)).sum() for each in (first, second)]
    assert late == [before[0] + (role == "write"), before[1]]  # nothing but the call that was under way
    assert [each.stops for each in (first, second)] == [n + 1 for n in stops]
    with pytest.raises(DeviceError, match=f"`{role}` of the device of finger0"):
        session.run(1)
    session.finish()


def test_a_function_that_does_not_return_is_a_fault_of_the_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The recording has it, the run is not complete, and the command's exit code is that of a fault."""
    monkeypatch.setattr(whole_run, "is_possible", lambda: False)  # in this process
    release = hang_in("write", monkeypatch, lambda device: device.numbers[0, 0, 0, 0] > 0.0, 30)
    try:
        made = scene(driver(tmp_path), TICKS, native=True, rest=SETTLING)
        rec = gx.run(made, {"safety.watchdog": 60.0}, real_time=True, out=tmp_path / "rec")  # late is no matter here
    finally:
        release.set()
    [fault] = rec.faults
    assert fault.message.startswith("`write` of the device of finger1 (Scripted) has not returned for ")
    assert fault.tick == len(rec) == 29
    assert rec.outcome.cause == fault.message
    assert not rec.outcome.complete
    assert say_faults(rec) == 3


def test_devices_are_stopped_before_the_tick_of_a_fault_is_computed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:  # fmt: skip
    """When they are, the forces of the tick before still stand in the tick's memory, and its row is not there."""
    real, seen = vars(Scripted)["calls"].fget, list[Any]()

    def calls(device: Scripted) -> Calls:
        own: Calls = real(device)
        function = KIND(own.stop)

        @KIND
        def stop(context: int, block: int) -> int:
            commands = [float(each.port.command[0, 0]) for each in session.devices.ports]
            seen.append((session.stations.index(device), int(session.native._ring.words[Word.HEAD]), commands))
            return int(function(context, block))

        place = ctypes.cast(stop, ctypes.c_void_p).value
        assert place is not None
        return own._replace(stop=place, keep=(own.keep, stop))

    monkeypatch.setattr(Scripted, "calls", property(calls))
    session = Session(scene(driver(tmp_path), TICKS, native=True, codes=[0] * HANG + [-3]))
    session.run(HANG + 1)
    last = [float(each.written[HANG - 1, 0, 0]) for each in session.stations]
    assert [(i, head) for i, head, _ in seen] == [(1, HANG), (0, HANG)]  # the one that still answers first
    assert all(commands == last for _, _, commands in seen)
    assert min(abs(force) for force in last) > 0.01
    session.finish()


def test_devices_are_stopped_before_they_are_read_where_a_tick_is_late(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A tick that follows too many periods that were left out: the force of before them ends first."""
    real, events = vars(Scripted)["calls"].fget, list[str]()

    def noting(role: str, function: Any) -> Any:
        @KIND
        def note(context: int, block: int) -> int:
            events.append(role)
            if role == "write" and events.count(role) == 2 * HANG:
                session.native._pacer.row = 99
            return int(function(context, block))

        return note

    def calls(device: Scripted) -> Calls:
        own: Calls = real(device)
        noted = {role: noting(role, KIND(getattr(own, role))) for role in ("read", "write", "stop")}
        places = {role: ctypes.cast(each, ctypes.c_void_p).value or 0 for role, each in noted.items()}
        return own._replace(**places, keep=(own.keep, noted))

    monkeypatch.setattr(Scripted, "calls", property(calls))
    session = Session(scene(driver(tmp_path), TICKS, native=True))
    session.run(HANG + 1)
    last = len(events) - events[::-1].index("write")
    assert events[last : last + 4] == ["stop", "stop", "read", "read"]
    assert "99 successive periods of" in session.finish().outcome.faults[0].message


@pytest.mark.parametrize("scale", [0.5, 3.0])
def test_a_device_askew_is_that_of_pythons_loop(tmp_path: Path, scale: float) -> None:
    """A frame with a rotation, an origin and a scale: the same recording, and the same forces in the device's axes.

    What goes in as a velocity comes out as a force with the same power.
    """
    frame: Any = {"origin": [0.003, -0.001, 0.002], "axes": TILT, "scale": scale}
    base = scene(driver(tmp_path), TICKS, native=True, dimensions=3)
    table = dict(base.finger[0].device.settings)  # type: ignore[union-attr]
    turn, origin = np.array(TILT), np.array(frame["origin"])
    readings = np.array(table["readings"])
    readings[:, 0] = (readings[:, 0] - origin) @ turn / scale
    readings[:, 1] = readings[:, 1] @ turn / scale
    changes = {"finger.0.device.readings": readings.tolist(), "finger.0.device.frame": frame}
    python, one, native, other = both(driver(tmp_path), TICKS, dimensions=3, **changes)
    assert not one.outcome.faults
    for column in COLUMNS:
        assert getattr(one, column) == pytest.approx(getattr(other, column), abs=1e-12), column
    assert np.abs(one.displayed_force[:, 0]).max() > 0.01
    for first, second in zip(python.stations, native.stations, strict=True):
        assert second.written == pytest.approx(first.written, abs=1e-12, nan_ok=True)
    told, velocity = native.stations[0].written[:TICKS, 0], readings[:, 1, 0]
    power = np.sum(np.asarray(other.displayed_force)[:, 0] * np.asarray(other.finger_velocity)[:, 0], axis=1)
    assert np.sum(told * velocity, axis=1) == pytest.approx(power, abs=1e-12)


@pytest.mark.parametrize(
    "changes",
    [{"codes": [0] * 50 + [1, 1, 0, 0, 1, 1, 1]}, {"codes": [0] * 150 + [-3]}, {"safety.force": 0.05}],
    ids=["held samples", "a fault", "a limit"],
)
def test_a_recording_is_replayed_in_python(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, changes: dict[str, Any]
) -> None:
    """Ticks that machine code alone has recorded come out of the scene's tick again, to the bit."""
    monkeypatch.setattr(whole_run, "is_possible", lambda: False)  # in this process
    small = scene(driver(tmp_path), TICKS, native=True, rest=SETTLING, **changes)
    rec = gx.run(small, real_time=True, out=tmp_path / "rec")
    with granted(True):  # the driver is in a folder of its own
        replay = replayed_with(rec, {})
    assert [str(each) for each in replay.differences] == []
    assert len(replay.recording) == len(rec) > 0
    assert np.abs(rec.displayed_force).max() > 0.0 or rec.outcome.faults
