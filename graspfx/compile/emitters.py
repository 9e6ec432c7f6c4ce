"""Processes that emit machine code side by side: LLVM is called by one thread at a time."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from queue import SimpleQueue
from threading import Lock
from types import TracebackType
from typing import IO

from graspfx import log
from graspfx.compile.child import start
from graspfx.compile.emission import best
from graspfx.system.scheduling import processors

WORKER = "graspfx.compile.emitter"


class Emitters:
    """Processes for all processors that this one may use, with a line of progress where a person watches.

    They import nothing of the program that starts them. Where none can be started, this process does their work.

    Args:
        title: of the line; empty for none.
    """

    def __init__(self, title: str = "") -> None:
        self._title, self._done, self._lock = title, 0, Lock()
        self._processes: list[subprocess.Popen[bytes]] = []

    def __enter__(self) -> Emitters:
        if self._title:  # a library: the processes start while its text is written
            count = processors()
            try:
                self._processes += [start(WORKER) for _ in range(count if count > 1 else 0)]
            except OSError as error:
                log.info("no further processes to compile kernels: %s", error)
            self._show(0, 0)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for process in self._processes:
            assert process.stdin is not None and process.stdout is not None
            process.kill()
            with suppress(OSError):  # what it has not read
                process.stdin.close()
            process.stdout.close()
            process.wait()
        if self._title and _is_watched():
            print(file=sys.stderr)

    def emit(self, texts: Sequence[tuple[str, bool]]) -> list[bytes]:
        """Emit the machine code of each text, the longest first; each says whether it has loops over lanes."""
        left: SimpleQueue[int] = SimpleQueue()
        for k in sorted(range(len(texts)), key=lambda k: -len(texts[k][0])):
            left.put(k)
        machines: dict[int, bytes] = {}

        def work(process: subprocess.Popen[bytes] | None) -> None:
            while not left.empty():
                k = left.get()
                text, lanes = texts[k]
                machine = None if process is None else _ask(process, text, lanes=lanes)
                if machine is None:
                    process, machine = None, best(text, lanes=lanes)
                machines[k] = machine
                with self._lock:
                    self._done += 1
                    self._show(self._done, len(texts))

        self._show(0, len(texts))
        if self._processes:
            with ThreadPoolExecutor(len(self._processes)) as pool:
                list(pool.map(work, self._processes))
        else:
            work(None)
        return [machines[k] for k in range(len(texts))]

    def _show(self, done: int, count: int) -> None:
        if self._title and _is_watched():
            print(f"\r{self._title}{f': {done} of {count}' if count else ' ...'}", end="", file=sys.stderr, flush=True)


def _ask(process: subprocess.Popen[bytes], text: str, *, lanes: bool) -> bytes | None:
    """Ask a process for the machine code of a text; None where it has ended."""
    assert process.stdin is not None and process.stdout is not None
    try:
        process.stdin.write(json.dumps([text, lanes]).encode() + b"\n")
        process.stdin.flush()
        return read_block(process.stdout)
    except OSError:
        return None


def read_block(stream: IO[bytes]) -> bytes | None:
    """Read a line that says how many bytes follow, and these."""
    head = stream.readline()
    content = stream.read(int(head)) if head.strip() else b""
    return content if head.strip() and len(content) == int(head) else None


def _is_watched() -> bool:
    return sys.stderr is not None and sys.stderr.isatty()
