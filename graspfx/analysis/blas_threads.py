"""Limit to one BLAS thread, for small eigenproblems that take less time than synchronising a second thread."""

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
    """Limit NumPy's and SciPy's BLAS to one thread in the context or decorated function; then restore the number.

    Contexts may be nested, and the number of BLAS threads is also restored after an exception. This number is common to
    the whole process: if several Python threads use this function at once, only the first thread changes and restores
    it. The eigenvalues of a 192 x 192 matrix take 16 ms with one BLAS thread, and about 100 ms with two BLAS threads on
    a busy machine.
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
    """Find the loaded BLAS libraries (1 ms); `modules`, whether each of `BRINGS_BLAS` is imported, is the cache key."""
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()
