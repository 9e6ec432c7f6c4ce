"""One call of a stage while it is unfolded: what each statement and expression of it comes to."""

from __future__ import annotations

import math
import operator
import sys
from collections.abc import Callable, Iterable
from types import FunctionType
from typing import Any

from graspfx.compile.records import Floats, Record
from graspfx.compile.unfold.choice import UNBOUND, Choice
from graspfx.compile.unfold.expression import (
    AND,
    ATOM,
    COMPARISON,
    NOT,
    OR,
    Expression,
    NotUnfoldable,
    join,
    number,
    operand,
)
from graspfx.compile.unfold.rewrite import rewrite
from graspfx.compile.unfold.stage import FRAME
from graspfx.compile.unfold.writer import Origin, Writer, is_memory

ARITHMETIC = (abs, min, max, int, float)  # of Python, that a program may call
OPERATIONS: dict[str, Callable[[Any, Any], Any]] = {
    "+": operator.add,
    "-": operator.sub,
    "*": operator.mul,
    "/": operator.truediv,
    "//": operator.floordiv,
    "%": operator.mod,
}


class Frame:
    """A stage's variables, and what its statements write.

    Args:
        writer: of the program.
        occupied: the program's variables of the stages that wait for this one.
        depth: how many stages wait for it.
        origin: of all that it writes; None for a stage of the first two, whose own lines are told.
    """

    unbound = UNBOUND

    def __init__(
        self, writer: Writer, occupied: frozenset[str] = frozenset(), depth: int = 0, origin: Origin | None = None
    ) -> None:
        self.writer, self.occupied, self.depth, self.origin = writer, occupied, depth, origin
        self.variables: dict[str, str] = {}  # the program's names of this stage's variables

    def variable(self, name: str) -> str:
        """Give the program's name of a variable."""
        if name not in self.variables:
            variable = self.writer.names.variable(name)
            while variable in self.occupied:
                variable = self.writer.names.variable(f"{variable}_")
            self.variables[name] = variable
        return self.variables[name]

    def here(self) -> Origin:
        """Give the line that is being unfolded."""
        if self.origin is not None:
            return self.origin
        frame = sys._getframe(1)
        while FRAME not in frame.f_code.co_varnames[:1]:
            assert frame.f_back is not None
            frame = frame.f_back
        return Origin(frame.f_code.co_name, frame.f_code.co_filename, frame.f_lineno)

    # Statements ---------------------------------------------------------------------------------------------------

    def assign(self, name: str, value: Any) -> Any:
        if not isinstance(value, Expression):
            return value
        to = self.variable(name)
        if value.text != to:  # as that of a stage which has ended may be
            self.writer.write(f"{to} = {value.text}", self.here())
        return Expression(to)

    def augment(self, name: str, value: Any, sign: str, by: Any) -> Any:
        if isinstance(value, Expression) and value.text == self.variables.get(name):
            self.writer.write(f"{value.text} {sign}= {number(by).text}", self.here())
            return value
        return self.assign(name, OPERATIONS[sign](value, by))

    def store(self, owner: Any, index: Any, value: Any) -> None:
        self.writer.write(f"{self.entry(owner, index)} = {number(value).text}", self.here())

    def augment_entry(self, owner: Any, index: Any, sign: str, by: Any) -> None:
        self.writer.write(f"{self.entry(owner, index)} {sign}= {number(by).text}", self.here())

    def do(self, value: Any) -> None:
        if isinstance(value, Expression):
            if not value.calls:
                raise NotUnfoldable(value, "a call: a number alone does nothing")
            self.writer.write(value.text, self.here())

    def turns(self, parts: Any) -> Iterable[Any]:
        if is_memory(parts) or isinstance(parts, Expression):
            raise NotUnfoldable(parts, "parts to go through, no numbers of the program")
        return parts  # type: ignore[no-any-return] # Python says if it cannot be gone through

    def choose(self, test: Any, *values: Any) -> Choice:
        return Choice(self.writer, test, self.here(), values)

    def leave(self, *choices: Choice) -> None:
        if any(choice.dynamic for choice in choices):
            raise NotUnfoldable("a way out of a branch", "choices around it that the parts settle, none of the program")

    # Expressions --------------------------------------------------------------------------------------------------

    def item(self, owner: Any, index: Any) -> Any:
        if is_memory(owner) or isinstance(owner, Expression):
            return owner[index] if isinstance(index, slice) else Expression(self.entry(owner, index))
        if isinstance(index, Expression):
            raise NotUnfoldable(index, f"an index into {type(owner).__qualname__} that the parts settle")
        return owner[index]

    def entry(self, owner: Any, index: Any) -> str:
        """Write an entry of a memory."""
        if isinstance(owner, Expression):
            return f"{operand(owner, ATOM)}[{number(index).text}]"
        if not is_memory(owner):
            raise NotUnfoldable(owner, "a float64 array, or one of the program")
        name, first = self.writer.place(owner)
        if isinstance(index, Expression):
            return f"{name}[{(index + first if first else index).text}]"
        k = operator.index(index)
        if not -len(owner) <= k < len(owner):
            raise NotUnfoldable(k, f"an entry of {len(owner)}")
        return f"{name}[{first + k % len(owner)}]"

    def negate(self, value: Any) -> Any:
        if not isinstance(value, Expression):
            return not value
        return Expression(f"not {operand(value, NOT)}", NOT, value.calls)

    def conjunction(self, *parts: Callable[[], Any]) -> Any:
        return self._logic("and", AND, parts)

    def disjunction(self, *parts: Callable[[], Any]) -> Any:
        return self._logic("or", OR, parts)

    def _logic(self, sign: str, level: int, parts: Iterable[Callable[[], Any]]) -> Any:
        """Ask one part after another, as Python does: a value that settles the whole ends it."""
        whole: Any = None
        for part in parts:
            value = part()
            if isinstance(value, Expression):
                whole = join(whole, sign, value, level) if isinstance(whole, Expression) else value
                continue
            settles = bool(value) is (sign == "or")
            if not isinstance(whole, Expression):
                whole = value
            elif settles or whole.level != COMPARISON:  # a comparison is as true with what does not settle it
                whole = join(whole, sign, bool(value), level)
            if settles:
                break
        return whole

    def call_inside(self, function: Any, *arguments: Any, **keywords: Any) -> Any:
        """Call inside an expression, whose other parts may be read before or after."""
        before = len(self.writer.lines)
        result = self.call(function, *arguments, **keywords)
        if len(self.writer.lines) != before:
            raise NotUnfoldable(function, "a stage that only computes, or a statement of its own for the call")
        return result

    def call(self, function: Any, *arguments: Any, **keywords: Any) -> Any:
        """Unfold a stage, write the call of a kernel, or call anything else now."""
        if getattr(function, "is_stage", False):
            return self._stage(function, arguments, keywords)
        values = [*arguments, *keywords.values()]
        if function in (len, isinstance) or not any(map(_is_of_program, values)):
            return function(*arguments, **keywords)
        if keywords:
            raise NotUnfoldable(function, "arguments in order: a kernel's have no names")
        writer = self.writer
        if isinstance(function, FunctionType):
            text = ", ".join([writer.argument(a) for a in arguments])
            return Expression(f"{writer.names.kernel(function)}({text})", calls=True)
        name = getattr(function, "__name__", "")
        of_mathematics = getattr(math, name, None) is function
        if not of_mathematics and function not in ARITHMETIC:
            raise NotUnfoldable(function, "a kernel, a stage, or a function of mathematics for numbers of the program")
        text = ", ".join([number(a).text for a in arguments])
        calls = any(number(a).calls for a in arguments)
        return Expression(f"math.{name}({text})" if of_mathematics else f"{name}({text})", calls=calls)

    def _stage(self, function: FunctionType, arguments: Iterable[Any], keywords: dict[str, Any]) -> Any:
        origin = self.here() if self.depth else None
        frame = Frame(self.writer, self.occupied | set(self.variables.values()), self.depth + 1, origin)
        values = [frame.parameter(k, v) for k, v in zip(function.__code__.co_varnames, arguments, strict=False)]
        return rewrite(function)(frame, *values, **{k: frame.parameter(k, v) for k, v in keywords.items()})

    def parameter(self, name: str, value: Any) -> Any:
        """Hand over an argument: a number as it is now, for what it is computed from may change in the stage."""
        return self.assign(name, value) if isinstance(value, Expression) and not value.text.isidentifier() else value


def _is_of_program(value: Any) -> bool:
    return is_memory(value) or isinstance(value, Expression | Record | Floats)
