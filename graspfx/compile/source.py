"""Where the source of a kernel is: each module's file is parsed once."""

from __future__ import annotations

import ast
import linecache
from functools import cache
from pathlib import Path
from types import FunctionType

from graspfx.errors import InputError


@cache
def _definitions(file: str) -> dict[int, ast.FunctionDef]:
    """The functions of a file by the line on which they begin."""
    text = "".join(linecache.getlines(file)) or Path(file).read_text(encoding="utf-8")
    found = (node for node in ast.walk(ast.parse(text)) if isinstance(node, ast.FunctionDef))
    return {min([node.lineno, *(d.lineno for d in node.decorator_list)]): node for node in found}


def definition(function: FunctionType) -> ast.FunctionDef:
    """The syntax tree of a function.

    Raises:
        InputError: its source is not to be found.
    """
    code = function.__code__
    try:
        return _definitions(code.co_filename)[code.co_firstlineno]
    except (OSError, KeyError, SyntaxError) as error:
        raise InputError(
            "kernel", f"{function.__module__}.{function.__qualname__}", "a plain function in a file that can be read"
        ) from error
