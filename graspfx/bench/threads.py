"""One BLAS thread for all methods: a second one makes products and eigenvalues of small matrices slower."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager

NAMES = ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Limit libraries that are loaded within, numpy's and scipy's BLAS among them; the user's own limits stay.

    On a machine whose processors are busy, two threads take thirty times as long for the eigenvalues of a 4 x 4 matrix:
    a peer would be slow by how it is called.
    """
    mine = [name for name in NAMES if name not in os.environ]
    os.environ.update(dict.fromkeys(mine, "1"))
    try:
        yield
    finally:
        for name in mine:
            del os.environ[name]


def environment() -> dict[str, str]:
    """Copy the environment without these limits, for processes that are to start as a user starts them."""
    return {name: value for name, value in os.environ.items() if name not in NAMES}
