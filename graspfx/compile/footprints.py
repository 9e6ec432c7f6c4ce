"""Cache entries that mark kernels as compiled separately, readable without loading LLVM."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from typing import Any

from graspfx.compile import cache as disk
from graspfx.compile import library
from graspfx.compile.kernel_marks import written
from graspfx.compile.own_sources import closure_digest, compiler_modules, is_own


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


def is_ours(kernel: Callable[..., Any]) -> bool:
    """Return whether a kernel's source belongs to this package."""
    return is_own(written(kernel).__code__.co_filename)


def footprint(kernel: Callable[..., Any]) -> str:
    """Return the cache key of a kernel of this package, which covers the kernel's sources."""
    sources = closure_digest(kernel.__module__, *compiler_modules())
    return f"kernel-{hashlib.sha256(f'{kernel.__module__}.{kernel.__qualname__} {sources}'.encode()).hexdigest()}"
