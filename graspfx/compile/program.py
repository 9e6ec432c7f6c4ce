"""Specialised programs of scripts, cached on disk until one of their sources changes."""

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

UNROLL = 400  # statements: unrolls most loops over fingers and axes, but not those over matrices of friction problems


def program_source(
    text: str,
    kernels: Mapping[str, Callable[..., Any]],
    arrays: Sequence[str],
    *,
    unroll: int = UNROLL,
    make: bool = True,
) -> str:
    """Specialise the function that a text defines, and the kernels that it calls, as one program.

    Args:
        text: text of one function, whose parameters are kept; its other names are kernels and arrays.
        kernels: kernels by name.
        arrays: names of the buffers.
        unroll: largest number of statements of an unrolled loop.
        make: whether to specialise a program that is not cached; otherwise a LookupError is raised.
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
    """Return the key of a program's sources; arguments as for `program_source`."""
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
    """Specialise a text without the cache; arguments as for `program_source`."""
    program = Program(unroll)
    names = {**kernels, **{array: Memory(array, 0) for array in arrays}}
    [tree] = ast.parse(text).body
    assert isinstance(tree, ast.FunctionDef)
    program.add_text(text, names, [Dynamic(ast.Name(a.arg, ast.Load())) for a in tree.args.args])
    return program
