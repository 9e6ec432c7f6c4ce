"""Start of a process beside this one: a fresh interpreter that imports this package, and never the main program."""

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
TEXT = "import sys; sys.path[:] = {path!r}; from {module} import main; main({numbers})"


def is_possible() -> bool:
    """Tell whether this system starts processes that share memory with this one."""
    return os.name == "posix" and bool(sys.executable)


def start(ring: int) -> tuple[subprocess.Popen[bytes], Connection]:
    """Start a servo's process; give it and the line to it.

    Args:
        ring: descriptor of the memory that both have.

    Raises:
        InputError: this system starts no such process.
    """
    return spawn("graspfx.build.process.servo_child", ring)


def spawn(module: str, *descriptors: int) -> tuple[subprocess.Popen[bytes], Connection]:
    """Start a process that calls `main` of a module with the descriptor of its line and others; give it and the line.

    It is in a group of its own: Ctrl-C on a terminal is for whoever began it, who passes it on.

    Args:
        module: of this package.
        descriptors: of files that both have.

    Raises:
        InputError: this system starts no such process.
    """
    if not is_possible():
        raise InputError("loop", "process", "a system with processes that share memory, such as Linux")
    ours, theirs = socketpair()
    home = str(Path(graspfx.__file__).parents[1])
    path = [*sys.path, *([] if home in sys.path else [home])]
    numbers = (theirs.fileno(), *descriptors)
    text = TEXT.format(path=path, module=module, numbers=", ".join(map(str, numbers)))
    try:
        process = subprocess.Popen(
            [sys.executable, "-c", text], stdin=subprocess.DEVNULL, pass_fds=numbers, process_group=0,
            env=os.environ | dict.fromkeys(THREADS, "1"),
        )  # fmt: skip
    except BaseException:
        ours.close()
        raise
    finally:
        theirs.close()
    return process, Connection(ours.detach())
