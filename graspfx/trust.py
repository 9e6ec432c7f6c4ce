"""Whether scene files may name files outside of their folder: said by the user, and never by a file."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

VARIABLE = "GRASPFX_TRUST"

_granted: ContextVar[bool] = ContextVar("granted", default=False)


def is_granted() -> bool:
    """Whether they may: within `granted`, or where the environment says GRASPFX_TRUST=1."""
    return _granted.get() or os.environ.get(VARIABLE, "0") not in ("", "0")


@contextmanager
def granted(yes: bool = True) -> Iterator[None]:
    """Let them within the block, if `yes`; else leave it as it is."""
    token = _granted.set(yes or _granted.get())
    try:
        yield
    finally:
        _granted.reset(token)
