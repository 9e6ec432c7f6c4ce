"""Compile the programs that a wheel contains: `python -m graspfx.loop.ahead FOLDER` (see `graspfx.compile.library`).

The command needs numpy, LLVM and a C compiler. It prints the tag of the platforms on which the programs run. If
`ziglang` is installed, the command also compiles a WebAssembly module for browsers (`graspfx.compile.webassembly`).
"""

from __future__ import annotations

import sys
from importlib.util import find_spec
from pathlib import Path

from graspfx.compile import webassembly
from graspfx.compile.library import build
from graspfx.compile.llvm.llvm import LlvmProgram, llvm_program
from graspfx.compile.machine import request_of
from graspfx.compile.own_sources import all_imports, footprint
from graspfx.grasp import direct
from graspfx.loop import step_program
from graspfx.loop.realtime import beat
from graspfx.loop.realtime.pacing import arrive, set_deadline
from graspfx.loop.realtime.readings import take_sample

BY_THEMSELVES = (direct.couple, direct.couple_rows, direct.mode_rows, set_deadline, arrive, take_sample)


def programs() -> dict[str, tuple[str, LlvmProgram]]:
    """Generate all programs as LLVM IR; return name and program, by the key of the program."""
    found = {
        step_program.program_key(): ("steps", llvm_program(step_program.source())),
        footprint(beat.beat): ("beat", llvm_program(beat.source())),
    }
    for kernel in BY_THEMSELVES:
        source, floats = request_of(kernel)
        found[footprint(kernel)] = (kernel.__name__, llvm_program(source, floats, apart=False))
    return found


def modules(steps: LlvmProgram) -> dict[str, tuple[str, bytes]]:
    """Compile the program that runs ticks to a WebAssembly module; return nothing if `ziglang` is not installed."""
    if find_spec("ziglang") is None:
        return {}
    return {webassembly.module_key(step_program.program_key()): ("steps", webassembly.build(steps))}


if __name__ == "__main__":
    found = programs()
    _, steps = found[step_program.program_key()]
    print(build(found, Path(sys.argv[1]), modules(steps), all_imports()))
