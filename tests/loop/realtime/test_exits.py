"""Exits of a run with hardware, by real signals: zero force first, then whole files, then the hardware's end."""

from __future__ import annotations

import signal
from pathlib import Path

import numpy as np
import pytest

from graspfx.recording.record import Recording
from tests.support.logged import LoggedRun
from tests.support.waiting import wait_until

pytestmark = pytest.mark.skipif(not hasattr(signal, "SIGHUP"), reason="signals of POSIX")

INT, TERM, HUP = signal.SIGINT, signal.SIGTERM, getattr(signal, "SIGHUP", 0)
SOON = 0.03  # [s], the least of some tries, as others use the processors too
TRIES = 3
SETTLING = 20  # writings of zero before the run


def require_order(run: LoggedRun) -> None:
    """Require zero force before the files are closed, and the hardware's end after it."""
    log = [each for each in run.log if each.what not in ("open", "hang", "raise")]
    order = [each.what for each in log]
    last_force = max(i for i, each in enumerate(log) if each.size > 0.0)
    assert order[last_force + 1] == "stop"
    assert last_force < order.index("files") < order.index("whole") < order.index("close")
    assert order[-1] == "close"


def forces(run: LoggedRun) -> int:
    """Count the forces that its device was told in the run."""
    return sum(each.what == "force" for each in run.log) - SETTLING


def end_by(
    numbers: tuple[int, ...], folder: Path, how: str = "", *, to_servo: bool = False
) -> tuple[float, int, Recording]:
    """End a run by signals once its finger feels a force; give the time to zero, its exit code and the recording.

    The disk hangs until the device was stopped: force does not wait for it.
    """
    with LoggedRun(folder, how, hangs=True) as run:
        run.press()
        if how:
            run.await_entry("hang")
        sent = run.signal(*numbers, to=run.servo if to_servo else None)
        run.await_entry("stop")
        run.free_disk()
        code, messages = run.end()
        assert "Traceback" not in messages, messages
        require_order(run)
        assert not how or not any(each.size > 0.0 and each.time > sent for each in run.log)
        return run.time_to_zero(sent), code, Recording.load(run.out)


@pytest.mark.parametrize(
    ("numbers", "how", "to_servo", "codes"),
    [
        pytest.param((INT,), "", False, {130}, id="INT"),
        pytest.param((INT, INT), "", False, {130, -INT}, id="INT INT"),
        pytest.param((HUP,), "", False, {-HUP}, id="HUP"),
        pytest.param((TERM, INT, HUP), "", False, {-TERM}, id="TERM INT HUP"),
        pytest.param((TERM,), "hangs", False, {-TERM}, id="TERM, a driver that hangs"),
        pytest.param((TERM,), "swallows", False, {-TERM}, id="TERM, a driver that hangs and swallows exceptions"),
        pytest.param((TERM, INT, HUP), "", True, {130}, id="TERM INT HUP to the servo alone"),
    ],
)
def test_signals_end_in_zero_force_first(
    numbers: tuple[int, ...], how: str, to_servo: bool, codes: set[int], tmp_path: Path
) -> None:
    """What a signal does by itself it does afterwards: the process has the code of it.

    A driver's reading that takes ten minutes is broken off; where it lets no exception pass, the next tick is not
    begun. Of signals to the servo alone the code is that of a run that broke off.
    """
    _, code, rec = end_by(numbers, tmp_path, how, to_servo=to_servo)
    assert code in codes
    assert not rec.outcome.complete
    assert rec.outcome.cause == signal.Signals(numbers[0]).name


@pytest.mark.alone
@pytest.mark.parametrize("how", ["", "hangs"])
def test_a_signal_ends_force_at_once(how: str, tmp_path: Path) -> None:
    times = []
    for i in range(TRIES):
        (folder := tmp_path / str(i)).mkdir()
        time, code, rec = end_by((TERM,), folder, how)
        assert (code, rec.outcome.cause) == (-TERM, "SIGTERM")
        times.append(time)
        if time < SOON:
            break
    assert min(times) < SOON, times


def test_a_slow_disk_makes_no_tick_wait(tmp_path: Path) -> None:
    """Rows wait in memory while the disk is busy, here from the first one to the end of the run: none is lost."""
    with LoggedRun(tmp_path, hangs=True, options=["--duration", "0.6"]) as run:
        run.await_entry("stop")
        assert forces(run) == 30
        run.free_disk()
        code, _ = run.end()
        require_order(run)
    rec = Recording.load(run.out)
    assert code == 0
    assert len(rec) == 30
    assert rec.outcome.complete


@pytest.mark.parametrize(("how", "says"), [("exits", "SystemExit: 0"), ("raises", "OSError: unplugged")])
def test_what_a_driver_raises_ends_in_zero_force_first(how: str, says: str, tmp_path: Path) -> None:
    """An exception is a fault, after which the run goes on without force; so is `sys.exit` within a driver."""
    with LoggedRun(tmp_path, how, options=["--duration", "1.5"]) as run:
        code, _ = run.end()
    rec = Recording.load(run.out)
    assert code == 3
    require_order(run)
    assert rec.outcome.complete
    assert f"the device of finger0 (Logged) cannot be read: {says}" in rec.faults[0].message


def test_a_driver_that_hangs_is_a_fault(tmp_path: Path) -> None:
    """It is broken off, every device is stopped, and the fault names device and call: nobody has interrupted."""
    with LoggedRun(tmp_path, "hangs") as run:
        code, messages = run.end()
    rec = Recording.load(run.out)
    [fault] = rec.faults
    assert code == 3
    assert fault.message.startswith("`read` of the device of finger0 (Logged) has not returned for ")
    assert fault.tick == len(rec)
    assert fault.message in messages and "interrupted" not in messages
    assert rec.outcome.cause == fault.message
    require_order(run)


def test_a_servo_that_was_killed_leaves_a_whole_recording(tmp_path: Path) -> None:
    """The cause is a fault and in the outcome; rows are those of all ticks that were finished."""
    with LoggedRun(tmp_path) as run:
        run.press()
        run.signal(signal.SIGKILL, to=run.servo)
        code, messages = run.end()
    rec = Recording.load(run.out)
    assert code == 3
    assert (
        "the servo's process was ended by SIGKILL; the force of the device of finger0 (Logged) was removed" in messages
    )
    assert rec.outcome.cause == "the servo's process was ended by SIGKILL"
    assert [fault.tick for fault in rec.faults] == [len(rec)]
    assert forces(run) - 1 <= len(rec) <= forces(run)


@pytest.mark.alone
def test_a_recorder_that_was_killed_lets_its_servo_rest(tmp_path: Path) -> None:
    """Nobody is left to tell it, and nobody to close the files: force is zero at once, and the device closed."""
    with LoggedRun(tmp_path) as run:
        run.press()
        servo = run.servo
        sent = run.signal(signal.SIGKILL)
        run.end()
        run.await_entry("close")
        assert run.time_to_zero(sent) < 0.6
        wait_until(lambda: not Path(f"/proc/{servo}").exists())
    part = Recording.load(run.out)
    assert not part.outcome.complete


@pytest.mark.alone
def test_a_recorder_that_is_stopped_holds_up_no_tick_until_it_gives_no_sign_of_life(tmp_path: Path) -> None:
    """For 300 ms it is away, with the viewer and the disk: the servo goes on, and no row is lost. Then it is away.

    After half a second of that the finger feels no force.
    """
    with LoggedRun(tmp_path, "watched") as run:
        run.press()
        began = run.signal(signal.SIGSTOP, pause=0.3)
        run.signal(signal.SIGCONT, pause=0.2)
        assert not any(each.what == "stop" for each in run.log)
        assert sum(each.what == "force" and began < each.time < began + 0.3 for each in run.log) > 5
        sent = run.signal(signal.SIGSTOP)
        run.await_entry("stop")
        assert run.time_to_zero(sent) < 2.0
        run.signal(signal.SIGCONT)
        run.end()
    rec = Recording.load(run.out)
    assert rec.outcome.cause == "the recording process sends no heartbeat"
    assert rec.outcome.lost == 0
    assert len(rec) == forces(run)
    assert np.isfinite(rec.finger_position).all()
