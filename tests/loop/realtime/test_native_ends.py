"""The loop without Python where it ends badly and where devices stand askew: zero is last, and all as in Python."""

from __future__ import annotations

import ctypes
import sys
import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import graspfx as gx
from graspfx.build import pace
from graspfx.build.replay import replayed_with
from graspfx.environment import granted
from graspfx.errors import DeviceError
from graspfx.loop.device_calls import Calls
from graspfx.loop.realtime import native_loop
from tests.support.native_runs import COLUMNS, Session, both, driver, scene
from tests.support.optional import require
from tests.support.scripted_devices import Scripted

require("llvmlite")
if not sys.platform.startswith("linux"):
    pytest.skip("Python's loop runs elsewhere", allow_module_level=True)

TICKS = 260
SETTLING = 101  # readings before a run's first tick
HANG = 150  # a tick in which the fingers press
TILT = [[0.6, -0.8, 0.0], [0.48, 0.36, -0.8], [0.64, 0.48, 0.6]]


@pytest.mark.parametrize("role", ["read", "write"])
def test_a_function_that_returns_after_the_stop_brings_no_force_back(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, role: str
) -> None:
    """Python has stopped the devices beside it; the rest of its tick writes nothing, and stops them once more."""
    monkeypatch.setattr(native_loop, "STALLED", 5)
    release, real, count = threading.Event(), vars(Scripted)["calls"].fget, [0]
    kind = ctypes.CFUNCTYPE(ctypes.c_int64, ctypes.c_void_p, ctypes.c_void_p)

    def calls(device: Scripted) -> Calls:
        own: Calls = real(device)
        function = kind(getattr(own, role))

        @kind
        def hang(context: int, block: int) -> int:
            count[0] += 1
            if count[0] == HANG:
                release.wait(60.0)
            return int(function(context, block))

        place = ctypes.cast(hang, ctypes.c_void_p).value
        assert place is not None
        return own._replace(**{role: place}, keep=(own.keep, hang)) if device is first else own

    session = Session(scene(driver(tmp_path), TICKS, native=True))
    first, second = session.stations
    monkeypatch.setattr(Scripted, "calls", property(calls))
    with pytest.raises(DeviceError, match="a device's C function does not return"):
        session.run(TICKS)
    assert not session.devices.stop()
    before = [np.isfinite(each.written).all(axis=(1, 2)).sum() for each in (first, second)]
    stops = [each.stops for each in (first, second)]
    assert np.abs(second.written[: HANG - 1]).max() > 0.0
    release.set()
    lost: list[Any] = [*native_loop._LOST]
    [worker] = [each[-1] for each in lost if each[0] is session.native]
    assert worker.end(5.0)
    late = [np.isfinite(each.written).all(axis=(1, 2)).sum() for each in (first, second)]
    assert late == [before[0] + (role == "write"), before[1]]  # nothing but the call that was under way
    assert [each.stops for each in (first, second)] == [n + 1 for n in stops]
    with pytest.raises(DeviceError, match="a device's C function does not return"):
        session.run(1)
    session.finish()


@pytest.mark.parametrize("scale", [0.5, 3.0])
def test_a_device_askew_is_that_of_pythons_loop(tmp_path: Path, scale: float) -> None:
    """A frame with a rotation, an origin and a scale: the same recording, and the same forces in the device's axes.

    What goes in as a velocity comes out as a force with the same power.
    """
    frame: Any = {"origin": [0.003, -0.001, 0.002], "axes": TILT, "scale": scale}
    base = scene(driver(tmp_path), TICKS, native=True, dimensions=3)
    table = dict(base.finger[0].device.settings)  # type: ignore[union-attr]
    turn, origin = np.array(TILT), np.array(frame["origin"])
    readings = np.array(table["readings"])
    readings[:, 0] = (readings[:, 0] - origin) @ turn / scale
    readings[:, 1] = readings[:, 1] @ turn / scale
    changes = {"finger.0.device.readings": readings.tolist(), "finger.0.device.frame": frame}
    python, one, native, other = both(driver(tmp_path), TICKS, dimensions=3, **changes)
    assert not one.outcome.faults
    for column in COLUMNS:
        assert getattr(one, column) == pytest.approx(getattr(other, column), abs=1e-12), column
    assert np.abs(one.displayed_force[:, 0]).max() > 0.01
    for first, second in zip(python.stations, native.stations, strict=True):
        assert second.written == pytest.approx(first.written, abs=1e-12, nan_ok=True)
    told, velocity = native.stations[0].written[:TICKS, 0], readings[:, 1, 0]
    power = np.sum(np.asarray(other.displayed_force)[:, 0] * np.asarray(other.finger_velocity)[:, 0], axis=1)
    assert np.sum(told * velocity, axis=1) == pytest.approx(power, abs=1e-12)


@pytest.mark.parametrize(
    "changes",
    [{"codes": [0] * 50 + [1, 1, 0, 0, 1, 1, 1]}, {"codes": [0] * 150 + [-3]}, {"safety.force": 0.05}],
    ids=["held samples", "a fault", "a limit"],
)
def test_a_recording_is_replayed_in_python(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, changes: dict[str, Any]
) -> None:
    """Ticks that machine code alone has recorded come out of the scene's tick again, to the bit."""
    monkeypatch.setattr(pace, "is_possible", lambda: False)  # in this process
    small = scene(driver(tmp_path), TICKS, native=True, rest=SETTLING, **changes)
    rec = gx.run(small, real_time=True, out=tmp_path / "rec")
    with granted(True):  # the driver is in a folder of its own
        replay = replayed_with(rec, {})
    assert [str(each) for each in replay.differences] == []
    assert len(replay.recording) == len(rec) > 0
    assert np.abs(rec.displayed_force).max() > 0.0 or rec.outcome.faults
