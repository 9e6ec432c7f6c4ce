"""Disk cache of values that take longer to compute than to read; each key includes all inputs of the value."""

from __future__ import annotations

import pickle
import sys
from collections.abc import Callable
from hashlib import sha256
from typing import TypeVar

from graspfx.compile import cache
from graspfx.compile.own_sources import source_stamps

FORMAT = 2
LARGEST = 50_000_000  # largest size of an entry, a quarter of the cache [bytes]

T = TypeVar("T")


def through_cache(settings: object, content: bytes, make: Callable[[], T]) -> T:
    """Return a value from the cache; if the cache does not contain the value, compute it with `make` and store it.

    A value of more than `LARGEST` bytes is not stored.

    Args:
        settings: All settings on which the value depends, as an object whose `repr` is complete. The content, Python's
            version and the sources of GraspFX are always part of the key.
        content: Content of a file, or bytes of arrays.
        make: Function that computes the value. If it raises an exception, nothing is stored.
    """
    parts = FORMAT, sys.version, sys.byteorder, source_stamps(), settings
    key = sha256(repr(parts).encode() + b"\0" + sha256(content).digest()).hexdigest()
    entry = cache.load(key)
    if entry is not None:
        kept: T = pickle.loads(entry)
        return kept
    value = make()
    entry = pickle.dumps(value, protocol=pickle.HIGHEST_PROTOCOL)
    if len(entry) <= LARGEST:
        cache.store(key, entry)
    return value
