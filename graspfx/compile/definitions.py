"""Source code of kernels, from files that are parsed once."""

from __future__ import annotations

import ast
import linecache
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from types import CodeType, FunctionType

from graspfx.compile.unbound import lost_end
from graspfx.errors import InputError, KernelError


@cache
def _definitions(file: str, text: str) -> dict[int, tuple[ast.FunctionDef, CodeType | None]]:
    """Return the functions of a file and their code objects, by the number of the function's first line."""
    tree = ast.parse(text)
    codes = {code.co_firstlineno: code for code in _codes(compile(tree, file, "exec", dont_inherit=True))}
    functions = (node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef))
    lines = ((min([node.lineno, *(d.lineno for d in node.decorator_list)]), node) for node in functions)
    return {line: (node, codes.get(line)) for line, node in lines}


def _codes(code: CodeType) -> Iterator[CodeType]:
    for each in code.co_consts:
        if isinstance(each, CodeType):
            yield each
            yield from _codes(each)


def definition(function: FunctionType) -> ast.FunctionDef:
    """Return the syntax tree of a function.

    Raises:
        InputError: If the source of the function is not found, or has changed since the function was created.
        KernelError: If some paths of the function return a value and others do not. Machine code would return zero
            where Python returns None.
    """
    code = function.__code__
    name = f"{function.__module__}.{function.__qualname__}"
    try:
        linecache.checkcache(code.co_filename)
        text = "".join(linecache.getlines(code.co_filename)) or Path(code.co_filename).read_text(encoding="utf-8")
        node, original = _definitions(code.co_filename, text)[code.co_firstlineno]
    except (OSError, KeyError, SyntaxError) as error:
        raise InputError("kernel", name, "a plain function in a file that can be read") from error
    if original is None or (original.co_code, original.co_consts, original.co_names) != (
        code.co_code,
        code.co_consts,
        code.co_names,
    ):
        raise InputError(
            "kernel", name, f"{code.co_filename} unchanged since its import", "it has changed: restart Python"
        )
    line = _lost_end(node)
    if line:
        raise KernelError(
            f"{code.co_filename}:{line}", f"the end of {function.__name__!r}", "a value on every path",
            "also return one after the last branch",
        )  # fmt: skip
    return node


@cache
def _lost_end(node: ast.FunctionDef) -> int:
    return lost_end(node)
