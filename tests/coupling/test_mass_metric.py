"""The metric of unequal devices: which modes it takes apart, against the analysis, and what a scene needs for it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import graspfx as gx
from graspfx.certificate.plan import plan
from graspfx.errors import SceneError

HEAVY, LIGHT = 0.3, 0.1  # devices' masses [kg]


def waved(metric: str, amplitudes: tuple[float, float], friction: tuple[float, float] = (0.6, 0.2)) -> gx.Scene:
    """Two devices attached to a mass on a line; hands and friction in the ratio of the devices' masses."""

    def finger(mass: float, b: float, amplitude: float) -> dict[str, Any]:
        return {
            "device": {"name": "simulated", "mass": mass, "damping": b}, "start": [0.0],
            "hand": {
                "stiffness": 300.0 * mass, "damping": 10.0 * mass,
                "motion": {"kind": "sine", "amplitude": amplitude, "frequency": 2.0, "axis": "x"},
            },
        }  # fmt: skip

    return gx.Scene(
        dimensions=1, period=0.002, duration=1.0, object={"mass": 0.1, "viscosity": 0.5},
        coupling={
            "contact": "attached", "metric": metric,
            "external": {"stiffness": 30.0, "damping": 0.1}, "internal": {"stiffness": 90.0, "damping": 0.3},
        },
        finger=[finger(HEAVY, friction[0], amplitudes[0]), finger(LIGHT, friction[1], amplitudes[1])],
    )  # fmt: skip


def coordinates(rec: gx.Recording) -> tuple[np.ndarray, np.ndarray]:
    """Internal x_1 - x_2, and external: the weighted mean less the object's position."""
    x = rec.finger_position[:, :, 0]
    return x[:, 0] - x[:, 1], (HEAVY * x[:, 0] + LIGHT * x[:, 1]) / (HEAVY + LIGHT) - rec.object_position[:, 0]


def test_unequal_devices_are_taken_apart() -> None:
    """Waved together nothing squeezes, squeezed by m_1 a_1 + m_2 a_2 = 0 nothing moves: 1e-15 m of 10 mm."""
    internal, external = coordinates(gx.run(waved("mass", (0.01, 0.01))))
    assert np.abs(internal).max() < 1e-15 and np.ptp(external) > 1e-3
    rec = gx.run(waved("mass", (0.004, -0.012)))
    internal, external = coordinates(rec)
    assert np.ptp(internal) > 1e-3 and np.abs(external).max() < 1e-15 and np.abs(rec.object_position).max() < 1e-15


@pytest.mark.parametrize(
    ("metric", "friction"), [("equal", (0.6, 0.2)), ("mass", (0.2, 0.2))], ids=["equal metric", "unequal b/m"]
)
def test_they_stay_coupled_otherwise(metric: str, friction: tuple[float, float]) -> None:
    """With the equal metric, and with the mass metric where friction is not in the ratio of the masses."""
    internal, _ = coordinates(gx.run(waved(metric, (0.01, 0.01), friction)))
    assert np.abs(internal).max() > 1e-4


def test_a_device_that_tells_no_mass_is_a_fault(tmp_path: Path) -> None:
    driver = tmp_path / "massless.py"
    driver.write_text(
        "from graspfx.loop.device import Features\n\n\nclass Rod:\n    features = Features(1, 1)\n\n\n"
        "def connect():\n    return Rod()\n"
    )
    table = waved("mass", (0.01, 0.01)).to_dict()
    table["finger"][1] = {"device": {"name": str(driver)}, "start": [0.0]}
    with pytest.raises(
        SceneError, match=r"coupling\.metric: 'mass' requires every device to report its mass; .*finger\.1"
    ):
        gx.Scene(**table)


def test_the_plan_names_the_metric() -> None:
    rows = {
        metric: {row.step: row for row in plan(waved(metric, (0.01, 0.01)))}["metric"] for metric in ("mass", "equal")
    }
    assert rows["mass"].runs and "mass" in rows["mass"].why and not rows["equal"].runs
