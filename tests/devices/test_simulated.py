"""Simulated point devices: sensors, delay, limit, and clear errors."""

from __future__ import annotations

import numpy as np
import pytest

from graspfx.devices.simulated import PointDevice, connect
from graspfx.errors import DeviceError, InputError
from graspfx.loop.hand import Hand
from graspfx.loop.motion.motion import Sine

T = 0.005
M, B = 0.15, 0.2  # [kg], [N s/m]


def made(start, mass=M, friction=B, **settings):
    """A device with a finger for each row of `start`, on its plant, placed and open."""
    start = np.array(start, dtype=float)
    device = connect(mass=mass, damping=friction, fingers=len(start), dimensions=start.shape[1], **settings)
    plant = PointDevice.plant([device])
    plant.place(start)
    device.open(T)
    return device, plant


def nobody(n, d):
    return Hand(np.zeros((n, d)), 0.0)


def test_time_is_the_tick_count_times_the_period_and_place_starts_again():
    device, plant = made([[0.1]])
    position = plant.position
    for _ in range(1000):
        plant.advance(np.ones((1, 1)), nobody(1, 1), T)
    assert device.read()[2] == plant.time == 1000 * T
    plant.place(np.array([[0.2]]))
    p, v, time = device.read()
    assert (p[0, 0], v[0, 0], time) == (0.2, 0.0, 0.0)
    assert plant.position is position
    assert not plant.velocity.any()


def test_two_runs_are_the_same_to_the_bit():
    def run():
        device, plant = made([[0.0, 0.1]], resolution=1e-5, delay=1, force_limit=2.0)
        hand = Hand([[0.0, 0.1]], 33.0, 1.0, Sine(0.05, 0.5, [1.0, 0.0]))
        for _ in range(300):
            p, v, _ = device.read()
            device.write(-30.0 * p - 0.1 * v)
            plant.advance(device.effort, hand, T)
        return np.concatenate([plant.position, plant.velocity, *device.read()[:2]])

    np.testing.assert_array_equal(run(), run())


# Sensors


def test_positions_are_read_to_the_nearest_multiple():
    r = 1e-4
    rng = np.random.default_rng(10)
    device, plant = made(np.zeros((2, 3)), resolution=r)
    for x in rng.uniform(-0.1, 0.1, (100, 2, 3)):
        plant.place(x)
        p, _, _ = device.read()
        assert np.abs(p - x).max() <= 0.5 * r * (1.0 + 1e-9)
        np.testing.assert_allclose(p / r, np.rint(p / r), atol=1e-9)
    assert device.features.resolution == r


def test_velocity_comes_from_the_positions_that_were_read():
    # No quantisation: the backward difference of two readings; with it: within r/(n T), here n >= 1, plus A T/2.
    device, plant = made([[0.0]])
    before, velocity, _ = device.read()
    assert velocity[0, 0] == 0.0
    before = before.copy()
    plant.advance(np.ones((1, 1)), nobody(1, 1), T)
    after, velocity, _ = device.read()
    assert velocity[0, 0] == (after[0, 0] - before[0, 0]) / T
    assert velocity[0, 0] != plant.velocity[0, 0]


def test_reading_twice_within_a_tick_changes_nothing():
    device, plant = made([[0.0]], resolution=1e-6)
    rows = []
    for _ in range(5):
        plant.advance(np.ones((1, 1)), nobody(1, 1), T)
        rows.append([tuple(float(a[0, 0]) for a in device.read()[:2]) for _ in range(3)])
    assert all(len(set(row)) == 1 for row in rows)
    assert rows[-1][0][1] > 0.0


def test_what_is_read_is_no_part_of_the_plant():
    device, plant = made([[0.01]])
    device.read()[0][...] = 99.0
    plant.advance(np.zeros((1, 1)), nobody(1, 1), T)
    assert device.read()[0][0, 0] == 0.01


# Forces


@pytest.mark.parametrize("delay", [0, 1, 3])
def test_forces_come_after_their_delay(delay):
    device, _ = made(np.zeros((2, 1)), delay=delay)
    written = np.random.default_rng(11).normal(size=(20, 2, 1))
    for k, f in enumerate(written):
        device.write(f)
        np.testing.assert_array_equal(device.effort, written[k - delay] if k >= delay else np.zeros((2, 1)))
    assert device.features.delay == delay
    device.stop()
    assert not device.effort.any()
    for f in written[: delay + 1]:
        device.write(f)  # nothing of before the stop comes out
    np.testing.assert_array_equal(device.effort, written[0])


def test_force_limit_shortens_each_fingers_force_and_keeps_its_direction():
    device, _ = made(np.zeros((3, 2)), force_limit=2.0)
    forces = np.array([[3.0, -4.0], [1.2, 1.6], [-0.3, 0.4]])
    kept = forces.copy()
    device.write(forces)
    np.testing.assert_allclose(device.effort, [[1.2, -1.6], [1.2, 1.6], [-0.3, 0.4]], rtol=1e-15)
    np.testing.assert_array_equal(forces, kept)
    assert device.features.peak_force == 2.0


def test_a_symmetric_squeeze_is_an_effort_on_both():
    device, _ = made(np.zeros((2, 1)))
    device.write(np.array([[1.0], [-1.0]]))
    np.testing.assert_array_equal(device.effort, [[1.0], [-1.0]])


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("delay", [0, 2])
def test_a_force_that_is_not_finite_is_zero_and_an_error(bad, delay):
    device, _ = made(np.zeros((2, 2)), delay=delay, force_limit=1.0)
    for _ in range(3):
        device.write(np.full((2, 2), 0.5))
    with pytest.raises(DeviceError, match=r"finger 1 .*\(0, (nan|inf|-inf)\) N, which is not finite; zero is"):
        device.write(np.array([[0.5, 0.5], [0.0, bad]]))
    assert not device.effort.any()
    for _ in range(3):
        device.write(np.zeros((2, 2)))
        assert not device.effort.any()


# Errors and life


def test_outside_the_workspace_is_an_error_that_says_where():
    device, plant = made([[0.0, 0.0], [0.02, 0.03]], workspace=([-0.1, -0.1], [0.1, 0.05]))
    device.read()
    plant.place(np.array([[0.0, 0.0], [0.02, 0.06]]))
    with pytest.raises(DeviceError) as error:
        device.read()
    assert "finger 1" in str(error.value)
    assert "(0.02, 0.06) m, outside its workspace from (-0.1, -0.1) to (0.1, 0.05) m; widen `workspace`" in str(
        error.value
    )


def test_a_motion_that_diverged_is_an_error():
    # 1e308 N on 0.15 kg: the velocity grows by 3.3e306 m/s a sample and passes the largest number, 1.8e308, after 54.
    device, plant = made([[0.0]], friction=0.0)
    for _ in range(60):
        plant.advance(np.array([[1e308]]), nobody(1, 1), T)
    with pytest.raises(DeviceError, match="diverged"):
        device.read()


def test_before_open_and_after_close_and_without_a_plant():
    device = connect(mass=M, dimensions=1)
    assert (device.features.fingers, device.features.dimensions, device.features.mass) == (1, 1, M)
    assert device.features.resolution is None
    assert device.features.peak_force is None
    assert device.features.workspace is None
    for act in (device.read, lambda: device.write(np.zeros((1, 1)))):
        with pytest.raises(DeviceError, match="not open"):
            act()
    device.open(T)
    with pytest.raises(DeviceError, match="has no plant to read"):
        device.read()
    with device as same:
        assert same is device
        device.write(np.ones((1, 1)))
    assert not device.effort.any()
    device.close()
    with pytest.raises(DeviceError, match="not open"):
        device.write(np.zeros((1, 1)))


def test_forces_of_another_shape_are_refused():
    device, _ = made(np.zeros((2, 1)))
    with pytest.raises(InputError, match=r"forces.*\(2, 1\)"):
        device.write(np.zeros(2))
