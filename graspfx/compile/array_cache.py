"""Disk cache of arrays that take longer to compute than to read, by all that they follow from."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from hashlib import sha256
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspfx.compile import cache
from graspfx.compile.own_sources import source_stamps

FORMAT = 1
LARGEST = 50_000_000  # [bytes] of an entry: a quarter of the cache
SEPARATOR = b"\n"  # after the entry's table, before its arrays


def content_key(settings: object, content: bytes) -> str:
    """Digest what arrays follow from: Python, this version of GraspFX, settings by their `repr`, and a content."""
    parts = FORMAT, sys.version, sys.byteorder, source_stamps(), settings
    return sha256(repr(parts).encode() + b"\0" + sha256(content).digest()).hexdigest()


def store_arrays(key: str, table: dict[str, Any], arrays: Sequence[NDArray[Any]]) -> None:
    """Store arrays, and a table that JSON can write, unless they are too large for the cache."""
    plain = [np.ascontiguousarray(each) for each in arrays]
    head = {"table": table, "arrays": [[each.dtype.str, each.shape] for each in plain]}
    entry = b"".join([json.dumps(head).encode(), SEPARATOR, *(each.tobytes() for each in plain)])
    if len(entry) <= LARGEST:
        cache.store(key, entry)


def load_arrays(key: str) -> tuple[dict[str, Any], list[NDArray[Any]]] | None:
    """Load a table and its arrays, which are the caller's own to write to; None if there are none."""
    entry = cache.load(key)
    if entry is None:
        return None
    text, _, rest = entry.partition(SEPARATOR)
    head = json.loads(text)
    start, arrays = 0, []
    for kind, shape in head["arrays"]:
        flat = np.frombuffer(rest, dtype=kind, count=int(np.prod(shape, dtype=np.int64)), offset=start)
        arrays.append(flat.reshape(shape).copy())
        start += flat.nbytes
    return head["table"], arrays
