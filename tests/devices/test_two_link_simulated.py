"""The simulated two-link arm: the preset's figures, reach, encoders, delay, and two arms side by side."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from graspfx import plugins
from graspfx.devices.two_link.arm_device import ArmState
from graspfx.errors import DeviceError
from graspfx.loop.hand import Hand
from graspfx.loop.motion.motion import Sine

two_link: Any = plugins.load("devices", "two-link")
FloatArray = NDArray[np.float64]

T = 0.005
L = 0.128
LEFT: dict[str, Any] = {"base": (-0.04, -0.18), "elbow": "left"}
RIGHT: dict[str, Any] = {"base": (0.04, -0.18), "elbow": "right"}


def opened(**settings: Any) -> Any:
    device = two_link.connect(**settings)
    device.open(T)
    return device


def test_preset_figures() -> None:
    """The figures of the module's text; with a right-angled elbow M = diag(2.45196, 2.4575) g m^2, l = 0.128 m."""
    for side, x in ((LEFT, -0.025), (RIGHT, 0.025)):
        device = two_link.connect(**side)
        mirror = 1.0 if x < 0 else -1.0
        mass, friction = device.effective_mass((x, 0.0)), device.effective_friction((x, 0.0))
        np.testing.assert_allclose(mass, [[0.1503, -0.0003 * mirror], [-0.0003 * mirror, 0.1493]], atol=6e-5)
        np.testing.assert_allclose(friction, [[0.2011, -0.0001 * mirror], [-0.0001 * mirror, 0.1993]], atol=6e-5)
        for wave in np.linspace(-0.065, 0.065, 27):
            at = (x + wave, 0.0)
            masses, frictions = (np.linalg.eigvalsh(f(at)) for f in (device.effective_mass, device.effective_friction))
            assert masses.min() > 0.130
            assert masses.max() < 0.178
            assert frictions.min() > 0.169
            assert frictions.max() < 0.246
            assert np.linalg.cond(device.arm.jacobian(*device.arm.angles(*at))) < 1.21
    f = device.features
    assert f.mass == pytest.approx(math.sqrt(0.00245196 * 0.0024575) / L**2, rel=1e-12)
    assert f.friction == pytest.approx(3.28e-3 / L**2, rel=1e-12)
    assert f.resolution == pytest.approx(L * math.tau / 60000, rel=1e-12)  # 13.4 um
    assert f.peak_force == pytest.approx(0.06 * 15 / L, rel=1e-12)  # 7.03 N
    assert (f.fingers, f.dimensions, f.delay) == (1, 2, 0)
    np.testing.assert_allclose(f.workspace, [[0.04 - 0.246, -0.18 - 0.246], [0.04 + 0.246, -0.18 + 0.246]], rtol=1e-12)


@pytest.mark.parametrize(
    ("finger", "text"),
    [
        (
            (-0.04, 0.08),
            "finger at (-0.0400, 0.0800) m, 0.2600 m from the arm's base at (-0.0400, -0.1800) m: the arm works from "
            "0.0100 to 0.2460 m (links of 0.128 and 0.128 m, 0.01 m short of the stretched posture); move the finger "
            "closer to the base, or move the base",
        ),
        (
            (-0.04, -0.175),
            "finger at (-0.0400, -0.1750) m, 0.0050 m from the arm's base at (-0.0400, -0.1800) m: the arm works from "
            "0.0100 to 0.2460 m (links of 0.128 and 0.128 m, 0.01 m short of the folded posture); move the finger "
            "away from the base, or move the base",
        ),
    ],
)
def test_out_of_reach(finger: tuple[float, float], text: str) -> None:
    """Beyond the reach and within it: a sentence with the figures, from `place` and from `effective_mass`."""
    device = two_link.connect(**LEFT)
    plant = type(device).plant([device])
    with pytest.raises(DeviceError) as placed:
        plant.place(np.array([finger]))
    assert str(placed.value) == text
    with pytest.raises(DeviceError, match="m from the arm's base"):
        device.effective_mass(finger)


def test_counts_are_whole_and_positions_quantised() -> None:
    """Encoders round: read and true position differ by no more than half a count of each joint, l pi/60000 each."""
    device = opened(**LEFT)
    plant = type(device).plant([device])
    rng = np.random.default_rng(5)
    bound = math.hypot(L, L) * math.pi / 60000
    worst = 0.0
    for p in rng.uniform((-0.09, -0.02), (0.04, 0.02), (100, 2)):
        plant.place(p[None])
        position = device.read()[0]
        counts = ArmState(device.state).counts
        assert counts.first == round(counts.first)
        assert counts.second == round(counts.second)
        a1, a2 = device.arm.angles(*p)
        assert abs(counts.first - a1 * 60000 / math.tau) <= 0.5
        assert abs(counts.second - a2 * 60000 / math.tau) <= 0.5
        error = np.abs(position - plant.position).max()
        assert error <= bound
        worst = max(worst, error)
    assert worst > bound / 4


def test_velocity_comes_from_counts() -> None:
    """Waving at up to 0.157 m/s, a count in 5 ms being 2.7 mm/s: off by less than four of them, but not by nothing.

    Read twice in a tick it is the same; after `place` it starts anew.
    """
    device = opened(**LEFT)
    plant = type(device).plant([device])
    plant.place(np.array([[-0.025, 0.0]]))
    hand = Hand([[-0.025, 0.0]], 2000.0, 40.0, motion=Sine(0.05, 0.5, (1.0, 0.0)))
    errors = []
    for _ in range(400):
        _, velocity, taken = device.read()
        assert taken == plant.time
        errors.append(np.abs(velocity - plant.velocity).max())
        again = device.read()  # within one tick: the same sample, not a standstill
        assert again[1] is velocity
        plant.advance(device.effort, hand, T)
    assert max(errors[40:]) < 2 * 2 * L * math.tau / 60000 / T
    assert np.median(errors) > 1e-5
    plant.place(np.array([[0.0, 0.0]]))
    assert device.read()[2] == 0.0
    np.testing.assert_array_equal(device.read()[1], [[0.0, 0.0]])  # no jump from where it was before


def test_delay_and_stop() -> None:
    """With a delay of two samples the third write brings the first one's torque; `stop` empties the line."""
    device = opened(**LEFT, delay=2)
    device.read()
    device.write(np.array([[1.0, 0.0]]))
    device.write(np.array([[2.0, 0.0]]))
    assert not device.effort.any()
    device.write(np.array([[3.0, 0.0]]))
    a = device.arm.angles(-0.04, -0.18 + L * math.sqrt(2.0))  # at home
    expected = device.arm.jacobian(*a).T @ [1.0, 0.0]
    np.testing.assert_allclose(device.effort[0], expected, rtol=1e-3)  # by the encoders' posture, in whole counts
    device.stop()
    assert not device.effort.any()
    device.write(np.array([[0.0, 0.0]]))
    device.write(np.array([[0.0, 0.0]]))
    assert not device.effort.any()
    assert device.features.delay == 2


def test_two_arms_do_not_know_each_other() -> None:
    """Writing to one leaves the other's torque; each runs as it does alone, to the bit."""

    def run(which: list[dict[str, Any]]) -> list[FloatArray]:
        devices = [opened(**side) for side in which]
        plants = [type(d).plant([d]) for d in devices]
        for plant in plants:
            plant.place(np.array([[0.0, 0.0]]))
        for k in range(50):
            for i, (plant, device) in enumerate(zip(plants, devices, strict=True)):
                device.read()
                device.write(np.array([[0.3 * math.sin(0.1 * k), 0.1]]) * (1 if which[i] is LEFT else -1))
                plant.advance(device.effort, Hand([[0.0, 0.0]], 50.0), T)
        return [plant.position.copy() for plant in plants]

    both = run([LEFT, RIGHT])
    np.testing.assert_array_equal(both[0], run([LEFT])[0])
    np.testing.assert_array_equal(both[1], run([RIGHT])[0])
    assert both[0][0, 0] != both[1][0, 0]
