"""Frame, deadman and rate of a device: what its table says of its place in the scene."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import graspfx as gx
from graspfx.assembly import run_scene as whole_run
from graspfx.assembly.mechanics import mechanics
from graspfx.assembly.replay_recording import replayed_with
from graspfx.assembly.resolve import resolve
from graspfx.errors import DeviceError, SceneError
from graspfx.loop.device import Features
from graspfx.loop.device_mount import frame
from tests.support.hardware import SETTLING, Fake, VirtualClock, driver, fakes
from tests.support.optional import require

AXES = "x -z y"
ORIGIN = [0.01, -0.02, 0.03]
SPACE: dict[str, Any] = {
    "dimensions": 3, "period": 0.005, "duration": 0.4, "engine": "interpreted",
    "object": {
        "mass": 0.1, "viscosity": 0.8, "rotational_viscosity": 1e-3,
        "shape": {"kind": "box", "size": [0.05, 0.05, 0.05]},
    },
    "coupling": {
        "external": {"stiffness": 30.0}, "internal": {"stiffness": 70.0}, "contact": "attached", "enter": "ramp"
    },
}  # fmt: skip
FIXED = {"object.free": [False] * 6}
PARTNER: dict[str, Any] = {
    "start": [0.025, 0.0, 0.0], "device": {"name": "simulated", "mass": 0.15, "damping": 0.2},
    "hand": {"stiffness": 60.0, "damping": 0.5},
}  # fmt: skip


@pytest.fixture(autouse=True)
def clock(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let no time pass but what a device takes."""
    monkeypatch.setattr(whole_run, "WallClock", VirtualClock)


def scene(file: Path, position: Any, *, safety: Any = None, **keys: Any) -> gx.Scene:
    """Put a box between a fake and a simulated finger; `keys` are of the fake's table."""
    finger = {"start": [-0.025, 0.0, 0.0], "device": {"name": str(file), "position": [list(position)], **keys}}
    table = {**SPACE, "finger": [finger, PARTNER]}
    return gx.Scene(**(table if safety is None else {**table, "safety": safety}))


def test_axes_are_letters_or_a_matrix() -> None:
    letters = frame(3, ORIGIN, AXES, 2.0)
    matrix = frame(3, ORIGIN, [[1, 0, 0], [0, 0, -1], [0, 1, 0]], 2.0)
    assert np.array_equal(letters.axes, matrix.axes)
    assert np.allclose(letters.place(np.array([[0.1, 0.2, 0.3]])), [[0.21, -0.62, 0.43]])  # x, -z and y of the device
    assert np.array_equal(frame(2, None, None, 1.0).axes, np.eye(2))
    assert frame(1, None, "-x", 1.0).axes.tolist() == [[-1.0]]
    assert frame(2, None, "x -y", 1.0).axes.tolist() == [[1.0, 0.0], [0.0, -1.0]]  # a plane, seen from behind


def test_power_is_kept_and_motion_goes_back() -> None:
    rng = np.random.default_rng(0)
    for s in (0.3, 1.0, 7.0):
        turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        turn *= np.sign(np.linalg.det(turn))
        own = frame(3, rng.normal(size=3).tolist(), turn.tolist(), s)
        p, v, f = rng.normal(size=(3, 4, 3))
        assert np.sum(own.pull(f) * v) == pytest.approx(np.sum(f * own.turn(v)), rel=1e-13)
        assert own.back(own.place(p)[0]) == pytest.approx(p[0], abs=1e-14)
        energy = v[0] @ own.axes.T  # of a mass: the same on both sides
        M = rng.normal(size=(3, 3))
        assert own.turn(v)[0] @ own.impedance(M) @ own.turn(v)[0] == pytest.approx(v[0] @ M @ v[0], rel=1e-12)
        assert np.linalg.norm(energy) == pytest.approx(np.linalg.norm(v[0]))


def test_features_are_those_of_the_scene() -> None:
    box = np.array([-0.1, -0.2, 0.0]), np.array([0.1, 0.2, 0.4])
    own = Features(
        fingers=1, dimensions=3, workspace=box, continuous_force=2.0, peak_force=8.0, stiffness=400.0, damping=4.0,
        mass=0.2, friction=0.1, resolution=1e-5, delay=1, watchdog=0.01,
    )  # fmt: skip
    there = frame(3, ORIGIN, AXES, 2.0).features(own)
    figures = there.continuous_force, there.peak_force, there.stiffness, there.damping, there.mass, there.friction
    assert figures == (1.0, 4.0, 100.0, 1.0, 0.05, 0.025)
    assert (there.resolution, there.delay, there.watchdog) == (2e-5, 1, 0.01)
    assert there.workspace is not None
    assert np.allclose(there.workspace, [[-0.19, -0.82, -0.37], [0.21, -0.02, 0.43]])
    slanted = frame(2, None, [[0.6, 0.8], [-0.8, 0.6]], 1.0)
    corner = np.array([0.1, 0.3])
    lower, upper = require(slanted.features(Features(1, 2, workspace=(-corner, corner))).workspace)
    corners = np.array([[x, y] for x in (lower[0], upper[0]) for y in (lower[1], upper[1])]) @ slanted.axes
    assert np.abs(corners[:, 0]).max() <= 0.1 + 1e-12
    assert np.abs(corners[:, 1]).max() <= 0.3 + 1e-12


@pytest.mark.parametrize(
    ("key", "value", "text"),
    [
        ("axes", "x y", "each of x, y, z once"),
        ("axes", "x y -y", "each of x, y, z once"),
        ("axes", "x z y", "right-handed"),
        ("axes", "-x -y -z", "right-handed"),
        ("axes", [[1, 0], [0, 1]], "a matrix 3 x 3"),
        ("axes", [[2, 0, 0], [0, 2, 0], [0, 0, 2]], "orthogonal rows of length 1"),
        ("origin", [0.0, 0.0], "3 coordinates"),
        ("scale", 0.0, "more than 0"),
        ("scale", -1.0, "more than 0"),
    ],
)
def test_a_frame_that_is_none_is_refused_by_its_key(tmp_path: Path, key: str, value: Any, text: str) -> None:
    with pytest.raises(SceneError, match=rf"finger\.0\.device\.frame\.{key}.*{text}"):
        scene(driver(tmp_path), [-0.03, 0.0, 0.0], frame={key: value})


def test_keys_of_hardware_are_no_simulation_s(tmp_path: Path) -> None:
    for key, value in (("frame", {"scale": 2.0}), ("deadman", 0), ("rate", 100.0)):
        other = {**PARTNER, "device": {**PARTNER["device"], key: value}}
        with pytest.raises(SceneError, match=rf"finger\.0\.device\.{key}: only hardware has this setting"):
            gx.Scene(**{**SPACE, "finger": [other, {**PARTNER, "start": [-0.025, 0.0, 0.0]}]})


def test_a_run_in_a_frame_is_the_run_without_it(tmp_path: Path) -> None:
    """Positions and forces of the scene are the same; the device is told s R' f."""
    file, place = driver(tmp_path), frame(3, ORIGIN, AXES, 2.0)
    at = np.array([-0.031, 0.002, 0.001])
    plain = gx.run(scene(file, at), real_time=True)
    there = gx.run(scene(file, place.back(at), frame={"origin": ORIGIN, "axes": AXES, "scale": 2.0}), real_time=True)
    assert np.abs(there.finger_position - plain.finger_position).max() < 1e-15
    assert np.abs(there.finger_force).max() > 0.01
    # the fake's limit of 1 N is 0.5 N in the scene, which is not reached
    assert np.abs(there.finger_force - plain.finger_force).max() < 1e-12
    forces = np.array([force[0] for tick, force in fakes(file)[-1].forces if tick >= 0])
    assert np.allclose(forces, place.pull(there.displayed_force[:, 0]), rtol=1e-12, atol=0.0)
    assert there.header.settled["finger0"]["position"] == pytest.approx(at.tolist(), abs=1e-15)


def test_limits_are_those_at_the_device(tmp_path: Path) -> None:
    """A limit of 0.1 N in a scene is felt as 0.1 N, and 1 m/s is that of the hand."""
    file, large = driver(tmp_path), {"origin": ORIGIN, "scale": 4.0}
    far = frame(3, ORIGIN, None, 4.0).back(np.array([-0.06, 0.0, 0.0]))
    limited = scene(file, far, frame=large, safety={"force": 0.1, "rate": 8.0, "speed": 1.0, "soft_start": 0.005})
    limited = limited.replace(FIXED)
    limits = resolve(limited).safety
    assert limits is not None
    assert (limits.force[0], limits.rate[0], limits.speed[0]) == (0.025, 2.0, 4.0)
    assert (limits.force[1], limits.rate[1], limits.speed[1]) == (0.1, 8.0, 1.0)
    gx.run(limited, real_time=True)
    within = max(np.linalg.norm(force) for _, force in fakes(file)[-1].forces)
    gx.run(limited.replace({"safety.force": 9.0}), real_time=True)
    beyond = max(np.linalg.norm(force) for _, force in fakes(file)[-1].forces)
    assert 0.03 < within <= 0.1 * (1.0 + 1e-12) < beyond
    untold = resolve(scene(file, far, frame=large, safety={})).safety
    assert untold is not None
    assert untold.force.tolist() == [0.75, 3.0]  # 3 N at the hand


def test_masses_that_depend_on_the_posture_are_looked_up_in_the_device_s_place(tmp_path: Path) -> None:
    arm = """
import numpy as np
from tests.support.hardware import Fake
class Arm(Fake):
    def __init__(self, position):
        super().__init__(position)
        from dataclasses import replace
        self.features = replace(self.features, mass=0.1, friction=0.2)
    def effective_mass(self, position):
        return np.diag([1.0 + position[0], 2.0 + position[1], 3.0 + position[2]])
    def effective_friction(self, position):
        return np.eye(3)
def connect(position):
    return Arm(position)
"""
    file = tmp_path / "arms.py"
    file.write_text(arm)
    place = frame(3, ORIGIN, AXES, 2.0)
    parts = resolve(scene(file, [0, 0, 0], frame={"origin": ORIGIN, "axes": AXES, "scale": 2.0}))
    at = place.place(np.array([[0.5, 0.25, 0.125]]))
    found = mechanics(parts, np.vstack([at, at]), [])
    assert np.allclose(found.mass[0], np.diag([1.5, 3.125, 2.25]) / 4.0)
    assert np.allclose(found.friction[0], np.eye(3) / 4.0)


def test_a_deadman_that_is_up_takes_the_force(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Within a tick without a chain; with one in 20 ms, and a deadman that comes down again brings no force back."""
    file, at = driver(tmp_path), [-0.031, 0.0, 0.0]
    read = Fake.read

    def let_go(fake: Fake) -> Any:
        fake.switches = 1 if fake.tick in (20, 21) else 3
        return read(fake)

    monkeypatch.setattr(Fake, "read", let_go)
    chain = {"soft_start": 0.005, "force": 1.0}
    slow = gx.run(scene(file, at, deadman=1, switches=2, safety=chain).replace(FIXED), real_time=True)
    assert "the deadman switch of the device of finger0 (Fake) was released" in slow.faults[0].message
    size = np.linalg.norm(slow.displayed_force[:, 0], axis=1)
    assert size[20] > 0.0
    assert size[20:25] == pytest.approx(size[20] * np.linspace(1.0, 0.0, 5), rel=0.2, abs=1e-9)
    assert not size[25:].any()
    last = [force for tick, force in fakes(file)[-1].forces if tick >= 25]
    assert not np.any(last)


def test_a_run_in_a_frame_at_a_rate_with_a_deadman_let_go_is_replayed_to_the_bit(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file, place, read = driver(tmp_path), frame(3, ORIGIN, AXES, 2.0), Fake.read

    def unsteady(fake: Fake) -> Any:
        fake.switches = 0 if fake.reads == 50 else 1
        p, v, _ = read(fake)
        return p, v, fake.period * {30: 29, 36: 35, 37: 35}.get(fake.reads, fake.reads)  # some bring no new sample

    monkeypatch.setattr(Fake, "read", unsteady)
    own = place.back(np.array([-0.031, 0.002, 0.001]))
    keys: dict[str, Any] = {"frame": {"origin": ORIGIN, "axes": AXES, "scale": 2.0}, "rate": 100.0, "deadman": 0}
    rec = gx.run(scene(file, own, switches=1, **keys), real_time=True)
    assert "the deadman switch of" in rec.faults[0].message
    monkeypatch.setenv("GRASPFX_TRUST", "1")  # the fakes' driver is elsewhere
    again = replayed_with(rec, {})
    assert [str(each) for each in again.differences] == []
    assert np.array_equal(again.recording.displayed_force, rec.displayed_force)


def test_a_deadman_that_is_up_at_first_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file, read = driver(tmp_path), Fake.read

    def up(fake: Fake) -> Any:
        fake.switches = 0
        return read(fake)

    monkeypatch.setattr(Fake, "read", up)
    with pytest.raises(DeviceError, match=r"finger0 \(Fake\) has its deadman switch 0 released: hold it down"):
        gx.run(scene(file, [-0.031, 0.0, 0.0], deadman=0, switches=1), real_time=True)
    assert not any(force.any() for _, force in fakes(file)[-1].forces)


def test_a_deadman_is_a_switch_that_the_device_has(tmp_path: Path) -> None:
    file = driver(tmp_path)
    for switches, text in ((0, "no switches"), (1, "1 switch;"), (2, "2 switches")):
        with pytest.raises(SceneError, match=rf"finger\.0\.device\.deadman: .*{text}.*given 2"):
            scene(file, [-0.031, 0.0, 0.0], deadman=2, switches=switches)


def test_switches_that_are_no_number_are_a_fault(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file, read = driver(tmp_path), Fake.read

    def odd(fake: Fake) -> Any:
        fake.switches = 1 if fake.tick < 5 else None
        return read(fake)

    monkeypatch.setattr(Fake, "read", odd)
    rec = gx.run(scene(file, [-0.031, 0.0, 0.0], deadman=0, switches=1), real_time=True)
    assert "returned None for its switches" in rec.faults[0].message
    assert not rec.displayed_force[6:].any()


def test_a_device_is_called_at_its_rate(tmp_path: Path) -> None:
    """In every second tick, opened with twice the period; between two calls the last sample and force stand."""
    file = driver(tmp_path)
    rec = gx.run(scene(file, [-0.031, 0.0, 0.0], rate=100.0), real_time=True)
    fake = fakes(file)[-1]
    ticks = len(rec.time)
    assert fake.period == 0.01
    assert abs(2 * fake.reads - (ticks + SETTLING)) <= 2
    writes = sum(1 for _, what in fake.log if isinstance(what, np.ndarray))
    assert abs(writes - fake.reads) <= 1
    assert rec.outcome.complete
    assert rec.outcome.repeats == 0
    assert resolve(scene(file, [0, 0, 0], rate=100.0)).wires[0].features.delay == 1
    assert resolve(scene(file, [0, 0, 0], rate=200.0)).wires[0].fitting.every == 1
    with pytest.raises(SceneError, match=r"device\.rate: expected at least 50 Hz"):
        scene(file, [0, 0, 0], rate=40.0)


def test_a_device_of_a_lower_rate_still_faults_when_its_samples_stop(tmp_path: Path) -> None:
    file = driver(tmp_path)
    rec = gx.run(scene(file, [-0.031, 0.0, 0.0], rate=100.0, evil="a clock that stands"), real_time=True)
    assert "no new reading of the device of finger0 (Fake) for more than 3 samples" in rec.faults[0].message
