"""Shared libraries from LLVM's text: the compiler of this machine links them."""

from __future__ import annotations

from pathlib import Path

from graspfx.compile.emission import emitted
from graspfx.testing.wire.c_compiler import build


def shared(text: str, folder: Path, name: str) -> Path:
    """Link a shared library of this text in a folder."""
    import llvmlite.binding as llvm

    emitted("")  # LLVM is made ready
    machine = llvm.Target.from_default_triple().create_target_machine(reloc="pic", codemodel="default")
    module = llvm.parse_assembly(text)
    module.verify()
    (folder / "fake.o").write_bytes(machine.emit_object(module))
    return build(["-shared", "fake.o"], folder / name, folder)
