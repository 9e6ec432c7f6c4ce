"""Choices: settled while a program is unfolded, or written down as an `if` of the program."""

from __future__ import annotations

from typing import Any, NoReturn

from graspfx.compile.unfold.expression import Expression, NotUnfoldable
from graspfx.compile.unfold.writer import Line, Origin, Writer


class NoValue:
    """A variable without a value, or with one that depends on a choice of the program."""

    def __repr__(self) -> str:
        return "a variable without a value, or with one that depends on a choice of the program"

    def __bool__(self) -> NoReturn:
        raise NotUnfoldable(self, "one that the parts settle, or a number of the program")

    def __getattr__(self, name: str) -> NoReturn:
        self.__bool__()

    def __index__(self) -> NoReturn:
        self.__bool__()

    def __eq__(self, other: object) -> NoReturn:
        self.__bool__()

    __hash__ = None  # type: ignore[assignment] # what it is equal to is not known


UNBOUND = NoValue()  # before anything is assigned
UNSETTLED = NoValue()  # it depends on a choice of the program


class Choice:
    """An `if` whose branches are run one after another when it is written down.

    Args:
        writer: of the program.
        test: a number of the program, or whatever settles the choice now.
        origin: of the line.
        values: of the variables that a branch assigns to.
    """

    def __init__(self, writer: Writer, test: Any, origin: Origin, values: tuple[Any, ...]) -> None:
        self.writer, self.test, self.origin, self.values = writer, test, origin, values
        self.dynamic = isinstance(test, Expression)
        self.start = len(writer.lines)
        self.between: int | None = None  # where the other branch starts
        self.first: tuple[Any, ...] | None = None  # values after the first branch, if there is another

    def holds(self) -> bool:
        if not self.dynamic:
            return bool(self.test)
        self.writer.indent += "    "
        return True

    def fails(self) -> bool:
        if not self.dynamic:
            return not self.test
        self.between = len(self.writer.lines)
        return True

    def turn(self, *values: Any) -> tuple[Any, ...]:
        """Keep what variables are after the first branch; give what the other one begins with."""
        self.first = values
        return self.values

    def close(self, *values: Any) -> tuple[Any, ...]:
        """Write the choice down; give what variables are after it."""
        if not self.dynamic:
            return values
        writer, text = self.writer, self.test.text
        writer.indent = outside = writer.indent[:-4]
        between = len(writer.lines) if self.between is None else self.between
        body, other = writer.lines[self.start : between], writer.lines[between:]
        if body or other:
            head = Line(f"{outside}if {text}:" if body else f"{outside}if not ({text}):", self.origin)
            turn = [Line(f"{outside}else:", self.origin)] if body and other else []
            writer.lines[self.start :] = [head, *body, *turn, *other]
        elif self.test.calls:
            raise NotUnfoldable(text, "something to do in one of the branches: the test calls a kernel")
        if self.first is None:
            return tuple(map(_join, values, self.values))
        return tuple(map(_join, self.first, values))


def _join(one: Any, other: Any) -> Any:
    """Join a variable after a choice of the program, by its value after each branch."""
    if isinstance(one, Expression) and isinstance(other, Expression):
        return one if one.text == other.text else UNSETTLED
    if isinstance(one, Expression) and other is UNBOUND:
        return one  # unbound where the other branch runs, as in Python
    if isinstance(other, Expression) and one is UNBOUND:
        return other
    return one if one is other else UNSETTLED
