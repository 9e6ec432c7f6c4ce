"""A range of one key of a scene over operators, with the law by which a population is spread in it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from graspfx.errors import InputError, UnknownNameError

FloatArray = NDArray[np.float64]
Law = Literal["log", "uniform", "normal", "lognormal"]

FORM = "KEY=FROM:TO or KEY=FROM:TO:LAW, as in finger.*.hand.stiffness=50:1000"
INSIDE = 0.95  # of a normal law between the ends of its range, where it is cut


@dataclass(frozen=True)
class OperatorRange:
    """The values of one key over a set of operators.

    | law | spread between the ends |
    |---|---|
    | log | the logarithm evenly: as many from 50 to 100 as from 500 to 1000 |
    | uniform | evenly |
    | normal | a bell whose 95 % interval the range is, cut at its ends |
    | lognormal | a bell of the logarithm whose 95 % interval the range is, cut at its ends |

    Attributes:
        key: of the scene, with dots.
        low, high: ends of the range.
        law: of the population; the worst case is sought over the whole range whatever it is.

    Raises:
        InputError: ends that are no finite numbers in rising order; a logarithm of what is not above zero.
        UnknownNameError: a law of another name.
    """

    key: str
    low: float
    high: float
    law: Law = "log"

    def __post_init__(self) -> None:
        if self.law not in get_args(Law):
            raise UnknownNameError("law of a range", str(self.law), get_args(Law))
        for end in (self.low, self.high):
            if not is_number(end):
                raise InputError(self.key, end, "finite ends of a range")
        if not self.low < self.high:
            raise InputError(self.key, (self.low, self.high), "an end above the beginning")
        if self.is_logarithmic and self.low <= 0.0:
            raise InputError(self.key, self.low, f"ends above zero for the law {self.law!r}", "or the law 'uniform'")

    @classmethod
    def read(cls, text: str, name: str = "--operators") -> OperatorRange:
        """Read KEY=FROM:TO or KEY=FROM:TO:LAW; the law is "log" where both ends are above zero, else "uniform".

        Raises:
            InputError: anything else.
            UnknownNameError: a law of another name.
        """
        key, equals, span = text.partition("=")
        parts = [part.strip() for part in span.split(":")]
        if not key.strip() or not equals or len(parts) not in (2, 3):
            raise InputError(name, text, FORM)
        try:
            low, high = float(parts[0]), float(parts[1])
        except ValueError as error:
            raise InputError(name, text, FORM) from error
        return cls(key.strip(), low, high, parts[2] if len(parts) == 3 else usual_law(low))  # type: ignore[arg-type]

    @property
    def is_logarithmic(self) -> bool:
        """Whether its values are spread, and drawn, by their logarithm."""
        return self.law in ("log", "lognormal")

    @property
    def text(self) -> str:
        """The range as `read` takes it."""
        return f"{self.key}={self.low:g}:{self.high:g}:{self.law}"

    def between(self, share: FloatArray | float) -> FloatArray:
        """Give the values at these shares of the way from one end to the other, evenly or by logarithm."""
        u = np.asarray(share, dtype=float)
        if self.is_logarithmic:
            values = np.exp(math.log(self.low) + u * math.log(self.high / self.low))
        else:
            values = self.low + u * (self.high - self.low)
        return np.asarray(np.where(u <= 0.0, self.low, np.where(u >= 1.0, self.high, values).clip(self.low, self.high)))

    def quantile(self, probability: FloatArray) -> FloatArray:
        """Give the values below which these shares of the population are."""
        if self.law in ("normal", "lognormal"):
            from scipy.special import ndtr, ndtri

            edge = float(ndtri(0.5 + INSIDE / 2.0))  # in standard deviations
            inside = ndtr(-edge) + probability * INSIDE
            return self.between((ndtri(inside) + edge) / (2.0 * edge))
        return self.between(probability)


def is_number(value: object) -> bool:
    """Tell whether a value is a finite number."""
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def usual_law(low: float) -> Law:
    """Give the law of a range that names none."""
    return "log" if low > 0.0 else "uniform"
