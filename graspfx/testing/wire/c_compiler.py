"""The C compiler of this machine, where it has one."""

from __future__ import annotations

import subprocess
from collections.abc import Sequence
from pathlib import Path
from shutil import which

from graspfx.errors import MissingPackageError

STRICT = ("-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "-O2")


def compiler() -> str | None:
    """Find the compiler, gcc or what calls itself cc; None where there is none."""
    return which("gcc") or which("cc")


def build(arguments: Sequence[str], product: Path, folder: Path) -> Path:
    """Call the compiler with these arguments, in a folder, for a product.

    Raises:
        MissingPackageError: there is no compiler.
        RuntimeError: it refuses the source; the text is what it says.
    """
    program = compiler()
    if program is None:
        raise MissingPackageError("gcc", "the emulator of the rig", "install a C compiler")
    call = [program, *arguments, "-o", str(product)]
    answer = subprocess.run(call, cwd=folder, capture_output=True, text=True, check=False)
    if answer.returncode:
        raise RuntimeError(f"{' '.join(call)}:\n{answer.stderr}")
    return product
