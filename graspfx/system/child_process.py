"""Child processes: fresh interpreters that import this package but not the main program."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

import graspfx
from graspfx.errors import GraspFXError

TEXT = "import sys; sys.path[:] = {path!r}; from {module} import main; main({arguments})"
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
