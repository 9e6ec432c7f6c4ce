"""One BLAS thread around small eigenproblems: a second one waits longer for its share than that takes to compute."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache
from threading import RLock
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from threadpoolctl import ThreadpoolController

_limiting = RLock()
BRINGS_BLAS = ("numpy.linalg", "scipy.linalg")  # modules each of which may load a library of its own


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Limit numpy's and scipy's BLAS to one thread within, also as a decorator; what was set before comes back.

    It nests, and comes back after an exception too. A library has one number of threads for the whole process: of
    several threads that are in it together the first limits and restores, the others change nothing. The eigenvalues
    of a matrix of 192 rows take 16 ms on one thread; on two of a busy machine, six times that.
    """
    if not _limiting.acquire(blocking=False):
        yield
        return
    try:
        with _libraries(tuple(name in sys.modules for name in BRINGS_BLAS)).limit(limits=1, user_api="blas"):
            yield
    finally:
        _limiting.release()


@lru_cache(maxsize=1)
def _libraries(modules: tuple[bool, ...]) -> ThreadpoolController:
    """Find the libraries that are loaded, 1 ms: again only where a module has come that brings one."""
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()
