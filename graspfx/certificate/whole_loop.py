"""How far one gain of a whole loop can go with the others as they are: no modes needed, any fingers, any preload."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspfx.analysis.linearisation import Linearisation
from graspfx.analysis.stability.decoupled import Part, parts_of
from graspfx.analysis.stability.fullloop import (
    Motions,
    Plant,
    drift_free,
    is_late,
    late_loop,
    loop_matrix,
    uncoupled,
)
from graspfx.analysis.stability.late_roots import LateLoop, farthest_root, roots_beyond
from graspfx.certificate.certificate import ROUNDING

FloatArray = NDArray[np.float64]
Stiffness = Callable[[float], FloatArray]


@dataclass(frozen=True, eq=False)
class Line:
    """A matrix K_0 + s K_1 over the factor s of a gain."""

    still: FloatArray
    slope: FloatArray

    def __call__(self, s: float) -> FloatArray:
        return np.asarray(self.still + s * self.slope)


class WholeLoop:
    """A loop without its stiffness, in parts that move by themselves whatever that is put together from.

    Args:
        linear: the loop as it is.
        gains: matrices (m, m) that every stiffness to come is a combination of; None where it is not known of which.
    """

    def __init__(self, linear: Linearisation, gains: Sequence[FloatArray] | None = None) -> None:
        self.linear = linear
        parts = [Part(linear, None)] if gains is None else parts_of(linear, gains)
        self.parts = [PartLoop(part) for part in parts]


class PartLoop:
    """A(K) of a part, without motions that change no force: A(0) + W K C but for the implicit integrator."""

    def __init__(self, part: Part) -> None:
        linear, self._part = part.linear, part
        m, r = linear.coordinates
        self._motions: Motions = uncoupled(linear)
        self.late = is_late(linear)
        plant = Plant(linear.with_arrays(stiffness=np.zeros((m, m))), self._motions, inputs=m)
        states = plant.size
        basis = drift_free(linear, states)
        self._basis = basis
        self.size = states if basis is None else basis.shape[1]
        self.affine = linear.integrator != "implicit" and not self.late
        if self.affine:
            f, extra = plant.coupling()
            u = plant.at["u"]
            rows = plant.advanced(u + extra[:m], linear.G @ u - extra[m:])
            W, C = rows[:, states:], np.zeros((m, states))
            C += plant.reading[:, :states]
            C[:, 2 * m : 2 * m + r] -= linear.G_displacement.T
            still = rows[:, :states] + W @ f[:, :states]
            self._still = self._without_drift(still)
            self._W, self._C = (W, C) if basis is None else (basis.T @ W, C @ basis)

    def _without_drift(self, A: FloatArray) -> FloatArray:
        return A if self._basis is None else np.asarray(self._basis.T @ A @ self._basis)

    def matrices(self, stiffness: Stiffness, factors: Sequence[float]) -> FloatArray:
        """Give A for each factor, (f, states, states)."""
        part = self._part
        if not self.affine:
            loops = [part.linear.with_arrays(stiffness=part.stiffness(stiffness(s))) for s in factors]
            return np.stack([self._without_drift(loop_matrix(each, self._motions)) for each in loops])
        return np.stack([self._still + self._W @ (part.stiffness(stiffness(s)) @ self._C) for s in factors])

    def late_loop(self, stiffness: FloatArray) -> LateLoop:
        """Give the loop of a stiffness, opened where its late reaction enters."""
        part = self._part
        return late_loop(part.linear.with_arrays(stiffness=part.stiffness(stiffness)), self._motions)

    def line(self, stiffness: Line) -> Line:
        """Give A_0 + s A_1."""
        still, slope = (self._W @ (self._part.stiffness(K) @ self._C) for K in (stiffness.still, stiffness.slope))
        return Line(self._still + still, slope)


class Family:
    """The loops of all factors s of a gain, with K(s)."""

    def __init__(self, loop: WholeLoop | Linearisation, stiffness: Stiffness) -> None:
        self.loop = loop if isinstance(loop, WholeLoop) else WholeLoop(loop)
        self.stiffness = stiffness

    @property
    def period(self) -> float:
        return self.loop.linear.period

    @property
    def size(self) -> int:
        """States of the largest part."""
        return max(part.size for part in self.loop.parts)

    def roots(self, factors: FloatArray) -> NDArray[np.complex128]:
        """Find the eigenvalues for each factor, (f, states), without motions that change no force, alike ones once."""
        stacks = [A for A in self.matrices(factors.tolist()) if A.size]
        return np.concatenate([np.linalg.eigvals(A).astype(complex) for A in stacks], axis=1)

    @property
    def late(self) -> bool:
        """Whether a part has a reaction too late for a state for each sample of it."""
        return any(part.late for part in self.loop.parts)

    def farthest(self, factor: float) -> complex:
        """Find an eigenvalue of largest |z| for a factor, of parts with late reactions too."""
        return max((self.farthest_of(part, factor) for part in self.loop.parts), key=abs, default=0j)

    def farthest_of(self, part: PartLoop, factor: float) -> complex:
        """Find an eigenvalue of a part of largest |z| for a factor."""
        if part.late:
            return farthest_root(part.late_loop(self.stiffness(factor)))
        z = np.linalg.eigvals(part.matrices(self.stiffness, [factor])[0])
        return complex(z[np.abs(z).argmax()]) if z.size else 0j

    def unstable(self, factor: float) -> bool:
        """Tell whether an eigenvalue lies beyond the circle."""
        return any(self.unstable_of(part, factor) for part in self.loop.parts)

    def unstable_of(self, part: PartLoop, factor: float) -> bool:
        """Tell whether an eigenvalue of a part lies beyond the circle; those of a late one are counted."""
        if part.late:
            return roots_beyond(part.late_loop(self.stiffness(factor)), 1.0 + ROUNDING) > 0
        return abs(self.farthest_of(part, factor)) > 1.0 + ROUNDING

    def radius(self, factor: float) -> float:
        """Find the largest |z| for a factor."""
        if self.late:
            return abs(self.farthest(factor))
        return float(np.abs(self.roots(np.array([factor]))).max(initial=0.0))

    def matrices(self, factors: Sequence[float]) -> Iterator[FloatArray]:
        """Give A of each part for each factor."""
        if self.lines is None:
            return (part.matrices(self.stiffness, factors) for part in self.loop.parts)
        s = np.asarray(factors)[:, None, None]
        return (line.still + s * line.slope for line in self.lines)

    @cached_property
    def lines(self) -> list[Line] | None:
        """A_0 and A_1 of each part with A(s) = A_0 + s A_1; None where A is no line in s."""
        stiffness, parts = self.stiffness, self.loop.parts
        if not isinstance(stiffness, Line) or not all(part.affine for part in parts):
            return None
        return [part.line(stiffness) for part in parts]


def bounded(value: Any) -> Any:
    """Give a value as JSON has it: None for what is no limit or no number, in nested lists too."""
    if isinstance(value, list):
        return [bounded(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
