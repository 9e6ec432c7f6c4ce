"""A single BLAS thread for small eigenproblems, whose computation is shorter than the wait for a second thread."""

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
BRINGS_BLAS = ("numpy.linalg", "scipy.linalg")  # modules that may load a BLAS library of their own


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Limit numpy's and scipy's BLAS to one thread within the context or decorated function; then restore the number.

    Contexts may be nested, and the setting is also restored after exceptions. A library has one number of threads per
    process: if several threads use this function at once, the first thread limits and restores the number, and the
    other threads change nothing. Eigenvalues of a 192 x 192 matrix take 16 ms on one thread; on two threads of a busy
    machine, six times as long.
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
    """Find the loaded libraries in 1 ms; the search is repeated only after the import of a module that may load one."""
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()
