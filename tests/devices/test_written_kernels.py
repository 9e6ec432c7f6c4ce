"""Kernels of simulated devices and their plants: as they are written and lowered they give the same bits."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from graspfx import plugins
from graspfx.compile.kernel import written
from graspfx.devices.simulated import PointDevice, connect
from graspfx.devices.simulated.point_device import PointDeviceState
from graspfx.devices.simulated.points import PointPlantState
from graspfx.devices.two_link.arm_device import ArmState
from graspfx.devices.two_link.arm_dynamics import ArmPlantState
from graspfx.loop.hand import Hand

two_link: Any = plugins.load("devices", "two-link")

T = 0.005
POINTS: list[dict[str, Any]] = [
    {},
    {"resolution": 1e-4, "delay": 2, "force_limit": 0.4, "workspace": ([-0.1] * 3, [0.1] * 3), "velocity_window": 5},
]
ARMS: list[dict[str, Any]] = [{}, {"drive": "elbow", "delay": 1, "torque_limit": 0.002, "gear": (15.0, -12.0)}]


def assert_alike(kernel: Any, kind: Any, state: Any) -> int:
    """Run a kernel both ways on copies; the state becomes what they leave, their code is returned."""
    one, other = state.copy(), state.copy()
    code = written(kernel)(kind(one.data))
    assert code == kernel(kind(other.data))
    assert one.tobytes() == other.tobytes()
    state[:] = one
    return int(code)


@pytest.mark.parametrize("settings", POINTS)
def test_point_devices(settings: dict[str, Any]) -> None:
    rng = np.random.default_rng(1)
    device = connect(mass=0.15, dimensions=3, fingers=2, **settings)
    PointDevice.plant([device])
    device.open(T)
    codes = set()
    for k in range(60):
        block = PointDeviceState(device.state)
        for j in range(6):
            block.sensed[j] = 0.06 * math.sin(0.1 * k + j) + rng.normal(0.0, 1e-4) + (0.05 if k % 20 == 19 else 0.0)
            block.command[j] = math.nan if k == 40 else rng.normal(0.0, 0.3)
        codes.add(assert_alike(device.reading, PointDeviceState, device.state))
        codes.add(assert_alike(device.writing, PointDeviceState, device.state))
    assert codes > {0}
    assert_alike(device.stopping, PointDeviceState, device.state)


@pytest.mark.parametrize("settings", ARMS)
def test_arms(settings: dict[str, Any]) -> None:
    rng = np.random.default_rng(2)
    device = two_link.connect(base=(-0.04, -0.18), **settings)
    device.open(T)
    codes = set()
    for k in range(60):
        angles = device.arm.angles(0.03 * math.sin(0.1 * k), 0.01 * math.cos(0.2 * k))
        block = ArmState(device.state)
        block.angles = type(block.angles)(angles[0], math.nan if k == 30 else angles[1] + (0.9 if k == 50 else 0.0))
        block.command = type(block.command)(rng.normal(0.0, 2.0), math.inf if k == 20 else rng.normal(0.0, 2.0))
        codes.add(assert_alike(device.reading, ArmState, device.state))
        codes.add(assert_alike(device.writing, ArmState, device.state))
    assert len(codes) >= 3
    assert_alike(device.stopping, ArmState, device.state)


@pytest.mark.parametrize("still", [False, True])
@pytest.mark.parametrize("arms", [False, True])
def test_plants(arms: bool, still: bool) -> None:
    """Random efforts and targets, gains that couple fingers; efforts that are not finite move nothing."""
    rng = np.random.default_rng(3)
    if arms:
        devices = [
            two_link.connect(base=(x, -0.18), **settings) for x, settings in zip((-0.04, 0.04), ARMS, strict=True)
        ]
    else:
        devices = [connect(mass=0.1, dimensions=2, damping=0.2, fingers=2)]
    plant = type(devices[0]).plant(devices)
    kind = ArmPlantState if arms else PointPlantState
    rest = np.array([[-0.025, 0.0], [0.025, 0.0]])
    plant.place(rest)
    plant.hold(Hand.arm_and_grip(rest, arm=(30.0, 0.5), grip=(80.0, [1.0, 0.0])), T)
    kind(plant.state).still = still
    for k in range(20):
        block = kind(plant.state)
        for j in range(4):
            block.effort[j] = math.inf if k == 10 else rng.normal(0.0, 0.01)
            block.end[j], block.end_rate[j] = rest.flat[j] + rng.normal(0.0, 1e-3), rng.normal(0.0, 0.1)
            if arms:
                block.middle[j], block.middle_rate[j] = rest.flat[j] + rng.normal(0.0, 1e-3), rng.normal(0.0, 0.1)
        assert assert_alike(plant.kernel, kind, plant.state) == (k == 10)
    assert not np.array_equal(plant.position, rest)
