"""Start of another process: a new interpreter that imports this package but not the main program."""

from __future__ import annotations

import os
import subprocess
from socket import socketpair
from typing import TYPE_CHECKING

from graspfx.errors import InputError
from graspfx.system import child_process

if TYPE_CHECKING:
    from multiprocessing.connection import Connection

THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")  # thread limits of numerical libraries


def spawn(module: str, *descriptors: int) -> tuple[subprocess.Popen[bytes], Connection]:
    """Start a process that calls `main` of a module with descriptors of its connection and other files.

    The new process is in a separate process group: a terminal's Ctrl-C reaches only the calling process, which
    passes the signal on.

    Args:
        module: Module of this package.
        descriptors: Descriptors of shared files.

    Raises:
        InputError: If this system does not support such processes.
    """
    from multiprocessing.connection import Connection  # only where a process starts

    if not child_process.is_possible():
        raise InputError("loop", "process", "a system with processes that share memory, such as Linux")
    ours, theirs = socketpair()
    numbers = (theirs.fileno(), *descriptors)
    environment = os.environ | dict.fromkeys(THREADS, "1")
    try:
        process = child_process.start(module, numbers, numbers, inputs=subprocess.DEVNULL, environment=environment)
    except BaseException:
        ours.close()
        raise
    finally:
        theirs.close()
    return process, Connection(ours.detach())
