"""Disk cache of arrays that take longer to compute than to read; the key covers all inputs of the arrays."""

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
LARGEST = 50_000_000  # largest size of an entry, a quarter of the cache [bytes]
SEPARATOR = b"\n"  # separates the entry's table from its arrays


def content_key(settings: object, content: bytes) -> str:
    """Compute the digest of the inputs: Python, this version of GraspFX, settings by their `repr`, and the content."""
    parts = FORMAT, sys.version, sys.byteorder, source_stamps(), settings
    return sha256(repr(parts).encode() + b"\0" + sha256(content).digest()).hexdigest()


def store_arrays(key: str, table: dict[str, Any], arrays: Sequence[NDArray[Any]]) -> None:
    """Store arrays, and a JSON-serialisable table, unless they are too large for the cache."""
    plain = [np.ascontiguousarray(each) for each in arrays]
    head = {"table": table, "arrays": [[each.dtype.str, each.shape] for each in plain]}
    entry = b"".join([json.dumps(head).encode(), SEPARATOR, *(each.tobytes() for each in plain)])
    if len(entry) <= LARGEST:
        cache.store(key, entry)


def load_arrays(key: str) -> tuple[dict[str, Any], list[NDArray[Any]]] | None:
    """Load a table and its arrays as writable copies; None if they are not cached."""
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
