"""Random programs, compiled and as Python, to the last bit."""

from __future__ import annotations

import numpy as np

from graspfx.compile.native import compiled
from tests.support.branching_programs import SIZE, Writer
from tests.support.plain_programs import plain

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


def test_random_programs_are_what_python_does() -> None:
    ran = 0
    for seed in range(30):
        source = Writer(seed).program()
        for row in beginnings(seed, 2):
            expected = row.copy()
            try:
                plain(source, expected)(3)
            except (ArithmeticError, ValueError):
                continue  # where Python raises a program has no bits to keep
            found = row.copy()
            compiled(source).bind(found).long(3)
            require_same_bits(found, expected)
            ran += 1
    assert ran >= 30


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


def test_loops_are_left_as_python_leaves_them() -> None:
    rng, program = np.random.default_rng(5), compiled(PARTING)
    for expected in rng.normal(size=(400, 8)):
        found = expected.copy()
        plain(PARTING, expected)(8)
        program.bind(found).long(8)
        require_same_bits(found, expected)
