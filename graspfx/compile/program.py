"""The program of a script, specialised once: kept on disk as long as no source that it was made from changes."""

from __future__ import annotations

import ast
import json
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from graspfx import log
from graspfx.compile.freshness import identity, recall, remember, request_key
from graspfx.compile.kernel import keep_lowerings
from graspfx.compile.specialise.specialise import Program
from graspfx.compile.specialise.values import Dynamic, Memory

UNROLL = 400  # statements: loops over the fingers and axes of most scenes, none over friction's squares


def program_source(
    text: str,
    kernels: Mapping[str, Callable[..., Any]],
    arrays: Sequence[str],
    *,
    unroll: int = UNROLL,
    make: bool = True,
) -> str:
    """Specialise the function that a text defines, and the kernels that it calls, as a program of its own.

    Args:
        text: one function; its parameters stay, its other names are kernels and arrays.
        kernels: by name.
        arrays: the names of the buffers.
        unroll: most statements of a loop that is written out.
        make: whether to specialise what is not kept yet; else a LookupError.
    """
    key = program_key(text, kernels, arrays, unroll=unroll)
    known = recall(key)
    if known is not None:
        log.debug("program %s: specialised before", key[:12])
        return known
    if not make:
        raise LookupError("not specialised yet")
    program = specialise(text, kernels, arrays, unroll=unroll)
    source = program.source()
    log.debug("program %s: specialised, %d lines", key[:12], source.count("\n"))
    keep_lowerings()
    remember(key, program, source)
    return source


def program_key(
    text: str,
    kernels: Mapping[str, Callable[..., Any]],
    arrays: Sequence[str],
    *,
    unroll: int = UNROLL,
) -> str:
    """Name what a program is made from; arguments as of `program_source`."""
    roots = {name: identity(kernel) for name, kernel in sorted(kernels.items())}
    request = json.dumps([text, roots, list(arrays), unroll])
    return request_key((kernel.__module__ for kernel in kernels.values()), "program", request)


def specialise(
    text: str,
    kernels: Mapping[str, Callable[..., Any]],
    arrays: Sequence[str],
    *,
    unroll: int = UNROLL,
) -> Program:
    """Specialise a text, whatever the cache holds; arguments as of `program_source`."""
    program = Program(unroll)
    names = {**kernels, **{array: Memory(array, 0) for array in arrays}}
    [tree] = ast.parse(text).body
    assert isinstance(tree, ast.FunctionDef)
    program.add_text(text, names, [Dynamic(ast.Name(a.arg, ast.Load())) for a in tree.args.args])
    return program
