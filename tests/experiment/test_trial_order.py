"""Orders of trials: each has every trial as often as it should, and Williams' squares balance what comes after what."""

from __future__ import annotations

from collections import Counter
from itertools import pairwise

import numpy as np
import pytest

from graspfx.errors import InputError
from graspfx.experiment.session_plan import random_of, trial_order, williams_square


@pytest.mark.parametrize("count", range(1, 10))
def test_williams_squares_are_balanced(count: int) -> None:
    """Each condition is once in a row, as often in each place, and after each other one as often as after any."""
    square = williams_square(count)
    assert square.shape == (2 * count if count % 2 and count > 1 else count, count)
    assert (np.sort(square, axis=1) == np.arange(count)).all()
    for place in square.T:
        assert set(Counter(place.tolist()).values()) == {len(square) // count}
    after = Counter(pair for row in square.tolist() for pair in pairwise(row))
    assert set(after) == {(i, k) for i in range(count) for k in range(count) if i != k}
    assert set(after.values()) <= {len(square) // count}


@pytest.mark.parametrize("order", ["fixed", "random", "blocks", "latin-square"])
def test_each_trial_comes_once(order: str) -> None:
    trials = trial_order(order, 5, 3, random_of(1, "a"), "7")
    assert sorted(trials) == [(i, k) for i in range(5) for k in range(3)]
    if order != "fixed":
        conditions = [condition for condition, _ in trials]
        changes = sum(one != other for one, other in pairwise(conditions))
        assert (changes == 4) == (order != "random")
    else:
        assert trials == [(i, k) for k in range(3) for i in range(5)]


def test_rows_of_the_square_go_with_participants() -> None:
    rows = [trial_order("latin-square", 4, 2, random_of(0), str(number)) for number in range(1, 9)]
    assert rows[:4] == rows[4:]
    assert [[condition for condition, k in row if not k] for row in rows[:4]] == williams_square(4).tolist()
    with pytest.raises(InputError, match="a whole number of at least 1"):
        trial_order("latin-square", 4, 2, random_of(0), "AB")


def test_random_numbers_follow_from_seed_and_words() -> None:
    numbers = [random_of(seed, *words).random() for seed, words in
               ((1, ("a", "b")), (1, ("a", "b")), (2, ("a", "b")), (1, ("ab",)), (1, ("b", "a")))]  # fmt: skip
    assert numbers[0] == numbers[1] and len(set(numbers)) == 4
