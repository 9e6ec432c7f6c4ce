"""Delays in seconds in a scene: measures of its devices, jitter, recordings of hardware, and what a run refuses."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import graspfx as gx
from graspfx.assembly import run_scene as whole_run
from graspfx.certificate.recorded import exchange_times
from graspfx.errors import InputError, SceneError
from tests.support.hardware import VirtualClock
from tests.support.late_mass import late_driver

LATE = "finger.*.device.measures"


def reference(**measures: Any) -> gx.Scene:
    return gx.load("reference-1dof", {LATE: measures})


def test_a_lateness_in_seconds_is_that_of_the_linearisation() -> None:
    """Also as part of a sample: the radius is that of the loop of the certificate, and a whole sample is `delay`."""
    linear = reference(lateness=0.0013, latency=0.0004).linearise("start")
    assert linear.lateness.tolist() == [0.0013, 0.0013] and linear.age.tolist() == [0.0004, 0.0004]
    whole = gx.load("reference-1dof", {"finger.*.device.delay": 1}).linearise("start")
    late = reference(lateness=0.005).linearise("start")
    radii = [gx.stability.spectral_radius(each) for each in (whole, late)]
    assert radii[0] == pytest.approx(radii[1], abs=1e-13)
    [certificate] = gx.certify(reference(lateness=0.0013), quick=True)
    limits = [row.limit for row in certificate.limits if row.mode == "internal"]
    assert limits == pytest.approx([gx.stability.wall_limit(0.15, 0.2, 0.005, spring=33.0, latency=0.0013)], rel=1e-9)
    assert all(row.difference < 1e-6 for row in certificate.limits if row.exact and not np.isnan(row.difference))
    assert any("1.3 ms late, as measured; a simulation does not" in text for text in certificate.assumed)


def test_the_worse_end_of_jitter_counts() -> None:
    [even] = gx.certify(reference(lateness=0.002), quick=True)
    [uneven] = gx.certify(reference(lateness=0.001, jitter=[0.0005, 0.002]), quick=True)
    assert uneven.spectral_radius == even.spectral_radius
    assert uneven.assumed[-1] == "forces are 0.5 to 2 ms late in 98 % of the samples; judged at 2 ms"


def test_measures_stand_before_what_a_driver_tells() -> None:
    linear = reference(mass=0.3, friction=0.5).linearise("start")
    assert linear.mass.tolist() == [0.3, 0.3] and linear.friction.tolist() == [0.5, 0.5]
    arms = gx.load("paper-spring", {LATE: {"mass": 0.3, "friction": 0.5}}).linearise("start")
    assert arms.mass == pytest.approx(0.3) and arms.friction == pytest.approx(0.5)


@pytest.mark.parametrize(
    ("measures", "key"),
    [({"lateness": -1.0}, "lateness"), ({"mass": 0.0}, "mass"), ({"jitter": [0.2, 0.1]}, "jitter"),
     ({"jitter": [-0.1, 0.1]}, "jitter"), ({"latness": 0.1}, "latness")],
)  # fmt: skip
def test_measures_that_cannot_be(measures: dict[str, Any], key: str) -> None:
    with pytest.raises(SceneError, match=key):
        reference(**measures)


def test_a_simulation_refuses_part_of_a_sample() -> None:
    scene = reference(lateness=0.0063)
    with pytest.raises(InputError, match=r"measures\.lateness: given 0\.0063, .*delay = 1"):
        gx.run(scene, duration=0.01)
    with pytest.raises(InputError, match=r"measures\.lateness"), gx.open(scene):
        pass
    with pytest.raises(InputError, match=r"measures\.lateness"):
        gx.run_batch(scene, {"object.mass": [0.1, 0.2]}, duration=0.01)
    rows = {row.step: row for row in gx.check(scene).plan}
    assert not rows["lateness"].runs and "1.26 samples" in rows["lateness"].why
    assert "lateness" not in {row.step for row in gx.check("reference-1dof").plan}


def test_a_recording_tells_how_late_its_ticks_were(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its reading and writing take 0.15 ms, where the measures have 1 ms of 1.4 ms: 0.55 ms are left."""
    monkeypatch.setattr(whole_run, "WallClock", VirtualClock)
    measures = {"mass": 0.15, "friction": 0.2, "lateness": 0.0014, "round_trip": 0.001}
    scene = gx.Scene(
        dimensions=2, period=0.001, duration=0.05, engine="interpreted",
        object={"mass": 0.1, "viscosity": 0.8, "rotational_viscosity": 1e-3,
                "shape": {"kind": "box", "size": [0.04, 0.04]}, "position": [0.02, 0.0]},
        coupling={"contact": "attached", "external": {"stiffness": 30.0}, "internal": {"stiffness": 30.0}},
        finger=[{"device": {"name": str(late_driver(tmp_path)), "measures": measures}, "start": [0.0, 0.0]}],
    )  # fmt: skip
    recording = gx.run(scene, real_time=True)
    assert exchange_times(recording) == pytest.approx((0.00015, 0.00015), abs=1e-12)
    expected = scene.linearise("start").with_changes(lateness=0.00055)
    assert gx.stability.spectral_radius(scene, recording) == pytest.approx(gx.stability.spectral_radius(expected))
    with pytest.raises(InputError, match="recording: given"):
        gx.stability.spectral_radius(expected, recording)
    assert exchange_times(gx.run("reference-1dof", duration=0.05)) is None


def test_torsion_that_is_not_displayed_is_said_with_its_size() -> None:
    """rho 4.5 mm and mu 0.8: 3.6 N mm for each newton that presses; hard fingers lose nothing."""
    rows = {row.step: row for row in gx.check("soft-pinch").plan}
    row = rows["displayed moments"]
    assert not row.runs and "up to mu rho = 3.6 N mm per newton of normal force" in row.why
    assert "displayed moments" not in {row.step for row in gx.check("reference-1dof").plan}
