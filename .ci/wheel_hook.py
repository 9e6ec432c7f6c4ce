"""Build hook of wheels: the library of programs, compiled ahead of time (`graspfx/loop/ahead.py`).

On other systems than Linux on x86-64, without a C compiler or without LLVM the wheel brings none: programs are compiled
at first use then, and the build says so. `GRASPFX_AHEAD=off` leaves the library out.
"""

from __future__ import annotations

import os
import platform
import subprocess
import sys
from pathlib import Path
from shutil import rmtree
from tempfile import mkdtemp
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

INSIDE = "graspfx/compile/programs"


class Library(BuildHookInterface):  # type: ignore[type-arg] # of any builder
    """Adds the library to a wheel, and names the platforms that it is for."""

    folder: Path | None = None  # where the library stands until the wheel has it

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Build the library; an editable install takes none, since its kernels may be edited."""
        if version == "editable" or os.environ.get("GRASPFX_AHEAD") == "off":
            return
        if (sys.platform, platform.machine()) != ("linux", "x86_64"):
            self.app.display_warning(f"No library is built for {sys.platform} on {platform.machine()}.")
            return
        folder = self.folder = Path(mkdtemp())
        words = [sys.executable, "-m", "graspfx.loop.ahead", str(folder / "programs")]
        done = subprocess.run(
            words, cwd=self.root, env=os.environ | {"PYTHONPATH": self.root}, capture_output=True, text=True
        )
        if done.returncode:
            why = done.stderr.strip().splitlines()[-1] if done.stderr.strip() else f"exit code {done.returncode}"
            self.app.display_warning(f"No library is built; programs are compiled at first use: {why}")
            return
        build_data["pure_python"] = False
        build_data["tag"] = f"py3-none-{done.stdout.split()[-1]}"
        for file in sorted((folder / "programs").iterdir()):
            build_data["force_include"][str(file)] = f"{INSIDE}/{file.name}"

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:
        """Remove the library's folder."""
        if self.folder is not None:
            rmtree(self.folder, ignore_errors=True)
