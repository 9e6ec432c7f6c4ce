"""Values of swept keys, and variants of a sweep: a grid, keys that vary together, or a Latin hypercube."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspfx.batch.batch import as_array, grid
from graspfx.errors import InputError
from graspfx.numeric import count
from graspfx.scene.overrides import toml_value
from graspfx.scene.toml_text import excess

MOST = 10_000_000  # largest number of values of a range, and of variants of a sample
FORM = "FROM:TO:COUNT, FROM:TO:COUNT:log or values with commas, as in object.viscosity=0.8:1.5:15"
BOTH_ENDS = "both ends are included; a single value is written alone, as in object.viscosity=0.8"
GOLDEN = 0.6180339887498949
Values = Sequence[Any] | NDArray[Any]
IndexArray = NDArray[np.intp]


@dataclass(frozen=True)
class Range:
    """A range of numbers, including both ends.

    Args:
        first, last: Ends of the range.
        count: Number of values in a grid; 0 for a range that can only be sampled.
        log: Whether successive values have equal ratios instead of equal differences.
    """

    first: float
    last: float
    count: int = 0
    log: bool = False

    def grid(self) -> NDArray[np.float64]:
        """Return the `count` values of the range."""
        return (
            self.at(np.linspace(0.0, 1.0, self.count)) if self.log else np.linspace(self.first, self.last, self.count)
        )

    def at(self, share: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the values at fractions `share`, from 0 for the first value to 1 for the last."""
        if self.log:
            values = np.exp(math.log(self.first) + share * (math.log(self.last) - math.log(self.first)))
            values = np.where(share == 0.0, self.first, values)
            return np.asarray(np.where(share == 1.0, self.last, values))
        return self.first + share * (self.last - self.first)


def read_over(text: str) -> tuple[str, Range | list[Any]]:
    """Parse KEY=RANGE or KEY=V1,V2,... from a command line; return the key and its values.

    Raises:
        InputError: If the text has another form.
    """
    key, equals, values = text.partition("=")
    if not key.strip() or not equals or not values.strip():
        raise InputError("--over", text, f"KEY={FORM}")
    return key.strip(), read_values(values.strip(), "--over")


def read_values(text: str, argument: str) -> Range | list[Any]:
    """Parse a range, or a list of comma-separated values.

    Each value is read as TOML. In a text without quotes and brackets, a value that is not valid TOML is a text.

    Args:
        text: Text to parse.
        argument: Name of the argument in error messages.

    Raises:
        InputError: If the text is neither a range nor a list of values.
    """
    span = _range(text, argument)
    if span is not None:
        return span
    if fault := excess(f"value = [{text}]"):
        raise InputError(argument, text, FORM, fault.message)
    try:
        values: list[Any] = toml_value(f"[{text}]", argument)
    except tomllib.TOMLDecodeError:
        if any(letter in text for letter in "[]{}\"'"):
            raise InputError(argument, text, FORM, "each value must be valid TOML, or a word without quotes") from None
        values = [_value(part.strip(), argument) for part in text.split(",")]
    if not values:
        raise InputError(argument, text, FORM)
    return values


def as_values(key: str, values: Any) -> Range | Values:
    """Convert the values of a key, given as a list, an array, a range, or the text of a list or a range.

    Raises:
        InputError: If the values have another form.
    """
    if isinstance(values, str):
        return read_values(values, f"values[{key!r}]")
    if isinstance(values, Range | np.ndarray):
        return values
    if isinstance(values, bytes | Mapping) or not hasattr(values, "__iter__"):
        raise InputError(f"values[{key!r}]", values, "a list of values, or a range as in '20:70:25'")
    return list(values)


def _range(text: str, argument: str) -> Range | None:
    first, *rest = (part.strip() for part in text.split(":"))
    log = len(rest) > 1 and rest[-1] == "log"
    numbers = rest[: len(rest) - log]
    if not 1 <= len(rest) <= 3:
        return None
    try:
        low, high = float(first), float(rest[0])
    except ValueError:
        return None
    try:
        (size,) = map(int, numbers[1:] or "0")
    except ValueError:
        do = "COUNT must be an integer; if the value is a text, write it in quotes"
        raise InputError(argument, text, FORM, do) from None
    if not (math.isfinite(low) and math.isfinite(high)) or size > MOST or (len(numbers) == 2 and size < 1):
        raise InputError(argument, text, f"FROM:TO:COUNT with finite ends and from 1 to {MOST:,} values")
    if low == high and size != 1:
        raise InputError(argument, text, "FROM:TO:COUNT with two different ends", BOTH_ENDS)
    if low != high and size == 1:
        raise InputError(argument, text, "FROM:TO:COUNT with a COUNT of two or more", BOTH_ENDS)
    if log and min(low, high) <= 0.0:
        raise InputError(argument, text, "FROM:TO:COUNT:log with ends above zero")
    return Range(low, high, size, log)


def _value(text: str, argument: str) -> Any:
    try:
        return toml_value(text, argument)
    except tomllib.TOMLDecodeError:
        return text


@dataclass(frozen=True)
class VariantGrid:
    """All V variants of a sweep.

    Attributes:
        shape: Shape of the grid; (V,) if the keys vary together.
        lists: List of values of each key.
        numbers: For each variant and key, the index of the value in the key's list (V, keys).
        sample: Argument `sample` of `sweep`; empty if the variants are not a sample.
        seed: Seed of the sample.
    """

    shape: tuple[int, ...]
    lists: dict[str, list[Any]]
    numbers: IndexArray
    sample: str = ""
    seed: int = 0

    def __len__(self) -> int:
        return len(self.numbers)

    @property
    def keys(self) -> list[str]:
        """Swept keys, in order."""
        return list(self.lists)

    @property
    def arrays(self) -> dict[str, NDArray[Any]]:
        """For each key, its value in each variant, array in the shape of the grid; floats if all values are numbers."""
        return {
            key: as_array(self.lists[key])[self.numbers[:, k]].reshape(self.shape) for k, key in enumerate(self.lists)
        }

    def overrides(self, variant: int) -> dict[str, Any]:
        """Return the values of one variant, by key."""
        return {key: self.lists[key][n] for key, n in zip(self.lists, self.numbers[variant].tolist(), strict=True)}

    def part(self, members: IndexArray) -> tuple[dict[str, list[Any]], IndexArray]:
        """Return lists and indices, as the attributes `lists` and `numbers`, of the variants with indices `members`."""
        numbers = np.empty((len(members), len(self.lists)), dtype=np.intp)
        lists = {}
        for k, (key, items) in enumerate(self.lists.items()):
            used, choice = np.unique(self.numbers[members, k], return_inverse=True)
            numbers[:, k] = choice.ravel()
            lists[key] = [items[n] for n in used.tolist()]
        return lists, numbers


def scattered(count: int, size: int) -> list[IndexArray]:
    """Divide the indices below `count` into sorted parts of `size` indices, each spread over the whole range.

    The first complete part therefore represents the whole sweep. Since each part contains most values of every key, the
    same entries vary in all parts, and all parts can be run by the same compiled program. The index k goes to the parts
    in the order of the fractional part of k times the golden ratio.
    """
    order = np.argsort(np.arange(count) * GOLDEN % 1.0, kind="stable")
    return [np.sort(order[first : first + size]) for first in range(0, count, size)]


def make_grid(values: Mapping[str, Any], *, zip: bool, sample: str, seed: int) -> VariantGrid:
    """Create the variants of a sweep.

    Args:
        values: For each dotted key, a list, a range, or the text of a list or a range.
        zip: Whether to combine the first values of all keys, then the second values, and so on.
        sample: "lhs:N" for N variants of a Latin hypercube; empty for all combinations or for `zip`.
        seed: Seed of the sample.

    Raises:
        InputError: If there are no values; `zip` is True and lists have different lengths; a range without a count is
            not sampled; or the seed is not a non-negative integer.
    """
    if not isinstance(values, Mapping):
        raise InputError("values", values, "lists by dotted key", "as in {'coupling.internal.stiffness': [50.0, 60.0]}")
    spans = {str(key): as_values(str(key), each) for key, each in values.items()}
    if sample:
        if zip:
            raise InputError("zip", zip, "False, because a sample already combines the values of the keys")
        seed = count("seed", seed)
        return VariantGrid(*grid(_sampled(spans, _size(sample), seed), zip=True), sample=sample, seed=seed)
    lists: dict[str, Values] = {}
    for key, each in spans.items():
        if isinstance(each, Range) and not each.count:
            text = f"{each.first:g}:{each.last:g}"
            do = "a range without a count requires sample='lhs:N'"
            raise InputError(f"values[{key!r}]", text, "FROM:TO:COUNT", do)
        lists[key] = each.grid() if isinstance(each, Range) else each
    size = np.prod([float(len(each)) for each in lists.values()])
    if not zip and size > MOST:
        raise InputError("values", f"{size:.3g} variants", f"at most {MOST:,}", "draw a sample of variants: lhs:N")
    return VariantGrid(*grid(lists, zip=zip))


def _size(sample: str) -> int:
    kind, _, size = str(sample).partition(":")
    if kind != "lhs" or not size.isdecimal() or not 1 <= int(size) <= MOST:
        raise InputError("sample", sample, f"lhs:N, a Latin hypercube of N variants, from 1 to {MOST:,}")
    return int(size)


def _sampled(spans: Mapping[str, Range | Values], size: int, seed: int) -> dict[str, Values]:
    """Draw the values of each key in a Latin hypercube of `size` variants.

    Ranges have continuous values; each value of a list occurs equally often, up to rounding.
    """
    from scipy.stats import qmc

    if not spans:
        raise InputError("values", {}, "at least one key, with a range or a list of values each")
    shares = qmc.LatinHypercube(len(spans), seed=np.random.default_rng(seed)).random(size)
    drawn: dict[str, Values] = {}
    for (key, each), share in zip(spans.items(), shares.T, strict=True):
        if isinstance(each, Range):
            drawn[key] = each.at(share)
        else:
            items = each.tolist() if isinstance(each, np.ndarray) else list(each)
            if not items:
                raise InputError(f"values[{key!r}]", items, "at least one value")
            drawn[key] = [items[k] for k in np.minimum((share * len(items)).astype(int), len(items) - 1).tolist()]
    return drawn
