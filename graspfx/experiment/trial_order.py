"""Orders of trials: fixed, random, in blocks, and Williams' Latin squares, in which carry-over is balanced."""

from __future__ import annotations

from collections.abc import Sequence
from hashlib import sha256

import numpy as np
from numpy.typing import NDArray

from graspfx.errors import InputError

IntArray = NDArray[np.int64]


def random_of(seed: int, *words: str) -> np.random.Generator:
    """Make the random numbers of a participant's session: the same for the same seed and words, on any machine."""
    text = "\n".join([str(seed), *words]).encode()
    return np.random.Generator(np.random.PCG64(int.from_bytes(sha256(text).digest(), "big")))


def williams_square(count: int) -> IntArray:
    """Give Williams' design (rows, count): a Latin square, or a pair of them where the count is odd.

    Each condition is once in every row, as often in every place, and right after each other one as often as after any
    other (E. J. Williams, Aust. J. Sci. Res. A 2, 149 (1949)). The first row is 0, 1, n-1, 2, n-2, ...; the others
    follow from it by addition modulo n, and the mirrored square comes after it for odd n.

    Args:
        count: of conditions, n.

    Raises:
        InputError: none.
    """
    if type(count) is not int or count < 1:
        raise InputError("count", count, "one condition or more")
    first = [0]
    for k in range(1, count):
        first.append((k + 1) // 2 if k % 2 else count - k // 2)
    square = (np.array(first)[None] + np.arange(count)[:, None]) % count
    return np.concatenate([square, square[:, ::-1]]) if count % 2 and count > 1 else square


def trial_order(
    order: str, count: int, repetitions: int, rng: np.random.Generator, participant: str
) -> Sequence[tuple[int, int]]:
    """Arrange trials as pairs of a condition and its repetition, each counted from zero.

    Args:
        order: "fixed": conditions as in the file, as often as they are repeated; "random": all trials shuffled;
            "blocks": all repetitions of a condition after one another, conditions shuffled; "latin-square": likewise,
            conditions in the participant's row of Williams' design.
        count: of conditions.
        repetitions: of each.
        rng: of the participant's session.
        participant: by whose number a row is chosen: 1 has the first, and after the last it begins again.

    Raises:
        InputError: a Latin square for a participant who is no number.
    """
    if order == "fixed":
        return [(condition, k) for k in range(repetitions) for condition in range(count)]
    if order == "random":
        drawn = rng.permutation(np.repeat(np.arange(count), repetitions)).tolist()
        return [(condition, drawn[:at].count(condition)) for at, condition in enumerate(drawn)]
    if order == "blocks":
        row = rng.permutation(count).tolist()
    else:
        if not participant.isdecimal() or int(participant) < 1:
            do = "a row of the Latin square goes with it"
            raise InputError("--participant", participant, "a number from 1 on", do)
        square = williams_square(count)
        row = square[(int(participant) - 1) % len(square)].tolist()
    return [(condition, k) for condition in row for k in range(repetitions)]
