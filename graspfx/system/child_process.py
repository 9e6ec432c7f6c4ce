"""Child processes: fresh interpreters that import this package but not the main program."""

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
    """Tell whether this system supports child processes that share memory."""
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
    """Start a process that calls `main` of a module.

    The process has its own group, so that Ctrl-C in a terminal reaches only the parent, which passes the signal on.

    Args:
        module: Module of this package.
        arguments: Arguments of `main`; their `repr` must be valid Python.
        descriptors: Descriptors of shared files.
        inputs, outputs: Stdin and stdout of `subprocess.Popen`.
        environment: Environment of the process; None for that of this process.

    Raises:
        GraspFXError: If this system does not support such processes.
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
    """Start a process that calls `main` of a module with descriptors; return it and the connection to it.

    The new process is in a separate process group: a terminal's Ctrl-C reaches only the calling process, which
    passes the signal on.

    Args:
        module: Module of this package.
        descriptors: Descriptors of shared files; `main` receives that of its connection before them.

    Raises:
        InputError: If this system does not support such processes.
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
