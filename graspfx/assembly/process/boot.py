"""Start of a process beside this one: a fresh interpreter that imports this package, and never the main program."""

from __future__ import annotations

import os
import subprocess
from multiprocessing.connection import Connection
from socket import socketpair

from graspfx.errors import InputError
from graspfx.system import child_process

THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")  # of numerical libraries: none beside


def start(ring: int) -> tuple[subprocess.Popen[bytes], Connection]:
    """Start a servo's process; give it and the line to it.

    Args:
        ring: descriptor of the memory that both have.

    Raises:
        InputError: this system starts no such process.
    """
    return spawn("graspfx.assembly.process.servo_child", ring)


def spawn(module: str, *descriptors: int) -> tuple[subprocess.Popen[bytes], Connection]:
    """Start a process that calls `main` of a module with the descriptor of its line and others; give it and the line.

    It is in a group of its own: Ctrl-C on a terminal is for whoever began it, who passes it on.

    Args:
        module: of this package.
        descriptors: of files that both have.

    Raises:
        InputError: this system starts no such process.
    """
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
