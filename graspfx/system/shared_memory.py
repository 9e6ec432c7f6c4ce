"""Memory shared by two processes through a file descriptor."""

from __future__ import annotations

import os
import tempfile


def create(name: str, size: int) -> int:
    """Create zeroed shared memory; return its descriptor. The memory is freed with the last process that uses it.

    On Linux it has no file. On other systems it is a file without a directory entry.

    Args:
        name: Name shown by tools that inspect the process.
        size: Size in bytes.
    """
    if hasattr(os, "memfd_create"):
        file = os.memfd_create(name, getattr(os, "MFD_CLOEXEC", 0))
    else:
        with tempfile.TemporaryFile() as temporary:
            file = os.dup(temporary.fileno())
    os.ftruncate(file, size)
    return file
