"""New numbers for the parts of a running servo, ready to be written between two ticks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
Index = NDArray[np.intp]


@runtime_checkable
class Steerable(Protocol):
    """A plant or a hand whose parameters may change in mid-run."""

    def adopt(self, other: Any) -> None:
        """Take over the parameters of another one of the same structure; what it is doing goes on."""


@runtime_checkable
class SteerablePlant(Steerable, Protocol):
    """A plant whose mechanics and hand may change in mid-run.

    Attributes:
        live: whether they may: then its `structure` is only what never changes.
    """

    live: bool


@runtime_checkable
class CarriedPlant(Steerable, Protocol):
    """A plant whose mechanics are numbers that may come from another process.

    Attributes:
        mechanics: (2, n), masses [kg] and dampings [N s/m]; the plant takes hold anew after they were set.
    """

    mechanics: FloatArray


@dataclass(frozen=True, eq=False)
class Update:
    """New values of keys of a scene, as numbers.

    Attributes:
        values: of the keys.
        entries: memories, entries of them and their new numbers.
        parts: plants and hands, and others that have the new parameters.
        plants: numbers of the plants that take hold of their hands anew.
    """

    values: Mapping[str, Any] = field(default_factory=dict)
    entries: Sequence[tuple[FloatArray, Index, FloatArray]] = ()
    parts: Sequence[tuple[Steerable, Any]] = ()
    plants: Sequence[int] = ()
