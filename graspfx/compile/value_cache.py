"""Disk cache of values that take longer to compute than to read; the key covers all inputs of a value."""

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
    """Return a value from the cache, or else from `make`, and cache it unless it is too large.

    Args:
        settings: Everything on which the value depends, except the content, Python and this version of GraspFX, as an
            object with a complete text form.
        content: Content of a file, or bytes of arrays.
        make: Function that makes the value, or raises; an error is not cached.
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
