"""Generic kernels: machine code of kernels by themselves, with nothing of a scene folded in."""

from __future__ import annotations

import ast
import hashlib
import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from inspect import Parameter, signature
from threading import RLock
from time import perf_counter
from typing import Any

from graspfx import log
from graspfx.compile import cache as disk
from graspfx.compile.emission import loaded, platform, show
from graspfx.compile.freshness import identity, recall, remember, request_key
from graspfx.compile.kernel import keep_lowerings, source_function
from graspfx.compile.llvm.llvm_arithmetic import LlvmFunction, Type
from graspfx.system.file_lock import alone

TYPES = {"int": "i64", "float": "double", "bool": "i1"}  # by the annotation of a kernel's number; others are buffers
UNROLL = 400  # statements of a loop that is written out: over axes, of which there are three at most

Kernel = Callable[..., Any]
_SINGLES: dict[tuple[Kernel, tuple[str, ...]], Library] = {}  # loaded in this process
_loading = RLock()


@dataclass(frozen=True)
class Part:
    """One module of a library: where its machine code is, and what it has to do with others."""

    exports: Sequence[str]
    needs: Sequence[str]
    libm: Sequence[str]
    start: int
    end: int


class Library:
    """Machine code of kernels, of which a module is loaded where one of its kernels is asked for.

    Attributes:
        size: of all modules [bytes].
        cached: whether it was on disk.
        note: what stood in the way of keeping it there; empty if nothing did.
    """

    def __init__(self, description: Mapping[str, Any], machine: bytes, *, cached: bool, note: str = "") -> None:
        self._symbols = {
            name: LlvmFunction(symbol, _result(result)) for name, (symbol, result) in description["symbols"]
        }
        self._parts = [Part(*part) for part in description["parts"]]
        self._machine = machine
        self._engines: list[Any] = []
        self._public: set[str] = set()
        self.size, self.cached, self.note = len(machine), cached, note

    def find(self, name: str, types: Sequence[str]) -> LlvmFunction | None:
        """Find a kernel for these types of arguments; None if the library has it not."""
        return self._symbols.get(_label(name, types))

    def load(self, names: Sequence[str]) -> None:
        """Load the modules that some symbols need, and let machine code that is loaded later call these."""
        with _loading:
            parts, left = dict[int, Part](), [name for name in names if name not in self._public]
            homes = {name: k for k, part in enumerate(self._parts) for name in part.exports}
            while left:
                k = homes[left.pop()]
                if k not in parts:
                    parts[k] = self._parts[k]
                    left += [name for name in parts[k].needs if name not in self._public]
            if parts:
                objects = [self._machine[part.start : part.end] for part in parts.values()]
                engine = loaded(objects, {name for part in parts.values() for name in part.libm})
                exports = [name for part in parts.values() for name in part.exports]
                show(engine, exports)
                self._engines.append(engine)
                self._public.update(exports)


def _result(result: Any) -> Type:
    return tuple(result) if isinstance(result, list) else result


def _label(name: str, types: Sequence[str]) -> str:
    return f"{name}({', '.join(types)})"


def kernel_name(kernel: Kernel) -> str:
    """Name a kernel by its module and what it is called there."""
    return f"{kernel.__module__}.{kernel.__qualname__}"


# Where libraries come from --------------------------------------------------------------------------------------------


@cache
def library(names: tuple[str, ...]) -> Library:
    """Load the library of kernels of this package by their names, or compile it: once per version and machine.

    Args:
        names: their modules' and their own, with a point between, for the types of arguments that they declare.
    """
    key = _library_key(names)
    home = _from_disk(key)
    if home is not None:
        return home
    with alone(disk.lock_folder(), "kernels") as waited:
        home = _from_disk(key) if waited else None  # another process has compiled them meanwhile
        return home or _compiled(key, dict(_kernels(names)), "compiling kernels, once per version and machine")


def _library_key(names: tuple[str, ...]) -> str:
    return request_key((name.rpartition(".")[0] for name in names), "library", *names)


def _kernels(names: Iterable[str]) -> Iterator[tuple[str, tuple[Kernel, tuple[str, ...]]]]:
    """Import kernels by their names, with the types of arguments that they declare."""
    for name in names:
        module, _, kernel = name.rpartition(".")
        function = getattr(import_module(module), kernel)
        yield name, (function, _declared_types(function))


def single(kernel: Kernel, types: tuple[str, ...], *, make: bool = True) -> Library:
    """Load the library of one kernel for these types of arguments, or compile it.

    Args:
        kernel: the function.
        types: of the arguments.
        make: whether to compile what is not in the cache; else a LookupError.
    """
    home = _SINGLES.get((kernel, types))
    if home is None:
        key = request_key([kernel.__module__], "kernel", *identity(kernel), *types)
        home = _from_disk(key)
        if home is None and not make:
            raise LookupError("not compiled yet")
        home = _SINGLES[kernel, types] = home or _compiled(key, {kernel_name(kernel): (kernel, types)}, "")
    return home


def _declared_types(kernel: Kernel) -> tuple[str, ...]:
    parameters = signature(source_function(kernel)).parameters.values()
    return tuple(TYPES.get(str(parameter.annotation), "ptr") for parameter in parameters)


def _from_disk(key: str) -> Library | None:
    """Load the library that a request led to before."""
    digest = recall(key)
    return None if digest is None else _machine_code(digest)


def _machine_code(digest: str) -> Library | None:
    """Load the machine code of a text by its digest."""
    content = disk.load(_machine_key(digest))
    if content is None:
        return None
    head, _, machine = content.partition(b"\n")
    return Library(json.loads(head), machine, cached=True)


def _machine_key(digest: str) -> str:
    return hashlib.sha256("\0".join(["machine", *platform(), digest]).encode()).hexdigest()


def _compiled(key: str, kernels: Mapping[str, tuple[Kernel, tuple[str, ...]]], title: str) -> Library:
    """Compile a library, as many of its modules at a time as there are processors.

    The machine code is known by the text that it is compiled from: after an edit that leaves the text as it is, it is
    found again.
    """
    from graspfx.compile.emitters import Emitters
    from graspfx.compile.llvm.library_text import Entry, library_text
    from graspfx.compile.specialise.specialise import Program

    began = perf_counter()
    with Emitters(title) as emitters:
        program = Program({}, UNROLL)
        entries = [
            Entry(_add(program, kernel, types, f"kernel_{k}"), types)
            for k, (kernel, types) in enumerate(kernels.values())
        ]
        source = program.source([entry.function for entry in entries])
        keep_lowerings()
        digest = hashlib.sha256(repr((source, entries, [*kernels])).encode()).hexdigest()
        remember(key, program, digest)
        if (known := _machine_code(digest)) is not None:
            return known
        prefix = f"gx.{digest[:16]}"
        text = library_text(source, entries, prefix)
        machines = emitters.emit([(part.text, part.lanes) for part in text.parts])
    parts, at = [], 0
    for part, machine in zip(text.parts, machines, strict=True):
        parts.append((part.exports, part.needs, part.libm, at, at + len(machine)))
        at += len(machine)
    symbols = [
        (_label(name, types), (function.name, function.result))
        for (name, (_, types)), function in zip(kernels.items(), text.entries, strict=True)
    ]
    description = {"symbols": symbols, "parts": parts}
    log.info("%d kernels: compiled in %.2f s, %d kB", len(kernels), perf_counter() - began, at // 1000)
    note = disk.store(_machine_key(digest), json.dumps(description).encode() + b"\n" + b"".join(machines))
    return Library(json.loads(json.dumps(description)), b"".join(machines), cached=False, note=note)


def _add(program: Any, kernel: Kernel, types: Sequence[str], name: str) -> str:
    """Add a kernel to a program, as a function of its arguments in the order of a call; return the function's name."""
    from graspfx.compile.specialise.values import Dynamic, Memory

    function = source_function(kernel)
    places = [f"p{k}" for k in range(len(types))]
    values = [
        Memory(place, 0) if type_ == "ptr" else Dynamic(ast.Name(place, ast.Load()))
        for place, type_ in zip(places, types, strict=True)
    ]
    defaults = list(signature(function).parameters.values())[len(types) :]
    assert all(parameter.default is not Parameter.empty for parameter in defaults)
    numbers = [place for place, type_ in zip(places, types, strict=True) if type_ != "ptr"]
    buffers = {place: Memory(place, 0) for place, type_ in zip(places, types, strict=True) if type_ == "ptr"}
    call = f"{function.__name__}({', '.join(places)})"
    result = program.add(function, [*values]).result
    text = f"def {name}({', '.join(numbers)}):\n    {'' if result is None else 'return '}{call}"
    names = {function.__name__: kernel, **buffers}
    program.add_text(text, names, [Dynamic(ast.Name(number, ast.Load())) for number in numbers])
    return name
