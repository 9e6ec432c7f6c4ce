"""Common parts of simulated plants: the first fields of the block, the time, and the hand."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspfx.protocols import (
    DeviceError,
    Floats,
    FusedHand,
    Hand,
    InputError,
    Kernel,
    Ports,
    Record,
    floats,
    is_still,
    kernel,
    size_for,
    start_of,
    zeros,
)

FloatArray = NDArray[np.float64]
Index = NDArray[np.intp]
Pair = tuple[FloatArray, FloatArray]

NOT_FINITE = 1  # code of a kernel for non-finite inputs


class PlantState(Record):
    """First fields of the block of every plant: n fingers in d dimensions; arrays are (n, d), one row per finger."""

    fingers: int  # n
    dimensions: int  # d
    period: float  # sampling period T [s]
    since: float  # time at which counting of ticks began [s]
    ticks: float
    still: bool  # the targets are constant
    position: Floats = floats("fingers * dimensions")  # [m]
    velocity: Floats = floats("fingers * dimensions")  # [m/s]
    effort: Floats = floats("fingers * dimensions")  # effort u, held over the sample
    start: Floats = floats("fingers * dimensions")  # target r of the hand at the beginning of the sample [m]
    start_rate: Floats = floats("fingers * dimensions")  # its rate r' [m/s]
    end: Floats = floats("fingers * dimensions")  # target at the end of the sample [m]
    end_rate: Floats = floats("fingers * dimensions")


class MiddlePlantState(PlantState):
    """First fields of the block of a plant that needs the target in the middle of a sample."""

    middle: Floats = floats("fingers * dimensions")
    middle_rate: Floats = floats("fingers * dimensions")


PERIOD, SINCE, TICKS, STILL = (start_of(PlantState, name) for name in ("period", "since", "ticks", "still"))
ARRAYS = "position", "velocity", "effort", "start", "start_rate", "end", "end_rate"


class HeldPlant(ABC):
    """Fingers held by a hand and moved by a kernel that works on one block.

    The hand's gains are copied again when the hand has new arrays of gains.

    Args:
        kind: Record of the plant's block.
        fingers: Number of fingers n.
        dimensions: Number of dimensions d.
        whole: Other integers on which the size of the block depends.
    """

    kernel: Kernel  # moves the block by one sample; returns 0, or a code for `fault_text`

    def __init__(self, kind: type[PlantState], fingers: int, dimensions: int, **whole: int) -> None:
        shape, step = (fingers, dimensions), fingers * dimensions
        self.declaration = kind
        self.state: FloatArray = zeros(size_for(kind, fingers=fingers, dimensions=dimensions, **whole))
        block = kind(self.state)
        block.fingers, block.dimensions = shape
        names = ARRAYS + (("middle", "middle_rate") if isinstance(block, MiddlePlantState) else ())
        starts = {name: getattr(block, name).offset for name in names}
        arrays = {name: self.state[start : start + step].reshape(shape) for name, start in starts.items()}
        self.ports = Ports(
            effort=starts["effort"],
            middle=starts.get("middle"),
            end=starts["end"],
            position=starts["position"],
            velocity=starts["velocity"],
        )
        self.position: FloatArray = arrays["position"]
        self.velocity: FloatArray = arrays["velocity"]
        self._effort = arrays["effort"]
        self._start, self._end = (arrays["start"], arrays["start_rate"]), (arrays["end"], arrays["end_rate"])
        self._middle = (arrays["middle"], arrays["middle_rate"]) if "middle" in arrays else None
        self._entries: Any = self.state.data  # plain floats, because access to items of an array takes twice as long
        self._coupled_hand: tuple[Hand, FloatArray, FloatArray] | None = None  # the hand and its gains
        self._targets: tuple[FusedHand, Any, FloatArray, FloatArray] | None = None  # block and targets of the hand
        self.placed = 0  # number of calls of `place`, by which a device detects that its finger was placed anew

    @property
    def time(self) -> float:
        """Time since `place` [s]: the time at the last change of the period T, plus T times the samples since then."""
        S = self._entries
        now: float = S[SINCE] + S[TICKS] * S[PERIOD]
        return now

    def place(self, position: FloatArray) -> None:
        """Place the fingertips at positions (n, d) [m], at rest, at time zero; raise DeviceError if out of reach."""
        p = np.asarray(position, dtype=np.float64)
        if p.shape != self.position.shape or not np.isfinite(p).all():
            raise InputError("position", position, f"finite positions of shape {self.position.shape} [m]")
        self._put(p)
        self.position[...] = p
        self.velocity[...] = 0.0
        self._entries[SINCE] = self._entries[TICKS] = 0.0
        self._coupled_hand = None
        self.placed += 1

    def hold(self, hand: Hand, T: float) -> None:
        """Write the hand's gains, its targets at the plant's time and the period T [s] into the block."""
        K, B, S = hand.stiffness, hand.damping, self._entries
        n, d = self.position.shape
        if not (math.isfinite(T) and T > 0.0):
            raise InputError("T", T, "a finite time above zero [s]")
        for name, gain in (("hand.stiffness", K), ("hand.damping", B)):
            if gain.shape != (d, n, n) or not np.isfinite(gain).all():
                raise InputError(name, gain, f"finite gains of shape {(d, n, n)}, for {n} fingers in {d} dimensions")
        now = self.time
        self._grip(K, B, T)
        if S[PERIOD] != T:
            S[SINCE], S[TICKS], S[PERIOD] = now, 0.0, T
        self._targets = None
        if isinstance(hand, FusedHand):
            r, v = (hand.state[at : at + n * d].reshape(n, d) for at in hand.ports)
            self._targets = hand, hand.state.data, r, v
        S[STILL] = float(is_still(hand))
        self._aim(hand, now, self._start)
        self._coupled_hand = hand, K, B

    def advance(self, force: FloatArray, hand: Hand, T: float) -> None:
        """Advance by T seconds under held efforts (n, d) and the hand; raise DeviceError if the motion diverges."""
        if force.shape != self._effort.shape:
            raise InputError("force", force, f"an array of shape {self._effort.shape}")
        S, coupled = self._entries, self._coupled_hand
        if (
            coupled is None
            or hand is not coupled[0]
            or hand.stiffness is not coupled[1]
            or hand.damping is not coupled[2]
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
        """Write the hand's targets at a time into the block."""
        if self._targets is None:
            at[0][...], at[1][...] = hand.target(time)
            return
        fused, S, r, v = self._targets
        fused.kernel(S, 0, time)
        at[0][...] = r
        at[1][...] = v

    def fault_text(self, code: int) -> str:
        """Explain a code of the kernel."""
        return "efforts or the hand's targets are not finite, so a simulated plant cannot move"

    @property
    @abstractmethod
    def structure(self) -> Index:
        """Integer entries of the block that are constant after `hold` and select the computation."""

    @abstractmethod
    def _put(self, position: FloatArray) -> None:
        """Set the internal states for positions (n, d) [m]; if impossible, raise DeviceError and change nothing."""

    @abstractmethod
    def _grip(self, K: FloatArray, B: FloatArray, T: float) -> None:
        """Write gains (d, n, n), and everything that depends on them and on T, into the block."""


@kernel
def unfit(inputs: Floats, rows: int, columns: int) -> int:
    """Return NOT_FINITE if any of the rows of inputs is not finite, else 0.

    The sums of the rows are independent, so that the processor can overlap them.
    """
    nothing = 0.0
    for row in range(rows):
        part = 0.0
        for i in range(row * columns, (row + 1) * columns):
            part += 0.0 * inputs[i]
        nothing += part
    return 0 if nothing == 0.0 else NOT_FINITE
