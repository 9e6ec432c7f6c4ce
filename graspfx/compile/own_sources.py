"""The package's own source files, by which caches judge whether what they hold is of this version."""

from __future__ import annotations

import hashlib
import os
import sys
from collections.abc import Iterator, Sequence
from functools import cache
from pathlib import Path

from graspfx.compile import cache as disk

NO_KERNELS = ("commands", "live", "show")  # rooms that no program is made from: they stand above all that has kernels


@cache
def source_folders() -> tuple[str, ...]:
    """List the package's folder and, in a checkout, the shelf of drivers beside it."""
    package, *beside = (str(Path(place)) for place in sys.modules[__name__.partition(".")[0]].__path__)
    shelves = [os.path.join(place, "devices") for place in beside]  # noqa: PTH118 (strings, of hundreds of files)
    return package, *(shelf for shelf in shelves if os.path.isdir(shelf))  # noqa: PTH112


def is_own(file: str) -> bool:
    """Tell whether a source file is the package's."""
    return file.startswith(tuple(folder + os.sep for folder in source_folders()))


@cache
def source_stamps() -> tuple[tuple[str, int, int], ...]:
    """List the source files that programs are made from with their time and size, once in a process."""
    return tuple(stamp for folder in source_folders() for stamp in stamps_in(folder, NO_KERNELS))


def stamps_in(root: str, without: Sequence[str] = ()) -> Iterator[tuple[str, int, int]]:
    """List the source files below a folder with their time and size, as Python judges its own bytecode.

    Args:
        root: the folder.
        without: names of folders in it that are left out.
    """
    for folder, folders, names in os.walk(root):
        if folder == root:
            folders[:] = [each for each in folders if each not in without]
        for name in sorted(names):
            if name.endswith(".py"):
                status = os.stat(path := os.path.join(folder, name))  # noqa: PTH116, PTH118 (of hundreds of files)
                yield path, status.st_mtime_ns, status.st_size


@cache
def source_digest() -> str:
    """Digest all sources that programs are made from: kernels stand in many files, and numbers in still more.

    The digest is kept by the files' times and sizes, since reading them takes longer than loading what it is asked for.
    """
    key = f"sources-{hashlib.sha256(repr(source_stamps()).encode()).hexdigest()}"
    content = disk.load(key)
    if content is not None:
        return content.decode()
    digest = hashlib.sha256()
    for root in source_folders():
        for file in sorted(Path(each) for each, *_ in stamps_in(root, NO_KERNELS)):
            digest.update(f"{file.relative_to(root)}\0".encode() + file.read_bytes())
    disk.store(key, digest.hexdigest().encode())
    return digest.hexdigest()
