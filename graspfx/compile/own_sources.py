"""Digests of the sources of kernels, which show whether cached and precompiled programs are up to date."""

from __future__ import annotations

import hashlib
import json
import os
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from graspfx.compile import cache as disk
from graspfx.compile import library
from graspfx.compile.kernel_marks import written

PACKAGE = __name__.partition(".")[0]
NO_KERNELS = ("commands", "live", "show")  # packages without kernels; they are imported by no package with kernels


@cache
def source_folders() -> tuple[str, ...]:
    """Return the folder of the package and, in a checkout, the folder of drivers next to the package."""
    package, *beside = (str(Path(place)) for place in sys.modules[PACKAGE].__path__)
    shelves = [os.path.join(place, "devices") for place in beside]  # noqa: PTH118 (strings, of hundreds of files)
    return package, *(shelf for shelf in shelves if os.path.isdir(shelf))  # noqa: PTH112


def is_own(file: str) -> bool:
    """Return whether a source file is in one of the folders of `source_folders`."""
    return file.startswith(tuple(folder + os.sep for folder in source_folders()))


@cache
def source_stamps() -> tuple[tuple[str, int, int], ...]:
    """Return path, modification time [ns] and size [bytes] of all source files that may contain kernels.

    The folders are searched once in a process.
    """
    return tuple(stamp for folder in source_folders() for stamp in stamps_in(folder, NO_KERNELS))


def stamps_in(root: str, without: Sequence[str] = ()) -> Iterator[tuple[str, int, int]]:
    """Yield path, modification time [ns] and size [bytes] of all Python files below a folder.

    Args:
        root: Folder to search.
        without: Names of direct subfolders that are not searched.
    """
    for folder, folders, names in os.walk(root):
        if folder == root:
            folders[:] = [each for each in folders if each not in without]
        for name in sorted(names):
            if name.endswith(".py"):
                status = os.stat(path := os.path.join(folder, name))  # noqa: PTH116, PTH118 (of hundreds of files)
                yield path, status.st_mtime_ns, status.st_size


# Sources of kernels ---------------------------------------------------------------------------------------------------


class Source(NamedTuple):
    """Facts about a source file.

    Attributes:
        time: Modification time [ns].
        size: Size [bytes].
        digest: SHA-256 of the content.
        imports: Modules of the package that the file imports.
    """

    time: int
    size: int
    digest: str
    imports: Sequence[str]


@cache
def closure_digest(*modules: str) -> str:
    """Return the digest of the source files of modules and of all files of the package that they import, recursively.

    A kernel of the modules depends on no other files, because kernels refer to other kernels, records, values and
    numbers only by import statements. If a module is outside the package, the digest is that of all sources.
    """
    files, sources = _files(), _sources()
    roots = [files.get(module) for module in modules]
    left = [*files.values()] if None in roots else [file for file in roots if file is not None]
    closure = dict[str, Source]()
    while left:
        if (file := left.pop()) not in closure:
            closure[file] = sources.read(file)
            left += [files[module] for module in closure[file].imports if module in files]
    sources.save()
    rows = sorted((_name(file), source.digest) for file, source in closure.items())
    return hashlib.sha256(repr(rows).encode()).hexdigest()


def all_imports() -> dict[str, list[str]]:
    """Return the modules of the package that each source file imports, by the SHA-256 of the file."""
    return dict(sorted(_digest_and_imports(path) for path in _files().values()))


@cache
def compiler_modules() -> tuple[str, ...]:
    """Return the names of the modules of the compiler, on which the text of a program depends."""
    return tuple(module for module in _files() if module.startswith(__name__.rpartition(".")[0]))


@cache
def _files() -> dict[str, str]:
    """Return the path of each module that may contain kernels, by the name of the module."""
    found = {}
    for path, *_ in source_stamps():
        name = _name(path).removesuffix(".py").removesuffix(f"{os.sep}__init__").replace(os.sep, ".")
        found[name] = path
    found.pop(PACKAGE)  # re-exports the names of every package
    return found


class Sources:
    """Digests and imports of source files, by path, which are stored in the disk cache.

    An entry is used as long as the modification time and the size of the file are unchanged.
    """

    def __init__(self) -> None:
        self._key = f"sources-{hashlib.sha256(repr((sys.version, source_folders())).encode()).hexdigest()}"
        content = disk.load(self._key)
        self._entries = json.loads(content) if content is not None else {}
        self._stamps = {path: stamp for path, *stamp in source_stamps()}
        self._changed = False

    def read(self, path: str) -> Source:
        """Return the facts about a source file. The file is read only if its modification time or size has changed."""
        entry = self._entries.get(path)
        if entry is None or entry[:2] != self._stamps[path]:
            entry = self._entries[path] = [*self._stamps[path], *_digest_and_imports(path)]
            self._changed = True
        return Source(*entry)

    def save(self) -> None:
        """Write the digests and imports to the disk cache if they have changed."""
        if self._changed:
            disk.store(self._key, json.dumps(self._entries).encode())
            self._changed = False


@cache
def _sources() -> Sources:
    return Sources()


def _digest_and_imports(path: str) -> tuple[str, list[str]]:
    """Return the SHA-256 of a source file, and the modules of the package that the file imports when it is loaded.

    Imports in functions, and imports that are used only by type checkers, are omitted.
    """
    content = Path(path).read_bytes()
    digest = hashlib.sha256(content).hexdigest()
    known = library.imports().get(digest)
    return digest, _imports(content) if known is None else known


def _imports(content: bytes) -> list[str]:
    import ast  # only for a new source file

    names = set[str]()

    def visit(statements: Iterable[ast.stmt]) -> None:
        for statement in statements:
            if isinstance(statement, ast.Import):
                names.update(alias.name for alias in statement.names)
            elif isinstance(statement, ast.ImportFrom):
                names.add(f"{statement.module}")
                names.update(f"{statement.module}.{alias.name}" for alias in statement.names)
            elif isinstance(statement, ast.If) and ast.unparse(statement.test).endswith("TYPE_CHECKING"):
                visit(statement.orelse)
            elif not isinstance(statement, ast.FunctionDef):
                visit(each for each in ast.iter_child_nodes(statement) if isinstance(each, ast.stmt))

    visit(ast.parse(content).body)
    return sorted(name for name in names if name.startswith(f"{PACKAGE}."))


def _name(file: str) -> str:
    """Return the path of a source file relative to the package, so that keys do not depend on the installation."""
    package, *_ = folders = source_folders()
    folder = next(each for each in folders if file.startswith(each + os.sep))
    name = os.path.basename(folder) + file.removeprefix(folder)  # noqa: PTH119 (of hundreds of files)
    return name if folder == package else f"{PACKAGE}{os.sep}{name}"  # location of the drivers in a wheel


# Entries made from kernels --------------------------------------------------------------------------------------------


def identity(kernel: Callable[..., Any]) -> list[str]:
    """Return the qualified name of a kernel, and the file of a third-party kernel; for other kernels, "".

    Two third-party kernels in different files may have the same name.
    """
    code = getattr(written(kernel), "__code__", None)
    file = "" if code is None or is_own(code.co_filename) else code.co_filename
    return [f"{kernel.__module__}.{kernel.__qualname__}", file]


def request_key(modules: Iterable[str], *parts: str) -> str:
    """Return the key of a cached result that depends on the sources of modules, on the compiler, and on `parts`."""
    digest = closure_digest(*sorted(set(modules)), *compiler_modules())
    return hashlib.sha256("\0".join([digest, *parts]).encode()).hexdigest()


def recall(key: str) -> str | None:
    """Return the result that `remember` has stored for a key.

    The result is None if nothing is stored, or if a third-party file or a number of a module has changed.
    """
    content = disk.load(key)
    if content is None:
        return None
    entry = json.loads(content)
    files, numbers = entry["files"], entry["numbers"]
    same = all(_file_digest(file) == digest for file, digest in files.items())
    same = same and all(_present(module, name) == number for module, name, number in numbers)
    return str(entry["content"]) if same else None


def remember(key: str, files: Iterable[str], numbers: Mapping[tuple[str, str], str], content: str) -> None:
    """Store a result in the disk cache.

    Args:
        key: Key from `request_key`.
        files: Source files of the kernels. The digests of all Python files in the folders of third-party kernels are
            stored with the result.
        numbers: Numbers of modules that the result contains, as text, by module and name. Numbers of this package are
            not stored, because their changes change the key.
        content: Result.
    """
    folders = {Path(file).parent for file in files if not is_own(file)}
    digests = {str(file): _file_digest(str(file)) for folder in folders for file in folder.glob("*.py")}
    others = [[*where, each] for where, each in numbers.items() if where[0].partition(".")[0] not in ("math", PACKAGE)]
    disk.store(key, json.dumps({"files": digests, "numbers": others, "content": content}).encode())


def _present(module: str, name: str) -> str:
    """Return the present value of a number of a module, as text; the value need not come from the module's source."""
    return repr(getattr(sys.modules.get(module), name, None))


def _file_digest(file: str) -> str:
    try:
        return hashlib.sha256(Path(file).read_bytes()).hexdigest()
    except OSError:
        return ""


# Marks of kernels that were compiled separately, which are read without loading LLVM ----------------------------------


def is_ours(kernel: Callable[..., Any]) -> bool:
    """Return whether the source of a kernel belongs to this package."""
    return is_own(written(kernel).__code__.co_filename)


def footprint(kernel: Callable[..., Any]) -> str:
    """Return a key that identifies a kernel of this package and its sources."""
    sources = closure_digest(kernel.__module__, *compiler_modules())
    return f"kernel-{hashlib.sha256(f'{kernel.__module__}.{kernel.__qualname__} {sources}'.encode()).hexdigest()}"


def was_compiled(kernel: Callable[..., Any]) -> bool:
    """Return whether a kernel belongs to this package and was compiled from its present sources."""
    if not is_ours(kernel):
        return False
    key = footprint(kernel)
    return library.has(key) or disk.load(key) is not None


def note_compiled(kernel: Callable[..., Any]) -> None:
    """Record in the disk cache that a kernel was compiled; kernels that do not belong to this package are ignored."""
    if is_ours(kernel):
        disk.store(footprint(kernel), b"")
