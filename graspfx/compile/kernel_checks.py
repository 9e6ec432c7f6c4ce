"""Checks of third-party kernels, because machine code does not check indices and names."""

from __future__ import annotations

import ast
from collections.abc import Callable, Iterable, Iterator, Mapping
from types import FunctionType, ModuleType
from typing import Any

from graspfx.compile.kernel import source_function, written
from graspfx.compile.own_sources import is_own
from graspfx.errors import KernelError

PAGE = "see docs/development/records-and-kernels.md"


def foreign_kernels(kernels: Mapping[str, Callable[..., Any]]) -> dict[str, Callable[..., Any]]:
    """Return the kernels that do not belong to this package, by their names in `kernels`."""
    return {name: kernel for name, kernel in kernels.items() if _is_foreign(kernel)}


def check(kernels: Iterable[Callable[..., Any]]) -> dict[str, FunctionType]:
    """Check third-party kernels and the third-party functions that they call.

    Returns:
        Original functions, by the file names in the code objects of the original and of the lowered function.

    Raises:
        KernelError: If a variable may have no value where it is used, or if some paths of a kernel return a value and
            others do not.
    """
    from graspfx.compile.definitions import definition
    from graspfx.compile.unbound import unbound_names

    functions: dict[str, FunctionType] = {}
    left: list[Any] = [written(kernel) for kernel in kernels]
    seen: set[Any] = set()
    while left:
        function = left.pop()
        if function in seen:
            continue
        seen.add(function)
        tree, file = definition(function), function.__code__.co_filename
        for name in unbound_names(tree):
            raise KernelError(
                f"{file}:{name.lineno}", name.id, "a name that has a value on every path to this line",
                f"assign to {name.id!r} before the branch or the loop, which may be skipped; {PAGE}",
            )  # fmt: skip
        functions[f"<{function.__module__}.{function.__qualname__}, lowered>"] = function
        functions[file] = function
        left += [written(called) for called in _called(tree, function) if _is_foreign(called)]
    return functions


def _called(tree: ast.FunctionDef, function: Any) -> Iterator[Any]:
    """Yield the functions to which names, and attributes of modules, in a kernel refer."""
    for node in ast.walk(tree):
        item: Any = None
        if isinstance(node, ast.Name):
            item = function.__globals__.get(node.id)
        elif isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            module = function.__globals__.get(node.value.id)
            item = getattr(module, node.attr, None) if isinstance(module, ModuleType) else None
        if isinstance(item, FunctionType):
            yield item


def _is_foreign(kernel: Any) -> bool:
    code = getattr(written(kernel), "__code__", None)
    return code is not None and not is_own(code.co_filename)


class OutsideError(Exception):
    """Error: an index is outside of its buffer."""

    def __init__(self, index: int, length: int) -> None:
        super().__init__(f"entry {index} of a buffer of {length}")


class CheckedBuffer:
    """Buffer of floats that raises an `OutsideError` if an index is out of bounds.

    Args:
        view: Buffer whose entries are read and written.
    """

    __slots__ = ("_view",)

    def __init__(self, view: Any) -> None:
        self._view = view

    def __len__(self) -> int:
        return len(self._view)

    def __getitem__(self, index: int) -> float:
        if not 0 <= index < len(self._view):
            raise OutsideError(index, len(self._view))
        return float(self._view[index])

    def __setitem__(self, index: int, value: float) -> None:
        if not 0 <= index < len(self._view):
            raise OutsideError(index, len(self._view))
        self._view[index] = value


def checked_function(kernel: Callable[..., Any], functions: Mapping[str, FunctionType]) -> Callable[..., Any]:
    """Return a function that interprets a kernel and checks all indices.

    The returned function raises a KernelError, with the file and the line of the kernel, if an index is out of bounds.

    Args:
        kernel: Third-party kernel.
        functions: Result of `check`.
    """
    run = source_function(kernel)

    def checked(*arguments: Any) -> Any:
        try:
            return run(*(CheckedBuffer(a) if isinstance(a, memoryview) else a for a in arguments))
        except OutsideError as error:
            place, text = _place_of(error, functions)
            raise KernelError(
                place, str(error), "an index of the buffer",
                f"`{text}`: indices run from 0 to the declared size minus 1; compiled code would access "
                f"other memory; {PAGE}",
            ) from error  # fmt: skip

    return checked


def _place_of(error: OutsideError, functions: Mapping[str, FunctionType]) -> tuple[str, str]:
    """Return location and text of the line of a third-party kernel in which an error occurred."""
    import linecache

    from graspfx.compile.lower.lowering import written_lines

    place, step = ("", ""), error.__traceback__
    while step is not None:
        code, line = step.tb_frame.f_code, step.tb_lineno
        function = functions.get(code.co_filename)
        if function is not None:
            file = function.__code__.co_filename
            if code.co_filename != file:
                line = written_lines(function)[line - 1]
            place = f"{file}:{line}", linecache.getline(file, line).strip()
        step = step.tb_next
    return place
