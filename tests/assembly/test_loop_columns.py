"""Columns of a run on the wall's clock: when each tick was, how long devices took, and what they told besides."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import graspfx as gx
from graspfx.assembly import run_scene as whole_run
from tests.support.hardware import EVIL, SETTLING, Evil, Fake, VirtualClock, driver
from tests.support.pedal import Pedal, pedal

T = 0.005
CART: dict[str, Any] = {
    "dimensions": 1, "period": T, "duration": 0.4, "engine": "interpreted",
    "object": {"mass": 0.1, "viscosity": 0.8, "shape": {"kind": "box", "size": [0.05]}},
    "coupling": {"external": {"stiffness": 30.0}, "internal": {"stiffness": 70.0}, "absent": "follow", "enter": "ramp"},
}  # fmt: skip
NEW = {"wall", "late", "io", "skipped", "fresh"}


@pytest.fixture(autouse=True)
def clock(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(whole_run, "WallClock", VirtualClock)


def cart(file: Path, **changes: Any) -> gx.Scene:
    """Put a cart between a fake, 4 mm inside, and another one away from it."""
    fingers = [
        {"name": "left", "start": [-0.03], "device": {"name": str(file), "position": [[-0.021]]}},
        {"name": "right", "start": [0.03], "device": {"name": str(file), "position": [[0.03]]}},
    ]
    return gx.Scene(**{**CART, "finger": fingers}).replace(changes)


def late_reading(fake: Fake, p: Any, v: Any, t: float) -> Any:
    """Take 1 ms for each reading, 2.5 periods in tick 20; bring no new sample in ticks 30 to 32."""
    VirtualClock.time += 0.001 + (2.5 * T if fake.tick == 20 else 0.0)
    held = 30 <= fake.tick <= 32
    return p, v, (29 + SETTLING + 1) * fake.period if held else t


def slow_writing(fake: Fake, forces: Any) -> None:
    VirtualClock.time += 0.0005


def test_times_of_ticks_and_devices(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Readings of 1 ms and writings of 0.5 ms; one reading takes 2.5 periods more: the next tick leaves one out."""
    monkeypatch.setitem(EVIL, "slow", Evil(read=late_reading, write=slow_writing))
    scene = cart(driver(tmp_path), **{"finger.0.device.evil": "slow", "finger.0.device.at": -SETTLING})
    rec = gx.run(scene, real_time=True, out=tmp_path / "out")
    assert not rec.faults
    assert rec.layout.columns.keys() >= NEW
    wall, late, io, skipped, fresh = (getattr(rec, name) for name in ("wall", "late", "io", "skipped", "fresh"))
    assert io[:, 1] == pytest.approx(np.full(80, 0.0005))
    assert io[:, 0] == pytest.approx(np.where(np.arange(80) == 20, 0.001 + 2.5 * T, 0.001))
    assert np.flatnonzero(skipped).tolist() == [21]
    assert skipped[21] == 1
    assert skipped.dtype == np.int64
    due = (np.arange(80) + np.cumsum(skipped)) * T
    assert wall - late == pytest.approx(due, abs=1e-9)
    assert late[21] == pytest.approx(0.5 * T + 0.0015, abs=1e-9)
    assert np.flatnonzero(~fresh[:, 0]).tolist() == [30, 31, 32]
    assert fresh[:, 1].all()
    assert np.array_equal(rec.time, np.arange(80) * T)
    units = [rec.layout.columns[name].unit for name in ("wall", "late", "io", "skipped", "fresh")]
    assert units == ["s", "s", "s", "1", "1"]


def test_switches_and_raw_numbers(tmp_path: Path) -> None:
    """They are as the device had them, whole numbers to the last one, also on the disk and in xarray."""
    scene = cart(driver(tmp_path), **{"finger.1.device.name": pedal(tmp_path)})
    rec = gx.run(scene, real_time=True, out=tmp_path / "out")
    assert rec.layout.devices == ("left", "right")
    assert rec.switches is not None
    assert rec.switches.dtype == np.int64
    assert rec.switches[:, 1].tolist() == [k // 10 % 8 for k in range(80)]
    assert not rec.switches[:, 0].any()
    counts = rec.raw["right"]
    assert counts.dtype == np.int64
    assert np.array_equal(counts[:, 0] + counts[:, 1], np.full(80, -(1 << 40)))
    assert np.diff(counts[:, 0]).tolist() == [1] * 79
    data = rec.to_xarray()
    assert data["raw_right"].dtype == np.int64
    assert data["raw_right"].dims == ("time", "right_raw")
    assert data["switches"].dims == ("time", "device")
    assert data["io"].call.values.tolist() == ["read", "write"]
    assert {"wall", "late", "io", "skipped", "fresh"} <= set(data)
    assert "raw_right.0" in rec.to_frame()


WRONG = {
    "returned 9 for its switches, expected an integer with 3 bits": {"switches": property(lambda self: 9)},
    "returned True for its switches": {"switches": property(lambda self: True)},
    "cannot be read: ZeroDivisionError": {"switches": property(lambda self: 1 // 0)},
}


@pytest.mark.parametrize("says", WRONG)
def test_what_a_device_should_not_tell_is_a_fault(says: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name, value in WRONG[says].items():
        monkeypatch.setattr(Pedal, name, value)
    rec = gx.run(cart(driver(tmp_path), **{"finger.1.device.name": pedal(tmp_path)}), duration=0.1, real_time=True)
    assert rec.faults[0].tick == 0
    assert says in rec.faults[0].message
    assert not rec.displayed_force.any()


def test_columns_of_a_simulation(tmp_path: Path) -> None:
    """Unpaced it has none of them; paced it has, and all others are the same."""
    free = gx.run("paper-spring-arms", {"engine": "interpreted"}, duration=0.1)
    paced = gx.run("paper-spring-arms", {"engine": "interpreted"}, duration=0.1, real_time=True)
    assert paced.layout.columns.keys() - free.layout.columns.keys() == NEW | {"largest_force"}
    for name in free.layout.columns:
        assert np.array_equal(free.array(name), paced.array(name)), name
    assert paced.fresh is not None
    assert paced.fresh.all()
    assert (free.wall, free.late, free.io, free.skipped, free.fresh, free.switches, free.rest) == (None,) * 7
    assert not free.raw
    assert "timed" not in free.to_xarray().attrs["layout"]


# Forces at the beginning ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("depth", [-0.004, -0.0005, 0.0, 0.0005, 0.004, 0.015])
@pytest.mark.parametrize("safety", [{}, {"safety.rate": 10.0}, {"safety.rate": 10.0, "safety.soft_start": 0.05}])
def test_the_first_force_is_zero_and_grows_by_the_rate(depth: float, safety: dict[str, Any], tmp_path: Path) -> None:
    """Hardware before, at and in its object, with the chain as it is without a table and with one."""
    at = {"finger.0.device.position": [[-0.025 + depth]], "finger.1.device.position": [[0.025 - depth]]}
    rec = gx.run(cart(driver(tmp_path), **at, **safety), real_time=True)
    require_gentle(rec, safety.get("safety.rate"))
    assert not rec.faults
    if depth > 0.001:
        assert np.abs(rec.displayed_force[-8]).max() > 0.01


@pytest.mark.parametrize("start", [0.03, 0.025, 0.024, 0.02, 0.01])
def test_the_first_force_of_a_simulation_with_a_chain(start: float) -> None:
    """Fingers that start anywhere, 15 mm deep in a box too."""
    scene = gx.load("paper-waving", {"safety.rate": 50.0, "engine": "interpreted", "finger.0.start": [-start, 0.0]})
    require_gentle(gx.run(scene, duration=0.3), 50.0)


def require_gentle(rec: gx.Recording, rate: float | None) -> None:
    """Require no force in the first tick, and none that grows by more than the rate."""
    assert not rec.displayed_force[0].any()
    assert not rec.finger_force[0].any()
    if rate is not None:
        size = np.linalg.norm(rec.displayed_force, axis=2)
        assert np.diff(size, axis=0).max() <= rate * rec.period * (1.0 + 1e-9)
