"""Programs for lanes against the program itself, lane by lane, to the last bit."""

from __future__ import annotations

import numpy as np
import pytest

from graspfx.compile.emission import side_by_side
from graspfx.compile.native import compiled, interpreted
from graspfx.errors import InputError
from tests.support.branching_programs import SIZE, Writer

SPECIAL = [0.0, -0.0, 1.0, -1.0, 0.5, 3.0, 1e300, -1e-300, float("inf"), float("nan")]


def beginnings(seed: int, count: int) -> np.ndarray:
    """Buffers of some lanes at first, (count, SIZE), special numbers among common ones."""
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(count, SIZE)) * rng.choice([0.1, 1.0, 10.0], size=(count, SIZE))
    A[rng.random(A.shape) < 0.1] = rng.choice(SPECIAL)
    return A


def require_same_bits(one: np.ndarray, other: np.ndarray) -> None:
    """Require the same bits; which NaN it is nobody says, neither the processor nor LLVM."""
    one, other = (np.where(np.isnan(each), np.nan, each) for each in (one, other))
    np.testing.assert_array_equal(one.view(np.int64), other.view(np.int64))


def in_lanes(source: str, begin: np.ndarray, lanes: int, *numbers: int) -> np.ndarray:
    """The buffers after a run of all lanes at once."""
    memory = np.ascontiguousarray(begin.T)
    compiled(source, lanes=lanes).bind(memory.reshape(-1)).long(*numbers)
    return memory.T.copy()


def one_by_one(source: str, begin: np.ndarray, *numbers: int) -> np.ndarray:
    out = begin.copy()
    program = compiled(source, quick=True)
    for row in out:
        program.bind(row).long(*numbers)
    return out


@pytest.mark.parametrize("lanes", [2, 4, 8, 16])
@pytest.mark.parametrize("seed", range(30))
def test_a_random_program_does_in_each_lane_what_it_does_alone(seed: int, lanes: int) -> None:
    source = Writer(seed).program()
    begin = beginnings(seed, lanes)
    alone, together = one_by_one(source, begin, 3), in_lanes(source, begin, lanes, 3)
    require_same_bits(together, alone)


def test_random_programs_are_what_python_does() -> None:
    """The programs, of which there is one for lanes, are Python's: else they could agree on nothing worth it."""
    ran = 0
    for seed in range(12):
        source = Writer(seed).program()
        begin = beginnings(seed, 2)
        for row in begin:
            expected = row.copy()
            try:
                interpreted(source).bind(expected).brief(3)
            except (ArithmeticError, ValueError):
                continue  # where Python raises a program has no bits to keep
            found = row.copy()
            compiled(source, quick=True).bind(found).long(3)
            require_same_bits(found, expected)
            ran += 1
    assert ran >= 12


PARTING = """
def run(A, n):
    z = 0.0
    while A[0] < 10.0:
        A[0] = A[0] + abs(A[1]) + 0.3
        if A[2] > 1.0:
            continue
        for k in range(n):
            if A[k] > A[3]:
                break
            z = z + A[k] * k
            if z > 40.0:
                A[4] = k
                A[5] = z
                return
        A[6] = k
    A[7] = z
"""


def test_lanes_leave_loops_when_they_want_to() -> None:
    rng = np.random.default_rng(5)
    for _ in range(50):
        begin = rng.normal(size=(8, 8))
        together = in_lanes(PARTING, begin, 8, 8)
        require_same_bits(together, one_by_one(PARTING, begin, 8))


def test_what_is_guarded_does_not_trap_in_other_lanes() -> None:
    """A division by zero, an index far outside and an endless loop stand behind tests that hold in no lane, or few."""
    source = """
def run(A, n):
    k = int(A[0])
    if A[1] > 0.0:
        A[2] = n // k
        A[3] = A[k]
        while A[1] > 0.5:
            A[1] = A[1] - 1.0
    if A[1] > 1e9:
        A[4] = A[n * 1000000]
        A[n * 1000000] = 1.0
    A[5] = A[6] if A[1] > 1e9 else 2.0
"""
    begin = np.zeros((8, 8))
    begin[:, 0] = [0, 1e18, 3, -1e300, np.nan, 2, 1, 0]
    begin[:, 1] = [-1, -1, 4, -1, -1, 0.25, 7, -1]
    together = in_lanes(source, begin, 8, 7)
    require_same_bits(together, one_by_one(source, begin, 7))


def test_entries_that_lanes_share_stand_once() -> None:
    source = """
def total(A, first, n):
    sum = 0.0
    for k in range(n):
        sum = sum + A[first + k]
    return sum
def run(A, n):
    A[0] = total(A, 4, n) + A[6]
    k = int(A[1])
    A[2] = A[k] + total(A, k, 2)
    for k in range(2, 6):
        A[3] = A[3] + A[k]
"""
    rng = np.random.default_rng(2)
    common, lanes = rng.normal(size=12), 4
    own = rng.normal(size=(4, lanes))
    own[1] = [0, 3, 7, 13]
    alone = [np.concatenate([own[:, lane], common]) for lane in range(lanes)]
    for block in alone:
        compiled(source).bind(block).long(5)
    memory = own.copy()
    compiled(source, lanes=lanes, shared={"A": (4, 16)}).bind(memory.reshape(-1), common.copy()).long(5)
    expected = np.array([block[:4] for block in alone]).T
    require_same_bits(memory, expected)


@pytest.mark.parametrize(
    ("source", "message"),
    [
        ("def run(A):\n    return A[0] > 1.0\n", "returns nothing"),
        ("def run(A):\n    A[0.5] = 1.0\n", "line 2.*whole number"),
        ("def run(A):\n    A[0] = y\n", "line 2.*'y'"),
        ("def run(A):\n    A[0] = open(A[1])\n", "line 2.*open"),
    ],
)
def test_what_lanes_cannot_do_is_said_with_its_line(source: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        compiled(source, lanes=4)


def test_this_processor_has_some_lanes() -> None:
    assert side_by_side() in (4, 8)
