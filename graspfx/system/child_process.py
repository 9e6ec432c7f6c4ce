"""Child processes: new Python interpreters that import this package but not the main program."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from socket import socketpair
from typing import TYPE_CHECKING

import graspfx
from graspfx.errors import GraspFXError, InputError

if TYPE_CHECKING:
    from multiprocessing.connection import Connection

TEXT = "import sys; sys.path[:] = {path!r}; from {module} import main; main({arguments})"
THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")  # thread limits of numerical libraries
REFUSAL = "needs a system whose processes can share memory by file descriptors, such as Linux or macOS"


def is_possible() -> bool:
    """Return whether this system supports child processes that share memory."""
    return os.name == "posix" and bool(sys.executable)


def start(
    module: str,
    arguments: Sequence[object],
    descriptors: Sequence[int],
    *,
    inputs: int,
    outputs: int | None = None,
    environment: Mapping[str, str] | None = None,
) -> subprocess.Popen[bytes]:
    """Start a process that calls the function `main` of a module.

    The process is in its own process group. Ctrl-C in a terminal therefore reaches only the calling process, which
    forwards the signal.

    Args:
        module: Name of a module of this package.
        arguments: Arguments of `main`; their `repr` must be valid Python.
        descriptors: File descriptors that the process inherits.
        inputs, outputs: Arguments `stdin` and `stdout` of `subprocess.Popen`.
        environment: Environment variables of the process; by default those of the calling process.

    Raises:
        GraspFXError: If this system does not support child processes that share memory.
        OSError: If the process does not start.
    """
    if not is_possible():
        raise GraspFXError(f"{module} {REFUSAL}")
    home = str(Path(graspfx.__file__).parents[1])
    path = [*sys.path, *([] if home in sys.path else [home])]
    text = TEXT.format(path=path, module=module, arguments=", ".join(map(repr, arguments)))
    return subprocess.Popen(
        [sys.executable, "-c", text], stdin=inputs, stdout=outputs, pass_fds=tuple(descriptors), process_group=0,
        env=environment,
    )  # fmt: skip


def spawn(module: str, *descriptors: int) -> tuple[subprocess.Popen[bytes], Connection]:
    """Start a process with a connection to the calling process; otherwise as `start`.

    The arguments of `main` are the file descriptor of the connection, followed by `descriptors`. Numerical libraries in
    the process use one thread.

    Args:
        module: Name of a module of this package.
        descriptors: File descriptors that the process inherits.

    Returns:
        The process, and the calling process's end of the connection.

    Raises:
        InputError: If this system does not support child processes that share memory.
    """
    from multiprocessing.connection import Connection  # only where a process starts

    if not is_possible():
        raise InputError("loop", "process", "a system with processes that share memory, such as Linux")
    ours, theirs = socketpair()
    numbers = (theirs.fileno(), *descriptors)
    environment = os.environ | dict.fromkeys(THREADS, "1")
    try:
        process = start(module, numbers, numbers, inputs=subprocess.DEVNULL, environment=environment)
    except BaseException:
        ours.close()
        raise
    finally:
        theirs.close()
    return process, Connection(ours.detach())
