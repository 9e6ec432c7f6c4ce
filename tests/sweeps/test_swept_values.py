"""Values of swept keys as they are typed."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from graspfx.errors import InputError
from graspfx.sweeps.swept_values import Range, read_over


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ('a.b="00:11:22:33"', ["00:11:22:33"]),
        ("a.b=soft:1:2", ["soft:1:2"]),
        ("a.b=1:3:5", [1.0, 1.5, 2.0, 2.5, 3.0]),
        ("a.b=3:1:3", [3.0, 2.0, 1.0]),
        ("a.b=1:1000:4:log", [1.0, 10.0, 100.0, 1000.0]),
        ("a.b=2:2:1", [2.0]),
        ("a.b=0.5,1,2", [0.5, 1, 2]),
        ("a.b=native,bullet", ["native", "bullet"]),
        ('a.b="x","y z"', ["x", "y z"]),
        ("a.b=[0.0,1.0],[2.0,3.0]", [[0.0, 1.0], [2.0, 3.0]]),
        ("a.b={ s = 1.0 },{ s = 2.0 }", [{"s": 1.0}, {"s": 2.0}]),
        ("a.b=true,false", [True, False]),
        ("a.b=1,soft", [1, "soft"]),
        ("a.b=mesh/a.stl,mesh/b.stl", ["mesh/a.stl", "mesh/b.stl"]),
        ("a.b=7", [7]),
    ],
)
def test_values_are_read(text: str, values: list[Any]) -> None:
    key, read = read_over(text)
    items = read.grid().tolist() if isinstance(read, Range) else read
    assert key == "a.b"
    assert items == pytest.approx(values, rel=1e-15) if isinstance(read, Range) else items == values


def test_ends_are_exact() -> None:
    assert Range(0.1, 0.7, 4, log=True).grid()[[0, -1]].tolist() == [0.1, 0.7]
    assert Range(0.1, 0.7).at(np.array([0.0, 0.5])).tolist() == [0.1, 0.4]


@pytest.mark.parametrize(
    "text",
    [
        "",
        "a",
        "a=",
        "=1:2:3",
        "a=1:1:2",
        "a=0:1:3:log",
        "a=nan:1:3",
        "a=1:2:0",
        "a=1:2:99999999999",
        "a=[1,2",
        "a=b,[1",
        "a=1]\nother = [2",
        "a=1\nother = 2, 3",
    ],
)
def test_others_are_refused(text: str) -> None:
    with pytest.raises(InputError):
        read_over(text)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("a=40:60:1", "a COUNT of two or more.*both ends are included; a single value is written alone"),
        ("a=40:60:1:log", "a COUNT of two or more"),
        ("a=1:1:2", "two different ends"),
        ("a=0:1:3:log", "FROM:TO:COUNT:log with ends above zero"),
        ("a=nan:1:3", "finite ends and from 1 to"),
        ("a=1:2:0", "finite ends and from 1 to"),
        ("a=1:2:2.5", "COUNT must be an integer"),
        ("a=1:2:3:lin", "COUNT must be an integer"),
        ("a=1:2:x:log", "COUNT must be an integer"),
    ],
)
def test_errors_name_the_form(text: str, said: str) -> None:
    with pytest.raises(InputError, match=said) as error:
        read_over(text)
    assert "FROM:TO:COUNT" in str(error.value) and text[2:] in str(error.value)
