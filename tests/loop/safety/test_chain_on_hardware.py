"""The safety chain between the law and devices that say that they are hardware: what is written to them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import graspfx as gx
from graspfx.build import pace
from tests.support.hardware import VirtualClock, driver, fakes
from tests.support.optional import require

T = 0.005


@pytest.fixture(autouse=True)
def _no_wall(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pace, "WallClock", VirtualClock)


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
