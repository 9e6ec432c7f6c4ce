"""A set of operators: ranges of a scene's keys, the points that are judged in their box, and a population."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspfx.build.live import value_of
from graspfx.certificate.operators.operator_range import FORM, OperatorRange, is_number, usual_law
from graspfx.errors import GraspFXError, InputError
from graspfx.scene.model import Scene

FloatArray = NDArray[np.float64]
Ranges = Mapping[str, Any] | Sequence[str | OperatorRange]

STIFFNESS = 50.0, 1000.0  # of an operator's fingers [N/m]
DAMPING = 0.5, 2.0  # times the scene's
MASS = 1.0, 1.5  # times the device's: a fingertip moves with it
MOST_CORNERS = 6  # ranges up to which all corners of the box are judged
PRIMES = (2, 3, 5, 7, 11, 13, 17, 19, 23, 29, 31, 37)


@dataclass(frozen=True)
class OperatorSet:
    """Ranges of keys of a scene, independent of one another.

    Attributes:
        ranges: one for each key.
        source: where they come from, in words.
    """

    ranges: tuple[OperatorRange, ...]
    source: str

    @property
    def keys(self) -> tuple[str, ...]:
        """The keys that vary."""
        return tuple(each.key for each in self.ranges)

    def values(self, point: Sequence[float] | FloatArray) -> dict[str, float]:
        """Give the values by key at a point of the unit box."""
        pairs = zip(self.ranges, np.clip(point, 0.0, 1.0).tolist(), strict=True)
        return {each.key: float(each.between(share)) for each, share in pairs}

    def corners(self) -> list[tuple[float, ...]]:
        """List the corners of the box; of more than six ranges, the two ends of their diagonal."""
        count = len(self.ranges)
        if count > MOST_CORNERS:
            return [(0.0,) * count, (1.0,) * count]
        return [tuple(map(float, corner)) for corner in product((0, 1), repeat=count)]

    def spread(self, count: int) -> list[tuple[float, ...]]:
        """List points that fill the box evenly: Halton's, each coordinate in the radix of a prime number."""
        numbers = range(1, count + 1)
        return [tuple(radical_inverse(k, PRIMES[i]) for i in range(len(self.ranges))) for k in numbers]

    def population(self, count: int, seed: int) -> list[dict[str, float]]:
        """Draw operators at random, independent of one another, by the laws of their ranges."""
        uniform = np.random.Generator(np.random.PCG64(seed)).random((count, len(self.ranges)))
        columns = [each.quantile(uniform[:, i]).tolist() for i, each in enumerate(self.ranges)]
        return [dict(zip(self.keys, row, strict=True)) for row in zip(*columns, strict=True)]


def radical_inverse(number: int, radix: int) -> float:
    """Write a whole number's digits in a radix behind the point, the last digit first (Halton 1960)."""
    result, place = 0.0, 1.0 / radix
    while number:
        number, digit = divmod(number, radix)
        result += digit * place
        place /= radix
    return result


def operator_set(scene: Scene, ranges: Ranges | None = None) -> OperatorSet:
    """Read a set of operators; without one, that of the scene's table [operators], or the usual ranges of its hands.

    Args:
        scene: whose keys vary.
        ranges: by key, (low, high) or (low, high, law); or texts "KEY=FROM:TO" and `OperatorRange`s.

    Raises:
        InputError: no ranges, one key twice, too many, or what is no range; a scene without a simulated hand.
        UnknownNameError, SceneError: a key that the scene does not have.
    """
    source = "as asked for"
    if ranges is None and scene.operators:
        spans = scene.operators.items()
        ranges, source = [OperatorRange(key, each.low, each.high, each.law) for key, each in spans], "of the scene"
    if ranges is None:
        result, source = list(_usual(scene)), "the usual ones"
        if not result:
            remedy = "name their keys, as in finger.*.device.mass=0.1:0.2"
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
    scene.replace(answer.values([0.0] * len(result)))  # a key or a value that the scene does not take is said here
    scene.replace(answer.values([1.0] * len(result)))
    return answer


def _listed(ranges: object) -> Sequence[Any]:
    if isinstance(ranges, str) or not isinstance(ranges, Sequence):
        raise InputError("operators", ranges, "ranges by key, or a list of them", FORM)
    return ranges


def range_of(key: str, value: Any) -> OperatorRange:
    """Read (low, high) or (low, high, law) of a key.

    Raises:
        InputError: it is none of them.
    """
    if isinstance(value, OperatorRange):
        return value
    if not isinstance(value, Sequence) or isinstance(value, str) or len(value) not in (2, 3):
        raise InputError(f"operators[{key!r}]", value, "(low, high) or (low, high, law)")
    low, high, *law = value
    if not is_number(low):
        raise InputError(f"operators[{key!r}]", low, "finite ends of a range")
    return OperatorRange(key, low, high, law[0] if law else usual_law(low))


def _usual(scene: Scene) -> Iterator[OperatorRange]:
    """List the usual ranges: stiffness and damping of every hand, and the masses that the scene states for devices."""
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
    """Write one range for keys of all tables of a kind, where they have one value above zero."""
    groups: dict[str, list[float]] = {}
    for key in keys:
        first, _, *rest = key.split(".")
        try:
            value = value_of(scene, key)
        except GraspFXError:  # a setting that the scene leaves to its driver
            continue
        if isinstance(value, int | float) and value > 0.0:
            groups.setdefault(".".join([first, "*", *rest]), []).append(float(value))
    for key, values in groups.items():
        if factors is None:
            yield OperatorRange(key, *STIFFNESS)
        elif math.isclose(min(values), max(values)):
            yield OperatorRange(key, factors[0] * values[0], factors[1] * values[0])
