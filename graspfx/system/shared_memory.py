"""Memory that two processes have, by a descriptor which the one hands to the other."""

from __future__ import annotations

import os
import tempfile


def create(name: str, size: int) -> int:
    """Make memory of zeros, which goes with the last process that has it; give its descriptor.

    It has no place in a folder on Linux. Elsewhere it is a file that no folder lists.

    Args:
        name: for whoever looks at the process.
        size: in bytes.
    """
    if hasattr(os, "memfd_create"):
        file = os.memfd_create(name, getattr(os, "MFD_CLOEXEC", 0))
    else:
        with tempfile.TemporaryFile() as temporary:
            file = os.dup(temporary.fileno())
    os.ftruncate(file, size)
    return file
