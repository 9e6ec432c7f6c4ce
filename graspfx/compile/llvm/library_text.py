"""A library of functions as texts for LLVM: cut into modules that are compiled side by side and call one another."""

from __future__ import annotations

import ast
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from graspfx.compile.llvm.llvm import INTRINSICS, Module, declared
from graspfx.compile.llvm.llvm_arithmetic import LlvmFunction, Number, Type
from graspfx.compile.llvm.llvm_expressions import Array, result_type
from graspfx.errors import GraspFXError, InputError

CALLED = re.compile(r'@"([^"]+)"\(')
LIBRARY = re.compile(r"@graspfx_(\w+)\(")
HEAD = re.compile(r'^define internal (.+?) @"([^"]+)"\((.*)\) nounwind \{')
LARGE = 1500  # lines of LLVM's text, those of what it calls among them: from here on a function is compiled once


class Entry(NamedTuple):
    """A function of a source that other machine code may call.

    Args:
        function: its name; its parameters are `p0`, `p1`, ..., in the order of the call or in another.
        types: of the call's arguments, in order: `ptr` for a buffer.
    """

    function: str
    types: tuple[str, ...]


@dataclass(frozen=True)
class Part:
    """One module of a library.

    Attributes:
        text: LLVM's language.
        exports: the functions that it has for others.
        needs: those of other modules that it calls.
        libm: functions of the platform's library that it calls.
        lanes: whether it has loops over lanes, of which the turns may be done side by side.
    """

    text: str
    exports: tuple[str, ...]
    needs: tuple[str, ...]
    libm: tuple[str, ...]
    lanes: bool


class LibraryText(NamedTuple):
    """The modules of a library, and what its entries are called and return, in their order."""

    parts: tuple[Part, ...]
    entries: tuple[LlvmFunction, ...]


def library_text(source: str, entries: Sequence[Entry], prefix: str) -> LibraryText:
    """Write the functions of a source as modules.

    Buffers of two parameters may be the same memory: nothing here assumes that they are not.

    Args:
        source: the program as Python.
        entries: its functions that others may call.
        prefix: what the names of all functions that modules show begin with.

    Raises:
        InputError: the source holds something that cannot be compiled.
    """
    trees = [node for node in ast.parse(source).body if isinstance(node, ast.FunctionDef)]
    module = Module(trees)
    results: list[LlvmFunction] = []
    texts: dict[str, str] = {}
    for k, entry in enumerate(entries):
        function, text = _entry(module, entry, f"entry.{k}")
        results.append(LlvmFunction(f"{prefix}.{function.name}", function.result))
        texts[function.name] = text
    for text in module.texts:
        match = HEAD.match(text)
        assert match is not None
        texts[match.group(2)] = text
    heads = _heads(texts, [f"entry.{k}" for k in range(len(entries))])
    parts = [_part(name, texts, heads, prefix, module.notes) for name in heads]
    return LibraryText(tuple(parts), tuple(results))


def _entry(module: Module, entry: Entry, name: str) -> tuple[LlvmFunction, str]:
    """Write the function that passes a call's arguments on, in the order in which the source's function has them."""
    tree = module.trees[entry.function]

    def why(text: str) -> GraspFXError:
        return InputError(entry.function, entry.types, "a kernel that can be compiled", text)

    values: dict[str, Array | Number] = {}
    for k, type_ in enumerate(entry.types):
        values[f"p{k}"] = Array("any", f"%p{k}") if type_ == "ptr" else Number(type_, f"%p{k}")
    arguments = [values[a.arg] for a in tree.args.args]
    function = module.function_for(entry.function, arguments, why)
    operands = ", ".join(f"{'ptr' if isinstance(a, Array) else a.type} {a.text}" for a in arguments)
    parameters = ", ".join(f"{type_} %p{k}" for k, type_ in enumerate(entry.types))
    result: Type = function.result
    call = f'call {result_type(result)} @"{function.name}"({operands})'
    body = [f"  {call}", "  ret void"] if result is None else [f"  %r = {call}", f"  ret {result_type(result)} %r"]
    head = f'define internal {result_type(result)} @"{name}"({parameters}) nounwind {{'
    return LlvmFunction(name, result), "\n".join([head, *body, "}"])


def _heads(texts: Mapping[str, str], entries: Sequence[str]) -> dict[str, None]:
    """Choose the functions that modules begin with: the entries, and what is large and called from several places."""
    calls = {name: (set(CALLED.findall(text)) - {name}) & texts.keys() for name, text in texts.items()}
    reach: dict[str, set[str]] = {}

    def reached(name: str) -> set[str]:
        if name not in reach:
            reach[name] = {name}.union(*(reached(other) for other in calls[name]))
        return reach[name]

    callers = {name: sum(name in others for others in calls.values()) for name in texts}
    sizes = {name: text.count("\n") for name, text in texts.items()}
    large = [name for name in texts if callers[name] > 1 and sum(sizes[other] for other in reached(name)) >= LARGE]
    return dict.fromkeys([*entries, *large])


def _part(name: str, texts: Mapping[str, str], heads: Mapping[str, None], prefix: str, notes: Sequence[str]) -> Part:
    """Write the module that begins with a function: all that it calls, but for what other modules begin with."""
    own, needs, left = dict[str, None](), dict[str, None](), [name]
    while left:
        each = left.pop()
        if each in own:
            continue
        own[each] = None
        for other in CALLED.findall(texts[each]):
            if other in heads and other != name:
                needs[other] = None
            elif other in texts:
                left.append(other)

    def renamed(match: re.Match[str]) -> str:
        return f'@"{prefix}.{match.group(1)}"(' if match.group(1) in heads else match.group()

    body = CALLED.sub(renamed, "\n".join(texts[each] for each in own))
    body = body.replace(f'define internal {_head(texts[name])} @"{prefix}.', f'define {_head(texts[name])} @"{prefix}.')
    libm = tuple(sorted(set(LIBRARY.findall(body))))
    declarations = [CALLED.sub(renamed, _declaration(texts[other])) for other in needs]
    lanes = "!llvm." in body
    lines = [INTRINSICS, *map(declared, libm), *declarations, body, *(notes if lanes else ())]
    others = tuple(f"{prefix}.{other}" for other in needs)
    return Part("\n".join(lines) + "\n", (f"{prefix}.{name}",), others, libm, lanes)


def _head(text: str) -> str:
    match = HEAD.match(text)
    assert match is not None
    return match.group(1)


def _declaration(text: str) -> str:
    match = HEAD.match(text)
    assert match is not None
    result, name, parameters = match.groups()
    types = re.sub(r" (noalias )?%[\w.]+", "", parameters)
    return f'declare {result} @"{name}"({types}) nounwind'
