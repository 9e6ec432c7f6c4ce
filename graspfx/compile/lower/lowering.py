"""Lowering of a kernel on records and values to a Python function of numbers and entries, and its disk cache."""

from __future__ import annotations

import hashlib
import linecache
import marshal
import sys
from dataclasses import dataclass, field
from functools import cache
from importlib import import_module
from operator import attrgetter
from types import CodeType, FunctionType
from typing import TYPE_CHECKING, Any

from graspfx.compile import cache as disk
from graspfx.compile.kernel_marks import LOWERED, parameter_kinds
from graspfx.compile.own_sources import closure_digest, compiler_modules, is_own, source_folders

if TYPE_CHECKING:
    import ast

    from graspfx.compile.lower.statements import Body


@cache
def lowered(function: FunctionType) -> FunctionType:
    """Lower a kernel; kernels that it calls are lowered on their first call, other names of its module are unchanged.

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


# Disk cache: one entry for all kernels of this package, each with the digest of its sources ---------------------------


@dataclass(frozen=True)
class Lowering:
    """A kernel's lowered text and its code, the functions that it calls by names in the text, and its source files."""

    text: str
    code: CodeType
    callees: dict[str, tuple[str, str]]  # module and qualified name
    files: tuple[str, ...]


@dataclass
class Store:
    """Lowered kernels by name; `save` writes new kernels."""

    key: str
    entries: dict[str, Any] = field(default_factory=dict)
    changed: bool = False

    def find(self, function: FunctionType) -> Lowering | None:
        """Look up a kernel of this package; None if it is not stored, or its sources have changed."""
        digest, *entry = self.entries.get(_name(function), ("",))
        if digest != _sources_of(function):
            return None
        text, code, callees, files = entry
        return Lowering(text, marshal.loads(code), dict(callees), tuple(files))

    def add(self, function: FunctionType, lowering: Lowering) -> None:
        """Add a kernel if all its sources belong to this package, because the key covers no other sources."""
        if all(is_own(file) for file in lowering.files):
            parts = lowering.text, marshal.dumps(lowering.code), tuple(lowering.callees.items()), lowering.files
            self.entries[_name(function)] = _sources_of(function), *parts
            self.changed = True

    def save(self) -> None:
        """Write new entries; if this fails, the next process lowers the kernels again."""
        if self.changed:
            disk.store(self.key, marshal.dumps(self.entries))
            self.changed = False


@cache
def store() -> Store:
    """Open the cache of this installation for this Python."""
    digest = hashlib.sha256(repr((sys.version, marshal.version, source_folders())).encode())
    key = f"lowered-{digest.hexdigest()}"
    content = disk.load(key)
    return Store(key, marshal.loads(content) if content is not None else {})


def _sources_of(function: FunctionType) -> str:
    return closure_digest(function.__module__, *compiler_modules())


def _name(function: FunctionType) -> str:
    return f"{function.__module__}.{function.__qualname__}"
