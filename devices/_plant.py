"""What the simulated plants have in common: the front of their block, their time, and the hand that holds them."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspfx.errors import DeviceError, InputError
from graspfx.loop.plant import FusedHand, Hand, Kernel, Ports, is_still

FloatArray = NDArray[np.float64]
Index = NDArray[np.intp]
Pair = tuple[FloatArray, FloatArray]

# The block begins with these entries, STILL 1 if the targets never change; a plant's own start at OWN. Its arrays,
# where it says, are position, velocity and effort, (n, d) each, then the hand's targets r and r' at the sample's
# beginning, at its end and, for a plant that asks for them, in its middle, (2, n, d) each.
FINGERS, DIMENSIONS, PERIOD, SINCE, TICKS, STILL, OWN = range(7)
POSITION, VELOCITY, EFFORT, BEGIN, END, MIDDLE = 0, 1, 2, 3, 5, 7  # in n d entries
ARRAYS = 7  # n d entries of all of them without the middle

NOT_FINITE = 1  # what a kernel gives for inputs that are not


class HeldPlant(ABC):
    """Fingers that a hand holds, moved by a kernel that works on one block.

    A hand's gains are looked at again when its arrays are other objects than before.

    Args:
        fingers: n.
        dimensions: d.
        header: entries before the arrays.
        middle: whether it asks for the hand's target in the middle of the sample.
        own: entries after the arrays.
    """

    kernel: Kernel  # moves the block by one sample; 0, or a number that `fault_text` knows

    def __init__(self, fingers: int, dimensions: int, *, header: int, middle: bool, own: int) -> None:
        shape, step = (fingers, dimensions), fingers * dimensions
        size = header + (ARRAYS + 2 * middle) * step
        self.state: FloatArray = np.zeros(size + own)
        self.state[FINGERS], self.state[DIMENSIONS] = shape
        self.ports = Ports(
            effort=header + EFFORT * step,
            middle=header + MIDDLE * step if middle else None,
            end=header + END * step,
            position=header + POSITION * step,
            velocity=header + VELOCITY * step,
        )
        arrays = self.state[header:size].reshape(-1, *shape)
        self.position: FloatArray = arrays[POSITION]
        self.velocity: FloatArray = arrays[VELOCITY]
        self._effort = arrays[EFFORT]
        self._begin, self._end = (arrays[BEGIN], arrays[BEGIN + 1]), (arrays[END], arrays[END + 1])
        self._middle = (arrays[MIDDLE], arrays[MIDDLE + 1]) if middle else None
        self._S: Any = self.state.data  # plain floats, where items of an array cost twice as much
        self._held: tuple[Hand, FloatArray, FloatArray] | None = None  # the hand and its gains
        self._shown: tuple[FusedHand, Any, FloatArray, FloatArray] | None = None  # its block and its targets there
        self.placed = 0  # how often, so that a device knows that its finger was lifted

    @property
    def time(self) -> float:
        """Since `place` [s]: samples times the period, from where the period last changed."""
        S = self._S
        now: float = S[SINCE] + S[TICKS] * S[PERIOD]
        return now

    def place(self, position: FloatArray) -> None:
        """Put the fingertips at these positions (n, d) [m], at rest, at time zero; DeviceError out of reach."""
        p = np.asarray(position, dtype=np.float64)
        if p.shape != self.position.shape or not np.isfinite(p).all():
            raise InputError("position", position, f"finite positions of shape {self.position.shape} [m]")
        self._put(p)
        self.position[...] = p
        self.velocity[...] = 0.0
        self._S[SINCE] = self._S[TICKS] = 0.0
        self._held = None
        self.placed += 1

    def hold(self, hand: Hand, T: float) -> None:
        """Put the hand's gains, its targets at the plant's time and samples of T seconds into the block."""
        K, B, S = hand.stiffness, hand.damping, self._S
        n, d = self.position.shape
        if not (math.isfinite(T) and T > 0.0):
            raise InputError("T", T, "a finite time above zero [s]")
        for name, gain in (("hand.stiffness", K), ("hand.damping", B)):
            if gain.shape != (d, n, n) or not np.isfinite(gain).all():
                raise InputError(name, gain, f"finite gains {(d, n, n)}, for {n} fingers in {d} dimensions")
        now = self.time
        self._grip(K, B, T)
        if S[PERIOD] != T:
            S[SINCE], S[TICKS], S[PERIOD] = now, 0.0, T
        self._shown = None
        if isinstance(hand, FusedHand):
            r, v = (hand.state[at : at + n * d].reshape(n, d) for at in hand.ports)
            self._shown = hand, hand.state.data, r, v
        S[STILL] = float(is_still(hand))
        self._aim(hand, now, self._begin)
        self._held = hand, K, B

    def advance(self, force: FloatArray, hand: Hand, T: float) -> None:
        """Move for T seconds under efforts (n, d), held, and the hand; DeviceError if the motion cannot go on."""
        if force.shape != self._effort.shape:
            raise InputError("force", force, f"an array of shape {self._effort.shape}")
        S, held = self._S, self._held
        if (
            held is None
            or hand is not held[0]
            or hand.stiffness is not held[1]
            or hand.damping is not held[2]
            or S[PERIOD] != T
        ):
            self.hold(hand, T)
        ends = S[SINCE] + (S[TICKS] + 1.0) * T
        if self._middle is not None:
            self._aim(hand, 0.5 * (self.time + ends), self._middle)
        self._aim(hand, ends, self._end)
        self._effort[...] = force
        code = self.kernel(S, 0)
        if code:
            raise DeviceError(self.fault_text(code))

    def _aim(self, hand: Hand, time: float, at: Pair) -> None:
        """The hand's targets at a time into the block."""
        if self._shown is None:
            at[0][...], at[1][...] = hand.target(time)
            return
        fused, S, r, v = self._shown
        fused.kernel(S, 0, time)
        at[0][...] = r
        at[1][...] = v

    def fault_text(self, code: int) -> str:
        """Why the kernel gave this number."""
        return "efforts or the hand's targets are not finite numbers: a simulated plant does not move"

    @property
    @abstractmethod
    def structure(self) -> Index:
        """Entries of the block, whole numbers, that do not change after `hold` and pick what the kernel does."""

    @abstractmethod
    def _put(self, position: FloatArray) -> None:
        """What else is to be placed; DeviceError, and nothing changed, if it cannot be."""

    @abstractmethod
    def _grip(self, K: FloatArray, B: FloatArray, T: float) -> None:
        """Put gains (d, n, n) and whatever else depends on them and on T into the block."""


def unfit(S: Any, first: int, last: int, step: int) -> int:
    """NOT_FINITE if any of S[first], ..., S[last - 1] is not finite, or 0; sums of `step` wait for no other."""
    nothing = 0.0
    for start in range(first, last, step):
        part = 0.0
        for i in range(start, start + step):
            part += 0.0 * S[i]
        nothing += part
    return 0 if nothing == 0.0 else NOT_FINITE
