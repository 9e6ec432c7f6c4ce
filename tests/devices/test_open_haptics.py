"""Devices in the scheduler of OpenHaptics: its rules, its errors in words, zero force, and the loop in its thread."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import graspfx as gx
from graspfx.assembly import run_scene as whole_run
from graspfx.certificate.plan import plan
from graspfx.devices import open_haptics
from graspfx.devices.open_haptics.emulator import OpenHapticsWire
from graspfx.errors import DeviceError, InputError
from graspfx.testing import check_device, driver
from graspfx.testing.wire import compiler
from tests.support.hardware import VirtualClock
from tests.support.optional import require

require("llvmlite")
if not sys.platform.startswith("linux") or compiler() is None:
    pytest.skip("the fake scheduler is for Linux, and C", allow_module_level=True)

PERIOD = 0.001
TRIES = 10  # of a run that a busy machine may be too late for
X = np.array([[1.0, 0.0, 0.0]])


@pytest.fixture
def wire(monkeypatch: pytest.MonkeyPatch) -> Iterator[OpenHapticsWire]:
    """Devices whose scheduler calls as a test waits for it."""
    with paced(monkeypatch) as bench:
        yield bench


@pytest.fixture
def real_wire() -> Iterator[OpenHapticsWire]:
    """Devices whose scheduler has the machine's clock."""
    with OpenHapticsWire() as bench:
        yield bench


def paced(monkeypatch: pytest.MonkeyPatch) -> OpenHapticsWire:
    bench = OpenHapticsWire(clock=VirtualClock())
    now, sleep = bench.clock.now, bench.clock.sleep
    monkeypatch.setattr(open_haptics, "Stylus", partial(open_haptics.Stylus, now=now, sleep=sleep))
    return bench


def until(wire: OpenHapticsWire, condition: Callable[[], Any], turns: int = 100) -> None:
    """Let turns pass until a condition is true."""
    while not condition():
        assert turns, "not within these turns"
        turns -= 1
        wire.clock.sleep(PERIOD)


def connect(wire: OpenHapticsWire, **settings: Any) -> Any:
    return driver("open-haptics").connect(**{**wire.settings, **settings})


def display(wire: OpenHapticsWire, *forces: tuple[Any, float]) -> None:
    """Write forces along x [N] to devices, in the wire's order, until it has them: each stands for 20 ms only."""

    def has_them() -> bool:
        for device, force in forces:
            device.write(force * X)
        return [wire.forces(i)[0] for i in range(len(forces))] == [force for _, force in forces]

    until(wire, has_them)


def test_it_keeps_its_promises(wire: OpenHapticsWire) -> None:
    """All promises that are seen on its wire are kept, and no rule of the library is broken meanwhile."""
    check_device(lambda: connect(wire), wire=wire, period=PERIOD)
    assert wire.violations == 0


def test_two_devices_share_one_scheduler(wire: OpenHapticsWire) -> None:
    """One callback for both, frames inside one another; each has its own force; the one goes on without the other."""
    with connect(wire) as one, connect(wire, unit="right") as two:
        one.open(PERIOD)
        two.open(PERIOD)
        wire.place(np.array([0.1, 0.2, 0.3]), 1)
        until(wire, lambda: two.read()[0].tolist() == [[0.1, 0.2, pytest.approx(0.3)]])
        display(wire, (one, 1.0), (two, -2.0))
        one.close()
        assert not wire.forces(0).any()
        before = two.read()[2]
        until(wire, lambda: two.read()[2] > before)
    assert wire.violations == 0
    assert wire.state.starts == 2  # with both; then with the one that is left


def test_a_device_that_another_program_has_is_refused(wire: OpenHapticsWire) -> None:
    with connect(wire) as one, connect(wire) as two:
        one.open(PERIOD)
        with pytest.raises(DeviceError, match=r"hdInitDevice of OpenHaptics: the device has a fault: .* \(0x300\)"):
            two.open(PERIOD)
        one.read()


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (0x200, "the motors are warm"), (0x201, "above the device's maximum"), (0x202, "changed by more"),
        (0x203, "faster than"), (0x204, "cannot be displayed"), (0x300, "has a fault"), (0x302, "does not answer"),
        (0x304, "timer"), (0x777, r"an error \(0x777\)"),
    ],
)  # fmt: skip
def test_errors_of_the_library_are_faults_in_words(wire: OpenHapticsWire, error: int, words: str) -> None:
    """Each is told by its first reader, the device is at zero force, and the stack is empty afterwards."""
    with connect(wire) as device, connect(wire, unit="right") as other:
        device.open(PERIOD)
        other.open(PERIOD)
        display(wire, (device, 1.0), (other, 1.0))
        wire.leave(error)
        with pytest.raises(DeviceError, match=f"hdBeginFrame of OpenHaptics: .*{words}"):
            until(wire, lambda: device.read()[0] is None)
        until(wire, lambda: not wire.forces(0).any() and not wire.state.error_count)
        other.read()


def test_zero_force_is_zero_after_a_position_that_is_not_finite(
    wire: OpenHapticsWire, monkeypatch: pytest.MonkeyPatch
) -> None:  # fmt: skip
    """The last force before the scheduler stops was 0 times the position: NaN."""
    last: list[np.ndarray] = []
    with connect(wire) as device:
        device.open(PERIOD)
        device.read()
        wire.place(np.full(3, np.nan))
        with pytest.raises(DeviceError, match="which is not finite"):
            until(wire, lambda: device.read()[0] is None)
        hd = device._scheduler._hd
        call = hd.call

        def note(name: str, *arguments: object) -> Any:
            if name == "hdUnschedule":
                last.append(wire.torque)
            return call(name, *arguments)

        monkeypatch.setattr(hd, "call", note)
    assert last and not np.any(last)


def test_a_program_that_hangs_has_no_force(wire: OpenHapticsWire) -> None:
    """Without news for 20 ms the thread displays none."""
    with connect(wire) as device:
        device.open(PERIOD)
        device.read()
        display(wire, (device, 1.0))
        until(wire, lambda: not wire.torque.any())


def test_settings() -> None:
    for name, value in (("unit", ""), ("library", ""), ("force_limit", 0.0), ("velocity_window", 0)):
        with pytest.raises(InputError, match=name):
            driver("open-haptics").connect(**{name: value})
    device = driver("open-haptics").connect(library="/nowhere/libHD.so")
    with pytest.raises(DeviceError, match="cannot be loaded"):
        device.open(PERIOD)


def grasp(wire: OpenHapticsWire, **changes: Any) -> gx.Scene:
    """Put a ball between two devices, 2 mm inside of it each."""
    fingers, device = [], {"name": "open-haptics", "library": wire.library}
    for k, side in enumerate((1.0, -1.0)):
        wire.place(np.array([0.028 * side, 0.0, 0.0]), k)
        fingers.append({"start": [0.03 * side, 0.0, 0.0], "device": device})
    ball = {"mass": 0.1, "viscosity": 0.8, "rotational_viscosity": 2e-4, "shape": {"kind": "sphere", "radius": 0.03}}
    coupling = {"external": {"stiffness": 100.0, "damping": 0.5}, "internal": {"stiffness": 200.0}, "enter": "ramp"}
    scene = gx.Scene(dimensions=3, period=PERIOD, duration=0.4, object=ball, coupling=coupling, finger=fingers)
    return scene.replace(changes) if changes else scene


def loop_of(scene: gx.Scene) -> str:
    return next(row.why for row in plan(scene) if row.step == "loop")


def undisturbed(go: Callable[[], gx.Recording]) -> gx.Recording:
    """Run a scene in its devices' thread, again where this machine was too late for it."""
    for _ in range(TRIES):
        try:
            rec = go()
        except DeviceError as error:
            if "new sample in" not in str(error):  # of the readings before the first tick
                raise
        else:
            if not any("too slow" in fault.message for fault in rec.faults):
                return rec
    raise AssertionError(f"{TRIES} runs, and this machine was too late for each")


@pytest.mark.alone
def test_the_loop_runs_in_its_thread(
    real_wire: OpenHapticsWire, monkeypatch: pytest.MonkeyPatch
) -> None:  # fmt: skip
    """Every tick is a turn of the scheduler; another thread that keeps the interpreter takes none away."""
    monkeypatch.setattr(whole_run, "is_possible", lambda: False)  # in this process
    scene, before = grasp(real_wire), sys.getswitchinterval()

    def hog() -> None:
        sys.setswitchinterval(10.0)
        end = time.perf_counter() + 0.2
        while time.perf_counter() < end:
            pass
        sys.setswitchinterval(before)

    def go() -> gx.Recording:
        thread = threading.Thread(target=hog)

        def stop() -> bool:
            if not thread.ident:
                thread.start()
            return False

        try:
            return gx.run(scene, real_time=True, stop=stop)
        finally:
            thread.join()  # it was started
            sys.setswitchinterval(before)

    rec = undisturbed(go)
    assert rec.ticks == 400 and not rec.faults
    assert real_wire.violations == 0
    assert real_wire.turns >= 400
    assert np.abs(rec.displayed_force[:, 0, 0]).max() > 0.01  # they squeeze
    assert not real_wire.forces(0).any()
    assert not real_wire.forces(1).any()


@pytest.mark.alone
def test_an_error_in_its_thread_is_a_fault_in_words(
    real_wire: OpenHapticsWire, monkeypatch: pytest.MonkeyPatch
) -> None:  # fmt: skip
    monkeypatch.setattr(whole_run, "is_possible", lambda: False)

    def stop() -> bool:
        real_wire.leave(0x200, 1)
        return False

    def go() -> gx.Recording:
        real_wire.leave(0, 1)
        return gx.run(scene, real_time=True, stop=stop)

    scene = grasp(real_wire)
    rec = undisturbed(go)
    fault = rec.faults[0]
    assert "of finger1 (Stylus) cannot be asked" in fault.message
    assert "hdBeginFrame of OpenHaptics: the motors are warm" in fault.message
    assert not rec.displayed_force[fault.tick :].any()
    assert not real_wire.forces(0).any()
    assert not real_wire.forces(1).any()


@pytest.mark.alone
@pytest.mark.parametrize("cause", ["late turns", "a refused force"])
def test_a_fault_in_its_thread_ends_every_force_in_a_frame(
    real_wire: OpenHapticsWire, monkeypatch: pytest.MonkeyPatch, cause: str
) -> None:  # fmt: skip
    """Late turns stop the devices before their frames are opened, a refused force after the other one's is closed."""
    monkeypatch.setattr(whole_run, "is_possible", lambda: False)
    forces: list[np.ndarray] = []

    def stop() -> bool:
        if not (real_wire.forces(0).any() and real_wire.forces(1).any()):
            return False
        if cause == "late turns":
            real_wire.state.stalled = 1
            time.sleep(0.03)
            real_wire.state.stalled = 0
        else:
            real_wire.refuse(0x204)
        last, end = real_wire.turns + 5, time.monotonic() + 5.0
        while real_wire.turns < last and time.monotonic() < end:
            time.sleep(1e-4)
        forces.append(np.array([real_wire.forces(0), real_wire.forces(1)]))
        return True

    scene = grasp(real_wire, duration=5.0)
    for _ in range(TRIES):
        rec = gx.run(scene, real_time=True, stop=stop)
        if forces:
            break
    assert not forces[0].any()
    assert ("too slow" if cause == "late turns" else "cannot be displayed") in rec.faults[0].message
    assert not any("switch the device off" in fault.message for fault in rec.faults)
    assert real_wire.violations == 0


def test_the_plan_says_who_has_the_clock(wire: OpenHapticsWire) -> None:
    assert loop_of(grasp(wire)).startswith("driven: the thread of a device's vendor calls the loop")
    slow = loop_of(grasp(wire, period=0.002))
    assert slow.endswith("calls the loop itself, 1000 times a second, but the scene's period is 0.002 s")
    assert loop_of(grasp(wire, engine="interpreted")).endswith("because the engine is 'interpreted'")
    assert not any(row.step == "loop" for row in plan(gx.load("reference-1dof")))


def test_devices_of_another_kind_beside_it(wire: OpenHapticsWire, tmp_path: Path) -> None:
    """One that offers no C functions keeps Python in the loop, and is named; so does a deadman."""
    other = {"finger.1.device": {"name": str(plain(tmp_path))}}
    assert loop_of(grasp(wire, **other)).endswith("finger1 (Plain) offers no C functions (`calls`)")


def plain(folder: Path) -> Path:
    """Write a driver of a device in plain Python, which stays where it is."""
    file = folder / "plain_driver.py"
    file.write_text(PLAIN)
    return file


PLAIN = """
from tests.support.scripted_devices import Plain

def connect():
    return Plain([[[[-0.03, 0.0, 0.0]], [[0.0, 0.0, 0.0]]]])
"""


def test_threads_that_meet_have_one_scheduler(monkeypatch: pytest.MonkeyPatch) -> None:
    """Devices are quenched in parallel; a second scheduler of their library would be refused."""
    from graspfx.devices.open_haptics import scheduler

    def load(library: str) -> object:
        time.sleep(0.05)  # as the loading of a vendor's library may take
        return object()

    monkeypatch.setattr(scheduler, "Hd", load)
    found: list[object] = []
    threads = [threading.Thread(target=lambda: found.append(scheduler.scheduler_of("slow"))) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    scheduler._scheduler.cache_clear()
    assert len(found) == 4 and len(set(map(id, found))) == 1
