"""The plant protocol: how simulated devices move together with the hand that holds them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
Index = NDArray[np.intp]
Kernel = Callable[[Any, int], int]
"""Kernel of a part, called with its state and structure; it returns zero, or the number of a fault."""
HandKernel = Callable[..., None]
"""Kernel of a hand, called with a record, or with a buffer and an offset, and with a time."""


class Hand(Protocol):
    """A hand that holds fingertips: springs and dampers to intended positions that move.

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
        """Give intended positions r (n, d) [m] and their velocities (n, d) [m/s] at a time [s]."""
        ...


class HandPorts(NamedTuple):
    """Where a hand's block shows its targets: the first of their entries, finger by finger."""

    position: int  # r, (n, d) [m]
    velocity: int  # r', (n, d) [m/s]


@runtime_checkable
class FusedHand(Hand, Protocol):
    """A hand that shows its block and its kernel, so that a run may ask for its targets without calling it.

    With S the block, `kernel(S, 0, t)` leaves at `ports` what `target(t)` gives.
    """

    @property
    def state(self) -> FloatArray:
        """S, flat, the same array for the hand's life."""
        ...

    @property
    def structure(self) -> Index:
        """Entries of the block, whole numbers, that never change and pick what the kernel does."""
        ...

    @property
    def ports(self) -> HandPorts:
        """Where in the block the targets are, counted from its beginning."""
        ...

    @property
    def kernel(self) -> HandKernel:
        """kernel(S, o, t) works out the targets at a time t [s] of the hand whose block starts at S[o].

        A plain function in the subset of Python that `graspfx.compile` knows, for an array or a memoryview of it.
        """
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
    nothing else. The kernel carries the plant's time and the targets' beginning along in the block. In sample k after
    `place` the end is at (k + 1) T, the middle at 0.5 (k T + (k + 1) T).
    """

    @property
    def state(self) -> FloatArray:
        """S, flat, the same array for the plant's life; `position` and `velocity` are views of it."""
        ...

    @property
    def structure(self) -> Index:
        """Entries of the block, whole numbers, that do not change after `hold` and pick what the kernel does."""
        ...

    @property
    def ports(self) -> Ports:
        """Where in the block the caller writes and reads, counted from its beginning."""
        ...

    @property
    def kernel(self) -> Kernel:
        """kernel(S, o) moves the plant whose block starts at S[o] by one sample.

        A plain function in the subset of Python that `graspfx.compile` knows, for an array or a memoryview of it. It
        gives 0, or another number if it cannot go on: then nothing has moved.
        """
        ...

    def hold(self, hand: Hand, T: float) -> None:
        """Put the hand's gains, its targets at the plant's time and samples of T seconds into the block."""

    def fault_text(self, code: int) -> str:
        """Say why the kernel gave this number instead of 0."""
        ...


def is_still(hand: Hand) -> bool:
    """Tell whether a hand says, as `still`, that its targets never change and have no velocity."""
    return bool(getattr(hand, "still", False))


def fused(plant: Plant) -> FusedPlant | None:
    """Give the plant, if its kernel does all that `advance` does.

    None for one that lacks it, or whose class has an `advance` of its own over the kernel of one it is made from.
    """
    if isinstance(plant, FusedPlant) and unaltered(plant, ("advance",), ("kernel",)):
        return plant
    return None


def unaltered(component: object, methods: Sequence[str], kernels: Sequence[str]) -> bool:
    """Tell whether no class has these methods of its own over these kernels of a class that it is made from."""

    def nearest(names: Sequence[str]) -> int:
        order = type(component).__mro__
        return min((i for i, kind in enumerate(order) if not vars(kind).keys().isdisjoint(names)), default=0)

    return nearest(methods) >= nearest(kernels)
