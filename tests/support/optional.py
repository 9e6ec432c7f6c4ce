"""Values that may be None in general, and are there in a test."""

from __future__ import annotations

from typing import TypeVar

T = TypeVar("T")


def require(value: T | None) -> T:
    """Return the value; fail if it is None."""
    assert value is not None
    return value
