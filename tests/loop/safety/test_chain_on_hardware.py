"""The safety chain between the law and devices that say that they are hardware: what is written to them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import graspfx as gx
from graspfx.assembly import run_scene as whole_run
from tests.support import native_runs
from tests.support.hardware import EVIL, Evil, Fake, VirtualClock, driver, fakes
from tests.support.optional import require

T = 0.005


@pytest.fixture(autouse=True)
def _no_wall(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(whole_run, "WallClock", VirtualClock)


def pinch(file: Path, evil: str = "", **safety: Any) -> gx.Scene:
    """Two devices press a cart on a rail between them, 4 mm each: 0.28 N."""
    return gx.Scene(
        dimensions=1, period=T, duration=0.3, engine="interpreted",
        object={"mass": 0.1, "viscosity": 0.8, "shape": {"kind": "box", "size": [0.05]}},
        coupling={"external": {"stiffness": 30.0}, "internal": {"stiffness": 70.0}, "absent": "follow",
                  "enter": "ramp"},
        safety={"soft_start": 0.05} | safety,
        finger=[
            {"start": [-0.025], "device": {"name": str(file), "position": [[-0.021]], "evil": evil, "at": 30}},
            {"start": [0.025], "device": {"name": str(file), "position": [[0.021]]}},
        ],
    )  # fmt: skip


def test_what_is_written_grows_from_nothing_within_rate_and_force(tmp_path: Path) -> None:
    """No more than 2 N/s and 0.2 N, from zero in the first tick; what is written is what the recording says."""
    file = driver(tmp_path)
    rec = gx.run(pinch(file, force=0.2, rate=2.0), real_time=True)
    assert not rec.faults
    for i, fake in enumerate(fakes(file)[-2:]):
        written = np.array([force for tick, force in fake.forces if tick >= 0])[:, 0]
        np.testing.assert_array_equal(written, rec.displayed_force[:, i])
        size = np.abs(written[:, 0])
        assert size[0] == 0.0
        assert np.diff(size).max() <= 2.0 * T * (1.0 + 1e-12)
        assert size.max() == pytest.approx(0.2, rel=1e-12)


@pytest.mark.parametrize("frequency", [15.0, 32.0, 125.0, 250.0])
def test_positions_are_believed_before_a_velocity_of_zero(tmp_path: Path, frequency: float) -> None:
    """A finger that moves at up to 4 m/s and tells 0 m/s ends in both loops: 14 samples beyond 0.5 m/s at most.

    Four of them are the span of positions, ten the decay. 125 Hz are back at their place after four samples of 2 ms,
    250 Hz after two.
    """
    period, ticks, limit = native_runs.PERIOD, 200, 0.5
    t = period * np.arange(ticks)
    readings = native_runs.squeeze(ticks, -1.0)
    amplitude = 4.0 / (2.0 * np.pi * frequency)
    readings[:, 0, 0, 0] = -0.06 - amplitude * np.cos(2.0 * np.pi * frequency * np.maximum(t - 0.1, 0.0) - 0.5)
    readings[:, 1] = 0.0
    changes: dict[str, Any] = {"finger.0.start": readings[0, 0, 0].tolist(), "safety.speed": limit}
    file = native_runs.driver(tmp_path)
    _, python, _, native = native_runs.both(file, ticks, **changes, **{"finger.0.device.readings": readings.tolist()})
    for rec in (python, native):
        [fault] = rec.faults
        assert fault.message.startswith("finger0 exceeded safety.speed, 0.5 m/s")
        quick = np.abs(np.diff(rec.finger_position[:, 0, 0])) / period > limit
        assert quick[: fault.tick].sum() <= 14
        assert not rec.displayed_force[fault.tick :].any()
    assert python.faults == native.faults
    slower = 0.1 * limit / 4.0 * (readings - readings[0]) + readings[0]
    for rec in native_runs.both(file, ticks, **changes, **{"finger.0.device.readings": slower.tolist()})[1::2]:
        assert not rec.faults


def test_periods_that_were_left_out_are_no_speed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """0.3 m/s below a limit of 0.5 m/s, over a tick that comes three periods late: as if 0.75 m/s over two samples."""

    def hang(fake: Fake, forces: np.ndarray) -> None:
        VirtualClock.time += 4.2 * T if fake.tick == fake.at + 5 else 0.0

    start = []

    def slide(fake: Fake, p: np.ndarray, v: np.ndarray, t: float) -> Any:
        start.append(VirtualClock.time)
        return p - 0.3 * (VirtualClock.time - start[0]), v, t

    monkeypatch.setitem(EVIL, "slides", Evil(read=slide, write=hang))
    rec = gx.run(pinch(driver(tmp_path), "slides", speed=0.5), real_time=True)
    assert not rec.faults
    assert rec.outcome.skipped == 3


def test_a_clock_that_stands_decays_before_it_is_a_fault(tmp_path: Path) -> None:
    """Three readings are let pass, then it is a quarter less a tick, for both fingers; then the chain's fault."""
    file = driver(tmp_path)
    rec = gx.run(pinch(file, "a clock that stands"), real_time=True)
    [fault] = rec.faults
    assert fault.tick == 36
    assert "no new reading of the device of finger0" in fault.message
    trust = require(rec.objects["object"].scale)[:, 1]
    np.testing.assert_allclose(trust[29:36], [1.0, 1.0, 1.0, 1.0, 0.75, 0.5, 0.25], rtol=1e-12)
    size = np.abs(rec.displayed_force[:, 0, 0])
    assert (np.diff(size[32:37]) < 0.0).all()
    assert not rec.displayed_force[36:].any()
