"""Checks of blocks of rows: quick enough to keep up with compiled ticks, so that a change of any byte shows."""

from __future__ import annotations

from functools import cache
from hashlib import blake2b
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

NUMBER = np.dtype("<f8")
SIZE = 16  # bytes


def rows_sum(content: bytes | memoryview, width: int) -> bytes:
    """Sum up rows: BLAKE2b of their CRC-32 and of a weighted sum of each column.

    The numbers count as whole ones of 64 bits, modulo 2^64, each row times an odd weight: a change in one number always
    shows in its column's sum, and what cancels there is left to the CRC. A cryptographic digest of the rows themselves
    would take several times as long as the ticks.

    Args:
        content: rows of `width` numbers, little-endian.
        width: numbers in a row.
    """
    view = memoryview(content).cast("B")
    words = np.frombuffer(view, "<u8").reshape(-1, width)
    digest = blake2b(crc32(view).to_bytes(4, "little"), digest_size=SIZE)
    digest.update(np.einsum("i,ij->j", _weights(1 << len(words).bit_length())[: len(words)], words).astype("<u8"))
    return digest.digest()


def check_of(head: bytes, rows: bytes) -> bytes:
    """Compute the check of a block from its head and the `rows_sum` of its rows."""
    return blake2b(head + rows, digest_size=SIZE).digest()


@cache
def _weights(count: int) -> NDArray[np.uint64]:
    """List odd numbers without a pattern, by the mixing step of splitmix64 (Steele, Lea and Flood, OOPSLA 2014)."""
    z = np.arange(1, count + 1, dtype=np.uint64) * np.uint64(0x9E3779B97F4A7C15)
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return np.asarray((z ^ (z >> np.uint64(31))) | np.uint64(1))
