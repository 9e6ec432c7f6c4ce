"""Expressions of tuning: their grammar, and what is none."""

from __future__ import annotations

import math

import pytest

from graspfx.errors import InputError
from graspfx.tuning.formulas import read_constraints, read_expression

NUMBERS = {"a": 2.0, "b.c": 5.0, "finger.*.hand.stiffness": 3.0}


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("a", 2.0), ("a + b.c*2", 12.0), ("(a + b.c)*2", 14.0), ("-a", -2.0), ("a - -a", 4.0), ("b.c/a/2", 1.25),
        ("1e3", 1000.0), (".5*a", 1.0), ("a-1-1", 0.0), ("finger.*.hand.stiffness*a", 6.0), ("3", 3.0),
    ],
)  # fmt: skip
def test_values(text: str, value: float) -> None:
    assert read_expression(text).value(NUMBERS) == value


def test_names_are_listed_once() -> None:
    assert read_expression("a + b.c*a").names == ("a", "b.c")


@pytest.mark.parametrize(
    "text",
    [
        "",
        " ",
        "a +",
        "+ a",
        "a b",
        "(a",
        "a)",
        "a ** 2",
        "a()",
        "a[0]",
        "__import__('os')",
        "a >= 2",
        "a;b",
        "2..3",
        "a.",
        "(" * 99,
        "a" + "+a" * 2000,
    ],
)
def test_no_expressions(text: str) -> None:
    with pytest.raises(InputError, match="maximise"):
        read_expression(text)


def test_the_longest_formula_is_evaluated_and_a_longer_one_is_refused_with_the_reason() -> None:
    """A sum of 200 names is a tree of 199 levels; without a limit, one of 1000 ends in a RecursionError."""
    longest = read_expression("+".join(["a"] * 200))
    assert longest.value(NUMBERS) == 400.0 and longest.names == ("a",)
    reason = r"given '401 words', expected at most 400 names, .*; evaluation is recursive"
    with pytest.raises(InputError, match=reason):
        read_expression("+".join(["a"] * 201))
    with pytest.raises(InputError, match=reason):
        read_constraints("+".join(["a"] * 200) + " >= a")


def test_slack_is_relative_to_the_bound() -> None:
    least, most, both = read_constraints("b.c >= 4, a <= 2.5, a*2 >= b.c - 2")
    assert least.slack(NUMBERS) == pytest.approx(0.25)
    assert most.slack(NUMBERS) == pytest.approx(0.2)
    assert both.slack(NUMBERS) == pytest.approx(1.0 / 3.0)
    assert least.slack({"b.c": math.nan}) == -math.inf
    assert least.slack({"b.c": math.inf}) == math.inf
    assert [each.text for each in (least, most)] == ["b.c >= 4", "a <= 2.5"]
    assert read_constraints("a > 1")[0].text == "a >= 1"
    assert read_constraints("") == ()


@pytest.mark.parametrize("text", ["a", "a >= ", "1 <= a <= 2", "a == 2", "a >= 2 b", ">= 3", 3])
def test_no_constraints(text: object) -> None:
    with pytest.raises(InputError, match="subject_to"):
        read_constraints(text)
