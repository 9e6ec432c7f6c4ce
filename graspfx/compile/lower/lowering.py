"""A kernel on records and values lowered, as a function of Python's own."""

from __future__ import annotations

import ast
import linecache
from types import BuiltinFunctionType, FunctionType
from typing import Any

from graspfx.compile.kernel import parameter_kinds, source_function
from graspfx.compile.lower.expressions import Frame
from graspfx.compile.lower.statements import Body
from graspfx.compile.specialise.definitions import definition


def lowered(function: FunctionType) -> FunctionType:
    """Lower a kernel; its module's other names stay what they are, kernels that it calls are lowered too.

    Raises:
        InputError: a statement or an expression that a kernel may not hold, with its file and line.
    """
    text, body = lowered_text(function)
    file = f"<{function.__module__}.{function.__qualname__}, lowered>"
    linecache.cache[file] = (len(text), None, text.splitlines(keepends=True), file)
    namespace: dict[str, Any] = dict(function.__globals__)
    for name, callee in body.callees.items():  # functions of `math` that a written-out function calls among them
        namespace[name] = callee if isinstance(callee, BuiltinFunctionType) else source_function(callee)
    exec(compile(text, file, "exec", dont_inherit=True), namespace)
    result = namespace[function.__name__]
    assert isinstance(result, FunctionType)
    result.__module__, result.__qualname__, result.__doc__ = (
        function.__module__,
        function.__qualname__,
        function.__doc__,
    )
    result.__source_files__ = tuple(sorted(body.files))  # type: ignore[attr-defined] # asked for by the specialiser
    return result


def lowered_text(function: FunctionType) -> tuple[str, Body]:
    """Give a kernel's lowered text, and what it was lowered with."""
    body = Body(function.__qualname__, function.__code__.co_filename)
    frame = Frame({}, function.__globals__)
    node = body.lower(definition(function), frame, parameter_kinds(function))
    return ast.unparse(node) + "\n", body
