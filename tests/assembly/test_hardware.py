"""A run's hardware: opened when all else is ready, settled, met where its fingers are, told forces, rested, closed."""

from __future__ import annotations

import gc
import signal
import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import graspfx as gx
from graspfx.assembly import hardware
from graspfx.assembly import run_scene as whole_run
from graspfx.assembly.build import build
from graspfx.compile import kernel as kernels
from graspfx.compile import native
from graspfx.compile.lower import lowering
from graspfx.errors import DeviceError, InputError, RecordingError
from graspfx.loop import engine as engines
from graspfx.loop import servo as servos
from graspfx.loop.realtime import lifecycle
from graspfx.loop.realtime.pacing import decay_ticks
from graspfx.loop.servo import Servo
from graspfx.recording import recorder as recorders
from graspfx.recording import sink
from tests.support import foreign_parts
from tests.support.hardware import EVIL, SETTLING, Evil, Fake, VirtualClock, driver, fakes
from tests.support.optional import require

CART: dict[str, Any] = {
    "dimensions": 1, "period": 0.005, "duration": 0.8, "engine": "interpreted",
    "object": {"mass": 0.1, "viscosity": 0.8, "shape": {"kind": "box", "size": [0.05]}},
    "coupling": {"external": {"stiffness": 30.0}, "internal": {"stiffness": 70.0}, "absent": "follow"},
}  # fmt: skip
PARTNER = {
    "start": [0.025], "device": {"name": "simulated", "mass": 0.15, "damping": 0.2},
    "hand": {"stiffness": 60.0, "damping": 0.5},
}  # fmt: skip

REST = decay_ticks(CART["period"])  # ticks in which forces decay at the end


@pytest.fixture(autouse=True)
def clock(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Let no time pass but what a device takes."""
    monkeypatch.setattr(whole_run, "WallClock", VirtualClock)


def cart(file: Path, x: float = -0.03, **changes: Any) -> gx.Scene:
    """Put a cart on a rail, held by a fake at x and a simulated finger."""
    finger = {"start": [-0.03], "device": {"name": str(file), "position": [[x]]}}
    return gx.Scene(**{**CART, "finger": [finger, PARTNER]}).replace(changes)


def ramp(**changes: Any) -> dict[str, Any]:
    return {"coupling.enter": "ramp", **changes}


def test_the_order_of_a_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Programs are there before hardware is opened; forces are zero before files are closed, and these before it is."""
    file, events = driver(tmp_path), []

    def noting(owner: Any, name: str, event: str) -> None:
        whole = getattr(owner, name)

        def call(*arguments: Any, **options: Any) -> Any:
            events.append(event)
            return whole(*arguments, **options)

        monkeypatch.setattr(owner, name, call)

    noting(servos, "engine_for", "programs")
    noting(Servo, "_rehearse", "rehearsal")
    noting(Fake, "open", "open")
    noting(hardware, "settle", "settle")
    noting(hardware, "look_again", "arm")
    noting(Servo, "run", "run")
    noting(Servo, "rest", "rest")
    noting(sink.FileSink, "close", "files")
    noting(Fake, "close", "close")
    gx.run(cart(file), real_time=True, out=tmp_path / "out")
    assert events == ["programs", "rehearsal", "open", "settle", "arm", "run", "rest", "files", "close"]
    assert fakes(file)[-1].log[-1][1] == "close"


def test_auto_is_one_engine_from_the_first_tick_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Machine code is there before hardware is opened, and nothing is compiled from then on."""
    require("llvmlite")
    file, events = driver(tmp_path), list[str]()
    compiled, opens = native.compiled, Fake.open

    def noting(*arguments: Any, **options: Any) -> Any:
        events.append("compiled")
        return compiled(*arguments, **options)

    def opening(fake: Fake, period: float) -> None:
        events.append("open")
        opens(fake, period)

    engines.program.cache_clear()
    monkeypatch.setattr(native, "compiled", noting)
    monkeypatch.setattr(Fake, "open", opening)
    rec = gx.run(cart(file, engine="auto"), real_time=True)
    assert rec.outcome.engine == "compiled"
    assert events[0] == "compiled"
    assert events[-1] == "open"


def test_a_rehearsal_leaves_no_trace(tmp_path: Path) -> None:
    """Every memory of the tick is to the bit what it was, time and contacts too."""
    with build(cart(driver(tmp_path))) as servo:
        arrays = servo.arena.arrays
        before = [array.tobytes() for array in arrays]
        servo.prepare()
        assert [array.tobytes() for array in arrays] == before
        assert servo.ticks == 0


@pytest.mark.parametrize("how", ["read", "write", "late"])
def test_nothing_comes_between_a_fault_and_zero_force(
    how: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """All devices are stopped before one is read or the coupling is asked again, and before the fault is told."""
    file, events = driver(tmp_path), list[str]()

    def fail(fake: Fake, *arguments: Any) -> Any:
        if "fault" not in events:
            events.append("fault")
            VirtualClock.time += 0.05 if how == "late" else 0.0
        if how != "late":
            raise OSError("unplugged")

    def noting(owner: Any, name: str) -> None:
        whole = getattr(owner, name)

        def call(*arguments: Any) -> Any:
            events.append(name)
            return whole(*arguments)

        monkeypatch.setattr(owner, name, call)

    monkeypatch.setitem(EVIL, "fails", Evil(read=fail) if how == "read" else Evil(write=fail))
    noting(Fake, "stop")
    if how == "late":
        noting(Fake, "read")
    noting(engines.Interpreted, "run")
    noting(servos, "latch")
    scene = cart(file).replace({"finger.0.device.evil": "fails"})
    other = scene.to_dict()["finger"][0] | {"device": {"name": str(file), "position": [[-0.03]]}, "start": [-0.03]}
    gx.run(gx.Scene(**{**scene.to_dict(), "finger": [*scene.to_dict()["finger"], other]}), real_time=True)
    after = events[events.index("fault") + 1 :]
    if how == "late":
        assert after.pop(0) == "run"  # the rest of the tick that took so long
    assert after[:3] == ["stop", "stop", "latch"]


def test_a_first_fault_lowers_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What is called for the first time in a fault was called in the rehearsal, before the hardware was opened."""
    misses: list[int] = []

    def fail(fake: Fake, *arguments: Any) -> Any:
        misses.append(lowering.lowered.cache_info().misses)
        raise OSError("unplugged")

    monkeypatch.setitem(EVIL, "fails", Evil(fail))
    for each in (kernels._lowered, lowering.lowered):
        each.cache_clear()  # as in a fresh process
    rec = gx.run(cart(driver(tmp_path)).replace({"finger.0.device.evil": "fails"}), real_time=True)
    assert "unplugged" in rec.faults[0].message
    assert misses == [lowering.lowered.cache_info().misses]


def test_contact_is_met_where_the_finger_is(tmp_path: Path) -> None:
    """The scene has it start outside, it stands inside: force grows from nothing, after 0.5 s all of it counts.

    In the last 20 ms it decays.
    """
    file = driver(tmp_path)
    rec = gx.run(cart(file, -0.021, **ramp()), real_time=True)
    force, decay = np.split(rec.displayed_force[:, 0, 0], [-REST])
    assert force[0] == 0.0
    assert np.abs(np.diff(force)).max() < 0.02
    assert (force[1:] < 0.0).all()
    assert (np.diff(decay) > 0.0).all()
    assert decay[-1] == 0.0
    assert rec.finger_position[0, 0, 0] == pytest.approx(-0.025, abs=1e-15)
    assert rec.finger_position[-1, 0, 0] == -0.021
    settled = rec.header.settled["finger0"]
    assert settled["position"] == [-0.021]
    assert settled["offset"] == pytest.approx([0.004])
    held = gx.run(cart(file, -0.021, **ramp(), **{"object.free": [False]}), real_time=True)
    assert held.displayed_force[-1 - REST, 0, 0] == pytest.approx(-0.004 * 70.0, rel=0.6)


def test_a_finger_inside_its_object_is_refused_by_name(tmp_path: Path) -> None:
    """With the depth and what to do; and it is stopped and closed, and was never told a force."""
    file = driver(tmp_path)
    with pytest.raises(
        InputError, match=r"finger0 is 4\.0 mm inside object, .*move the finger out .* 'ramp' to increase"
    ):
        gx.run(cart(file, -0.021), real_time=True, out=tmp_path / "out")
    fake = fakes(file)[-1]
    assert not any(force.any() for _, force in fake.forces)
    assert [what for _, what in fake.log if isinstance(what, str)] == ["open", "stop", "close"]
    touching = gx.run(cart(file, -0.0242), real_time=True)  # 0.8 mm: what a touch is
    assert touching.displayed_force[0, 0, 0] == 0.0
    assert touching.displayed_force[-1 - REST, 0, 0] < 0.0


def test_attached_contacts_are_where_the_fingers_are(tmp_path: Path) -> None:
    """A finger far from its attachment is refused; let in, its force begins at zero."""
    file = driver(tmp_path)
    attached = {"coupling.contact": "attached"}
    with pytest.raises(InputError, match=r"finger0 is 5\.0 mm inside"):
        gx.run(cart(file, -0.03, **attached), real_time=True)
    rec = gx.run(cart(file, -0.03, **attached, **ramp()), real_time=True)
    assert rec.displayed_force[0, 0, 0] == 0.0
    assert rec.displayed_force[-1 - REST, 0, 0] > 0.0


MOVING = {
    "moves at 0.3 m/s": lambda fake, p, v, t: (p, v + 0.3, t),
    "moves at 0.4 m/s": lambda fake, p, v, t: (p + 0.4 * (t - 0.1), v, t),
    "had a new sample in": lambda fake, p, v, t: (p, v, fake.reads // 2 * 2 * fake.period),
    "outside its workspace": lambda fake, p, v, t: (p + 0.0, v, t),
    "cannot be read: OSError": lambda fake, p, v, t: 1 / 0 if fake.reads < 0 else (_ for _ in ()).throw(OSError("x")),
}


@pytest.mark.parametrize("says", MOVING)
def test_hardware_that_does_not_settle_is_refused(says: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(EVIL, "unsettled", Evil(read=MOVING[says]))
    file = driver(tmp_path)
    scene = cart(file, -0.03, **{"finger.0.device.evil": "unsettled", "finger.0.device.at": -SETTLING})
    if "workspace" in says:
        scene = scene.replace({"finger.0.device.workspace": [[0.0], [0.1]]})
    with pytest.raises(DeviceError, match=rf"the device of finger0 \(Fake\) (is )?{says}"):
        gx.run(scene, real_time=True)
    log = [what for _, what in fakes(file)[-1].log]
    assert log[-2:] == ["stop", "close"]
    assert not any(np.any(what) for what in log if isinstance(what, np.ndarray))


def test_a_finger_that_leaves_before_the_run_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It is moved by 2 mm while the recording is opened."""
    monkeypatch.setitem(EVIL, "leaves", Evil(read=lambda fake, p, v, t: (p - 0.002, v, t)))
    scene = cart(driver(tmp_path), -0.03, **{"finger.0.device.evil": "leaves", "finger.0.device.at": -1})
    with pytest.raises(DeviceError, match=r"was moved by 2\.0 mm before the run began"):
        gx.run(scene, real_time=True)


def test_a_second_device_that_does_not_open_closes_the_first(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = driver(tmp_path)
    two = {"start": [0.03], "device": {"name": str(file), "position": [[0.03]]}}
    scene = cart(file).replace({"finger.1": two})
    whole = Fake.open

    def second(self: Fake, period: float) -> None:
        if self.x[0, 0] > 0.0:
            raise PermissionError(13, "Permission denied")
        whole(self, period)

    monkeypatch.setattr(Fake, "open", second)
    with pytest.raises(DeviceError, match=r"finger1 \(Fake\) cannot be opened: PermissionError: .*Permission denied"):
        gx.run(scene, real_time=True)
    first, other = fakes(file)[-2:]
    assert [what for _, what in first.log] == ["open", "stop", "close"]
    assert [what for _, what in other.log] == ["stop", "close"]


def test_a_device_that_cannot_be_closed_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its force was zero before; the run's recording is there."""

    def close(self: Fake) -> None:
        raise OSError("no such device")

    monkeypatch.setattr(Fake, "close", close)
    with pytest.warns(UserWarning, match=r"finger0 \(Fake\) cannot be closed: OSError: no such device"):
        rec = gx.run(cart(driver(tmp_path)), real_time=True)
    assert rec.outcome.complete


def test_a_device_that_cannot_be_stopped_is_a_fault(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def stop(self: Fake) -> None:
        raise OSError("no such device")

    monkeypatch.setattr(Fake, "stop", stop)
    rec = gx.run(cart(driver(tmp_path)), real_time=True)
    assert "cannot be stopped, and its force may remain; switch the device off: OSError" in rec.faults[0].message
    assert rec.faults[0].tick == len(rec)


def test_all_are_asked_before_the_first_is_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file, calls = driver(tmp_path), list[str]()
    whole = Fake.read

    def read(self: Fake) -> Any:
        calls.append("read")
        return whole(self)

    monkeypatch.setattr(Fake, "ask", lambda self: calls.append("ask"), raising=False)
    monkeypatch.setattr(Fake, "read", read)
    two = {"start": [0.03], "device": {"name": str(file), "position": [[0.03]]}}
    gx.run(cart(file).replace({"finger.1": two}), duration=0.05, real_time=True)
    assert calls == ["ask", "ask", "read", "read"] * (10 + SETTLING)


def test_hardware_needs_the_walls_clock(tmp_path: Path) -> None:
    """Run, open, a batch and a bare servo refuse it in the same words, and nothing is opened."""
    file = driver(tmp_path)
    words = r"this scene has hardware, which needs real time; .*--real-time.*real_time=True.*finger0 \(Fake\)"
    with pytest.raises(InputError, match=words):
        gx.run(cart(file))
    with pytest.raises(InputError, match=words):
        gx.open(cart(file))
    with pytest.raises(InputError, match=words), build(cart(file)) as servo:
        servo.run(1, None)
    assert not any(fake.log for fake in fakes(file))


def test_simulations_in_real_time_are_the_same_to_the_bit() -> None:
    """Late or not, paced or not: no clock decides what is computed."""
    scene = gx.load("reference-1dof")
    paced = gx.run(scene, duration=0.5, real_time=True)
    assert VirtualClock.time > 0.0
    free = gx.run(scene, duration=0.5)
    for name in free.layout.columns:
        assert np.array_equal(getattr(paced, name, 0), getattr(free, name, 0)), name
    assert np.array_equal(require(paced.true_position), require(free.true_position))
    assert not paced.header.settled


def test_signals_have_their_handlers_only_while_hardware_is_open(tmp_path: Path) -> None:
    """Those of before are there again afterwards; another thread and simulations leave them alone."""
    numbers = [signal.SIGINT, signal.SIGTERM]
    before = [signal.getsignal(number) for number in numbers]
    seen: list[list[Any]] = []

    def stop() -> bool:
        seen.append([signal.getsignal(number) for number in numbers])
        return False

    gx.run(cart(driver(tmp_path)), duration=0.05, real_time=True, stop=stop)
    assert all(handlers[i] is not before[i] for handlers in seen for i in (0, 1))
    assert [signal.getsignal(number) for number in numbers] == before
    seen.clear()
    gx.run("reference-1dof", duration=0.05, real_time=True, stop=stop)
    thread = threading.Thread(target=lambda: gx.run(cart(driver(tmp_path)), duration=0.05, real_time=True, stop=stop))
    thread.start()
    thread.join()
    assert seen
    assert all(handlers == before for handlers in seen)


def test_the_cause_of_an_end_is_recorded(tmp_path: Path) -> None:
    """An exception that breaks off a run, simulated or not, is in what was recorded of it."""

    def stop() -> bool:
        raise ArithmeticError("the caller's own")

    file = driver(tmp_path)
    for i, scene in enumerate((cart(file, -0.0245), gx.load("reference-1dof"))):
        with pytest.raises(ArithmeticError):
            gx.run(scene, real_time=not i, stop=stop, out=tmp_path / str(i))
        rec = gx.Recording.load(tmp_path / str(i))
        assert rec.outcome.cause == "ArithmeticError: the caller's own"
        assert not rec.outcome.complete
    assert [what for _, what in fakes(file)[-1].log if isinstance(what, str)] == ["open", "stop", "stop", "close"]


def test_an_object_that_is_no_data_is_named(tmp_path: Path) -> None:
    """A board made in Python cannot be written into a recording: before anything is opened the key is told."""
    file = driver(tmp_path)
    with pytest.raises(InputError, match=r"finger\.0\.device\.board: .*expected numbers, texts.*a driver of your own"):
        gx.run(cart(file, -0.03, **{"finger.0.device.board": object()}), real_time=True)
    assert not any(fake.log for fake in fakes(file))


def test_settling_takes_a_fifth_of_a_second() -> None:
    assert lifecycle.DURATION == 0.2
    assert round(lifecycle.DURATION / CART["period"]) + 1 == SETTLING  # and a look before the run


def test_a_full_disk_ends_in_zero_force_first(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The error of the disk ends the run; by then every device had been stopped."""
    file, stops = driver(tmp_path), list[int]()

    def write(self: sink.FileSink, *arguments: Any) -> None:
        raise RecordingError("no space left on the disk")

    whole = sink.FileSink.close

    def close(self: sink.FileSink, outcome: Any) -> None:
        stops.append(fakes(file)[-1].index("stop"))
        whole(self, outcome)

    monkeypatch.setattr(recorders, "SECOND", 0.0)
    monkeypatch.setattr(sink.FileSink, "write", write)
    monkeypatch.setattr(sink.FileSink, "close", close)
    with pytest.raises(RecordingError, match="no space left"):
        gx.run(cart(file, -0.0245), real_time=True, out=tmp_path / "out")
    assert stops
    assert not any(np.any(what) for _, what in fakes(file)[-1].log[stops[0] :] if isinstance(what, np.ndarray))


def test_what_was_late_and_what_was_held_is_counted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Every third reading brings no new sample, and one tick takes three periods: no fault, and both are recorded."""

    def read(fake: Fake, p: Any, v: Any, t: float) -> Any:
        if fake.tick == 20:
            VirtualClock.time += 3.2 * fake.period
        return p, v, (fake.reads - (fake.reads % 3 == 0)) * fake.period

    monkeypatch.setitem(EVIL, "late", Evil(read=read))
    scene = cart(driver(tmp_path), -0.0245, **{"finger.0.device.evil": "late", "finger.0.device.at": 0})
    rec = gx.run(scene, duration=0.3, real_time=True, out=tmp_path / "out")
    assert not rec.faults
    assert (rec.outcome.skipped, rec.outcome.repeats) == (2, 20)
    assert len(rec) == 60
    assert np.array_equal(rec.time, np.arange(60) * 0.005)


def test_the_round_trip_is_measured(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A reading of 0.4 ms and a writing of 0.3 ms, on the clock of the run."""

    def read(fake: Fake, p: Any, v: Any, t: float) -> Any:
        VirtualClock.time += 0.4e-3
        return p, v, t

    def write(fake: Fake, forces: Any) -> None:
        VirtualClock.time += 0.3e-3

    monkeypatch.setitem(EVIL, "slow", Evil(read=read, write=write))
    scene = cart(driver(tmp_path), -0.03, **{"finger.0.device.evil": "slow", "finger.0.device.at": -SETTLING})
    rec = gx.run(scene, duration=0.05, real_time=True, out=tmp_path / "out")
    assert rec.header.round_trip == pytest.approx(0.7e-3, rel=1e-6)
    assert rec.header.settled == {"finger0": {"position": [-0.03], "offset": [0.0]}}


@pytest.mark.parametrize("error", [KeyboardInterrupt, SystemExit])
def test_all_are_stopped_and_closed_whatever_one_raises(
    error: type[BaseException], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The first device's reading, stop and end all ask the program to end: the other one rests, too, at once."""
    file = driver(tmp_path)
    two = {"start": [0.0245], "device": {"name": str(file), "position": [[0.0245]]}}
    scene = cart(file, -0.0245).replace({"finger.1": two})

    def leave(self: Fake) -> None:
        if self.x[0, 0] < 0.0 and self.reads > SETTLING + 10:
            raise error

    for name in ("read", "stop", "close"):
        whole = getattr(Fake, name)

        def call(self: Fake, whole: Any = whole) -> Any:
            result = whole(self)
            leave(self)
            return result

        monkeypatch.setattr(Fake, name, call)
    if error is SystemExit:  # no driver ends a run: it is a fault of each call
        with pytest.warns(UserWarning, match="cannot be closed: SystemExit"):
            rec = gx.run(scene, real_time=True, out=tmp_path / "out")
        assert "cannot be read: SystemExit" in rec.faults[0].message
        assert rec.outcome.complete
    else:
        with pytest.raises(error):
            gx.run(scene, real_time=True, out=tmp_path / "out")
        rec = gx.Recording.load(tmp_path / "out")
        assert rec.outcome.cause == error.__name__
        assert not rec.outcome.complete
    for fake in fakes(file)[-2:]:
        ends = [what for _, what in fake.log if isinstance(what, str)]
        assert (ends[0], set(ends[1:-1]), ends[-1]) == ("open", {"stop"}, "close")
        last = max(i for i, (_, what) in enumerate(fake.log) if isinstance(what, np.ndarray) and what.any())
        assert fake.log[last + 1][1] == "stop"


def test_memory_is_frozen_while_hardware_is_open(tmp_path: Path) -> None:
    """Objects of before are no matter for the collector, whose pass would make a tick late; then they are again."""
    counts: list[int] = []

    def stop() -> bool:
        counts.append(gc.get_freeze_count())
        return False

    gx.run(cart(driver(tmp_path)), duration=0.05, real_time=True, stop=stop)
    assert min(counts) > 10_000
    assert gc.get_freeze_count() == 0


def test_after_one_device_has_failed_the_next_is_told_nothing(tmp_path: Path) -> None:
    """In the tick in which the first one's `write` raises, the second one is stopped instead; both felt it before."""
    file = driver(tmp_path)
    fingers = [
        {"start": [-0.02], "device": {"name": str(file), "position": [[-0.02]], "evil": "write raises OSError"}},
        {"start": [0.02], "device": {"name": str(file), "position": [[0.02]]}},
    ]
    recording = gx.run(gx.Scene(**{**CART, "finger": fingers}).replace(ramp()), real_time=True)
    first, second = (fake for fake in fakes(file) if fake.log)
    assert recording.faults[0].tick == first.at
    assert [first.forces[-1][0], second.forces[-1][0]] == [first.at, first.at - 1]
    assert first.forces[-2][1].any() and second.forces[-1][1].any()
    after = [what for reads, what in second.log if reads > second.forces[-1][0] + 42]
    assert after and all(what in ("stop", "close") for what in after)
    assert np.array_equal(recording.displayed_force[first.at :], np.zeros_like(recording.displayed_force[first.at :]))


def test_displayed_forces_do_not_scale_with_the_period() -> None:
    """A squeeze at rest is the same for periods of 5, 2.5 and 1 ms; others display force times the period."""
    forces = []
    for period in (0.005, 0.0025, 0.001):
        changes = {
            "engine": "interpreted", "period": period,
            "coupling.internal.stiffness": 30.0, "finger.*.hand.damping": 3.0,
            "finger.0.hand.rest": [0.01], "finger.1.hand.rest": [-0.01],
        }  # fmt: skip
        recording = gx.run(gx.load("reference-1dof", changes), duration=4.0)
        forces.append(recording.displayed_force[-1].ravel())
    assert np.abs(forces[0]).min() > 0.05
    assert forces[1] == pytest.approx(forces[0], rel=1e-6)
    assert forces[2] == pytest.approx(forces[0], rel=1e-6)


def test_a_body_that_cannot_go_on_ends_the_force_at_once(tmp_path: Path) -> None:
    """It fails as it moves after tick 20, when that tick's force is displayed: the device is stopped before tick 21.

    Row 20 has the force that was displayed, and the fault is one of tick 21, the first without force.
    """
    file = driver(tmp_path)
    body = foreign_parts.write(tmp_path)["breaking"]
    rec = gx.run(cart(file, -0.021, **ramp(), **{"object.dynamics": body}), real_time=True)
    [fault] = rec.faults
    assert fault.tick == 21 and "the object broke" in fault.message
    assert rec.displayed_force[20].any() and not rec.displayed_force[21:].any()
    fake = fakes(file)[-1]
    assert max(tick for tick, _ in fake.forces) == 20
    stops = [reads - SETTLING - 1 for reads, what in fake.log if isinstance(what, str) and what == "stop"]
    assert min(tick for tick in stops if tick >= 0) == 20
