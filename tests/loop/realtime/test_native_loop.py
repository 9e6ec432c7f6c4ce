"""The loop without Python: the same recordings, forces and faults as Python's, to the bit."""

from __future__ import annotations

import ctypes
import sys
import threading
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import graspfx as gx
from graspfx.assembly import run_scene as whole_run
from graspfx.errors import DeviceError
from graspfx.loop.device import Calls
from graspfx.loop.realtime.pacing import ClockState, Lateness, Pacer
from graspfx.loop.realtime.ring import SLOTS
from tests.support.native_runs import COLUMNS, PERIOD, Session, both, driver, scene
from tests.support.optional import require
from tests.support.scripted_devices import Scripted

require("llvmlite")
if not sys.platform.startswith("linux"):
    pytest.skip("Python's loop runs elsewhere", allow_module_level=True)

TICKS = 260
SETTLING = 101  # readings before a run's first tick
KINDS: dict[str, tuple[dict[str, Any], str]] = {
    "all well": ({}, ""),
    "in the plane": ({"dimensions": 2}, ""),
    "compiled for the scene": ({"engine": "compiled"}, ""),
    "held samples": ({"codes": [0] * 50 + [1, 1, 0, 0, 1, 1, 1]}, ""),
    "no new sample any more": ({"codes": [0] * 50 + [1] * 30}, "no new reading"),
    "held for too long, without the chain's decay": (
        {"codes": [0] * 50 + [1] * 30, "safety.hold": 0},
        "no new reading",
    ),
    "a read that fails": ({"codes": [0] * 60 + [-3]}, "code -3"),
    "a read that fails at once": ({"codes": [-3]}, "code -3"),
    "a write that fails": ({"refusals": [0] * 60 + [-3]}, "code -3"),
    "NaN": ({"spoil": (100, np.nan)}, "which are not finite"),
    "infinity": ({"spoil": (100, [[[np.inf]], [[0.0]]])}, "which are not finite"),
    "a jump": ({"spoil": (100, [[[0.5]], [[0.0]]])}, "returned a position 0.5"),
    "too quick": ({"spoil": (100, [[[-0.0255]], [[40.0]]])}, "returned a velocity of 40 m/s"),
    "zeros": ({"spoil": (100, 0.0)}, "returned only zeros"),
    "a limit": ({"safety.force": 0.05}, ""),
    "every third tick": ({"record.every": 3}, ""),
}


@pytest.mark.parametrize("kind", KINDS)
def test_recordings_are_those_of_pythons_loop(tmp_path: Path, kind: str) -> None:
    """Positions, velocities, forces, what each device was told, counts and the fault's words: all the same."""
    changes, says = KINDS[kind]
    python, one, native, other = both(driver(tmp_path), TICKS, **changes)
    assert one.ticks == other.ticks
    for column in COLUMNS:
        assert np.array_equal(getattr(one, column), getattr(other, column)), column
    assert float(np.abs(one.displayed_force).max()) > 0.0 or says
    for first, second in zip(python.stations, native.stations, strict=True):
        assert np.array_equal(first.written, second.written, equal_nan=True)
        assert first.stops == second.stops
        assert (second.reads, second.python_writes) == (0, 0)
    assert python.devices.repeats == native.devices.repeats
    assert len(one.outcome.faults) == len(other.outcome.faults) == bool(says)
    for fault, same in zip(one.outcome.faults, other.outcome.faults, strict=True):
        assert fault.tick == same.tick
        assert says in fault.message
        assert says in same.message
    if says:
        later = native.stations[1].written[one.outcome.faults[0].tick + 1 :]
        assert np.isnan(later).all()  # nobody is written to after a fault


@pytest.mark.parametrize(
    "kind", ["all well", "held samples", "a read that fails", "a write that fails", "NaN", "a jump", "a limit"]
)
def test_machine_code_is_what_its_source_says(tmp_path: Path, kind: str) -> None:
    """The source of a beat, run by Python, leaves the same in every device, every row and every memory, to the bit."""
    changes = dict(KINDS[kind][0])
    spoil, sessions, recordings = changes.pop("spoil", None), [], []
    for is_interpreted in (False, True):
        session = Session(scene(driver(tmp_path), TICKS, native=True, **changes))
        if spoil is not None:
            session.stations[0].numbers[spoil[0]] = spoil[1]
        if is_interpreted:
            session.interpret()
        session.run(TICKS)
        sessions.append(session)
        recordings.append(session.finish())
    for column in COLUMNS:
        assert np.array_equal(*[getattr(each, column) for each in recordings]), column
    assert len(recordings[0]) == TICKS
    first, second = sessions
    for one, other in zip(first.devices.ports, second.devices.ports, strict=True):
        assert np.array_equal(one.readings.memory, other.readings.memory, equal_nan=True)
        mine: Any = one.device
        theirs: Any = other.device
        assert np.array_equal(mine.written, theirs.written, equal_nan=True)
        assert mine.stops == theirs.stops
    assert [each.tick for each in recordings[0].faults] == [each.tick for each in recordings[1].faults]
    assert first.native.words.tolist() == second.native.words.tolist()
    assert first.pacer.array(ClockState.wall) == second.pacer.array(ClockState.wall)


@pytest.mark.parametrize("code", [2, 7, 1 << 40])
def test_a_code_of_no_meaning_is_a_fault(tmp_path: Path, code: int) -> None:
    """A `read` that returns neither 0 nor 1 has said nothing about its block: it counted as a new sample."""
    session = Session(scene(driver(tmp_path), TICKS, native=True, codes=[0] * 140 + [code] * 5))
    session.run(TICKS)
    rec = session.finish()
    [fault] = rec.faults
    assert fault.tick == 140
    assert (
        f"finger0 (Scripted) cannot be read: its C function returned {code}, expected 0 (new sample)" in fault.message
    )
    assert rec.displayed_force[139].any() and not rec.displayed_force[140:].any()


def test_forces_keep_within_the_limit_of_the_device(tmp_path: Path) -> None:
    """The loop limits what it tells C functions, as a driver's `write` does; a recording has what came before."""
    session = Session(scene(driver(tmp_path), TICKS, native=True, dimensions=2, **{"safety.force": 2.0}))
    device = session.stations[0]
    device.features = replace(device.features, peak_force=0.01)  # which the chain knows nothing of
    session.run(TICKS)
    rec = session.finish()
    force, told = rec.displayed_force[:, 0], device.written[:TICKS, 0]
    over = np.linalg.norm(force, axis=1) > 0.01
    assert over.any()
    assert np.linalg.norm(told, axis=1).max() <= 0.01 * (1.0 + 1e-15)
    assert told[over] == pytest.approx(0.01 * force[over] / np.linalg.norm(force[over], axis=1)[:, None], abs=1e-15)
    assert np.array_equal(told[~over], force[~over])


def test_runs_in_pieces_are_one_run(tmp_path: Path) -> None:
    """All that there is goes on from one call to the next: deadlines, samples, counts."""
    whole, pieces = (Session(scene(driver(tmp_path), TICKS, native=True)) for _ in range(2))
    whole.run(TICKS)
    for count in (1, 2, 57, 100, 100):
        pieces.run(count)
    one, other = whole.finish(), pieces.finish()
    for column in COLUMNS[:-1]:  # forces decay at the end of each piece
        assert np.array_equal(getattr(one, column)[:1], getattr(other, column)[:1]), column
    assert other.ticks == TICKS
    assert np.array_equal(one.finger_position, other.finger_position)


def test_a_device_that_cannot_be_stopped_is_a_fault(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def calls(device: Scripted) -> Calls:
        own = real(device)
        return own._replace(stop=own.write)  # which fails by then

    real = vars(Scripted)["calls"].fget
    monkeypatch.setattr(Scripted, "calls", property(calls))
    session = Session(scene(driver(tmp_path), TICKS, native=True, refusals=[0] * 60 + [-3] * 200))
    for device in session.stations[1:]:
        device.refusals[60:] = -4
    session.run(TICKS)
    faults = session.finish().outcome.faults
    assert [fault.tick for fault in faults] == [60, 60]
    says = "finger1 (Scripted) cannot be stopped, and its force may remain; switch the device off: code -4"
    assert says in faults[1].message


def test_a_device_without_its_functions_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    session = Session(scene(driver(tmp_path), TICKS, native=True))
    monkeypatch.setattr(Scripted, "calls", property(lambda device: None))
    with pytest.raises(DeviceError, match="offers C functions, but returns none after opening"):
        session.run(1)
    session.finish()


def test_no_python_runs_in_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """While another thread keeps the interpreter for 50 ticks the loop goes on, and all rows are there."""
    monkeypatch.setattr(whole_run, "is_possible", lambda: False)  # in this process
    ticks, before = 1000, sys.getswitchinterval()
    began, busy = threading.Event(), threading.Event()

    def hog() -> None:
        began.wait()
        sys.setswitchinterval(100.0)
        busy.set()  # whoever waits for it is back when this thread has let go of the interpreter
        first, end = count(), time.perf_counter() + 60.0
        while count() < first + 50 and time.perf_counter() < end:
            pass
        looks.append((count() - first, time.perf_counter()))
        sys.setswitchinterval(before)

    thread = threading.Thread(target=hog)
    thread.start()
    file = driver(tmp_path)
    small = scene(file, ticks, native=True, rest=SETTLING).replace({"safety.watchdog": 60.0})  # late is no matter here
    looks: list[tuple[int, float]] = []
    returns: list[float] = []

    def count() -> int:
        return int(newest(file).context[0])

    def stop() -> bool:
        if not began.is_set():
            began.set()
            busy.wait()
            returns.append(time.perf_counter())
        return False

    try:
        rec = gx.run(small, real_time=True, stop=stop)
    finally:
        began.set()
        thread.join()
        sys.setswitchinterval(before)
    device = newest(file)
    assert rec.ticks == ticks
    assert rec.outcome.lost == 0
    assert not rec.outcome.faults
    assert device.reads == SETTLING
    assert device.python_writes == SETTLING - 1
    assert int(device.context[0]) >= SETTLING + ticks - 1
    [(done, end)] = looks
    assert done >= 50
    assert returns[0] > end  # nobody else in Python came meanwhile


def newest(file: Path) -> Any:
    """Give the device of a driver that was connected last."""
    return next(m for m in sys.modules.values() if getattr(m, "__file__", "") == str(file)).devices[-1]


def test_many_ticks_lose_no_row(tmp_path: Path) -> None:
    """More ticks than the ring has rows, at once; the rows of a recorder that is away for too long are told as lost."""
    ticks = 3 * SLOTS
    session = Session(scene(driver(tmp_path), 400, native=True))
    for _ in range(12):
        session.run(ticks // 12)
    assert session.pacer.duration.array(Lateness.counts).sum() == ticks
    rec = session.finish()
    assert rec.ticks == ticks
    assert not rec.outcome.faults
    assert np.isfinite(rec.finger_position).all()
    assert np.array_equal(rec.finger_position[400:], np.repeat(rec.finger_position[400:401], ticks - 400, axis=0))


@pytest.mark.parametrize("every", [1, 3])
def test_rows_that_were_lost_are_told(every: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The message counts the rows that are NaN, also where one tick in three has a row."""
    session = Session(scene(driver(tmp_path), 400, native=True, **{"record.every": every}), selected=True)
    native = session.native
    drain = native._drain

    def late(recorder: Any, ring: Any) -> int:
        return drain(recorder, ring) if ring.words[0] >= ticks else int(ring.words[0])

    ticks = every * (SLOTS + 9)
    monkeypatch.setattr(native, "_drain", late)
    session.run(ticks)
    rec = session.finish()
    [fault] = rec.outcome.faults
    assert fault.message == f"10 rows are lost: the recorder did not read for {every * SLOTS} ticks"
    assert np.flatnonzero(np.isnan(rec.finger_position).all(axis=(1, 2))).tolist() == list(range(10))
    assert len(rec) == SLOTS + 9


def test_deadlines_are_absolute(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A run of 150 ticks of 2 ms takes 0.3 s, however late each of them is, and says of each how late it was."""
    monkeypatch.setattr(whole_run, "is_possible", lambda: False)
    rec = gx.run(
        scene(driver(tmp_path), 150, native=True, rest=SETTLING).replace({"safety.watchdog": 60.0}), real_time=True
    )
    assert rec.header.scheduling["loop"] == "inline"
    wall, late, skipped, io = (np.asarray(getattr(rec, name)) for name in ("wall", "late", "skipped", "io"))
    grid = PERIOD * (np.arange(150) + np.cumsum(skipped.ravel()))
    rounding = 150 * np.spacing(time.monotonic())  # of deadlines, which are counted on from one to the next
    assert wall.ravel() - late.ravel() == pytest.approx(grid, abs=1e-9 + rounding)
    assert (late >= 0.0).all()
    assert rec.outcome.skipped == skipped.sum()
    assert (io[:, 0] > 0.0).all()


class Letters:
    """A `stop` that writes into memories now and then, and looks whether a tick goes on meanwhile."""

    def __init__(self, session: Session, at: list[int]) -> None:
        self._session, self._at = session, at
        self.ticks: list[int] = []

    @property
    def has_news(self) -> bool:
        return bool(self._at) and self._session.servo.ticks >= self._at[0]

    def __call__(self) -> bool:
        if self.has_news:
            self._at.pop(0)
            before = self._session.native._ring.words[0]
            time.sleep(0.005)
            assert self._session.native._ring.words[0] == before  # no tick goes on
            self.ticks.append(int(before))
        return False


def test_letters_are_taken_between_two_ticks(tmp_path: Path) -> None:
    session = Session(scene(driver(tmp_path), 400, native=True))
    servo, letters = session.servo, Letters(session, [20, 60])

    def look(done: int) -> None:
        servo.ticks = done

    done = session.native.run(0, 100, session.recorder, letters, Pacer(PERIOD), look)
    assert done == 100
    assert len(letters.ticks) == 2
    assert letters.ticks[0] >= 20
    assert letters.ticks[1] >= 60
    session.finish()


def test_a_function_that_does_not_return_ends_the_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Python sees that no tick comes, stops the devices beside it, and says why."""
    release = threading.Event()

    @ctypes.CFUNCTYPE(ctypes.c_int64, ctypes.c_void_p, ctypes.c_void_p)
    def hang(context: int, block: int) -> int:
        release.wait(60.0)
        return 0

    def calls(device: Scripted) -> Calls:
        place = ctypes.cast(hang, ctypes.c_void_p).value
        assert place is not None
        return real(device)._replace(write=place)

    real = vars(Scripted)["calls"].fget
    monkeypatch.setattr(Scripted, "calls", property(calls))
    session = Session(scene(driver(tmp_path), TICKS, native=True))
    try:
        session.run(TICKS)
        assert session.servo.fault is not None
        assert session.servo.fault.message.startswith("`write` of the device of finger0 (Scripted) has not returned")
        assert [device.stops for device in session.stations] == [1, 1]
    finally:
        release.set()
    session.finish()
