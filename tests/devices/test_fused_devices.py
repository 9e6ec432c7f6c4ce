"""Simulated devices on one array with their plant and their hand: their methods to the bit, compiled to rounding."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from graspfx import plugins
from graspfx.compile.machine import compiled
from graspfx.devices.simulated import PointDevice, connect
from graspfx.devices.simulated.point_device import nearest
from graspfx.errors import DeviceError
from graspfx.loop.device import FusedDevice, fused
from graspfx.loop.hand import Hand
from graspfx.loop.motion.motion import Sine
from graspfx.loop.plant import fused as fused_plant

FloatArray = NDArray[np.float64]

two_link: Any = plugins.load("devices", "two-link")

T = 0.005
START = np.array([[-0.025, 0.0], [0.03, 0.01]])
POINTS: dict[str, dict[str, Any]] = {
    "plain": {},
    "sensors, delay and limit": {"resolution": 1e-5, "delay": 2, "force_limit": 0.4, "workspace": ([-1, -1], [1, 1])},
}
ARMS: dict[str, dict[str, Any]] = {
    "base": {},
    "elbow": {"drive": "elbow", "delay": 1, "torque_limit": 0.002, "gear": (15.0, -12.0)},
}


class Arena:
    """One simulated device, its plant and its hand on one array, each block somewhere in it; nan between them."""

    def __init__(self, parts: tuple[Any, Any, Any], T: float, kernels: Callable[[Any], Any]) -> None:
        device, plant, hand = parts
        plant.hold(hand, T)
        self.device, self.plant, self.hand, self.T, self.ticks = device, plant, hand, T, 0
        gap = np.full(3, np.nan)
        blocks = [device.state, plant.state, hand.state]
        self.S = np.concatenate([part for block in blocks for part in (gap, block)])
        sizes = [len(gap) + len(block) for block in blocks]
        self.at_device, self.at_plant, self.at_hand = np.cumsum([len(gap), *sizes[:2]]).tolist()
        self.reading, self.writing = kernels(device.reading), kernels(device.writing)
        self.aim, self.move = kernels(hand.kernel), kernels(plant.kernel)

    def tick(self, force: Callable[[FloatArray, FloatArray], FloatArray]) -> FloatArray:
        """One sample: position, velocity and effort of the device, and the plant's position after it."""
        S, ports, moved, shape = self.S, self.device.ports, self.plant.ports, self.plant.position.shape
        N, o, p, h = shape[0] * shape[1], self.at_device, self.at_plant, self.at_hand
        seen = self.device.sensed
        S[o + ports.sensed : o + ports.sensed + len(seen)] = S[p + seen]
        assert self.reading(S, o) == 0
        x, v = (S[o + at : o + at + N].reshape(shape) for at in (ports.position, ports.velocity))
        S[o + ports.command : o + ports.command + N] = force(x, v).ravel()
        assert self.writing(S, o) == 0
        S[p + moved.effort : p + moved.effort + N] = S[o + ports.effort : o + ports.effort + N]
        begin, end = self.ticks * self.T, (self.ticks + 1) * self.T
        for at, time in ((moved.middle, 0.5 * (begin + end)), (moved.end, end)):
            if at is not None:
                self.aim(S, h, time)
                for to, ours in zip((at, at + N), self.hand.ports, strict=True):
                    S[p + to : p + to + N] = S[h + ours : h + ours + N]
        assert self.move(S, p) == 0
        self.ticks += 1
        y = S[p + moved.position : p + moved.position + N].reshape(shape)
        return np.array([x, v, S[o + ports.effort : o + ports.effort + N].reshape(shape), y])


def called(device: Any, plant: Any, hand: Any, T: float, force: Callable[[FloatArray, FloatArray], FloatArray]) -> Any:
    """Run the sample by the methods."""
    x, v, _ = device.read()
    device.write(force(x, v))
    effort = np.array(device.effort)
    plant.advance(effort, hand, T)
    return np.array([x, v, effort, plant.position])


def on_memory(kernel: Any) -> Any:
    """The kernel as it is, on a memoryview of the array that it is given."""
    return lambda S, *rest: kernel(memoryview(S), *rest)


def points(settings: dict[str, Any]) -> tuple[Any, Any, Hand]:
    return *opened(connect(mass=0.15, damping=0.2, fingers=2, dimensions=2, **settings), START), hand(START)


def arm(settings: dict[str, Any]) -> tuple[Any, Any, Hand]:
    return *opened(two_link.connect(base=(-0.04, -0.18), **settings), START[:1]), hand(START[:1])


def together(settings: dict[str, Any]) -> tuple[Any, Any, Hand]:
    """Three fingers in space that one hand waves and squeezes: its gains couple them."""
    start = np.random.default_rng(12).normal(0.0, 0.01, (3, 3))
    held = Hand.arm_and_grip(
        start + 0.01, arm=(30.0, 1.0), grip=(200.0, np.linspace(0.0, 1.0, 3)), motion=Sine(0.05, 0.5, np.ones(3)),
        squeeze=0.01, inward=np.ones((3, 3)),
    )  # fmt: skip
    return *opened(connect(mass=0.15, damping=0.2, fingers=3, dimensions=3, **settings), start), held


def opened(device: Any, start: FloatArray) -> tuple[Any, Any]:
    plant = type(device).plant([device])
    plant.place(start)
    device.open(T)
    return device, plant


def hand(start: FloatArray) -> Hand:
    inward = np.tile([[0.0, 1.0]], (len(start), 1))
    return Hand(start, 60.0, 1.0, Sine(0.03, 0.8, [1.0, 0.5], 0.1, 0.5), 0.004, inward)


def wall(x: Any, v: Any) -> Any:
    """A stiff wall at x = -20 mm to the left, and some damping: forces beyond the limits."""
    force = -0.5 * v
    force[:, 0] -= 150.0 * np.minimum(x[:, 0] + 0.02, 0.0)
    return force


CASES = [
    *((points, settings) for settings in POINTS.values()), *((arm, settings) for settings in ARMS.values()),
    (together, {}),
]  # fmt: skip


@pytest.mark.parametrize(("make", "settings"), CASES, ids=[*POINTS, *ARMS, "together"])
def test_blocks_alone_are_the_methods_to_the_bit(make: Any, settings: dict[str, Any]) -> None:
    device, plant, held = make(settings)
    assert isinstance(device, FusedDevice)
    arena = Arena(make(settings), T, on_memory)
    for _ in range(300):
        np.testing.assert_array_equal(arena.tick(wall), called(device, plant, held, T, wall))
    structure = device.structure
    np.testing.assert_array_equal(device.state[structure], arena.device.state[structure])
    np.testing.assert_array_equal(device.state[structure], np.rint(device.state[structure]))
    assert np.isnan(arena.S).sum() == 9  # nothing was written between the blocks


@pytest.mark.parametrize(("make", "settings"), [CASES[1], CASES[3], CASES[4]], ids=["points", "arm", "together"])
def test_compiled_it_is_the_same_to_rounding(make: Any, settings: dict[str, Any]) -> None:
    # Rounding of positions around 0.1 m, that of velocities over 5 ms and of forces by 150 N/m; no count of these runs
    # is so near to a half that it falls on its other side.
    interpreted, machine = (Arena(make(settings), T, kernels) for kernels in (on_memory, compiled))
    for _ in range(300):
        x, y = interpreted.tick(wall), machine.tick(wall)
        np.testing.assert_allclose(y[[0, 3]], x[[0, 3]], rtol=0, atol=1e-14)
        np.testing.assert_allclose(y[[1, 2]], x[[1, 2]], rtol=0, atol=1e-11)


def test_codes_say_what_the_methods_say() -> None:
    device, plant, _ = points({"workspace": ([-0.1, -0.1], [0.1, 0.1]), "delay": 1})
    S: Any = memoryview(device.state)
    ports = device.ports
    device.write(np.ones((2, 2)))
    S[ports.command + 3] = math.nan
    code = device.writing(S, 0)
    with pytest.raises(DeviceError) as error:
        device.write(np.array([[1.0, 1.0], [1.0, math.nan]]))
    assert str(error.value) == device.fault_text(code)
    assert not device.state[ports.effort : ports.effort + 4].any()
    device.write(np.zeros((2, 2)))
    assert not device.effort.any()  # nothing left of the delay
    plant.place(np.array([[0.0, 0.0], [0.0, 0.2]]))
    with pytest.raises(DeviceError, match=r"finger 1 .*outside its workspace"):
        device.read()
    S[ports.sensed + 1] = math.inf
    assert "finger 0 of a simulated device is at (0, inf) m; its motion has diverged" in device.fault_text(
        device.reading(S, 0)
    )


def test_an_arm_says_what_stops_it() -> None:
    device, _, _ = arm({"delay": 1})
    S: Any = memoryview(device.state)
    ports = device.ports
    device.write(np.array([[1.0, 0.0]]))
    S[ports.command] = math.inf
    assert "cannot be displayed" in device.fault_text(device.writing(S, 0))
    S[ports.command] = 0.0
    assert device.writing(S, 0) == 0
    assert not device.effort.any()
    before = device.read()[0].copy()
    for angles, said in (((0.0, 0.001), "stretched posture"), ((0.0, 1.0), "on the right"), ((math.nan, 0.0), "nan")):
        S[ports.sensed], S[ports.sensed + 1] = angles
        assert said in device.fault_text(device.reading(S, 0))
    np.testing.assert_array_equal(device.read()[0], before)


def test_stopping_is_stop() -> None:
    for make in (points, arm):
        device, _, _ = make({"delay": 2})
        for _ in range(3):
            device.write(np.full(device.effort.shape, 0.1))
        assert device.effort.any()
        assert device.stopping(memoryview(device.state), 0) == 0
        for _ in range(3):
            assert not device.effort.any()
            device.write(np.zeros(device.effort.shape))


def test_a_class_that_reads_or_moves_in_its_own_way_is_not_fused() -> None:
    class Shaking(PointDevice):
        def read(self) -> Any:
            x, v, time = super().read()
            return x + 1e-6, v, time

    class Named(PointDevice):
        @property
        def name(self) -> str:
            return "thumb"

    settings = {
        "mass": 0.1, "damping": 0.0, "fingers": 1, "dimensions": 1, "resolution": 0.0, "velocity_window": 1,
        "delay": 0, "force_limit": None, "workspace": None,
    }  # fmt: skip
    plain, shaking, named = PointDevice(**settings), Shaking(**settings), Named(**settings)
    assert fused(plain) is plain
    assert fused(named) is named
    assert fused(shaking) is None
    arm_device = two_link.connect()
    assert fused(arm_device) is arm_device

    class Board:
        def open(self, period: float) -> None: ...

    assert fused(two_link.connect(board=Board())) is None

    plant = PointDevice.plant([plain])
    assert fused_plant(plant) is plant

    Plant: Any = type(plant)

    class Slow(Plant):
        def advance(self, force: Any, hand: Any, T: float) -> None:
            super().advance(force, hand, 0.5 * T)

    assert fused_plant(Slow([0.1], [0.0], 1)) is None


def test_rounding_is_half_to_even() -> None:
    rng = np.random.default_rng(5)
    x = np.concatenate([np.arange(-6, 7) / 2.0, rng.normal(size=500) * 10.0 ** rng.uniform(-3, 18, 500), [np.inf]])
    np.testing.assert_array_equal([nearest(float(a)) for a in x], np.rint(x))
    assert math.isnan(nearest(math.nan))
