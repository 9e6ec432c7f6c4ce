"""Lowering of kernels to Python functions of numbers and entries of buffers, and disk cache of the lowered kernels."""

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
    """Lower the original function of a kernel, and return the lowered function.

    Kernels that the function calls are lowered when they are first called.

    Raises:
        InputError: If the function contains a statement or an expression that kernels do not support.
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
    """Return a function that, on its first call, lowers a kernel and replaces itself in the caller's namespace.

    Kernels are not lowered in advance, because a scene calls only few of the kernels to which its kernels refer.
    """
    original = getattr(kernel, LOWERED)

    def first(*arguments: Any, **keywords: Any) -> Any:
        namespace[name] = lowered(original)
        return namespace[name](*arguments, **keywords)

    setattr(first, LOWERED, original)
    return first


def lowered_text(function: FunctionType) -> tuple[str, dict[str, Any], tuple[str, ...]]:
    """Lower the original function of a kernel.

    Returns:
        `text`, `callees` and `files` of a `Lowering`.
    """
    import ast  # only for a kernel that is not in the cache

    node, body = _lower(function)
    return ast.unparse(node) + "\n", body.callees, tuple(sorted(body.files))


def written_lines(function: FunctionType) -> list[int]:
    """Return the line number in the source of a kernel for each line of the lowered text."""
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
    """Lowered kernel.

    Attributes:
        text: Text of the lowered function.
        code: Code object of the text.
        callees: Functions that the text calls by names other than in the source, by these names.
        files: Source files of the kernel and of inlined functions.
    """

    text: str
    code: CodeType
    callees: dict[str, tuple[str, str]]  # module and qualified name
    files: tuple[str, ...]


@dataclass
class Store:
    """Lowered kernels of this package, in one entry of the disk cache.

    Attributes:
        key: Key of the entry.
        entries: Digest of the sources, and lowered kernel, by name of the kernel.
        changed: Whether kernels were added that the disk cache does not contain.
    """

    key: str
    entries: dict[str, Any] = field(default_factory=dict)
    changed: bool = False

    def find(self, function: FunctionType) -> Lowering | None:
        """Return the lowered kernel of a function; None if it is not stored, or if its sources have changed."""
        digest, *entry = self.entries.get(_name(function), ("",))
        if digest != _sources_of(function):
            return None
        text, code, callees, files = entry
        return Lowering(text, marshal.loads(code), dict(callees), tuple(files))

    def add(self, function: FunctionType, lowering: Lowering) -> None:
        """Add a lowered kernel if all its sources belong to this package; changes of other sources are not detected."""
        if all(is_own(file) for file in lowering.files):
            parts = lowering.text, marshal.dumps(lowering.code), tuple(lowering.callees.items()), lowering.files
            self.entries[_name(function)] = _sources_of(function), *parts
            self.changed = True

    def save(self) -> None:
        """Write the entry to the disk cache if kernels were added."""
        if self.changed:
            disk.store(self.key, marshal.dumps(self.entries))
            self.changed = False


@cache
def store() -> Store:
    """Return the lowered kernels of this installation and this version of Python."""
    digest = hashlib.sha256(repr((sys.version, marshal.version, source_folders())).encode())
    key = f"lowered-{digest.hexdigest()}"
    content = disk.load(key)
    return Store(key, marshal.loads(content) if content is not None else {})


def _sources_of(function: FunctionType) -> str:
    return closure_digest(function.__module__, *compiler_modules())


def _name(function: FunctionType) -> str:
    return f"{function.__module__}.{function.__qualname__}"
