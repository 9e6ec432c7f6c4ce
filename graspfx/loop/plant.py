"""Protocols of plants, which simulate the motion of devices, and of hands, which hold the devices."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
Index = NDArray[np.intp]
Kernel = Callable[[Any, int], int]
"""Kernel of a part. Its arguments are a buffer and the offset of the part's block; it returns zero or a fault code."""
HandKernel = Callable[..., None]
"""Kernel of a hand. Its arguments are the hand's record (or a buffer and the offset of the hand's block) and a time."""


class Hand(Protocol):
    """Hand that pulls n fingertips in d dimensions towards moving intended positions r by springs and dampers.

    The force on fingertips with positions p and velocities v is K[a] (r - p)[:, a] + B[a] (r' - v)[:, a] for axis a.
    """

    @property
    def stiffness(self) -> FloatArray:
        """Stiffness K, (d, n, n) [N/m]."""
        ...

    @property
    def damping(self) -> FloatArray:
        """Damping B, (d, n, n) [N s/m]."""
        ...

    def target(self, time: float) -> tuple[FloatArray, FloatArray]:
        """Return intended positions r (n, d) [m] and intended velocities r' (n, d) [m/s] at a time [s]."""
        ...


class HandPorts(NamedTuple):
    """Entries of a hand's block at which the targets of all fingers start."""

    position: int  # r, (n, d) [m]
    velocity: int  # r', (n, d) [m/s]


@runtime_checkable
class FusedHand(Hand, Protocol):
    """Hand whose targets a kernel computes, without Python calls.

    The memory of the hand is a block S; `kernel(S, 0, t)` writes the result of `target(t)` to S at `ports`.
    """

    @property
    def state(self) -> FloatArray:
        """Block S, one-dimensional; the property must always return the same array."""
        ...

    @property
    def structure(self) -> Index:
        """Indices of the integer and Boolean entries of S that select the computation and never change."""
        ...

    @property
    def ports(self) -> HandPorts:
        """Entries of S at which the targets start."""
        ...

    @property
    def kernel(self) -> HandKernel:
        """Kernel kernel(S, o, t), which computes the targets at the time t [s]; the block of the hand starts at S[o].

        The kernel is a function in the subset of Python that `graspfx.compile` supports. S may be an array or a
        memoryview of an array.
        """
        ...


class Plant(Protocol):
    """Mechanics of one or more simulated devices with n fingertips that are held by one hand.

    The plant computes the true motion of the fingertips, which the sensors of the devices measure. The motion starts at
    time zero.
    """

    @property
    def position(self) -> FloatArray:
        """True positions of the fingertips, (n, d) [m]; the property must always return the same array."""
        ...

    @property
    def velocity(self) -> FloatArray:
        """True velocities of the fingertips, (n, d) [m/s]; the property must always return the same array."""
        ...

    def place(self, position: FloatArray) -> None:
        """Set the positions of the fingertips (n, d) [m], their velocities to zero, and the time to zero."""

    def advance(self, force: FloatArray, hand: Hand, T: float) -> None:
        """Advance by T seconds under the forces of the hand and constant efforts (n, d) of the devices."""


class Ports(NamedTuple):
    """Entries of a plant's block at which inputs and motion of all fingers start."""

    effort: int  # efforts of the devices, (n, d), constant over the next sample
    middle: int | None  # the hand's r, then r', (n, d) each, in the middle of the next sample; None if not needed
    end: int  # the hand's r, then r', (n, d) each, at the end of the next sample
    position: int  # (n, d) [m]
    velocity: int  # (n, d) [m/s]


@runtime_checkable
class FusedPlant(Plant, Protocol):
    """Plant that is moved by a kernel, without Python calls.

    The memory of the plant is a block S, which also contains the time and the targets at the start of the sample.
    `hold` must be called after `place`, and when the hand, the gains of the hand or the period T change. In each
    sample, efforts and targets are then written to S at `ports`, `kernel(S, 0)` is called, and positions and velocities
    are read from S; `advance` must do the same. Sample k after `place` ends at the time (k + 1) T; the middle of the
    sample is at 0.5 (k T + (k + 1) T).
    """

    @property
    def state(self) -> FloatArray:
        """Block S, one-dimensional; always the same array, of which `position` and `velocity` are views."""
        ...

    @property
    def structure(self) -> Index:
        """Indices of the integer and Boolean entries of S that select the computation and are constant after `hold`."""
        ...

    @property
    def ports(self) -> Ports:
        """Entries of S at which the caller writes inputs and reads the motion."""
        ...

    @property
    def kernel(self) -> Kernel:
        """Kernel kernel(S, o), which moves the plant by one sample; the block of the plant starts at S[o].

        The kernel is a function in the subset of Python that `graspfx.compile` supports. S may be an array or a
        memoryview of an array. The kernel returns 0, or a fault code if the plant cannot continue; it then has not
        moved the plant.
        """
        ...

    def hold(self, hand: Hand, T: float) -> None:
        """Write into the block the gains of the hand, the hand's targets at the present time, and the period T [s]."""

    def fault_text(self, code: int) -> str:
        """Return the message for a fault code of the kernel."""
        ...


def is_still(hand: Hand) -> bool:
    """Return whether the targets of a hand are constant, as the hand declares by the attribute `still`."""
    return bool(getattr(hand, "still", False))


def fused(plant: Plant) -> FusedPlant | None:
    """Return the plant if a kernel can replace its method `advance`, otherwise None.

    The result is None if the plant has no kernel, or if its class overrides `advance` of a base class with a kernel.
    """
    if isinstance(plant, FusedPlant) and unaltered(plant, ("advance",), ("kernel",)):
        return plant
    return None


def unaltered(component: object, methods: Sequence[str], kernels: Sequence[str]) -> bool:
    """Return whether no class of the object overrides one of the methods of a base class but none of the kernels."""

    def nearest(names: Sequence[str]) -> int:
        order = type(component).__mro__
        return min((i for i, kind in enumerate(order) if not vars(kind).keys().isdisjoint(names)), default=0)

    return nearest(methods) >= nearest(kernels)
