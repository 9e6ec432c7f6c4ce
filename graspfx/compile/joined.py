"""Programs that join generic kernels: text of their own, compiled in a short time, that calls kernels by symbol."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Callable, Collection, Mapping
from time import perf_counter
from types import MappingProxyType
from typing import Any

from graspfx import log
from graspfx.compile import cache as disk
from graspfx.compile.emission import QUICK, platform, require_llvm
from graspfx.compile.freshness import identity
from graspfx.compile.generic import Library, kernel_name, library, single
from graspfx.compile.llvm.llvm_arithmetic import LlvmFunction
from graspfx.compile.native import Native, native_of

Kernel = Callable[..., Any]
NAME = re.compile(r"[A-Za-z_]\w*")


class Calls:
    """The kernels that a text names, in the machine code that it calls.

    Args:
        kernels: by the names that the text has for them.
        shelf: kernels of the package that are compiled together, by module and name.
        machine: functions of machine code that is loaded, by the names that the text has for them.
    """

    def __init__(
        self,
        kernels: Mapping[str, Kernel],
        shelf: tuple[str, ...],
        machine: Mapping[str, LlvmFunction] = MappingProxyType({}),
    ) -> None:
        self._kernels, self._shelf, self._machine = kernels, shelf, machine
        self.symbols: dict[tuple[str, tuple[str, ...]], str] = {}
        self._libraries: dict[int, tuple[Library, list[str]]] = {}

    def has(self, name: str) -> bool:
        """Tell whether a text's name is a kernel's."""
        return name in self._kernels or name in self._machine

    def find(self, name: str, types: tuple[str, ...]) -> LlvmFunction:
        """Find the machine code of a kernel for these types of arguments; compile it if there is none."""
        if name in self._machine:
            self.symbols[name, types] = self._machine[name].name
            return self._machine[name]
        kernel = self._kernels[name]
        home, symbol = None, None
        if kernel_name(kernel) in self._shelf:
            home = library(self._shelf)
            symbol = home.find(kernel_name(kernel), types)
        if home is None or symbol is None:
            home = single(kernel, types)
            symbol = home.find(kernel_name(kernel), types)
            assert symbol is not None
        self.symbols[name, types] = symbol.name
        self._libraries.setdefault(id(home), (home, []))[1].append(symbol.name)
        return symbol

    def load(self) -> None:
        """Load all that was asked for."""
        for home, symbols in self._libraries.values():
            home.load(symbols)


def joined(
    source: str,
    kernels: Mapping[str, Kernel],
    buffers: Collection[str],
    shelf: tuple[str, ...] = (),
    floats: Collection[str] = (),
    machine: Mapping[str, LlvmFunction] = MappingProxyType({}),
) -> Native:
    """Compile a program with the kernels that it calls left by themselves.

    Args:
        source: the program as Python, its last function the entry, which takes buffers and then numbers; other names
            are kernels.
        kernels: by name.
        buffers: the parameters that are buffers.
        shelf: kernels of the package that are compiled together, by module and name.
        floats: the entry's parameters that are floats; its other numbers are whole.
        machine: functions of machine code that is loaded, by the names that the source has for them; what they do is in
            no key of the cache.

    Raises:
        MissingPackageError: no LLVM.
        InputError: the program or a kernel holds something that cannot be compiled.
    """
    require_llvm()
    names = set(NAME.findall(source))
    used = {name: kernel for name, kernel in kernels.items() if name in names}
    roots = [[name, *identity(kernel)] for name, kernel in sorted(used.items())]
    request = json.dumps([*platform(), source, sorted(buffers), roots, sorted(floats)])
    key = hashlib.sha256(f"joined {request}".encode()).hexdigest()
    calls = Calls(used, shelf, machine)
    return _from_cache(key, calls) or _compiled(key, source, buffers, calls, floats)


def _from_cache(key: str, calls: Calls) -> Native | None:
    """Load a program whose kernels are still where it calls them."""
    entry = disk.load(key)
    if entry is None:
        return None
    head, _, machine = entry.partition(b"\n")
    description = json.loads(head)
    for name, types, symbol in description["calls"]:
        if calls.find(name, tuple(types)).name != symbol:
            return None
    calls.load()
    return Native(description, machine, cached=True)


def _compiled(key: str, source: str, buffers: Collection[str], calls: Calls, floats: Collection[str]) -> Native:
    from graspfx.compile.llvm.llvm import llvm_program

    began = perf_counter()
    program = llvm_program(source, floats, buffers=buffers, externals=calls)
    calls.load()
    listed = [(name, types, symbol) for (name, types), symbol in calls.symbols.items()]
    log.debug("program %s: joins %d kernels", key[:12], len(listed))
    return native_of(program, key, QUICK, began, more={"calls": listed})
