"""Set of operators, given by ranges of a scene's keys: random samples, and the search for the worst operator."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from graspfx.assembly.live import value_of
from graspfx.certificate.judgement import Judgement, is_number
from graspfx.errors import GraspFXError, InputError, UnknownNameError
from graspfx.progress import waiting
from graspfx.scene.keys import general
from graspfx.scene.model import Scene

FloatArray = NDArray[np.float64]
Law = Literal["log", "uniform", "normal", "lognormal"]

FORM = "KEY=FROM:TO or KEY=FROM:TO:LAW, as in finger.*.hand.stiffness=50:1000"
INSIDE = 0.95  # probability that a normal distribution, before it is truncated at the ends, lies within the range
STIFFNESS = 50.0, 1000.0  # usual range of an operator's fingers [N/m]
DAMPING = 0.5, 2.0  # usual range of a hand's damping, relative to the scene's value
MASS = 1.0, 1.5  # usual range of a device's mass, relative to the scene's value: a fingertip moves with the device
MOST_CORNERS = 6  # largest number of ranges for which all corners of the box are judged
PRIMES = (2, 3, 5, 7, 11, 13, 17, 19, 23, 29, 31, 37)
POINTS = 16  # points per range that fill the box
DESCENTS = 2  # descents, from the worst points
STEPS = 30  # largest number of evaluations in a descent, for each range
FINE = 1e-4  # size of a simplex at which a descent ends, relative to a range
BOX_STEP = 0.15  # first step of a descent, relative to a range
MASSES = "finger.*.device.mass", "device.*.mass"
OF_HANDS = frozenset(
    f"{hand}.{key}"
    for hand in ("finger.*.hand", "hand.*")
    for key in ("stiffness", "damping", "limb.mass", "limb.stiffness", "limb.damping")
)


@dataclass(frozen=True)
class OperatorRange:
    """Range of one key over a set of operators.

    | law | distribution of the values of a random population |
    |---|---|
    | log | logarithm of the value uniform: as many values from 50 to 100 as from 500 to 1000 |
    | uniform | uniform |
    | normal | normal, truncated at the ends of the range; 95 % of the untruncated distribution lies in the range |
    | lognormal | logarithm of the value normal, truncated in the same way |

    Attributes:
        key: Dotted key of the scene.
        low, high: Ends of the range, in the unit of the key.
        law: Distribution of a random population. The search for the worst operator does not depend on it.

    Raises:
        InputError: If an end is not a finite number, the upper end is not above the lower end, or the law is "log" or
            "lognormal" and the lower end is not above zero.
        UnknownNameError: If no law has that name.
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
            raise InputError(self.key, (self.low, self.high), "an upper end above the lower end")
        if self.is_logarithmic and self.low <= 0.0:
            raise InputError(self.key, self.low, f"ends above zero for the law {self.law!r}", "or the law 'uniform'")

    @classmethod
    def read(cls, text: str, name: str = "--operators") -> OperatorRange:
        """Parse a text KEY=FROM:TO or KEY=FROM:TO:LAW.

        Without a law, the law is "log" if the lower end is above zero, and "uniform" otherwise.

        Args:
            text: Text to parse.
            name: Name of the argument in error messages.

        Raises:
            InputError: If the text has another form, or the ends are invalid (see `OperatorRange`).
            UnknownNameError: If no law has that name.
        """
        if not isinstance(text, str):
            raise InputError(name, text, FORM)
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
        """Whether the law is a distribution of the logarithm of the value."""
        return self.law in ("log", "lognormal")

    @property
    def text(self) -> str:
        """Range in the form that `read` parses."""
        return f"{self.key}={self.low:g}:{self.high:g}:{self.law}"

    def between(self, share: FloatArray | float) -> FloatArray:
        """Return values of the key between the ends, by linear interpolation of the values or of their logarithms.

        The logarithms are interpolated if `is_logarithmic`.

        Args:
            share: Fractions of the range, from 0 for the lower end to 1 for the upper end.
        """
        u = np.asarray(share, dtype=float)
        if self.is_logarithmic:
            values = np.exp(math.log(self.low) + u * math.log(self.high / self.low))
        else:
            values = self.low + u * (self.high - self.low)
        return np.asarray(np.where(u <= 0.0, self.low, np.where(u >= 1.0, self.high, values).clip(self.low, self.high)))

    def quantile(self, probability: FloatArray) -> FloatArray:
        """Return the quantiles of a random population for probabilities between 0 and 1."""
        if self.law in ("normal", "lognormal"):
            from scipy.special import ndtr, ndtri

            edge = float(ndtri(0.5 + INSIDE / 2.0))  # in standard deviations
            inside = ndtr(-edge) + probability * INSIDE
            return self.between((ndtri(inside) + edge) / (2.0 * edge))
        return self.between(probability)


Ranges = Mapping[str, Any] | Sequence[str | OperatorRange]


def usual_law(low: float) -> Law:
    """Return the default law of a range with this lower end: "log" if it is above zero, otherwise "uniform"."""
    return "log" if low > 0.0 else "uniform"


@dataclass(frozen=True)
class OperatorSet:
    """Set of operators, given by independent ranges of a scene's keys.

    Attributes:
        ranges: Range of each key.
        source: Origin of the ranges: "as asked for" (arguments), "of the scene" (its table [operators]) or "the usual
            ones" (defaults).
    """

    ranges: tuple[OperatorRange, ...]
    source: str

    @property
    def keys(self) -> tuple[str, ...]:
        """Keys of the ranges."""
        return tuple(each.key for each in self.ranges)

    def values(self, point: Sequence[float] | FloatArray) -> dict[str, float]:
        """Return the value of each key at a point of the unit box. Its coordinates are fractions of the ranges."""
        pairs = zip(self.ranges, np.clip(point, 0.0, 1.0).tolist(), strict=True)
        return {each.key: float(each.between(share)) for each, share in pairs}

    def corners(self) -> list[tuple[float, ...]]:
        """List the corners of the unit box; for more than six ranges, only (0, ..., 0) and (1, ..., 1)."""
        count = len(self.ranges)
        if count > MOST_CORNERS:
            return [(0.0,) * count, (1.0,) * count]
        return [tuple(map(float, corner)) for corner in product((0, 1), repeat=count)]

    def spread(self, count: int) -> list[tuple[float, ...]]:
        """List the first `count` points of a Halton sequence, which fill the unit box evenly."""
        numbers = range(1, count + 1)
        return [tuple(radical_inverse(k, PRIMES[i]) for i in range(len(self.ranges))) for k in numbers]

    def population(self, count: int, seed: int) -> list[dict[str, float]]:
        """Draw `count` random operators, as values by key. The values of different keys are independent."""
        uniform = np.random.Generator(np.random.PCG64(seed)).random((count, len(self.ranges)))
        columns = [each.quantile(uniform[:, i]).tolist() for i, each in enumerate(self.ranges)]
        return [dict(zip(self.keys, row, strict=True)) for row in zip(*columns, strict=True)]


def radical_inverse(number: int, radix: int) -> float:
    """Return the radical inverse of an integer: its digits mirrored at the radix point (Halton 1960)."""
    result, place = 0.0, 1.0 / radix
    while number:
        number, digit = divmod(number, radix)
        result += digit * place
        place /= radix
    return result


def operator_set(scene: Scene, ranges: Ranges | None = None) -> OperatorSet:
    """Return a set of operators from ranges of a scene's keys.

    Args:
        scene: Scene whose keys vary.
        ranges: Ranges by key, as (low, high), (low, high, law) or `OperatorRange`; or a list of texts "KEY=FROM:TO" or
            "KEY=FROM:TO:LAW" and of `OperatorRange`s. If None, the ranges of the scene's table [operators] are used; a
            scene without this table has default ranges for its hands and device masses.

    Raises:
        InputError: If there is no range or more than 12; a range is invalid; a key occurs twice; or `ranges` is None
            and the scene has neither a table [operators] nor a hand or a device mass with a default range.
        UnknownNameError: If no law has that name.
        SceneError: If the scene does not accept a key or a value.
    """
    source = "as asked for"
    if ranges is None and scene.operators:
        spans = scene.operators.items()
        ranges, source = [OperatorRange(key, each.low, each.high, each.law) for key, each in spans], "of the scene"
    if ranges is None:
        result, source = list(_usual(scene)), "the usual ones"
        if not result:
            remedy = "otherwise specify ranges, as in finger.*.device.mass=0.1:0.2"
            raise InputError("operators", scene.source.name, "a scene with a simulated hand", remedy)
    elif isinstance(ranges, Mapping):
        result = [range_of(key, value) for key, value in ranges.items()]
    else:
        result = [each if isinstance(each, OperatorRange) else OperatorRange.read(each) for each in _listed(ranges)]
    if not 1 <= len(result) <= len(PRIMES):
        raise InputError("operators", len(result), f"from 1 to {len(PRIMES)} ranges", FORM)
    for k, each in enumerate(result):
        if each.key in [other.key for other in result[:k]]:
            raise InputError("operators", each.key, "each key once")
    answer = OperatorSet(tuple(result), source)
    scene.replace(answer.values([0.0] * len(result)))  # raises if the scene does not accept a key or a value
    scene.replace(answer.values([1.0] * len(result)))
    return answer


def _listed(ranges: object) -> Sequence[Any]:
    if isinstance(ranges, str) or not isinstance(ranges, Sequence):
        raise InputError("operators", ranges, "ranges by key, or a list of them", FORM)
    return ranges


def range_of(key: str, value: Any) -> OperatorRange:
    """Return the range of a key from (low, high), (low, high, law), or an `OperatorRange`, whose key is replaced.

    Raises:
        InputError: If the value has another form, or the ends are invalid (see `OperatorRange`).
        UnknownNameError: If no law has that name.
    """
    if isinstance(value, OperatorRange):
        return replace(value, key=key)
    if not isinstance(value, Sequence) or isinstance(value, str) or len(value) not in (2, 3):
        raise InputError(f"operators[{key!r}]", value, "(low, high) or (low, high, law)")
    low, high, *law = value
    if not is_number(low):
        raise InputError(f"operators[{key!r}]", low, "finite ends of a range")
    return OperatorRange(key, low, high, law[0] if law else usual_law(low))


def _usual(scene: Scene) -> Iterator[OperatorRange]:
    """Yield default ranges of the stiffness and damping of hands, and of the device masses that the scene states."""
    hands = [
        *(f"finger.{i}.hand" for i, each in enumerate(scene.finger) if _has(each.hand, "stiffness")),
        *(f"hand.{i}.{part}" for i, each in enumerate(scene.hand) for part in ("arm", "grip") if _has(each, part)),
    ]
    devices = [f"finger.{i}.device" for i, each in enumerate(scene.finger) if not isinstance(each.device, str)]
    yield from _alike(scene, [f"{each}.stiffness" for each in hands], None)
    yield from _alike(scene, [f"{each}.damping" for each in hands], DAMPING)
    yield from _alike(scene, [f"{each}.mass" for each in devices], MASS)


def _has(table: object, name: str) -> bool:
    return getattr(table, name, None) is not None


def _alike(scene: Scene, keys: list[str], factors: tuple[float, float] | None) -> Iterator[OperatorRange]:
    """Yield default ranges for keys with values above zero, with numbers in the keys replaced by `*`.

    `factors` are the ends of a range relative to the scene's value. A range is omitted if keys that differ only in the
    number have different values. If `factors` is None, the ends are `STIFFNESS`.
    """
    groups: dict[str, list[float]] = {}
    for key in keys:
        first, _, *rest = key.split(".")
        try:
            value = value_of(scene, key)
        except GraspFXError:  # a setting that the scene leaves to the driver
            continue
        if isinstance(value, int | float) and value > 0.0:
            groups.setdefault(".".join([first, "*", *rest]), []).append(float(value))
    for key, values in groups.items():
        if factors is None:
            yield OperatorRange(key, *STIFFNESS)
        elif math.isclose(min(values), max(values)):
            yield OperatorRange(key, factors[0] * values[0], factors[1] * values[0])


def are_passive(scene: Scene, operators: OperatorSet) -> bool:
    """Return whether a set varies only properties of hands, and every hand is passive.

    Springs, dampers and masses are passive. A device mass above the scene's value counts as mass of the hand. A hand
    that reacts with a delay, or stiffens with the grip force, is not passive.
    """
    hands = [*scene.hand, *(finger.hand for finger in scene.finger)]
    if any(getattr(hand, name, None) is not None for hand in hands for name in ("reaction", "stiffening")):
        return False
    return all(_is_passive(scene, each.key, each.low) for each in operators.ranges)


def _is_passive(scene: Scene, key: str, least: float) -> bool:
    if general(key) in MASSES:
        own = value_of(scene, key)
        return is_number(own) and least >= own
    return general(key) in OF_HANDS


# The worst of them ---------------------------------------------------------------------------------------------------


Point = tuple[float, ...]
Judging = Callable[[dict[str, float]], Judgement]
Figure = Callable[[Judgement], float]


@dataclass(frozen=True)
class Search:
    """Result of the search for the worst operator.

    Attributes:
        worst: Judgement of the operator with the smallest figure of merit.
        point: Point of this operator in the unit box.
        every: Points and judgements of all operators that were judged.
    """

    worst: Judgement
    point: Point
    every: tuple[tuple[Point, Judgement], ...]


def worst_operator(
    operators: OperatorSet, judge: Judging, figure: Figure, starts: Sequence[Point] = (), points: int | None = None
) -> Search:
    """Search a set of operators for the smallest figure of merit.

    The corners of the ranges (`OperatorSet.corners`), the centre, and points of a Halton sequence are judged first. The
    two worst of these points that are not close to each other are the starts of descents by the method of Nelder and
    Mead (1965). The search does not guarantee the worst operator: the figure of merit may have a minimum that is
    narrower than the distance between the points.

    Args:
        operators: Set of operators.
        judge: Function that returns the judgement of an operator, which is given as values by key.
        figure: Function that returns the figure of merit of a judgement; smaller is worse.
        starts: Additional points of the unit box to judge before the descents.
        points: Number of points of the Halton sequence; if None, 16 for each range.
    """
    from scipy.optimize import minimize

    size = len(operators.ranges)
    spread = operators.spread(POINTS * size if points is None else points)
    places = list(dict.fromkeys([*operators.corners(), (0.5,) * size, *spread, *starts]))
    every: dict[Point, Judgement] = {}

    def value(point: FloatArray | Point) -> float:
        place = tuple(float(x) for x in np.clip(point, 0.0, 1.0))
        if place not in every:
            every[place] = judge(operators.values(place))
        return figure(every[place])

    most = len(places) + DESCENTS * STEPS * size
    with waiting("searching for the worst operator", most, "operators", lambda: float(len(every))):
        ranked = sorted(places, key=value)
        for start in apart(ranked)[:DESCENTS]:
            minimize(
                value, start, method="Nelder-Mead", bounds=[(0.0, 1.0)] * size,
                options={
                    "initial_simplex": simplex(start), "maxfev": STEPS * size, "xatol": FINE, "fatol": 1e-6,
                },
            )  # fmt: skip
    point = min(every, key=lambda place: figure(every[place]))
    return Search(every[point], point, tuple(every.items()))


def apart(ranked: Sequence[Point]) -> list[Point]:
    """Select points in the given order; omit points within 0.3 of a selected point in every coordinate."""
    selection: list[Point] = []
    for place in ranked:
        if all(np.abs(np.subtract(place, other)).max() > 2.0 * BOX_STEP for other in selection):
            selection.append(place)
    return selection


def simplex(start: Point) -> FloatArray:
    """Return a simplex (n + 1, n): a point of the unit box, and the ends of steps of 0.15 from it along each axis."""
    corners = np.tile(np.array(start), (len(start) + 1, 1))
    for i, x in enumerate(start):
        corners[i + 1, i] = x - BOX_STEP if x > 0.5 else x + BOX_STEP
    return corners
