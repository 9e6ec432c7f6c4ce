"""Start of a servo's process: a fresh interpreter that imports this package, and not the program that begins it."""

from __future__ import annotations

import os
import subprocess
import sys
from multiprocessing.connection import Connection
from pathlib import Path
from socket import socketpair

import graspfx
from graspfx.errors import InputError

THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")  # of numerical libraries: none beside
TEXT = "import sys; sys.path[:] = {path!r}; from graspfx.build.process.servo_child import main; main({line}, {ring})"


def is_possible() -> bool:
    """Tell whether this system starts processes that share memory with this one."""
    return os.name == "posix" and bool(sys.executable)


def start(ring: int) -> tuple[subprocess.Popen[bytes], Connection]:
    """Start the process; give it and the line to it.

    It is in a group of its own: Ctrl-C on a terminal is for whoever records, who passes it on.

    Args:
        ring: descriptor of the memory that both have.

    Raises:
        InputError: this system starts no such process.
    """
    if not is_possible():
        raise InputError("loop", "process", "a system with processes that share memory, such as Linux")
    ours, theirs = socketpair()
    home = str(Path(graspfx.__file__).parents[1])
    path = [*sys.path, *([] if home in sys.path else [home])]
    text = TEXT.format(path=path, line=theirs.fileno(), ring=ring)
    try:
        process = subprocess.Popen(
            [sys.executable, "-c", text], stdin=subprocess.DEVNULL, pass_fds=(theirs.fileno(), ring), process_group=0,
            env=os.environ | dict.fromkeys(THREADS, "1"),
        )  # fmt: skip
    except BaseException:
        ours.close()
        raise
    finally:
        theirs.close()
    return process, Connection(ours.detach())
