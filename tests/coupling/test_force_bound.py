"""`coupling.force_bound`: forces without meaning are a fault that names the gain."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import graspfx as gx
from graspfx.errors import SceneError

CASES: dict[str, tuple[str, dict[str, Any], str]] = {  # scene, overrides, gain
    "stiffness": ("reference-1dof", {"coupling.internal.stiffness": 1e6}, "coupling.internal.stiffness = 1e+06 N/m"),
    "speed": (
        "reference-1dof",
        {"coupling.external.damping": 1.75, "object.velocity": [1e6]},
        "coupling.external.damping = 1.75 N s/m",
    ),
    "implicit": (
        "reference-1dof",
        {"coupling.external.damping": 1.75, "object.velocity": [1e6], "object.integrator": "implicit"},
        "coupling.external.damping = 1.75 N s/m",
    ),
    "friction": (
        "sphere-three-fingers",
        {"coupling.internal.stiffness": 3e8, "coupling.external.stiffness": 1e3},
        "coupling.internal.stiffness = 3e+08 N/m",
    ),
    "matrices": (
        "paper-spring",
        {"coupling.internal.stiffness": [[1e9, 0.0], [0.0, 1e9]]},
        "coupling.internal.stiffness = 1e+09 N/m",
    ),
    "limited": (
        "reference-1dof",
        {"coupling.internal.stiffness": 1e6, "finger.*.device.force_limit": 5.0},
        "coupling.internal.stiffness = 1e+06 N/m",
    ),
}


@pytest.mark.parametrize("engine", ["interpreted", "compiled"])
@pytest.mark.parametrize("case", CASES)
def test_a_force_without_meaning_is_a_fault_that_names_the_gain(case: str, engine: str) -> None:
    """No force above 1e4 N is displayed or acts on the object, and none after the fault."""
    name, overrides, gain = CASES[case]
    rec = gx.run(name, {**overrides, "engine": engine}, duration=0.6)
    (fault,) = rec.faults
    assert "above coupling.force_bound = 10000 N: the largest contribution is " + gain in fault.message
    assert np.abs(rec.finger_force).max() <= 1e4
    assert not rec.finger_force[fault.tick :].any() and not rec.wrench[fault.tick :].any()
    assert "force_bound" in repr(rec) and rec.summary()["faults"] == 1


def test_the_bound_is_a_key() -> None:
    """A hand that squeezes with 0.2 N passes 1 N and not 0.1 N; what is no force is refused."""
    usual = gx.run("reference-1dof", duration=0.5)
    peak = float(np.abs(usual.finger_force).max())
    above = gx.run("reference-1dof", {"coupling.force_bound": 1.01 * peak}, duration=0.5)
    assert above.rows.tobytes() == usual.rows.tobytes() and not above.faults
    below = gx.run("reference-1dof", {"coupling.force_bound": 0.99 * peak}, duration=0.5)
    assert "coupling.force_bound" in below.faults[0].message
    with pytest.raises(SceneError, match=r"coupling\.force_bound: expected more than 0"):
        gx.load("reference-1dof", {"coupling.force_bound": 0.0})
