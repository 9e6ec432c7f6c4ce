"""The plant protocol: how simulated devices move together with the hand that holds them."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


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
