"""Unfolds a function over Python objects into the lines of a program: loops over parts are written out, choices that
parts settle are made, and what remains are entries of arrays, arithmetic and calls of kernels.

A stage is a plain Python function, which also runs as it stands. Its arguments are parts (any Python objects) and
numbers of the program. In it

- an entry of a float64 array, and what is computed from one, is a number of the program;
- an `if` on such a number is written down, any other is settled now; so is every loop;
- a call of a function with an array or such a number is a call of a kernel, and that of another stage is unfolded.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Iterable
from types import FunctionType
from typing import Any, NamedTuple, NoReturn, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from graspfx.compile.unfold.dynamic import (
    AND,
    ATOM,
    COMPARISON,
    NOT,
    OR,
    Dynamic,
    NotUnfoldable,
    joined,
    number,
    operand,
)
from graspfx.compile.unfold.stages import FRAME, rewritten, stamp
from graspfx.errors import InputError

ARITHMETIC = (abs, min, max, int, float)  # of Python, that a program may call
OPERATIONS: dict[str, Callable[[Any, Any], Any]] = {
    "+": lambda a, b: a + b,
    "-": lambda a, b: a - b,
    "*": lambda a, b: a * b,
    "/": lambda a, b: a / b,
    "//": lambda a, b: a // b,
    "%": lambda a, b: a % b,
}

Stage = TypeVar("Stage", bound=Callable[..., Any])


def stage(function: Stage) -> Stage:
    """Marks a function that is unfolded where another stage calls it."""
    function.is_stage = True  # type: ignore[attr-defined] # a function takes any attribute
    stamp(function.__code__.co_filename)
    return function


class Line(NamedTuple):
    """A line of a program, and the line of the stage that it comes from."""

    text: str
    file: str
    number: int


class Names(Protocol):
    """The names of a program."""

    def place(self, array: NDArray[np.float64]) -> tuple[str, int]:
        """The name of the memory that an array is a piece of, and which entry of it is the array's first."""
        ...

    def kernel(self, function: Callable[..., Any]) -> str: ...

    def variable(self, name: str) -> str:
        """A name that is no memory's and no kernel's, this one if it can be."""
        ...


def unfold(function: Callable[..., Any], names: Names, **parts: object) -> list[Line]:
    """The lines of a stage's program.

    Args:
        function: the stage; a parameter that no part is given for is a variable, or an array, of the program.
        names: of memories, kernels and variables.
        parts: by parameter.

    Raises:
        InputError: the stage does what no stage can, with its file and line.
    """
    assert isinstance(function, FunctionType)
    writer = Writer(names)
    parameters = function.__code__.co_varnames[: function.__code__.co_argcount]
    frame = Frame(writer, frozenset())
    values = [parts[name] if name in parts else Dynamic(frame.own(name)) for name in parameters]
    try:
        rewritten(function)(frame, *values)
    except NotUnfoldable as error:
        raise InputError(_place(error), error.found, error.expected, error.do) from error
    except (AttributeError, IndexError, TypeError) as error:
        raise InputError(_place(error), str(error), "what the parts have, and arithmetic that a program has") from error
    return writer.lines


class Writer:
    """The lines so far."""

    def __init__(self, names: Names) -> None:
        self.names = names
        self.lines: list[Line] = []
        self.indent = ""
        self.places: dict[int, tuple[Any, str, int]] = {}  # by an array's id: the array, which keeps it, and its place

    def write(self, text: str) -> None:
        self.lines.append(Line(self.indent + text, *_here()))

    def place(self, array: NDArray[np.float64]) -> tuple[str, int]:
        known = self.places.get(id(array))
        if known is None:
            if array.ndim != 1 or not array.flags.c_contiguous:
                raise NotUnfoldable(f"an array {array.shape}", "a flat contiguous array")
            known = self.places[id(array)] = (array, *self.names.place(array))
        return known[1], known[2]

    def argument(self, value: Any) -> str:
        """An argument of a kernel."""
        if is_memory(value):
            name, first = self.place(value)
            if first:
                raise NotUnfoldable(f"{name} from entry {first} on", "a whole array: a kernel takes that and the entry")
            return name
        return number(value).text


class Frame:
    """One call of a stage while it is unfolded.

    Args:
        writer: of the program.
        taken: the program's variables of the stages that wait for this one.
    """

    nothing: Any

    def __init__(self, writer: Writer, taken: frozenset[str]) -> None:
        self.writer, self.taken = writer, taken
        self.variables: dict[str, str] = {}  # the program's names of this stage's variables

    def own(self, name: str) -> str:
        """The program's name of a variable."""
        if name not in self.variables:
            mine = self.writer.names.variable(name)
            while mine in self.taken:
                mine = self.writer.names.variable(f"{mine}_")
            self.variables[name] = mine
        return self.variables[name]

    # Statements ---------------------------------------------------------------------------------------------------

    def assign(self, name: str, value: Any) -> Any:
        if not isinstance(value, Dynamic):
            return value
        to = self.own(name)
        self.writer.write(f"{to} = {value.text}")
        return Dynamic(to)

    def augment(self, name: str, value: Any, sign: str, by: Any) -> Any:
        if isinstance(value, Dynamic) and value.text == self.variables.get(name):
            self.writer.write(f"{value.text} {sign}= {number(by).text}")
            return value
        return self.assign(name, OPERATIONS[sign](value, by))

    def store(self, owner: Any, index: Any, value: Any) -> None:
        self.writer.write(f"{self.entry(owner, index)} = {number(value).text}")

    def augment_entry(self, owner: Any, index: Any, sign: str, by: Any) -> None:
        self.writer.write(f"{self.entry(owner, index)} {sign}= {number(by).text}")

    def do(self, value: Any) -> None:
        if isinstance(value, Dynamic):
            if not value.calls:
                raise NotUnfoldable(value.text, "a call: a number alone does nothing")
            self.writer.write(value.text)

    def turns(self, parts: Any) -> Iterable[Any]:
        if is_memory(parts) or isinstance(parts, Dynamic):
            raise NotUnfoldable(parts, "parts to go through, not numbers of the program")
        return parts  # type: ignore[no-any-return] # Python says if it cannot be gone through

    def choose(self, test: Any, *values: Any) -> Choice:
        return Choice(self.writer, test, values)

    def leave(self, *choices: Choice) -> None:
        if any(choice.dynamic for choice in choices):
            raise NotUnfoldable(
                "a way out of a branch", "a choice that the parts settle around it, none of the program"
            )

    # Expressions --------------------------------------------------------------------------------------------------

    def item(self, owner: Any, index: Any) -> Any:
        if is_memory(owner) or isinstance(owner, Dynamic):
            return owner[index] if isinstance(index, slice) else Dynamic(self.entry(owner, index))
        if isinstance(index, Dynamic):
            raise NotUnfoldable(index.text, f"an index into {type(owner).__qualname__} that the parts settle")
        return owner[index]

    def entry(self, owner: Any, index: Any) -> str:
        if isinstance(owner, Dynamic):
            return f"{operand(owner, ATOM)}[{number(index).text}]"
        if not is_memory(owner):
            raise NotUnfoldable(owner, "a float64 array, or one of the program")
        name, first = self.writer.place(owner)
        if isinstance(index, Dynamic):
            return f"{name}[{(index + first if first else index).text}]"
        k = index.__index__()
        if not -len(owner) <= k < len(owner):
            raise NotUnfoldable(k, f"an entry of {len(owner)}")
        return f"{name}[{first + (k if k >= 0 else k + len(owner))}]"

    def negate(self, value: Any) -> Any:
        if not isinstance(value, Dynamic):
            return not value
        return Dynamic(f"not {operand(value, NOT)}", NOT, value.calls)

    def both(self, *parts: Callable[[], Any]) -> Any:
        return self._logic("and", AND, parts)

    def either(self, *parts: Callable[[], Any]) -> Any:
        return self._logic("or", OR, parts)

    def _logic(self, sign: str, level: int, parts: Iterable[Callable[[], Any]]) -> Any:
        """As Python has it: a value that settles the whole ends it."""
        whole: Any = None
        for part in parts:
            value = part()
            if not isinstance(value, Dynamic):
                if not isinstance(whole, Dynamic):
                    whole = value
                elif bool(value) is (sign == "or") or whole.level != COMPARISON:
                    whole = joined(whole, sign, bool(value), level)
                if bool(value) is (sign == "or"):
                    return whole
                continue
            whole = joined(whole, sign, value, level) if isinstance(whole, Dynamic) else value
        return whole

    def inner(self, function: Any, *arguments: Any, **named: Any) -> Any:
        """A call inside an expression, whose other parts may be read before it or after it."""
        before = len(self.writer.lines)
        result = self.call(function, *arguments, **named)
        if len(self.writer.lines) != before:
            raise NotUnfoldable(function.__qualname__, "a stage that only computes, or a statement of its own for it")
        return result

    def call(self, function: Any, *arguments: Any, **named: Any) -> Any:
        if getattr(function, "is_stage", False):
            return self._stage(function, arguments, named)
        values = [*arguments, *named.values()]
        if not any(is_memory(a) or isinstance(a, Dynamic) for a in values) or function in (len, isinstance):
            return function(*arguments, **named)
        writer = self.writer
        if named:
            raise NotUnfoldable(function, "a call without names: a kernel takes its arguments in order")
        if isinstance(function, FunctionType):
            given = ", ".join([writer.argument(a) for a in arguments])
            return Dynamic(f"{writer.names.kernel(function)}({given})", calls=True)
        name = getattr(function, "__name__", "")
        if function in ARITHMETIC or getattr(math, name, None) is function:
            given = ", ".join([number(a).text for a in arguments])
            return Dynamic(f"{name}({given})" if function in ARITHMETIC else f"math.{name}({given})")
        raise NotUnfoldable(function, "a kernel, a stage, or a function of mathematics for numbers of the program")

    def _stage(self, function: FunctionType, arguments: Iterable[Any], named: dict[str, Any]) -> Any:
        inside = Frame(self.writer, self.taken | set(self.variables.values()))
        parameters = function.__code__.co_varnames
        values = [inside._parameter(name, value) for name, value in zip(parameters, arguments, strict=False)]
        return rewritten(function)(inside, *values, **{k: inside._parameter(k, v) for k, v in named.items()})

    def _parameter(self, name: str, value: Any) -> Any:
        """A number as it is now: what it was computed from may change in the stage."""
        return self.assign(name, value) if isinstance(value, Dynamic) and not value.text.isidentifier() else value


class Choice:
    """An `if`: settled, or written down with what becomes of the variables that it changes.

    Args:
        writer: of the program.
        test: of the choice.
        values: of the variables that some branch assigns to.
    """

    def __init__(self, writer: Writer, test: Any, values: tuple[Any, ...]) -> None:
        self.writer, self.test, self.values = writer, test, values
        self.dynamic = isinstance(test, Dynamic)
        self.between = -1  # lines before the other branch
        self.first: tuple[Any, ...] | None = None  # values after the first branch

    def holds(self) -> bool:
        if not self.dynamic:
            return bool(self.test)
        self.here = _here()
        self.start = len(self.writer.lines)
        self.writer.indent += "    "
        return True

    def fails(self) -> bool:
        if not self.dynamic:
            return not self.test
        self.between = len(self.writer.lines)
        return True

    def turn(self, *values: Any) -> tuple[Any, ...]:
        """The values that the other branch begins with."""
        self.first = values
        return self.values

    def close(self, *values: Any) -> tuple[Any, ...]:
        """The values after the choice; one that depends on it is none, unless the program has a variable for it."""
        if not self.dynamic:
            return values
        writer, test = self.writer, self.test
        writer.indent = outside = writer.indent[:-4]
        body = writer.lines[self.start : None if self.between < 0 else self.between]
        other = writer.lines[self.between :] if self.between >= 0 else []
        if not body and not other:
            if test.calls:
                raise NotUnfoldable(test.text, "a branch with something to do: this one only calls")
        else:
            head = f"if {test.text}:" if body else f"if not ({test.text}):"
            turn = [Line(f"{outside}else:", *self.here)] if body and other else []
            writer.lines[self.start :] = [Line(outside + head, *self.here), *body, *turn, *other]
        others = self.values if self.first is None else values
        firsts = values if self.first is None else self.first
        return tuple(map(_joined, firsts, others))


class Nothing:
    """A variable that has no value here: it has none yet, or one that depends on a choice of the program."""

    def __repr__(self) -> str:
        return "a variable without a value, or with one that depends on a choice of the program"

    def __bool__(self) -> NoReturn:
        raise NotUnfoldable(self, "one that the parts settle, or a number of the program")

    def __getattr__(self, name: str) -> NoReturn:
        self.__bool__()

    def __eq__(self, other: object) -> NoReturn:
        self.__bool__()

    __hash__ = None  # type: ignore[assignment] # what it is equal to is not known


Frame.nothing = Nothing()
UNSETTLED = Nothing()  # it depends on a choice of the program


def is_memory(value: object) -> bool:
    """Whether a value is an array whose entries are numbers of the program."""
    return isinstance(value, np.ndarray) and value.dtype == np.float64


def _joined(one: Any, other: Any) -> Any:
    """A variable after a choice of the program, by what it is after each branch."""
    if isinstance(one, Dynamic) and isinstance(other, Dynamic):
        return one if one.text == other.text else UNSETTLED
    if isinstance(one, Dynamic) and other is Frame.nothing:
        return one  # unbound where the other branch runs, as in Python
    if isinstance(other, Dynamic) and one is Frame.nothing:
        return other
    return one if one is other else UNSETTLED


def _here() -> tuple[str, int]:
    """The file and the line of the stage that is being unfolded."""
    frame = sys._getframe(1)
    while FRAME not in frame.f_code.co_varnames[:1]:
        assert frame.f_back is not None
        frame = frame.f_back
    return frame.f_code.co_filename, frame.f_lineno


def _place(error: BaseException) -> str:
    """The file and the line of the innermost stage in which an error happened."""
    place, trace = "stage", error.__traceback__
    while trace is not None:
        code = trace.tb_frame.f_code
        if FRAME in code.co_varnames[:1]:
            place = f"{code.co_filename}:{trace.tb_lineno}"
        trace = trace.tb_next
    return place
