"""The sums and peaks of a block of rows that a summary is made of, as one program for all scenes.

Sums are taken row after row. Largest values begin at -1, which stands for none; what is not a number stays.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from graspfx.compile.demand import KernelOnDemand

FloatArray = NDArray[np.float64]

LENGTHS, PLACES, MOMENTS, SHARES, DEPTHS, DISTANCES, LAWS, LARGEST = range(8)  # kinds of measures
STEP = 11  # numbers of a measure: its kind, those of `Measure`, where its results are, and its rows


def larger(peak: float, size: float) -> float:
    """Choose the larger of two numbers; one that is not a number wins, as in numpy."""
    return peak if peak >= size or peak != peak else size


def add_up(results: Any, to: int, value: float) -> None:
    """Add a value to the sum at `to`, of which what rounding took away stands behind it and is added with the next one.

    W. Kahan, Further remarks on reducing truncation errors, Communications of the ACM 8(1), 1965.
    """
    value = value + results[to + 1]
    total = results[to] + value
    results[to + 1] = value - (total - results[to]) if total - total == 0.0 else 0.0  # of infinity nothing is left
    results[to] = total


def measure(rows: Any, measures: Any, entries: Any, results: Any, width: int, number: int) -> None:
    """Take measures of rows.

    Args:
        rows: of `width` numbers.
        measures: `number` of them, `STEP` numbers each.
        entries: numbers of fingers, and which axes are free, for measures that have a list.
        results: of all measures, which are added to.
        width: of a row.
        number: of the measures.
    """
    for k in range(number):
        o = k * STEP
        kind = int(measures[o])
        at = int(measures[o + 1])
        n = int(measures[o + 2])
        d = int(measures[o + 3])
        mask = int(measures[o + 4])
        other = int(measures[o + 5])
        centre = int(measures[o + 6])
        some = int(measures[o + 7])
        to = int(measures[o + 8])
        first = int(measures[o + 9])
        stop = int(measures[o + 10])
        if kind == LENGTHS:
            measure_lengths(rows, results, width, n, d, at, mask, to, first, stop)
        elif kind == PLACES:
            measure_places(rows, entries, results, width, n, d, at, mask, other, centre, some, to, first, stop)
        elif kind == MOMENTS:
            measure_moments(rows, entries, results, width, n, d, at, other, centre, some, to, first, stop)
        elif kind == DEPTHS:
            measure_depths(rows, results, width, n, at, mask, to, first, stop)
        elif kind == DISTANCES:
            measure_distances(rows, results, width, d, at, to, first, stop)
        else:
            measure_numbers(rows, results, width, n, at, kind, to, first, stop)


def measure_lengths(
    rows: Any, results: Any, width: int, n: int, d: int, at: int, mask: int, to: int, first: int, stop: int
) -> None:
    """Find the largest length of each of n vectors in d axes from entry `at` on, and add up the lengths.

    Args:
        rows: of `width` numbers, from `first` up to `stop`.
        results: from `to` on, of each vector the largest length, then the sum over all and how many there were.
        width, n, d, at, to, first, stop: see above.
        mask: entry of whether each counts; below 0 if all do.
    """
    for row in range(first, stop):
        for i in range(n):
            if mask < 0 or rows[row * width + mask + i] != 0.0:
                start = row * width + at + i * d
                square = 0.0
                for j in range(d):
                    square += rows[start + j] * rows[start + j]
                size = math.sqrt(square)
                results[to + i] = larger(results[to + i], size)
                results[to + n] = results[to + n] + size
                results[to + n + 1] = results[to + n + 1] + 1.0


def measure_places(
    rows: Any, entries: Any, results: Any, width: int,
    n: int, d: int, at: int, touching: int, contact: int, centre: int, some: int, to: int, first: int, stop: int,
) -> None:  # fmt: skip
    """Add up how far the fingers of one object squeeze, and how far it is from their centre.

    Args:
        rows: of `width` numbers, from `first` up to `stop`.
        entries: from `some` on the numbers of the fingers, n.
        results: from `to` on the largest squeeze, sqrt(mean |e - mean e|^2) over touching fingers where there are two
            and more, the sum of them and how many; and the sum of the squares of the distance from the centre.
        width, n, d, some, to, first, stop: see above.
        at: entry of the fingers' positions.
        touching, contact: entries of whether fingers touch and of their contacts; below 0 if there is none.
        centre: entry of the object's position; below 0 if there is none.
    """
    for row in range(first, stop):
        start = row * width
        if touching >= 0:
            touch = 0.0
            for i in range(n):
                if rows[start + touching + int(entries[some + i])] != 0.0:
                    touch += 1.0
            if touch >= 2.0:
                spread = 0.0
                for j in range(d):
                    mean = 0.0
                    for i in range(n):
                        f = int(entries[some + i])
                        if rows[start + touching + f] != 0.0:
                            mean += rows[start + at + f * d + j] - rows[start + contact + f * d + j]
                    mean /= touch
                    for i in range(n):
                        f = int(entries[some + i])
                        if rows[start + touching + f] != 0.0:
                            off = rows[start + at + f * d + j] - rows[start + contact + f * d + j] - mean
                            spread += off * off
                squeeze = math.sqrt(spread / touch)
                results[to] = larger(results[to], squeeze)
                results[to + 1] = results[to + 1] + squeeze
                results[to + 2] = results[to + 2] + 1.0
        if centre >= 0:
            for j in range(d):
                mean = 0.0
                for i in range(n):
                    mean += rows[start + at + int(entries[some + i]) * d + j]
                off = rows[start + centre + j] - mean / n
                results[to + 3] = results[to + 3] + off * off


def measure_moments(
    rows: Any, entries: Any, results: Any, width: int,
    n: int, d: int, at: int, contact: int, force: int, some: int, to: int, first: int, stop: int,
) -> None:  # fmt: skip
    """Find the peaks of |sum e_i x f_i| along free axes and of |f| r, of the forces on one object.

    |f|^2 = sum |f_i|^2, and r^2 is the mean square of the contacts' distances from their centroid.

    Args:
        rows: of `width` numbers, from `first` up to `stop`.
        entries: from `some` on the numbers of the fingers, n, and whether the object turns about each of three axes.
        results: from `to` on the two peaks.
        width, n, d, some, to, first, stop: see above.
        at, contact, force: entries of the fingers' positions, contacts c of e = p - c, and forces f.
    """
    for row in range(first, stop):
        start = row * width
        x = 0.0
        y = 0.0
        z = 0.0
        push = 0.0
        for i in range(n):
            o = start + int(entries[some + i]) * d
            e0 = rows[o + at] - rows[o + contact]
            e1 = rows[o + at + 1] - rows[o + contact + 1]
            f0 = rows[o + force]
            f1 = rows[o + force + 1]
            push += f0 * f0 + f1 * f1
            z += e0 * f1 - e1 * f0
            if d > 2:
                e2 = rows[o + at + 2] - rows[o + contact + 2]
                f2 = rows[o + force + 2]
                push += f2 * f2
                x += e1 * f2 - e2 * f1
                y += e2 * f0 - e0 * f2
        arm = 0.0
        for j in range(d):
            mean = 0.0
            for i in range(n):
                mean += rows[start + contact + int(entries[some + i]) * d + j]
            mean /= n
            for i in range(n):
                off = rows[start + contact + int(entries[some + i]) * d + j] - mean
                arm += off * off
        moment = 0.0
        if entries[some + n] != 0.0:
            moment += x * x
        if entries[some + n + 1] != 0.0:
            moment += y * y
        if entries[some + n + 2] != 0.0:
            moment += z * z
        results[to] = larger(results[to], math.sqrt(moment))
        results[to + 1] = larger(results[to + 1], math.sqrt(push * arm / n))


def measure_depths(
    rows: Any, results: Any, width: int, n: int, at: int, touching: int, to: int, first: int, stop: int
) -> None:
    """Find the largest depth of touching fingers, their gap below zero; count them, and add up the depths.

    Args:
        rows: of `width` numbers, from `first` up to `stop`; gaps from entry `at` on, n.
        results: from `to` on.
        width, n, at, to, first, stop: see above.
        touching: entry of whether each finger touches.
    """
    for row in range(first, stop):
        for i in range(n):
            if rows[row * width + touching + i] != 0.0:
                gap = rows[row * width + at + i]
                depth = 0.0 if gap > 0.0 else -gap
                results[to] = larger(results[to], depth)
                results[to + 1] = results[to + 1] + 1.0
                add_up(results, to + 2, depth)


def measure_distances(rows: Any, results: Any, width: int, d: int, at: int, to: int, first: int, stop: int) -> None:
    """Find the least distance of two fingers; count the rows, and add up the distances.

    Args:
        rows: of `width` numbers, from `first` up to `stop`; both positions from entry `at` on.
        results: from `to` on: the negative of the least one, which begins at minus infinity.
        width, d, at, to, first, stop: see above.
    """
    for row in range(first, stop):
        start = row * width + at
        square = 0.0
        for j in range(d):
            off = rows[start + d + j] - rows[start + j]
            square += off * off
        apart = math.sqrt(square)
        results[to] = larger(results[to], -apart)
        results[to + 1] = results[to + 1] + 1.0
        add_up(results, to + 2, apart)


def measure_numbers(
    rows: Any, results: Any, width: int, n: int, at: int, kind: int, to: int, first: int, stop: int
) -> None:
    """Count which of n numbers from entry `at` on are not 0, or are 1; or find the largest of each.

    Args:
        rows: of `width` numbers, from `first` up to `stop`.
        results: of each number, from `to` on.
        width, n, at, to, first, stop: see above.
        kind: `SHARES`, `LAWS` or `LARGEST`.
    """
    for row in range(first, stop):
        for i in range(n):
            number = rows[row * width + at + i]
            if kind == LARGEST:
                results[to + i] = larger(results[to + i], number)
            elif (kind == SHARES and number != 0.0) or (kind == LAWS and number == 1.0):
                results[to + i] = results[to + i] + 1.0


# in rows x measures, which Python looks at in some ten microseconds each
MEASURE = KernelOnDemand(measure, few=300, load=10_000, make=100_000)


class Measure(NamedTuple):
    """A measure of rows: its kind and entries, as the kernels have them, and the list that it has."""

    kind: int
    at: int
    n: int = 1
    d: int = 1
    mask: int = -1
    other: int = -1
    centre: int = -1
    some: Sequence[float] = ()


SIZES = {PLACES: 4, MOMENTS: 2, DEPTHS: 4, DISTANCES: 4}  # of results, where they do not depend on n


class Measures(Mapping[str, list[float]]):
    """Sums and peaks of blocks of rows: the results of each measure by its name.

    Args:
        rows: how many there are in all.
    """

    def __init__(self, rows: int) -> None:
        self._rows = rows
        self._run: Callable[..., object] | None = None
        self._lists: list[float] = []
        self._lines: dict[str, list[float]] = {}
        self._where: dict[str, slice] = {}
        self._results = np.empty(0)

    def add(self, name: str, each: Measure) -> None:
        """Add a measure, under a name."""
        n, start = each.n, len(self._results)
        begin = np.zeros(n + 2 if each.kind == LENGTHS else SIZES.get(each.kind, n))
        if each.kind in (LENGTHS, LARGEST):
            begin[:n] = -1.0
        elif each.kind in (PLACES, DEPTHS):
            begin[0] = -1.0
        elif each.kind == DISTANCES:
            begin[0] = -math.inf
        self._where[name] = slice(start, start + len(begin))
        self._results = np.concatenate([self._results, begin])
        self._lines[name] = [*map(float, each[:-1]), float(len(self._lists)), float(start)]
        self._lists += each.some

    def take(self, rows: FloatArray, pieces: Mapping[str, slice]) -> None:
        """Take measures of rows.

        Args:
            rows: (r, w), an array that can be written.
            pieces: the rows of each measure, by its name.
        """
        if not pieces or not len(rows):
            return
        table = [[*self._lines[name], float(piece.start), float(piece.stop)] for name, piece in pieces.items()]
        if self._run is None:
            self._run = MEASURE.runner(self._rows * len(table))
        lines, lists = np.array(table).reshape(-1), np.array([*self._lists, 0.0])
        self._run(rows.reshape(-1), lines, lists, self._results, rows.shape[1], len(table))

    def __iter__(self) -> Iterator[str]:
        return iter([*self._where])

    def __len__(self) -> int:
        return len(self._where)

    def __getitem__(self, name: str) -> list[float]:
        return [float(value) for value in self._results[self._where[name]]]
