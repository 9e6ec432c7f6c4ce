"""Sources of kernels, whose digests show whether entries of the cache and programs of the library are up to date."""

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
    """List the package's folder and, in a checkout, the folder of drivers next to it."""
    package, *beside = (str(Path(place)) for place in sys.modules[PACKAGE].__path__)
    shelves = [os.path.join(place, "devices") for place in beside]  # noqa: PTH118 (strings, of hundreds of files)
    return package, *(shelf for shelf in shelves if os.path.isdir(shelf))  # noqa: PTH112


def is_own(file: str) -> bool:
    """Return whether a source file belongs to the package, or in a checkout to the drivers next to it."""
    return file.startswith(tuple(folder + os.sep for folder in source_folders()))


@cache
def source_stamps() -> tuple[tuple[str, int, int], ...]:
    """List the source files of programs with modification times [ns] and sizes [bytes], once per process."""
    return tuple(stamp for folder in source_folders() for stamp in stamps_in(folder, NO_KERNELS))


def stamps_in(root: str, without: Sequence[str] = ()) -> Iterator[tuple[str, int, int]]:
    """List the source files below a folder with modification times [ns] and sizes [bytes].

    Args:
        root: Folder to search.
        without: Names of subfolders to skip.
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
    """Modification time [ns] and size [bytes] of a source file, its digest, and the package's modules it imports."""

    time: int
    size: int
    digest: str
    imports: Sequence[str]


@cache
def closure_digest(*modules: str) -> str:
    """Compute the digest of the sources of these modules: their files, and all files of the package that they import.

    Kernels obtain other kernels, records, values and numbers by import statements only, so other files need not be
    covered. For a module outside the package, the digest covers all sources of the package.
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
    """Return the modules of the package that each source file imports, by the digest of its content."""
    return dict(sorted(_digest_and_imports(path) for path in _files().values()))


@cache
def compiler_modules() -> tuple[str, ...]:
    """List the modules of the compiler, which write a program's text."""
    return tuple(module for module in _files() if module.startswith(__name__.rpartition(".")[0]))


@cache
def _files() -> dict[str, str]:
    """Return the source file of each module that may contain kernels."""
    found = {}
    for path, *_ in source_stamps():
        name = _name(path).removesuffix(".py").removesuffix(f"{os.sep}__init__").replace(os.sep, ".")
        found[name] = path
    found.pop(PACKAGE)  # re-exports the names of every package
    return found


class Sources:
    """Digests and imports of source files, cached on disk by path.

    An entry is valid while the file's modification time and size are unchanged.
    """

    def __init__(self) -> None:
        self._key = f"sources-{hashlib.sha256(repr((sys.version, source_folders())).encode()).hexdigest()}"
        content = disk.load(self._key)
        self._entries = json.loads(content) if content is not None else {}
        self._stamps = {path: stamp for path, *stamp in source_stamps()}
        self._changed = False

    def read(self, path: str) -> Source:
        """Return the facts about a file, which is read only if its modification time or its size has changed."""
        entry = self._entries.get(path)
        if entry is None or entry[:2] != self._stamps[path]:
            entry = self._entries[path] = [*self._stamps[path], *_digest_and_imports(path)]
            self._changed = True
        return Source(*entry)

    def save(self) -> None:
        """Write the cache."""
        if self._changed:
            disk.store(self._key, json.dumps(self._entries).encode())
            self._changed = False


@cache
def _sources() -> Sources:
    return Sources()


def _digest_and_imports(path: str) -> tuple[str, list[str]]:
    """Read a source file; return its digest and its imports at load time, except those in functions or for types."""
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
    """Return a name of a source file that does not depend on the package's location."""
    package, *_ = folders = source_folders()
    folder = next(each for each in folders if file.startswith(each + os.sep))
    name = os.path.basename(folder) + file.removeprefix(folder)  # noqa: PTH119 (of hundreds of files)
    return name if folder == package else f"{PACKAGE}{os.sep}{name}"  # location of the drivers in a wheel


# Entries made from kernels --------------------------------------------------------------------------------------------


def identity(kernel: Callable[..., Any]) -> list[str]:
    """Return a kernel's identity: its name and, for a third-party kernel, its file, because names may be ambiguous."""
    code = getattr(written(kernel), "__code__", None)
    file = "" if code is None or is_own(code.co_filename) else code.co_filename
    return [f"{kernel.__module__}.{kernel.__qualname__}", file]


def request_key(modules: Iterable[str], *parts: str) -> str:
    """Return the key of a request, which covers its parts, the sources of its modules, and those of the compiler."""
    digest = closure_digest(*sorted(set(modules)), *compiler_modules())
    return hashlib.sha256("\0".join([digest, *parts]).encode()).hexdigest()


def recall(key: str) -> str | None:
    """Load the result of a request; None if it is missing, or third-party files or numbers have changed.

    The key covers the sources of this package.
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
    """Store the result of a request.

    Args:
        files: Source files of the kernels. `recall` compares all Python files in the folder of a third-party kernel.
        numbers: Numbers of modules that the result contains, by module and name. Numbers of this package are not
            stored, because the key covers its sources.
    """
    folders = {Path(file).parent for file in files if not is_own(file)}
    digests = {str(file): _file_digest(str(file)) for folder in folders for file in folder.glob("*.py")}
    others = [[*where, each] for where, each in numbers.items() if where[0].partition(".")[0] not in ("math", PACKAGE)]
    disk.store(key, json.dumps({"files": digests, "numbers": others, "content": content}).encode())


def _present(module: str, name: str) -> str:
    """Return a module's present number, which the module may have read from another source on import."""
    return repr(getattr(sys.modules.get(module), name, None))


def _file_digest(file: str) -> str:
    try:
        return hashlib.sha256(Path(file).read_bytes()).hexdigest()
    except OSError:
        return ""


# Marks of kernels that were compiled separately, which are read without loading LLVM ----------------------------------


def is_ours(kernel: Callable[..., Any]) -> bool:
    """Return whether a kernel's source belongs to this package."""
    return is_own(written(kernel).__code__.co_filename)


def footprint(kernel: Callable[..., Any]) -> str:
    """Return the cache key of a kernel of this package, which covers the kernel's sources."""
    sources = closure_digest(kernel.__module__, *compiler_modules())
    return f"kernel-{hashlib.sha256(f'{kernel.__module__}.{kernel.__qualname__} {sources}'.encode()).hexdigest()}"


def was_compiled(kernel: Callable[..., Any]) -> bool:
    """Return whether a kernel of this package was compiled from its present sources."""
    if not is_ours(kernel):
        return False
    key = footprint(kernel)
    return library.has(key) or disk.load(key) is not None


def note_compiled(kernel: Callable[..., Any]) -> None:
    """Record that a kernel was compiled, if it belongs to this package; the key does not cover other sources."""
    if is_ours(kernel):
        disk.store(footprint(kernel), b"")
