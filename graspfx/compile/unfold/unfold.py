"""Unfolds a function over Python objects into the lines of a program.

Loops over parts are written out, choices that parts settle are made, and what remains are entries of arrays,
arithmetic and calls of kernels. A stage is a plain Python function, which also runs as it stands. Its arguments are
parts (any Python objects) and numbers of the program. In it

- an entry of a float64 array, and what is computed from one, is a number of the program;
- an `if` on such a number is written down, any other is settled now; so is every loop;
- a call of a function with an array, a record or such a number is a call of a kernel; that of another stage is
  unfolded.
"""

from __future__ import annotations

from collections.abc import Callable
from types import FunctionType

from graspfx.compile.unfold.expression import Expression, NotUnfoldable
from graspfx.compile.unfold.rewrite import rewrite
from graspfx.compile.unfold.stage import FRAME
from graspfx.compile.unfold.stage_frame import Frame
from graspfx.compile.unfold.writer import Line, Names, Writer
from graspfx.errors import InputError


def unfold(function: Callable[..., None], names: Names, **parts: object) -> list[Line]:
    """Unfold a stage into a program.

    Args:
        function: the stage; a parameter that no part is given for is a variable, or an array, of the program.
        names: of memories, kernels and variables.
        parts: by parameter.

    Raises:
        InputError: the stage does what no stage can, with its file and line.
    """
    assert isinstance(function, FunctionType)
    writer = Writer(names)
    frame = Frame(writer)
    parameters = function.__code__.co_varnames[: function.__code__.co_argcount]
    values = [parts[name] if name in parts else Expression(frame.variable(name)) for name in parameters]
    try:
        rewrite(function)(frame, *values)
    except NotUnfoldable as error:
        raise InputError(_place(error), error.actual, error.expected, error.do) from error
    except (AttributeError, IndexError, TypeError) as error:
        raise InputError(_place(error), str(error), "what the parts have, and arithmetic that a program has") from error
    return writer.lines


def _place(error: BaseException) -> str:
    """Give the file and the line of the innermost stage in which an error happened."""
    place, trace = "stage", error.__traceback__
    while trace is not None:
        code = trace.tb_frame.f_code
        if FRAME in code.co_varnames[:1]:
            place = f"{code.co_filename}:{trace.tb_lineno}"
        trace = trace.tb_next
    return place
