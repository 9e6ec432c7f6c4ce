"""Lowering of a kernel on records and values to a Python function of numbers and entries."""

from __future__ import annotations

import linecache
from functools import cache
from importlib import import_module
from operator import attrgetter
from types import FunctionType
from typing import TYPE_CHECKING, Any

from graspfx.compile.kernel_marks import LOWERED, parameter_kinds
from graspfx.compile.lower.store import Lowering, store

if TYPE_CHECKING:
    import ast

    from graspfx.compile.lower.statements import Body


@cache
def lowered(function: FunctionType) -> FunctionType:
    """Lower a kernel; kernels that it calls are lowered on their first call. Its module's other names are unchanged.

    Raises:
        InputError: If a statement or an expression is not supported in kernels; the error names its file and line.
    """
    file = f"<{function.__module__}.{function.__qualname__}, lowered>"
    stored = store().find(function)
    if stored is None:
        text, callees, files = lowered_text(function)
        code = compile(text, file, "exec", dont_inherit=True)
        names = {alias: (str(callee.__module__), str(callee.__qualname__)) for alias, callee in callees.items()}
        store().add(function, Lowering(text, code, names, files))
    else:
        text, code, files = stored.text, stored.code, stored.files
        callees = {alias: attrgetter(name)(import_module(module)) for alias, (module, name) in stored.callees.items()}
    linecache.cache[file] = (len(text), None, text.splitlines(keepends=True), file)
    namespace = {**function.__globals__, **callees}
    namespace |= {name: _on_call(namespace, name, f) for name, f in callees.items() if hasattr(f, LOWERED)}
    exec(code, namespace)
    result = namespace[function.__name__]
    assert isinstance(result, FunctionType)
    for name in ("__module__", "__qualname__", "__doc__"):
        setattr(result, name, getattr(function, name))
    result.__source_files__ = files  # type: ignore[attr-defined] # read by `Program`
    result.__written__ = function  # type: ignore[attr-defined] # named beside its part of a program
    return result


def _on_call(namespace: dict[str, Any], name: str, kernel: Any) -> Any:
    """Return a function that lowers a kernel on its first call; most scenes call few of the kernels that they name."""
    original = getattr(kernel, LOWERED)

    def first(*arguments: Any, **keywords: Any) -> Any:
        namespace[name] = lowered(original)
        return namespace[name](*arguments, **keywords)

    setattr(first, LOWERED, original)
    return first


def lowered_text(function: FunctionType) -> tuple[str, dict[str, Any], tuple[str, ...]]:
    """Return a kernel's lowered text, the functions that it calls by other names, and its source files."""
    import ast  # only for a kernel that is not in the cache

    node, body = _lower(function)
    return ast.unparse(node) + "\n", body.callees, tuple(sorted(body.files))


def written_lines(function: FunctionType) -> list[int]:
    """Return the line of the kernel's source for each line of its lowered text."""
    from graspfx.compile.syntax import unparsed_statements

    lines = [function.__code__.co_firstlineno]
    for statement in unparsed_statements(_lower(function)[0].body):
        lines.append(vars(statement).get("origin", lines[-1]))
    return lines


def _lower(function: FunctionType) -> tuple[ast.FunctionDef, Body]:
    from graspfx.compile.definitions import definition
    from graspfx.compile.lower.pieces import names_of
    from graspfx.compile.lower.scratch import Frame
    from graspfx.compile.lower.statements import Body

    body, tree = Body(function.__code__.co_filename), definition(function)
    frame = Frame({}, function.__globals__, written=names_of(tree))
    return body.lower(tree, frame, parameter_kinds(function)), body
