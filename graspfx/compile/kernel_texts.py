"""Disk cache of the programs of kernels by themselves: to specialise one takes as long as to load its machine code."""

from __future__ import annotations

import hashlib
import marshal
import sys
from typing import Any, NamedTuple

from graspfx.compile import cache as disk
from graspfx.compile.marks import written
from graspfx.compile.own_sources import is_own, source_stamps


class KernelText(NamedTuple):
    """A kernel's program as Python: its parameters with their kinds, how many numbers it returns, and its files."""

    source: str
    parameters: tuple[tuple[str, str], ...]
    results: int
    files: tuple[str, ...]


def find(kernel: Any) -> KernelText | None:
    """Look up a kernel of ours."""
    content = disk.load(_key(kernel)) if is_own(written(kernel).__code__.co_filename) else None
    return None if content is None else KernelText(*marshal.loads(content))


def add(kernel: Any, text: KernelText) -> None:
    """Write a kernel's program, if all of it is ours: the key says nothing of others' sources."""
    if all(is_own(file) for file in text.files):
        disk.store(_key(kernel), marshal.dumps(tuple(text)))


def _key(kernel: Any) -> str:
    function = written(kernel)
    name = f"{function.__module__}.{function.__qualname__}"
    digest = hashlib.sha256(repr((name, sys.version, marshal.version, source_stamps())).encode())
    return f"kernel-{digest.hexdigest()}"
