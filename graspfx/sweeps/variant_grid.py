"""The variants of a sweep: a grid of all combinations, lists taken together, or a Latin hypercube."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspfx.analysis.arguments import count
from graspfx.batch.grid import as_array, grid
from graspfx.errors import InputError
from graspfx.sweeps.ranges import MOST, Range, Values, as_values

IndexArray = NDArray[np.intp]
GOLDEN = 0.6180339887498949


@dataclass(frozen=True)
class VariantGrid:
    """All variants of a sweep.

    Attributes:
        shape: of the grid, or (N,) of variants whose values go together.
        lists: by key, the values that there are.
        numbers: of the value that each key has in each variant, (V, keys).
        sample: as it was asked for, empty for none.
        seed: of the sample.
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
        """The keys, in order."""
        return list(self.lists)

    @property
    def arrays(self) -> dict[str, NDArray[Any]]:
        """Values by key, of the grid's shape: that of each variant; numbers as floats where all are."""
        return {
            key: as_array(self.lists[key])[self.numbers[:, k]].reshape(self.shape) for k, key in enumerate(self.lists)
        }

    def overrides(self, variant: int) -> dict[str, Any]:
        """Give the values of one variant, by key."""
        return {key: self.lists[key][n] for key, n in zip(self.lists, self.numbers[variant].tolist(), strict=True)}

    def part(self, members: IndexArray) -> tuple[dict[str, list[Any]], IndexArray]:
        """Give the values that some variants have, by key, and the numbers of each variant's among them."""
        numbers = np.empty((len(members), len(self.lists)), dtype=np.intp)
        lists = {}
        for k, (key, items) in enumerate(self.lists.items()):
            used, choice = np.unique(self.numbers[members, k], return_inverse=True)
            numbers[:, k] = choice.ravel()
            lists[key] = [items[n] for n in used.tolist()]
        return lists, numbers


def scattered(count: int, size: int) -> list[IndexArray]:
    """Deal numbers below a count to parts of a size, each from all over, and sorted.

    Whatever part is done first shows the whole; and as each has most values of every key, the same entries vary in all
    of them, for which the same programs are compiled. The order is that of the fractions of k times the golden ratio.
    """
    order = np.argsort(np.arange(count) * GOLDEN % 1.0, kind="stable")
    return [np.sort(order[first : first + size]) for first in range(0, count, size)]


def make_grid(values: Mapping[str, Any], *, zip: bool, sample: str, seed: int) -> VariantGrid:
    """Make the variants of a sweep.

    Args:
        values: by dotted key, a list, a range, or the text of one.
        zip: take the keys' first values together, then their second ones, ...
        sample: "lhs:N" for N variants of a Latin hypercube; empty for all combinations.
        seed: of the sample.

    Raises:
        InputError: no values, lists of different lengths with `zip`, a range without a count in a grid, a seed that is
            no whole number from zero.
    """
    if not isinstance(values, Mapping):
        raise InputError("values", values, "lists by dotted key", "as in {'coupling.internal.stiffness': [50.0, 60.0]}")
    spans = {str(key): as_values(str(key), each) for key, each in values.items()}
    if sample:
        if zip:
            raise InputError("zip", zip, "no zip with a sample: its values go together already")
        seed = count("seed", seed)
        return VariantGrid(*grid(_sampled(spans, _size(sample), seed), zip=True), sample=sample, seed=seed)
    lists: dict[str, Values] = {}
    for key, each in spans.items():
        if isinstance(each, Range) and not each.count:
            text = f"{each.first:g}:{each.last:g}"
            raise InputError(f"values[{key!r}]", text, "FROM:TO:COUNT", "a range without a count is for sample='lhs:N'")
        lists[key] = each.grid() if isinstance(each, Range) else each
    size = np.prod([float(len(each)) for each in lists.values()])
    if not zip and size > MOST:
        raise InputError("values", f"{size:.3g} variants", f"at most {MOST:,}", "draw a sample of them: lhs:N")
    return VariantGrid(*grid(lists, zip=zip))


def _size(sample: str) -> int:
    kind, _, count = str(sample).partition(":")
    if kind != "lhs" or not count.isdecimal() or not 1 <= int(count) <= MOST:
        raise InputError("sample", sample, f"lhs:N, a Latin hypercube of N variants, from 1 to {MOST:,}")
    return int(count)


def _sampled(spans: Mapping[str, Range | Values], size: int, seed: int) -> dict[str, Values]:
    """Draw a Latin hypercube: anywhere in a range, and each value of a list as often as the others."""
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
