"""Plant protocol: the joint motion of simulated devices and the hand that holds them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
Index = NDArray[np.intp]
Kernel = Callable[[Any, int], int]
"""Kernel of a part, called with a buffer and the offset of the part's block; it returns zero or a fault code."""
HandKernel = Callable[..., None]
"""Kernel of a hand, called with a record, or with a buffer and an offset, and with a time."""


class Hand(Protocol):
    """A hand that holds fingertips by springs and dampers to moving intended positions.

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
        """Return intended positions r (n, d) [m] and their velocities (n, d) [m/s] at a time [s]."""
        ...


class HandPorts(NamedTuple):
    """First entries of the targets in a hand's block, finger by finger."""

    position: int  # r, (n, d) [m]
    velocity: int  # r', (n, d) [m/s]


@runtime_checkable
class FusedHand(Hand, Protocol):
    """A hand that exposes its block and its kernel: a run computes its targets without Python calls.

    With the block S, `kernel(S, 0, t)` writes the result of `target(t)` at `ports`.
    """

    @property
    def state(self) -> FloatArray:
        """Block S, flat; the same array for the hand's lifetime."""
        ...

    @property
    def structure(self) -> Index:
        """Indices of the integer and boolean entries of the block that select the computation and never change."""
        ...

    @property
    def ports(self) -> HandPorts:
        """Entries of the targets, counted from the block's beginning."""
        ...

    @property
    def kernel(self) -> HandKernel:
        """Kernel kernel(S, o, t), which computes the targets at time t [s] of the hand whose block starts at S[o].

        It is a plain function in the subset of Python that `graspfx.compile` supports. S may be an array or a
        memoryview of an array.
        """
        ...


class Plant(Protocol):
    """Mechanics of one or more simulated devices, which one hand holds and which move together.

    The plant computes the true motion, which the devices read through their sensors. The motion starts at time zero.
    """

    @property
    def position(self) -> FloatArray:
        """True fingertip positions, (n, d) [m]; the same array for the plant's lifetime."""
        ...

    @property
    def velocity(self) -> FloatArray:
        """True fingertip velocities, (n, d) [m/s]; the same array for the plant's lifetime."""
        ...

    def place(self, position: FloatArray) -> None:
        """Set the fingertips to positions (n, d) [m], at rest, at time zero."""

    def advance(self, force: FloatArray, hand: Hand, T: float) -> None:
        """Advance by T seconds under constant efforts (n, d) of the devices and under the hand."""


class Ports(NamedTuple):
    """First entries of the inputs and of the motion in a plant's block, finger by finger."""

    effort: int  # u, (n, d), constant over the next sample
    middle: int | None  # the hand's r, (n, d), then r', (n, d), in the middle of that sample, if the plant needs them
    end: int  # r and r' at the end of that sample
    position: int  # (n, d) [m]
    velocity: int  # (n, d) [m/s]


@runtime_checkable
class FusedPlant(Plant, Protocol):
    """A plant that exposes its block and its kernel: a run moves it without Python calls.

    Call `hold` after `place`, and when the hand, its gains or T change. With the block S, each sample then writes
    efforts and targets to S at `ports`, calls `kernel(S, 0)`, and reads positions and velocities from S. `advance` does
    exactly this. The block also contains the plant's time and the targets at the sample's beginning. Sample k after
    `place` ends at (k + 1) T; its middle is at 0.5 (k T + (k + 1) T).
    """

    @property
    def state(self) -> FloatArray:
        """Block S, flat; the same array for the plant's lifetime. `position` and `velocity` are views of it."""
        ...

    @property
    def structure(self) -> Index:
        """Indices of the integer and boolean entries that select the computation and do not change after `hold`."""
        ...

    @property
    def ports(self) -> Ports:
        """Entries that the caller writes and reads, counted from the block's beginning."""
        ...

    @property
    def kernel(self) -> Kernel:
        """Kernel kernel(S, o), which moves the plant whose block starts at S[o] by one sample.

        It is a plain function in the subset of Python that `graspfx.compile` supports. S may be an array or a
        memoryview of an array. The kernel returns 0, or a fault code if the plant cannot continue and has not moved.
        """
        ...

    def hold(self, hand: Hand, T: float) -> None:
        """Write the hand's gains, its targets at the plant's time and the period T [s] into the block."""

    def fault_text(self, code: int) -> str:
        """Return the message for a fault code of the kernel."""
        ...


def is_still(hand: Hand) -> bool:
    """Return whether a hand declares by `still` that its targets are constant, with zero velocity."""
    return bool(getattr(hand, "still", False))


def fused(plant: Plant) -> FusedPlant | None:
    """Return the plant if its kernel replaces `advance`.

    Return None if the plant has no kernel, or if its class overrides the `advance` of a class with a kernel.
    """
    if isinstance(plant, FusedPlant) and unaltered(plant, ("advance",), ("kernel",)):
        return plant
    return None


def unaltered(component: object, methods: Sequence[str], kernels: Sequence[str]) -> bool:
    """Return whether no subclass overrides these methods without also overriding these kernels."""

    def nearest(names: Sequence[str]) -> int:
        order = type(component).__mro__
        return min((i for i, kind in enumerate(order) if not vars(kind).keys().isdisjoint(names)), default=0)

    return nearest(methods) >= nearest(kernels)
