"""Point masses held by an operator model beyond spring and damper."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from graspfx.devices._plant import NOT_FINITE, HeldPlant
from graspfx.devices.simulated.operated_sample import MOST, TOO_STIFF, OperatedPlantState, advance
from graspfx.protocols import Hand, InputError, Operator, elementary, layout

FloatArray = NDArray[np.float64]
Index = NDArray[np.intp]


class OperatedPlant(HeldPlant):  # type: ignore[misc] # mypy does not see devices from inside the package
    """Point masses held by an operator; for the equations see `graspfx.loop.operator.Operator`.

    Efforts, grip forces and the operator's voluntary force are held over a sample, and targets follow the cubic through
    their values and velocities at its ends, as for `PointPlant`. Tips and limbs then satisfy linear equations. The
    Taylor series of the motion are summed to rounding error, in as many substeps as necessary.

    Args:
        mass: Masses (n,) [kg].
        damping: Damping (n,) [N s/m].
        dimensions: Number of dimensions d.
        room: Number of stored samples of reactions; 0 without a reaction.
        operator: Initial operator; `hold` replaces it by the operator of the hand.

    Attributes:
        live: Whether mechanics and hand may change during a run; always true.
    """

    kernel = staticmethod(advance)
    live = True

    def __init__(
        self,
        mass: Sequence[float],
        damping: Sequence[float],
        dimensions: int,
        room: int = 0,
        operator: Operator | None = None,
    ) -> None:
        super().__init__(OperatedPlantState, len(mass), dimensions, room=room)
        self._block = OperatedPlantState(self.state)
        self._block.room = room
        self._array("mass")[:], self._array("friction")[:] = mass, damping
        self._operator = Operator(len(mass)) if operator is None else operator

    def _array(self, name: str) -> FloatArray:
        values: FloatArray = self._block.array(getattr(OperatedPlantState, name))
        return values

    @property
    def structure(self) -> Index:
        """Entries of the numbers of fingers and dimensions, and of the size of the delay line."""
        return np.array(
            [layout(OperatedPlantState)[name].place(self._block) for name in ("fingers", "dimensions", "room")]
        )

    def hold(self, hand: Hand, T: float) -> None:
        """Write the hand's gains, its operator, its targets and the period T [s] into the block."""
        operator = getattr(hand, "operator", None)
        self._operator = Operator(len(self.position)) if operator is None else operator
        super().hold(hand, T)

    def adopt(self, other: OperatedPlant) -> None:
        """Adopt the masses and dampings of another plant of the same structure; call `hold` afterwards."""
        self.mechanics = other.mechanics

    @property
    def mechanics(self) -> FloatArray:
        """Masses [kg], the operator's numbers and dampings [N s/m], (2, entries); call `hold` after a change."""
        own = [self._array("mass"), self._operator.numbers.ravel(), self._array("friction")]
        flat = np.concatenate(own)
        return np.asarray(np.append(flat, np.zeros(len(flat) % 2)).reshape(2, -1))

    @mechanics.setter
    def mechanics(self, values: FloatArray) -> None:
        n, flat = len(self.position), values.ravel()
        own = self._operator.numbers
        self._array("mass")[:], own[:] = flat[:n], flat[n : n + own.size].reshape(own.shape)
        self._array("friction")[:] = flat[n + own.size : 2 * n + own.size]

    def _put(self, position: FloatArray) -> None:
        """Place the limbs at the fingertips, at rest, and clear the memory."""
        self._array("limb")[:] = position.ravel()
        for name in ("limb_rate", "command", "pull"):
            self._array(name)[:] = 0.0
        self._block.slot = 0
        self._line()[:] = 0.0
        for finger in self._block.operators:
            finger.grip = 0.0

    def _line(self) -> FloatArray:
        start = self._block.line.offset
        line: FloatArray = self.state[start : start + self._block.room * self.position.size]
        return line

    def _grip(self, K: FloatArray, B: FloatArray, T: float) -> None:
        self._array("stiffness")[:], self._array("damping")[:] = K.ravel(), B.ravel()
        for i, finger in enumerate(self._block.operators):
            own = self._operator.finger(i)
            start = finger.now.offset
            self.state[start : start + self._operator.numbers.shape[1]] = self._operator.numbers[i]
            finger.grip_share = elementary.exp(-T / own.grip_lag) if own.grip_lag > 0.0 else 0.0
            finger.command_share = elementary.exp(-T / own.command_lag) if own.command_lag > 0.0 else 0.0
            finger.delay = samples_of(own.delay, T)
            if self._block.room and finger.delay >= self._block.room:
                raise InputError(
                    "delay", own.delay, f"a delay of less than {self._block.room} samples, the delay line's size"
                )

    def fault_text(self, code: int) -> str:
        """Explain a code of the kernel."""
        if code == TOO_STIFF:
            return (
                f"the operator's gains need {MOST} substeps or more: a hand is too stiff or too strongly "
                "damped for the masses that it holds"
            )
        text: str = super().fault_text(NOT_FINITE)
        return text


def samples_of(delay: float, T: float) -> int:
    """Return a delay as the nearest integer number of samples, at least one if it is positive."""
    return max(1, round(delay / T)) if delay > 0.0 else 0


def room_for(delay: float, T: float) -> int:
    """Return the size of the line for a delay [s]: 0, or a power of two, so that similar delays share a program."""
    return 0 if delay <= 0.0 else 1 << samples_of(delay, T).bit_length()
