"""Calibration: late masses on a virtual clock give their own figures back, and emulators theirs."""

from __future__ import annotations

import math
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import graspfx as gx
from graspfx.assembly import device_calibration
from graspfx.assembly.device_calibration import calibrate
from graspfx.devices import haply_2diy, rig
from graspfx.devices.haply_2diy.emulator import DiyWire
from graspfx.devices.rig.emulator import RigWire
from graspfx.devices.two_link import connect as two_link
from graspfx.errors import DeviceError, InputError
from graspfx.loop.realtime.process import Exits
from graspfx.testing.wire import Wire, compiler
from tests.support.hardware import Line, VirtualClock
from tests.support.late_mass import LateMass, late_driver, late_masses

needs_compiler = pytest.mark.skipif(compiler() is None, reason="no C compiler")

SQUARE: dict[str, Any] = {
    "dimensions": 2, "period": 0.001, "duration": 1.0,
    "object": {"mass": 0.1, "viscosity": 0.8, "rotational_viscosity": 1e-3,
               "shape": {"kind": "box", "size": [0.04, 0.04]}},
    "coupling": {"external": {"stiffness": 30.0}, "internal": {"stiffness": 30.0}}, "safety": {"force": 5.0},
}  # fmt: skip


@pytest.fixture
def virtual(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let no time pass but what the device takes."""
    monkeypatch.setattr(device_calibration, "WallClock", VirtualClock)
    VirtualClock.time = 1.0


def square(file: Path, **settings: Any) -> gx.Scene:
    device = {"name": str(file), **settings}
    return gx.Scene(**SQUARE, finger=[{"device": device, "start": [-0.03, 0.0]}])


@pytest.mark.parametrize(
    ("settings", "pulses"),
    [({}, 60), ({"transport": 0.0031, "age": 0.0005}, 40), ({"mass": 0.4, "friction": 1.5, "transport": 0.0}, 40)],
)
@pytest.mark.usefixtures("virtual")
def test_a_late_mass_comes_back(settings: dict[str, Any], pulses: int, tmp_path: Path) -> None:
    """Lateness to 0.1 ms and to four of its own standard errors, mass to 1 %, friction to 5 %."""
    file = late_driver(tmp_path)
    result = calibrate(square(file, **settings), pulses=pulses)
    device = late_masses(file)[-1]
    figures = result.devices[0].each["finger0"]
    true = device.transport + device.age + device.writing
    assert result.devices[0].lateness == pytest.approx(true, abs=1e-4)
    assert abs(result.devices[0].lateness - true) < 4.0 * figures.delay.error + 2e-5
    assert result.devices[0].round_trip == pytest.approx(device.reading + device.writing, abs=1e-9)
    assert figures.mass.value == pytest.approx(device.mass, rel=0.01)
    assert figures.friction.value == pytest.approx(device.friction, rel=0.05)
    assert figures.force == pytest.approx(0.02 * 5.0)
    assert figures.pulses == pulses and figures.resolution == device.step
    forces = np.array([each for each in device.log if isinstance(each, np.ndarray)])
    assert np.linalg.norm(forces, axis=2).max() <= 0.1 + 1e-12
    first = next(k for k, each in enumerate(device.log) if isinstance(each, np.ndarray) and each.any())
    assert first > 200  # settled at zero force
    assert [each for each in device.log if isinstance(each, str)] == ["open", "stop", "close"]


@pytest.mark.usefixtures("virtual")
def test_measures_go_into_the_scene_and_its_certificate(tmp_path: Path) -> None:
    file = late_driver(tmp_path)
    scene = square(file, transport=0.002).replace({"object.position": [-0.01, 0.0]})  # the finger is on its side
    with pytest.raises(InputError, match="mass and friction"):
        gx.certify(scene)
    result = calibrate(scene, pulses=20)
    text = result.toml()
    overrides = tomllib.loads(text)
    assert set(overrides) == {"finger.0.device.measures"}
    for key, value in result.overrides["finger.0.device.measures"].items():
        assert overrides["finger.0.device.measures"][key] == pytest.approx(value, rel=1e-5)
    low = overrides["finger.0.device.measures"]["lateness"]
    high = low + 0.004
    overrides["finger.0.device.measures"]["jitter"] = [low, high]
    measured = scene.replace(overrides)
    [certificate] = gx.certify(measured, quick=True)
    assert any("late in 98 % of the samples; judged at" in text for text in certificate.assumed)
    linear = measured.linearise("provisional")
    assert set(linear.lateness.tolist()) <= {low, high}
    ends = [gx.stability.spectral_radius(linear.with_changes(lateness=each)) for each in (low, high)]
    assert gx.stability.spectral_radius(linear) == max(ends)
    assert "lateness" in "\n".join(result.lines())


@pytest.mark.parametrize(
    ("settings", "says"),
    [({"stuck": True}, "moved by 0 um under 0.1 N"), ({"way": -1.0}, "moves against a force along axis 0")],
)
@pytest.mark.usefixtures("virtual")
def test_a_finger_that_does_not_answer_is_told(settings: dict[str, Any], says: str, tmp_path: Path) -> None:
    file = late_driver(tmp_path)
    with pytest.raises(DeviceError, match=says):
        calibrate(square(file, **settings), pulses=20)
    assert late_masses(file)[-1].log[-2:] == ["stop", "close"]


@pytest.mark.usefixtures("virtual")
def test_a_finger_that_runs_away_is_stopped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A hand, or gravity, that takes the finger along while it is pushed."""
    file = late_driver(tmp_path)
    write = LateMass.write

    def pushed(self: LateMass, forces: Any) -> None:
        write(self, forces)
        self.push[0] = 0.5 if forces.any() else self.push[0]

    monkeypatch.setattr(LateMass, "write", pushed)
    with pytest.raises(DeviceError, match=r"make sure that nothing touches it|faster than|against a force"):
        calibrate(square(file), pulses=20)
    assert late_masses(file)[-1].log[-2:] == ["stop", "close"]


@pytest.mark.parametrize("pause", [0.0055, 0.02, 30.0])
@pytest.mark.usefixtures("virtual")
def test_a_force_does_not_stand_while_the_machine_is_away(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, pause: float
) -> None:  # fmt: skip
    """Five periods may be left out while a force is on, no more: then zero is the next that the device is told."""
    file, away = late_driver(tmp_path), list[float]()
    write = LateMass.write

    def slow(self: LateMass, forces: Any) -> None:
        write(self, forces)
        if forces.any() and not away:
            VirtualClock.time += pause
            away.append(pause)

    monkeypatch.setattr(LateMass, "write", slow)
    if pause < 0.006:
        calibrate(square(file), pulses=20)
        return
    with pytest.raises(DeviceError, match=r"successive periods of 0\.001 s were skipped, expected at most 5"):
        calibrate(square(file), pulses=20)
    log = late_masses(file)[-1].log
    assert log[-2:] == ["stop", "close"]
    assert sum(isinstance(each, np.ndarray) and bool(each.any()) for each in log) == 1


@pytest.mark.usefixtures("virtual")
def test_limits_of_the_scene_hold_and_a_signal_ends_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = late_driver(tmp_path)
    limited = square(file).replace({"safety.force": 1.0})
    figures = calibrate(limited, pulses=20).devices[0].each["finger0"]
    assert figures.force == pytest.approx(0.02)
    write = LateMass.write

    def signalled(self: LateMass, forces: Any) -> None:
        write(self, forces)
        if forces.any():
            import signal

            signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr(LateMass, "write", signalled)
    with pytest.raises(KeyboardInterrupt):
        calibrate(square(file), pulses=20)
    log = late_masses(file)[-1].log
    assert log[-2:] == ["stop", "close"]
    assert sum(isinstance(each, np.ndarray) and bool(each.any()) for each in log) == 1
    assert isinstance(Exits().numbers, list)


def test_simulations_and_odd_arguments_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="expected a scene with hardware"):
        calibrate("reference-1dof")
    scene = square(late_driver(tmp_path))
    for share in (0.0, 0.5, math.nan):
        with pytest.raises(InputError, match="share: given"):
            calibrate(scene, share=share)
    with pytest.raises(InputError, match="pulses: given"):
        calibrate(scene, pulses=0)


@pytest.mark.usefixtures("virtual")
def test_a_person_shows_axes_and_zero(tmp_path: Path) -> None:
    """The prompt moves the finger as it is told, along x to the wrong side."""
    file = late_driver(tmp_path)
    said: list[str] = []

    def person(text: str) -> None:
        said.append(text)
        device = late_masses(file)[-1]
        device.v[...] = 0.0
        if "to the right" in text:
            device.x[0] -= 0.02
            return_to.append(device)
        elif "up, or away" in text:
            device.x[1] += 0.02
        elif "origin" in text:
            device.x[:] = 0.004, -0.003

    return_to: list[LateMass] = []
    # a step of 20 mm at once is no motion of a hand: let readings be of a hand that is quick enough
    result = calibrate(square(file).replace({"safety.speed": 50.0}), pulses=20, prompt=person)
    measures = result.devices[0]
    assert measures.axes["finger0"]["x"].startswith("WRONG: it moved along -x")
    assert measures.axes["finger0"]["y"] == "correct: it moved along +y"
    assert measures.zero["finger0"] == pytest.approx([0.004, -0.003], abs=1e-4)
    assert said[0].startswith("move finger0")
    text = "\n".join(measures.lines())
    assert "WRONG" in text and "read at" in text


def on_wire(name: str, wire: Wire, **settings: Any) -> gx.Scene:
    device = {"name": name, "timeout": 0.0025, **wire.settings, **settings}
    return gx.Scene(
        **SQUARE | {"period": 0.002, "safety": {"force": 5.0, "hold": 300}},
        finger=[{"device": device, "start": [0, 0]}],
    )


@needs_compiler
@pytest.mark.usefixtures("virtual")
def test_an_arm_of_the_rig_s_emulator_comes_back(monkeypatch: pytest.MonkeyPatch) -> None:
    """Mass to 4 % and friction to 20 %; the line takes no time."""
    base = (-0.04, -0.18)
    with RigWire(stiffness=0.0, damping=0.0, slowness=8.0, clock=VirtualClock()) as wire:
        monkeypatch.setattr(rig, "SerialPort", lambda path: Line(wire))
        place = wire.position[0].tolist()
        [device] = calibrate(on_wire("rig", wire, arms=[{"base": base, "elbow": "left"}]), pulses=20).devices
    arm, figures = two_link(base=base), device.each["finger0"]
    M, B = arm.effective_mass(place), arm.effective_friction(place)
    assert figures.mass.value == pytest.approx(math.sqrt(np.linalg.det(M)), rel=0.04)
    assert figures.friction.value == pytest.approx(math.sqrt(np.linalg.det(B)), rel=0.2)
    assert figures.mobility == pytest.approx(np.linalg.inv(M), rel=0.06, abs=0.5)
    assert 0.0 <= device.lateness < 0.002


@pytest.mark.usefixtures("virtual")
def test_a_2diy_s_emulator_with_heavy_links_comes_back(monkeypatch: pytest.MonkeyPatch) -> None:
    """Mass to 8 %, friction to 40 %: a step of its encoders is a tenth of a millimetre at the handle."""
    inertia, friction, home = 5e-4, 1e-3, (125.0, 55.0)
    with DiyWire(inertia=inertia, friction=friction, clock=VirtualClock()) as wire:
        monkeypatch.setattr(haply_2diy, "SerialPort", lambda path: Line(wire))
        wire.place(np.array(home))
        lever = abs(float(np.linalg.det(jacobian(wire, np.radians(home)))))
        result = calibrate(on_wire("haply-2diy", wire, home=list(home)), pulses=20, share=0.15)
    figures = result.devices[0].each["finger0"]
    assert figures.mass.value == pytest.approx(inertia / lever, rel=0.08)
    assert figures.friction.value == pytest.approx(friction / lever, rel=0.4)


def jacobian(wire: DiyWire, angles: np.ndarray) -> np.ndarray:
    steps = 1e-6 * np.eye(2)
    return np.array([(wire._place(angles + h) - wire._place(angles - h)) / 2e-6 for h in steps]).T
