"""Exits of a run with hardware, by real signals: zero force first, then whole files, then the hardware's end."""

from __future__ import annotations

import signal
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from graspfx.loop.recording.record import Recording
from tests.support.logged import SLOW, LoggedRun
from tests.support.waiting import wait_until

pytestmark = [
    pytest.mark.alone,
    pytest.mark.skipif(not hasattr(signal, "SIGHUP"), reason="signals of POSIX"),
]

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


def end_by(numbers: tuple[int, ...], how: str, folder: Path) -> tuple[float, int, Recording]:
    """End a run by signals once its finger feels a force; give the time to zero, its exit code and the recording."""
    folder.mkdir()
    with LoggedRun(folder, how) as run:
        run.press()
        if how:
            run.await_entry("hang")
        sent = run.signal(*numbers)
        code, messages = run.end()
        assert "Traceback" not in messages, messages
        require_order(run)
        return run.time_to_zero(sent), code, Recording.load(run.out)


@pytest.mark.parametrize(
    ("numbers", "codes"),
    [((INT,), {130}), ((INT, INT), {130, -INT}), ((TERM,), {-TERM}), ((HUP,), {-HUP}), ((TERM, INT, HUP), {-TERM})],
    ids=["INT", "INT INT", "TERM", "HUP", "TERM INT HUP"],
)
def test_signals_end_in_zero_force_first(numbers: tuple[int, ...], codes: set[int], tmp_path: Path) -> None:
    """The disk takes 1.5 s for each block, in the middle of the run and at its end: force does not wait for it.

    What a signal does by itself it does afterwards: the process has the code of it.
    """
    times = []
    for i in range(TRIES):
        time, code, rec = end_by(numbers, "", tmp_path / str(i))
        assert code in codes
        assert not rec.outcome.complete
        assert rec.outcome.cause == signal.Signals(numbers[0]).name
        times.append(time)
        if time < SOON:
            break
    assert min(times) < SOON, times


@pytest.mark.parametrize("how", ["hangs", "swallows"])
def test_a_signal_breaks_off_a_driver_that_hangs(how: str, tmp_path: Path) -> None:
    """Its reading takes 20 s; also where it lets no exception pass, the next tick is not begun."""
    times = []
    for i in range(TRIES):
        time, code, rec = end_by((TERM,), how, tmp_path / str(i))
        assert code == -TERM
        assert rec.outcome.cause == "SIGTERM"
        times.append(time)
        if time < SOON:
            break
    assert min(times) < SOON, times


def run_in_time(folder: Path, how: str, duration: str) -> tuple[LoggedRun, int, Recording]:
    """Run to the end, again where the machine was away for 100 ms; give the run, its exit code and the recording."""
    for i in range(TRIES):
        place = folder / str(i)
        place.mkdir()
        with LoggedRun(place, how, options=["--duration", duration]) as run:
            code, messages = run.end()
        if "left out" not in messages:
            break
    return run, code, Recording.load(run.out)


def test_a_slow_disk_makes_no_tick_wait(tmp_path: Path) -> None:
    """Rows wait in memory while the disk is busy: 3 s of ticks with blocks of 1.5 s each, and none of them is lost."""
    run, code, rec = run_in_time(tmp_path, "", "3")
    times = [each.time for each in run.log if each.what == "force"]
    assert max(b - a for a, b in pairwise(times)) < 0.5 * SLOW
    require_order(run)
    assert code == 0
    assert len(rec) == 150
    assert rec.outcome.complete


@pytest.mark.parametrize(("how", "code", "says"), [("exits", 7, "SystemExit: 7"), ("raises", 3, "")])
def test_what_a_driver_raises_ends_in_zero_force_first(how: str, code: int, says: str, tmp_path: Path) -> None:
    """A program that ends itself rests first; an exception is a fault, after which the run goes on without force."""
    run, exit_code, rec = run_in_time(tmp_path, how, "1.5")
    assert exit_code == code
    require_order(run)
    assert rec.outcome.cause == says
    assert rec.outcome.complete is not bool(says)
    if not says:
        assert "the device of finger0 (Logged) cannot be read: OSError: unplugged" in rec.faults[0].message


@pytest.mark.parametrize(("pause", "is_fault"), [(0.07, False), (0.5, True)])
def test_a_servo_that_was_stopped_is_late(pause: float, is_fault: bool, tmp_path: Path) -> None:
    """Three periods away is counted; after 25 the finger feels no force from the first tick on.

    Others use the processors too, and may make any run late: the least of some tries counts.
    """
    faults = []
    for i in range(TRIES):
        folder = tmp_path / str(i)
        folder.mkdir()
        with LoggedRun(folder, slow=0.0) as run:
            run.press()
            run.signal(signal.SIGSTOP, pause=pause, to=run.servo)
            run.signal(signal.SIGCONT, pause=0.2, to=run.servo)
            sent = run.signal(INT)
            run.end()
            rec = Recording.load(run.out)
            assert rec.outcome.skipped >= 2
            assert rec.outcome.late["max"] > 0.5 * pause
            faults.append(len(rec.faults))
            if is_fault:
                assert "periods of 0.02 s in a row were left out, 5 at most" in rec.faults[0].message
                assert not any(each.size > 0.0 for each in run.log if each.time > sent - 0.2)
        if faults[-1] == is_fault:
            break
    assert min(faults) == is_fault


def test_signals_to_the_servo_alone_end_in_zero_force_first(tmp_path: Path) -> None:
    """The run ends as if its end had come: whole files, the cause in them, and the code of a run that broke off."""
    with LoggedRun(tmp_path, slow=0.0) as run:
        run.press()
        sent = run.signal(TERM, INT, HUP, to=run.servo)
        code, messages = run.end()
        require_order(run)
        assert run.time_to_zero(sent) < SLOW
    assert (code, "Traceback" in messages) == (130, False)
    assert Recording.load(run.out).outcome.cause == "SIGTERM"


def test_a_servo_that_was_killed_leaves_a_whole_recording(tmp_path: Path) -> None:
    """The cause is a fault and in the outcome; rows are those of all ticks that were finished."""
    with LoggedRun(tmp_path, slow=0.0) as run:
        run.press()
        run.signal(signal.SIGKILL, to=run.servo)
        code, messages = run.end()
    rec = Recording.load(run.out)
    assert code == 3
    assert (
        "the servo's process was ended by SIGKILL; the force of the device of finger0 (Logged) was taken away"
        in messages
    )
    assert rec.outcome.cause == "the servo's process was ended by SIGKILL"
    assert [fault.tick for fault in rec.faults] == [len(rec)]
    forces = sum(each.what == "force" for each in run.log) - SETTLING
    assert forces - 1 <= len(rec) <= forces


def test_a_recorder_that_was_killed_lets_its_servo_rest(tmp_path: Path) -> None:
    """Nobody is left to tell it, and nobody to close the files: force is zero at once, and the device closed."""
    with LoggedRun(tmp_path, slow=0.0) as run:
        run.press()
        servo = run.servo
        sent = run.signal(signal.SIGKILL)
        run.end()
        run.await_entry("close")
        assert run.time_to_zero(sent) < 0.6
        wait_until(lambda: not Path(f"/proc/{servo}").exists())
    part = Recording.load(run.out)
    assert not part.outcome.complete


def test_a_recorder_that_is_stopped_holds_up_no_tick_until_it_gives_no_sign_of_life(tmp_path: Path) -> None:
    """For 300 ms it is away, with the viewer and the disk: the servo goes on, and no row is lost. Then it is away.

    After half a second of that the finger feels no force.
    """
    with LoggedRun(tmp_path, slow=0.0) as run:
        run.press()
        began = run.signal(signal.SIGSTOP, pause=0.3)
        run.signal(signal.SIGCONT, pause=0.2)
        assert not any(each.what == "stop" for each in run.log)
        assert sum(each.what == "force" and began < each.time < began + 0.3 for each in run.log) > 5
        sent = run.signal(signal.SIGSTOP)
        run.await_entry("stop")
        assert run.time_to_zero(sent) < 0.5 + SLOW
        run.signal(signal.SIGCONT)
        run.end()
    rec = Recording.load(run.out)
    assert rec.outcome.cause == "the process that records gives no sign of life"
    assert rec.outcome.lost == 0
    assert len(rec) == sum(each.what == "force" for each in run.log) - SETTLING
    assert np.isfinite(rec.finger_position).all()
