"""Expressions of measures and keys: names, numbers, + - * / and brackets, and comparisons of two of them."""

from __future__ import annotations

import math
import operator
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import NoReturn

from graspfx.errors import InputError

TOKEN = re.compile(
    r"\s*(?:(?P<number>(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)|(?P<name>[A-Za-z_]\w*(?:\.(?:\w+|\*))*)|(?P<sign><=|>=|[-+*/()<>]))"
)
FORM = "names, numbers, + - * / and brackets, as in internal.stiffness or 2*depth"
COMPARISON = "a comparison with >= or <=, as in margin >= 1.3"
SIGNS: dict[str, Callable[[float, float], float]] = {
    "+": operator.add, "-": operator.sub, "*": operator.mul, "/": operator.truediv,
}  # fmt: skip
DEEPEST = 50  # brackets in one another
LEVELS = ("+-", "*/")  # signs, from those that bind least

Tree = float | str | tuple[str, "Tree", "Tree"]


@dataclass(frozen=True)
class Expression:
    """A formula of names, as it was typed."""

    text: str
    tree: Tree

    @property
    def names(self) -> tuple[str, ...]:
        """The names in it, each once."""
        return tuple(dict.fromkeys(_names(self.tree)))

    def value(self, numbers: Mapping[str, float]) -> float:
        """Compute it for values of its names; nan where it divides by zero."""
        return _value(self.tree, numbers)


@dataclass(frozen=True)
class Constraint:
    """A comparison: `left` is at least, or at most, `right`."""

    text: str
    left: Expression
    right: Expression
    is_least: bool

    @property
    def names(self) -> tuple[str, ...]:
        """The names on both sides, each once."""
        return tuple(dict.fromkeys((*self.left.names, *self.right.names)))

    def slack(self, numbers: Mapping[str, float]) -> float:
        """Compute by how much it is met, over the bound's size; below zero it is not, and -inf without a number."""
        left, right = self.left.value(numbers), self.right.value(numbers)
        room = left - right if self.is_least else right - left
        if math.isnan(room):
            return -math.inf
        return room / abs(right) if right and math.isfinite(right) else room


def read_expression(text: str, name: str = "maximise") -> Expression:
    """Read a formula.

    Raises:
        InputError: what is none.
    """
    words, rest = _words(text, name), text
    tree, words = _sum(words, name, rest, 0)
    if words:
        _refuse(name, text, f"{FORM}; {words[0]!r} has no place there")
    return Expression(text.strip(), tree)


def read_constraints(text: object, name: str = "subject_to") -> tuple[Constraint, ...]:
    """Read comparisons that commas separate.

    Raises:
        InputError: what is none.
    """
    if not isinstance(text, str):
        _refuse(name, text, COMPARISON)
    return tuple(_constraint(part, name) for part in text.split(",") if part.strip())


def _constraint(text: str, name: str) -> Constraint:
    words = _words(text, name)
    signs = [k for k, word in enumerate(words) if word in ("<=", ">=", "<", ">")]
    if len(signs) != 1:
        _refuse(name, text.strip(), COMPARISON)
    (at,) = signs
    left, right = (_side(side, name, text) for side in (words[:at], words[at + 1 :]))
    return Constraint(f"{left.text} {words[at][0]}= {right.text}", left, right, words[at][0] == ">")


def _side(words: list[str], name: str, text: str) -> Expression:
    tree, rest = _sum(words, name, text, 0)
    if rest:
        _refuse(name, text.strip(), f"{FORM}; {rest[0]!r} has no place there")
    return Expression(" ".join(words), tree)


def _words(text: object, name: str) -> list[str]:
    if not isinstance(text, str) or not text.strip():
        _refuse(name, text, FORM)
    words, at = [], 0
    while text[at:].strip():
        match = TOKEN.match(text, at)
        if match is None:
            _refuse(name, text.strip(), f"{FORM}; {text[at:].strip()[0]!r} has no place there")
        words.append(match.group().strip())
        at = match.end()
    return words


def _sum(words: list[str], name: str, text: str, depth: int, level: int = 0) -> tuple[Tree, list[str]]:
    """Read terms and the signs of a level between them, from the left; terms of the last level are factors."""
    if level == len(LEVELS):
        return _factor(words, name, text, depth)
    tree, words = _sum(words, name, text, depth, level + 1)
    while words and words[0] in LEVELS[level]:
        right, rest = _sum(words[1:], name, text, depth, level + 1)
        tree, words = (words[0], tree, right), rest
    return tree, words


def _factor(words: list[str], name: str, text: str, depth: int) -> tuple[Tree, list[str]]:
    if depth > DEEPEST:
        _refuse(name, text, f"at most {DEEPEST} brackets in one another")
    if not words:
        _refuse(name, text.strip(), f"{FORM}; something is missing at the end")
    first, *rest = words
    if first == "-":
        tree, rest = _factor(rest, name, text, depth + 1)
        return ("-", 0.0, tree), rest
    if first == "(":
        tree, rest = _sum(rest, name, text, depth + 1)
        if not rest or rest[0] != ")":
            _refuse(name, text.strip(), f"{FORM}; a bracket is not closed")
        return tree, rest[1:]
    if first[0].isdigit() or first[0] == ".":
        return float(first), rest
    if not (first[0].isalpha() or first[0] == "_"):
        _refuse(name, text.strip(), f"{FORM}; {first!r} has no place there")
    return first, rest


def _names(tree: Tree) -> Iterator[str]:
    if isinstance(tree, str):
        yield tree
    elif isinstance(tree, tuple):
        yield from _names(tree[1])
        yield from _names(tree[2])


def _value(tree: Tree, numbers: Mapping[str, float]) -> float:
    if isinstance(tree, str):
        return numbers[tree]
    if not isinstance(tree, tuple):
        return tree
    sign, left, right = tree
    a, b = _value(left, numbers), _value(right, numbers)
    return math.nan if sign == "/" and b == 0.0 else SIGNS[sign](a, b)


def _refuse(name: str, text: object, expected: str) -> NoReturn:
    raise InputError(name, text, expected)
