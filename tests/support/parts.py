"""Parts of recordings made by hand, and programs of their own that try to lose them."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from graspfx.loop.columns import RunFault
from graspfx.recording.sink import FileSink
from tests.support.recordings import header, layout, rows

ROOT = Path(__file__).parents[2]
POSIX = pytest.mark.skipif(os.name != "posix", reason="kills a process, limits its files or removes its folder")

made = layout(3, 2)
values = rows(made, 1500)


def script(code: str, folder: Path, *arguments: str) -> Any:
    """Run a program of its own and read the JSON that it prints; it must come to its end by itself."""
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-c", code, *arguments]
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, timeout=900)
    assert done.returncode == 0, done.stderr[-3000:]
    return json.loads(done.stdout.splitlines()[-1])


def abandon(sink: FileSink) -> None:
    """Do what the system does with the file of a process that ends."""
    sink._part.file.close()


def write_part(path: Path, count: int = 1500, block: int = 200) -> FileSink:
    sink = FileSink(path, made, header())
    for first in range(0, count, block):
        faults = [RunFault(first, "unplugged")] if first == 400 else []
        sink.write(values[first : min(count, first + block)], faults)
    return sink
