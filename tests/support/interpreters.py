"""Other Pythons of this machine: `python -m tests.support.interpreters 3.12` prints where one is, and fails without."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[2]
PART = ROOT / "tests" / "part.txt"
QUESTION = "import sys, venv; print(*sys.version_info[:2], sep='.')"


def part() -> list[str]:
    """List the files that are tested on other Pythons, from the root."""
    lines = PART.read_text(encoding="utf-8").splitlines()
    return [line for line in lines if line and not line.startswith("#")]


def places(version: str) -> Iterator[str]:
    """Name where a Python of a version may be: what uv manages or sees, the PATH, and pyenv's folder.

    Nothing is downloaded.
    """
    if (uv := shutil.which("uv")) is not None:
        done = subprocess.run(
            [uv, "python", "find", "--no-python-downloads", version], capture_output=True, text=True, encoding="utf-8"
        )
        if done.returncode == 0:
            yield done.stdout.strip()
    if (path := shutil.which(f"python{version}")) is not None:
        yield path
    home = Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv"))
    yield from map(str, sorted((home / "versions").glob(f"{version}.*/bin/python{version}"), reverse=True))


def is_of(version: str, path: str) -> bool:
    """Tell whether a program is a Python of a version that makes environments; pyenv's names alone are none."""
    try:
        done = subprocess.run(
            [path, "-c", QUESTION], capture_output=True, text=True, encoding="utf-8", timeout=60.0, cwd="/"
        )
    except (OSError, subprocess.TimeoutExpired):
        return False
    return done.returncode == 0 and done.stdout.strip() == version


def interpreter(version: str) -> str | None:
    """Find a Python of a version, such as 3.12; None where none runs."""
    return next((path for path in places(version) if is_of(version, path)), None)


if __name__ == "__main__":
    place = interpreter(sys.argv[1])
    if place is None:
        sys.exit(1)
    print(place)
