"""The plant protocol: how simulated devices move together with the hand that holds them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
Kernel = Callable[[Any, int], int]


class Hand(Protocol):
    """What holds the fingertips: springs and dampers to intended positions that move.

    Force on the fingertips, per axis a: K[a] (r(t) - p[:, a]) + B[a] (r'(t) - v[:, a]).
    """

    @property
    def stiffness(self) -> FloatArray:
        """K, (d, n, n) [N/m]."""
        ...

    @property
    def damping(self) -> FloatArray:
        """B, (d, n, n) [N s/m]."""
        ...

    def target(self, time: float) -> tuple[FloatArray, FloatArray]:
        """Intended positions r (n, d) [m] and their velocities (n, d) [m/s] at a time [s]."""
        ...


class Plant(Protocol):
    """The mechanics of one or several simulated devices, all fingers that one hand moves together.

    The plant owns the true motion; the devices read it through their sensors. It starts at time zero.
    """

    @property
    def position(self) -> FloatArray:
        """True fingertip positions, (n, d) [m], the same array for the plant's life."""
        ...

    @property
    def velocity(self) -> FloatArray:
        """True fingertip velocities, (n, d) [m/s], the same array for the plant's life."""
        ...

    def place(self, position: FloatArray) -> None:
        """Put the fingertips at these positions (n, d) [m], at rest, at time zero."""

    def advance(self, force: FloatArray, hand: Hand, T: float) -> None:
        """Move for T seconds under the devices' efforts (n, d), held, and the hand."""


class Ports(NamedTuple):
    """Where a plant's block takes its inputs and shows its motion: the first of their entries, finger by finger."""

    effort: int  # u, (n, d), held over the coming sample
    middle: int | None  # the hand's r, (n, d), then r', (n, d), in the middle of it, if the plant asks for them
    end: int  # r and r' at its end
    position: int  # (n, d) [m]
    velocity: int  # (n, d) [m/s]


@runtime_checkable
class FusedPlant(Plant, Protocol):
    """A plant that shows its block and its kernel, so that a run may move it without calling it.

    `hold` comes first: after `place`, and when the hand, its gains or T change. Then, with S the block, each sample:
    efforts and targets written to S at `ports`, `kernel(S, 0)`, positions and velocities read from S. `advance` does
    nothing else. The kernel carries the plant's time and the targets' beginning along in the block.
    """

    @property
    def state(self) -> FloatArray:
        """S, flat, the same array for the plant's life; `position` and `velocity` are views of it."""
        ...

    @property
    def ports(self) -> Ports:
        """Where in the block the caller writes and reads, counted from its beginning."""
        ...

    @property
    def kernel(self) -> Kernel:
        """kernel(S, o) moves the plant whose block starts at S[o] by one sample.

        A plain function in the subset of Python that numba compiles, for an array or a memoryview of it. It gives 0,
        or another number if it cannot go on: then nothing has moved.
        """
        ...

    def hold(self, hand: Hand, T: float) -> None:
        """Put the hand's gains, its targets at the plant's time and samples of T seconds into the block."""

    def fault_text(self, code: int) -> str:
        """Why the kernel gave this number instead of 0, as an error says it."""
        ...
