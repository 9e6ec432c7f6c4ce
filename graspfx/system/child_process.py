"""A fresh interpreter beside this one that imports this package, and never the main program."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

import graspfx
from graspfx.errors import GraspFXError

TEXT = "import sys; sys.path[:] = {path!r}; from {module} import main; main({arguments})"
REFUSAL = "needs a system whose processes share memory by descriptors, such as Linux or macOS"


def is_possible() -> bool:
    """Tell whether this system starts processes that share memory with this one."""
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

    It is in a group of its own: Ctrl-C on a terminal is for whoever began it, who passes it on.

    Args:
        module: of this package.
        arguments: of `main`, which Python writes as it reads them.
        descriptors: of files that both have.
        inputs, outputs: as of `subprocess.Popen`.
        environment: of the process; None for this one's.

    Raises:
        GraspFXError: this system starts no such process.
        OSError: it does not start.
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
