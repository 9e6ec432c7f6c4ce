"""Death of a servo's process: whoever records takes the force away, says so, and has every row."""

from __future__ import annotations

import math
import os
import signal
import sys
import threading
import time
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import graspfx as gx
from graspfx.assembly.process import guard as guard_module
from graspfx.assembly.process import quenching
from graspfx.assembly.process.guard import CLOSING, LONGER, OPENING, PATIENCE, STEPS, Guard
from graspfx.assembly.process.quenching import Quencher, quench_all
from graspfx.certificate.plan import plan
from graspfx.devices.haply_2diy.emulator import DiyWire
from graspfx.errors import DeviceError, InputError, RecordingError
from graspfx.loop.realtime.readings import MOST_STILL, WATCHDOGS
from graspfx.loop.realtime.ring import Phase, Ring, Word, create
from graspfx.recording import recorder as recorders
from graspfx.recording import sink
from graspfx.recording.record import Recording
from graspfx.system import child_process
from tests.support.hardware import VirtualClock, driver
from tests.support.logged import LoggedRun, write_logged
from tests.support.servo_wires import BUSY, PATIENT, PRESSED, SMALL, Assault, board, boards_scene, servo_of, settled
from tests.support.waiting import wait_until

pytestmark = pytest.mark.skipif(not hasattr(signal, "SIGHUP"), reason="processes of POSIX")

TRIES = 3
SOON = 0.1  # [s]: a generous bound, as others use the processors too


def kill(servo: int) -> None:
    os.kill(servo, signal.SIGKILL)


def require_quenched(folder: Path) -> float:
    """Kill the servo of two boards while their handles are pressed; give the time until both are silent [s].

    The disk hangs until they are.
    """
    whole = sink.FileSink.write

    def are_silent() -> bool:
        return not left.torque.any() and not right.torque.any()

    def write(self: sink.FileSink, *arguments: Any) -> None:
        wait_until(lambda: assault.time and are_silent())
        whole(self, *arguments)

    with board() as left, board() as right, pytest.MonkeyPatch.context() as patch:
        patch.setattr(sink.FileSink, "write", write)
        patch.setattr(recorders, "SECOND", 0.0)
        scene, assault = boards_scene([left, right], PATIENT, **BUSY), Assault([left, right], kill)
        rec = settled(partial(gx.run, scene, real_time=True, stop=assault, out=folder))
        assert are_silent()
        times = [assault.silence(wire) for wire in (left, right)]
    assert rec.outcome.cause == "the servo's process was ended by SIGKILL"
    assert not rec.outcome.complete
    [fault] = rec.faults
    assert fault.tick == len(rec) > 0
    assert fault.message.count("(Haply2Diy) was removed in") == 2
    assert rec.outcome.lost == 0
    assert np.isfinite(rec.finger_position).all()
    assert np.abs(rec.displayed_force).max() > 0.01
    return max(times)


@pytest.mark.alone
def test_a_servo_that_is_killed_leaves_no_force(tmp_path: Path) -> None:
    """It has two boards without watchdogs, alike but for their ports."""
    times = list[float]()
    while len(times) < 5 and min(times, default=1.0) >= SOON:  # others may use the processors
        times.append(require_quenched(tmp_path / str(len(times))))
    assert min(times) < SOON, times


def test_a_crash_in_a_library_leaves_no_force(tmp_path: Path) -> None:
    """The driver's own code reads at address zero: the driver's `quench` is called here, after the crash."""
    with LoggedRun(tmp_path, "crashes") as run:
        code, messages = run.end()
    order = [each.what for each in run.log if each.what in ("crash", "quench", "files", "whole")]
    assert order == ["crash", "quench", "files", "whole"]
    assert code == 3
    assert "the servo's process was ended by SIGSEGV; the force of the device of finger0 (Logged) was" in messages


def test_a_device_that_cannot_be_stopped_is_quenched(tmp_path: Path) -> None:
    """Its process lets go of it and ends at the end of the run, before the disk is done; then it is reached afresh."""
    with LoggedRun(tmp_path, "unstoppable", hangs=True, options=["--duration", "0.2"]) as run:
        run.await_entry("quench")
        run.free_disk()
        run.end()
    order = [each.what for each in run.log]
    assert order.index("close") < order.index("quench") < order.index("whole")
    assert "cannot be stopped, and its force may remain" in str(Recording.load(run.out).faults)


def test_a_driver_that_never_returns_is_ended_and_quenched(tmp_path: Path) -> None:
    """It swallows every signal and exception: after a second without a tick its process is killed."""
    with LoggedRun(tmp_path, "deaf") as run:
        code, messages = run.end()
    hang, quench = ([each.time for each in run.log if each.what == what] for what in ("hang", "quench"))
    assert quench[0] - hang[0] > MOST_STILL
    assert code == 3
    assert "`read` of the device of finger0 (Logged) has not returned for " in messages
    assert "the servo's process was ended by SIGKILL" in messages


def test_a_program_that_is_killed_while_a_driver_never_returns_can_be_left(tmp_path: Path) -> None:
    """The servo's process has the program's pipes: a test that fails meanwhile does not wait for their end."""
    with LoggedRun(tmp_path, "deaf") as run:
        run.await_entry("hang")
        servo = run.servo
    wait_until(lambda: not Path(f"/proc/{servo}").exists())


def test_a_servo_is_killed_before_it_has_a_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """As Ctrl-C does while the process is started."""

    def spawn(*arguments: Any) -> Any:
        guard.kill()
        return whole(*arguments)

    whole = child_process.spawn
    monkeypatch.setattr(child_process, "spawn", spawn)
    guard = Guard(Ring(create(1), 1, 1), [], 0.001)
    guard.start()
    guard.join(60.0)
    assert not guard.is_alive() and guard.process is not None and guard.process.returncode == -signal.SIGKILL


@pytest.mark.parametrize("how", ["hangs in open", "deaf in open"])
def test_a_device_that_never_opens_is_ended_and_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, how: str
) -> None:
    """One that a signal breaks off, and one that swallows every exception: it had no bound."""
    monkeypatch.setattr(guard_module, "OPENING", 0.3)
    scene = write_logged(tmp_path, how)
    with pytest.raises(DeviceError, match=r"opening the device of finger0 \(Logged\) took more than .* and was ended"):
        gx.run(scene, real_time=True)


@pytest.mark.parametrize(
    ("phase", "told", "halt", "call", "patience"),
    [
        (Phase.RUNNING, 0, 0, 0, MOST_STILL),
        (Phase.RUNNING, 0, 0, 6, WATCHDOGS * 0.2),
        (Phase.RUNNING, 1, 0, 6, PATIENCE),
        (Phase.RUNNING, 0, 5, 0, math.inf),
        (Phase.OPEN, 1, 0, 0, CLOSING),
        (Phase.OPEN, 0, 0, 0, OPENING),
        (Phase.STARTING, 0, 0, 0, math.inf),
        (Phase.RESTED, 1, 0, 0, math.inf),
    ],
    ids=["no tick", "a call", "no rest", "paused", "not armed", "not open", "not begun", "at rest"],
)
def test_patience_with_a_servo_without_ticks(phase: int, told: int, halt: int, call: int, patience: float) -> None:
    """A signal that a driver's call gives way to, and one that nothing withstands a quarter of a second later.

    A call of a device has some times what the scene's watchdog lets a tick be late.
    """

    class Told(Guard):
        def _signal(self, number: int) -> None:
            told_numbers[number] = clock.now() - began

    clock, told_numbers, file = VirtualClock(), dict[int, float](), create(1)
    ring = Ring(file, 1, 1)
    try:
        guard, words = Told(ring, [], 0.001, clock, names=["one", "two"], watchdog=0.2), ring.words
        words[Word.PHASE], words[Word.STOP], words[Word.HALT], words[Word.CALL] = phase, told, halt, call
        for tick in range(4):  # signs of life
            words[Word.HEAD] = tick + 1
            guard._hurry()
            clock.sleep(0.9 * PATIENCE)
        began = clock.now() - 0.9 * PATIENCE
        for _ in range(3200):
            guard._hurry()
            clock.sleep(0.01)
    finally:
        os.close(file)
    assert list(told_numbers) == ([] if math.isinf(patience) else list(STEPS))
    assert list(told_numbers.values()) == pytest.approx([patience, patience + LONGER][: len(told_numbers)], abs=0.011)
    assert guard.hang.partition(" has")[0] == ("`read` of two" if call and not told else "")


def test_each_call_has_its_own_time() -> None:
    """A loop without Python has stood still for 0.15 s and stops its devices then: that `stop` does not hang yet."""
    sent: list[int] = []

    class Told(Guard):
        def _signal(self, number: int) -> None:
            sent.append(number)

    clock, file = VirtualClock(), create(1)
    ring = Ring(file, 1, 1)
    try:
        guard, words = Told(ring, [], 0.001, clock, names=["one", "two"], watchdog=0.005), ring.words
        words[Word.PHASE], words[Word.HEAD] = Phase.RUNNING, 1
        for call, time in ((0, 0.0), (0, 0.15), (4, 0.01), (8, 0.06), (8, 0.06), (8, 0.06)):
            words[Word.CALL] = call
            clock.sleep(time)
            guard._hurry()
            if not sent:
                assert not guard.hang
    finally:
        os.close(file)
    assert guard.hang.startswith("`stop` of two has not returned for 0.12 s")
    assert len(sent) == 1


def test_a_full_disk_ends_in_zero_force_first(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The error of the disk comes when both boards have been told zero."""
    silent: list[bool] = []

    def write(self: sink.FileSink, *arguments: Any) -> None:
        if strike.time:
            raise RecordingError("no space left on the disk")

    def close(self: sink.FileSink, outcome: Any) -> None:
        wait_until(lambda: not left.torque.any() and not right.torque.any())
        silent.append(True)
        whole(self, outcome)

    whole = sink.FileSink.close
    monkeypatch.setattr(recorders, "SECOND", 0.0)
    monkeypatch.setattr(sink.FileSink, "write", write)
    monkeypatch.setattr(sink.FileSink, "close", close)
    with board() as left, board() as right:
        strike, scene = Assault([left, right], lambda servo: None), boards_scene([left, right], PATIENT, **BUSY)
        with pytest.raises(RecordingError, match="no space left"):
            settled(lambda: gx.run(scene, real_time=True, stop=strike, out=tmp_path))
    assert silent


@pytest.mark.alone
def test_a_servo_that_is_stopped_for_3_20_70_and_500_ms(tmp_path: Path) -> None:
    """Up to three periods away are counted, at 50 Hz; after 25 the first tick on has no force."""
    for _ in range(TRIES):
        with board() as wire, settled(partial(open_board, wire)) as session:
            wire.place(np.array(PRESSED))
            wait_until(lambda: bool(np.abs(wire.torque).max() > SMALL) or session.fault is not None)
            early = list[bool]()
            for pause in (0.003, 0.02, 0.07, 0.5):
                early.append(session.fault is None)
                resumed = stop(servo_of(os.getpid()), pause)
                session.wait(0.2)
            wait_until(lambda: not wire.torque.any())
        if all(early):  # else this machine was away by itself
            break
    assert all(early)
    assert sum(any(torques) for at, torques in wire.frames if at > resumed) <= 2  # a tick's end, and a question
    assert "successive periods of 0.02 s were skipped, expected at most 5" in session.recording.faults[0].message
    assert 22 <= session.recording.outcome.skipped < 60
    assert 0.4 < session.recording.outcome.late["max"] < 0.8


def open_board(wire: DiyWire) -> gx.RealTimeSession:
    return gx.open(boards_scene([wire], PATIENT), real_time=True)


def stop(servo: int, pause: float) -> float:
    """Stop a servo for so long; give the time at which it goes on [s]."""
    os.kill(servo, signal.SIGSTOP)
    time.sleep(pause)
    resumed = time.monotonic()
    os.kill(servo, signal.SIGCONT)
    return resumed


def test_what_the_process_raises_is_raised_here(tmp_path: Path) -> None:
    """A board that is not there, and one whose `open` is an error of its own: the words of a run in this process."""
    with board() as wire:
        scene = boards_scene([wire], PATIENT, **{"finger.0.device.port": str(tmp_path / "none")})
        with pytest.raises(DeviceError, match=r"the device of finger0 \(Haply2Diy\): .*none cannot be opened: No such"):
            gx.run(scene, real_time=True, out=tmp_path / "out")
        wire.place(np.array([160.0, 20.0]))
        inside = {"object.0.position": [0.0, 0.04]}
        with pytest.raises((InputError, DeviceError), match=r"finger0"):
            settled(lambda: gx.run(boards_scene([wire], PATIENT, **inside), real_time=True))
    assert not list((tmp_path).glob("out/*"))


def test_hardware_without_watchdog_or_quench_is_refused(tmp_path: Path) -> None:
    scene = gx.Scene(
        dimensions=1,
        period=0.005,
        duration=1.0,
        object={"mass": 0.1, "viscosity": 0.8, "shape": {"kind": "box", "size": [0.05]}},
        coupling={"external": {"stiffness": 30.0}, "internal": {"stiffness": 70.0}, "absent": "follow"},
        finger=[{"start": [-0.03], "device": {"name": str(driver(tmp_path)), "position": [[-0.03]]}}],
    )
    rows = {row.step: row for row in plan(scene)}
    assert rows["process"].runs
    assert not rows["guard"].runs
    assert "refused with --real-time: features.watchdog" in rows["guard"].why
    with pytest.raises(InputError, match=r"features\.watchdog: .*quench\(\*\*settings\) in the driver of .*finger0"):
        gx.run(scene, real_time=True)


def test_the_plan_says_who_takes_the_force_away() -> None:
    with board() as wire:
        [row] = [row for row in plan(boards_scene([wire])) if row.step == "guard"]
    assert row.runs
    assert row.why == ("the device of finger0 (Haply2Diy): if the process dies its driver's quench removes the force")


def test_every_device_is_quenched_whatever_another_one_does(monkeypatch: pytest.MonkeyPatch) -> None:
    """One raises, one ends its thread, and the first one and another do not return: the bound is one for all."""
    calls: list[str] = []

    def fail() -> None:
        calls.append("fail")
        raise OSError("no such port")

    def hang() -> None:
        over.wait(60.0 * PATIENCE)

    monkeypatch.setattr(quenching, "PATIENCE", 0.2)
    over = threading.Event()
    texts = quench_all([
        Quencher("zero", hang, None),
        Quencher("one", fail, None),
        Quencher("two", lambda: calls.append("two"), None),
        Quencher("three", None, 0.02),
        Quencher("four", fail, 0.5),
        Quencher("five", hang, 0.02),
        Quencher("six", lambda: sys.exit(5), None),
    ])  # fmt: skip
    over.set()
    silent = "could not be removed and may persist: switch the device off"
    late = "could not be removed within 0.2 s"
    assert texts[0] == f"the force of zero {late} and may persist: switch the device off"
    assert texts[1] == f"the force of one {silent} (OSError: no such port)"
    assert texts[2].startswith("the force of two was removed in ")
    assert texts[3] == "the watchdog of three removes its force within 0.02 s"
    by_itself = "; the device's watchdog removes it"
    assert texts[4] == f"the force of four could not be removed (OSError: no such port){by_itself}"
    assert texts[5] == f"the force of five {late}{by_itself}"
    assert texts[6] == f"the force of six {silent} (SystemExit: 5)"
    assert sorted(calls) == ["fail", "fail", "two"]


def test_every_device_is_quenched_without_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    """The system grants a thread for the second of three devices alone; the others wait for nobody but each other."""

    class Scarce(threading.Thread):
        def start(self) -> None:
            begun.append(0)
            if len(begun) != 2:
                raise RuntimeError("can't start new thread")
            super().start()
            self.join()

    begun, calls = list[int](), list[str]()
    monkeypatch.setattr(quenching, "Thread", Scarce)
    texts = quench_all([Quencher(name, partial(calls.append, name), None) for name in ("one", "two", "three")])
    assert calls == ["two", "one", "three"]
    assert all("was removed in" in text for text in texts)


@pytest.mark.stress
def test_a_hundred_servos_that_are_killed_leave_no_force(tmp_path: Path) -> None:
    times = [require_quenched(tmp_path / str(i)) for i in range(100)]
    assert float(np.median(times)) < SOON, times


@pytest.mark.stress
def test_nothing_is_compiled_while_hardware_is_open(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """With an empty cache all kernels are compiled first: between two forces no more than some periods go by."""
    monkeypatch.setenv("GRASPFX_CACHE", str(tmp_path / "cache"))
    with board() as wire:
        rec = gx.run(boards_scene([wire], engine="compiled", **BUSY), real_time=True, duration=1.0)
        times = np.array([at for at, _ in wire.frames])
    assert rec.outcome.engine == "compiled"
    assert np.diff(times).max() < 0.5
