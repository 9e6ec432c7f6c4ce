"""Processes that run one of the compiler's modules, and nothing of the program that starts them."""

from __future__ import annotations

import os
import subprocess
import sys


def start(module: str, *, answers: bool = True) -> subprocess.Popen[bytes]:
    """Start a module in a process of its own, which finds the same modules as this one.

    Args:
        module: by name.
        answers: whether it writes to a pipe.

    Raises:
        OSError: there is no interpreter to start, or the system refuses.
    """
    if not sys.executable:
        raise OSError("this Python says not where its interpreter is")
    path = os.pathsep.join(os.path.abspath(place) for place in sys.path if place)  # noqa: PTH100 (as it stands)
    return subprocess.Popen(
        [sys.executable, "-P", "-m", module],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE if answers else subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        env={**os.environ, "PYTHONPATH": path},
    )  # fmt: skip
