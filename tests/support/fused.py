"""Components driven through their blocks alone, by their kernels as they are or compiled."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspfx.loop.plant import FusedPlant, Hand

FloatArray = NDArray[np.float64]
Kernel = Callable[[Any, int], int]


def drive(
    plant: FusedPlant, efforts: FloatArray, hand: Hand, T: float, kernel: Kernel | None = None, o: int = 0
) -> FloatArray:
    """Positions and velocities after each sample, (samples, 2, n, d), from time zero.

    By the plant's own kernel on a memoryview of its block; or by `kernel`, on an array that holds the block from `o`.
    """
    plant.hold(hand, T)
    ports, shape = plant.ports, plant.position.shape
    N = shape[0] * shape[1]
    whole = np.concatenate([np.full(o, np.nan), plant.state]) if kernel else plant.state
    S = whole[o:]
    rows = []
    for k, effort in enumerate(efforts):
        S[ports.effort : ports.effort + N] = effort.ravel()
        if ports.middle is not None:
            S[ports.middle : ports.middle + 2 * N] = np.ravel(hand.target(0.5 * (k * T + (k + 1) * T)))
        S[ports.end : ports.end + 2 * N] = np.ravel(hand.target((k + 1) * T))
        assert (kernel(whole, o) if kernel else plant.kernel(memoryview(whole), 0)) == 0
        rows.append([S[p : p + N].reshape(shape).copy() for p in (ports.position, ports.velocity)])
    assert np.isnan(whole[:o]).all()  # nothing written before the block
    return np.array(rows)


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


def advanced(plant: FusedPlant, efforts: FloatArray, hand: Hand, T: float) -> FloatArray:
    """Run it by `advance`."""
    rows = []
    for effort in efforts:
        plant.advance(effort, hand, T)
        rows.append([plant.position.copy(), plant.velocity.copy()])
    return np.array(rows)
