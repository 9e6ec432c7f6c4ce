"""Specialising by another process, at low priority, into the disk cache: it ends with the one that starts it."""

from __future__ import annotations

import atexit
import json
import os
import sys
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from importlib import import_module
from threading import Thread
from typing import TYPE_CHECKING, Any, NamedTuple

from graspfx import log
from graspfx.compile.freshness import identity
from graspfx.system.scheduling import be_nice

if TYPE_CHECKING:
    import subprocess

MODULE = "graspfx.compile.background"
NICE = 10  # steps of priority below this process


class Request(NamedTuple):
    """A text to be specialised and compiled, as `program_source` takes it."""

    text: str
    kernels: Mapping[str, Callable[..., Any]]
    arrays: Sequence[str]
    frozen: Mapping[tuple[str, int], float]


def begin(requests: Sequence[Request]) -> subprocess.Popen[bytes] | None:
    """Begin to specialise and compile texts; None where that cannot be done by another process.

    Texts that a process of this one works at already, or has done, begin nothing new.
    """
    lines = []
    for request in requests:
        kernels = {}
        for name, kernel in request.kernels.items():
            if _by_name(kernel.__module__, kernel.__qualname__) is not kernel:
                log.info("%s cannot be imported by name: it stays generic", kernel.__qualname__)
                return None
            kernels[name] = [kernel.__module__, kernel.__qualname__, identity(kernel)[1]]
        frozen = [(array, k, value.hex()) for (array, k), value in sorted(request.frozen.items())]
        lines.append([request.text, kernels, list(request.arrays), frozen])
    return _process(json.dumps(lines))


def _by_name(module: str, name: str) -> Any:
    """Find what a module has under a name; nothing that only the user's main script has."""
    return None if module == "__main__" else getattr(sys.modules.get(module), name, None)


@cache
def _process(text: str) -> subprocess.Popen[bytes] | None:
    from graspfx.compile.child import start

    try:
        process = start(MODULE, answers=False)
        assert process.stdin is not None
        process.stdin.write(text.encode() + b"\n")
        process.stdin.flush()  # and stays open: the other process ends when this one does
    except OSError as error:
        log.info("nothing is specialised in the background: %s", error)
        return None
    atexit.register(_end, process, os.getpid())
    return process


def _end(process: subprocess.Popen[bytes], owner: int) -> None:
    if os.getpid() == owner:  # and no fork of it
        process.kill()
        if process.stdin is not None:
            process.stdin.close()
        process.wait()


# The other process ----------------------------------------------------------------------------------------------------


def main() -> None:
    """Specialise and compile what one line of stdin asks for."""
    from graspfx.compile.native import compiled
    from graspfx.compile.program import program_source

    be_nice(NICE)
    requests = json.loads(sys.stdin.buffer.readline())
    Thread(target=_end_with_parent, daemon=True).start()
    for text, places, arrays, numbers in requests:
        kernels = {}
        for name, (module, function, file) in places.items():
            kernels[name] = getattr(import_module(module), function)
            if identity(kernels[name])[1] != file:
                raise ImportError(f"{module}.{function} is another one here")
        frozen = {(array, k): float.fromhex(value) for array, k, value in numbers}
        compiled(program_source(text, kernels, arrays, frozen))


def _end_with_parent() -> None:
    while os.read(sys.stdin.fileno(), 1024):  # not by a buffer, whose lock the end of the process would wait for
        pass
    os._exit(1)


if __name__ == "__main__":
    main()
