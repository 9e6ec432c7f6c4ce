"""Numbers that only the running program knows: texts of expressions, which arithmetic puts together."""

from __future__ import annotations

import math
from typing import Any, NoReturn

import numpy as np

OR, AND, NOT, COMPARISON, SUM, PRODUCT, SIGN, ATOM = range(8)  # how tightly an expression holds together


class NotUnfoldable(Exception):
    """An operation that no stage can do: what stands there, what was expected, and what to do."""

    def __init__(self, actual: object, expected: str, do: str = "") -> None:
        super().__init__(actual, expected, do)
        self.actual, self.expected, self.do = actual if isinstance(actual, str) else repr(actual), expected, do


class Expression:
    """The text of an expression.

    Attributes:
        text: as it stands in the program.
        level: how tightly it holds together: where less is needed it stands in brackets.
        calls: whether it calls a kernel, so that it may not be dropped.
    """

    __slots__ = ("calls", "level", "text")
    __array_ufunc__ = None  # numpy's numbers leave arithmetic to this class
    __hash__ = None  # type: ignore[assignment] # it is equal to nothing before the program runs

    def __init__(self, text: str, level: int = ATOM, calls: bool = False) -> None:
        self.text, self.level, self.calls = text, level, calls

    def __add__(self, other: object) -> Expression:
        return join(self, "+", other, SUM)

    def __radd__(self, other: object) -> Expression:
        return join(other, "+", self, SUM)

    def __sub__(self, other: object) -> Expression:
        return join(self, "-", other, SUM)

    def __rsub__(self, other: object) -> Expression:
        return join(other, "-", self, SUM)

    def __mul__(self, other: object) -> Expression:
        return join(self, "*", other, PRODUCT)

    def __rmul__(self, other: object) -> Expression:
        return join(other, "*", self, PRODUCT)

    def __truediv__(self, other: object) -> Expression:
        return join(self, "/", other, PRODUCT)

    def __rtruediv__(self, other: object) -> Expression:
        return join(other, "/", self, PRODUCT)

    def __floordiv__(self, other: object) -> Expression:
        return join(self, "//", other, PRODUCT)

    def __mod__(self, other: object) -> Expression:
        return join(self, "%", other, PRODUCT)

    def __neg__(self) -> Expression:
        return Expression(f"-{operand(self, SIGN)}", SIGN, self.calls)

    def __lt__(self, other: object) -> Expression:
        return compare(self, "<", other)

    def __le__(self, other: object) -> Expression:
        return compare(self, "<=", other)

    def __gt__(self, other: object) -> Expression:
        return compare(self, ">", other)

    def __ge__(self, other: object) -> Expression:
        return compare(self, ">=", other)

    def __eq__(self, other: object) -> Expression:  # type: ignore[override]
        return compare(self, "==", other)

    def __ne__(self, other: object) -> Expression:  # type: ignore[override]
        return compare(self, "!=", other)

    def __bool__(self) -> NoReturn:
        raise NotUnfoldable(self, "a choice that the parts settle", "put this one into an `if`")

    def __iter__(self) -> NoReturn:
        raise NotUnfoldable(self, "parts to go through, no number of the program")

    def __repr__(self) -> str:
        return self.text


def literal(value: object) -> Expression:
    """Write a number that is known already.

    Raises:
        NotUnfoldable: it is none, or not finite.
    """
    if isinstance(value, bool | np.bool_):
        return Expression(repr(bool(value)))
    if isinstance(value, int | np.integer):
        return Expression(repr(int(value)), SIGN if value < 0 else ATOM)
    if isinstance(value, float | np.floating) and math.isfinite(value):
        return Expression(repr(float(value)), SIGN if math.copysign(1.0, value) < 0.0 else ATOM)
    raise NotUnfoldable(value, "a finite number, or one of the program")


def number(value: Any) -> Expression:
    """Write an operand as an expression."""
    return value if isinstance(value, Expression) else literal(value)


def operand(value: object, level: int) -> str:
    """Write the text of an operand, in brackets unless it holds together that tightly."""
    expression = number(value)
    return expression.text if expression.level >= level else f"({expression.text})"


def join(left: object, sign: str, right: object, level: int) -> Expression:
    """Write two operands with a sign between them, the left one first as Python has it."""
    calls = number(left).calls or number(right).calls
    return Expression(f"{operand(left, level)} {sign} {operand(right, level + 1)}", level, calls)


def compare(left: object, sign: str, right: object) -> Expression:
    """Write a comparison of two operands."""
    calls = number(left).calls or number(right).calls
    return Expression(f"{operand(left, SUM)} {sign} {operand(right, SUM)}", COMPARISON, calls)
