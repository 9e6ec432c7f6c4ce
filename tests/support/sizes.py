"""Size and time of an installation, by extra: `python -m tests.support.sizes` prints a table of docs/how-to/install.md.

Each is installed by uv into a fresh environment: once from the registry, with nothing in uv's cache, and once from it.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import time
import tomllib
from pathlib import Path
from tempfile import TemporaryDirectory

from tests.support.clean_install import distributions

ROOT = Path(__file__).parents[2]
LARGE = 20.0  # of a package that is listed by itself [MB]


def size(folder: Path) -> float:
    """Add up the files of a folder [MB]."""
    return 1e-6 * sum(path.stat().st_size for path in folder.rglob("*") if path.is_file() and not path.is_symlink())


def install(home: Path, wish: str, *options: str) -> float:
    """Install into a fresh environment; give the time that the packages took [s]."""
    uv, python = shutil.which("uv") or "uv", str(home / "bin" / "python")
    subprocess.run([uv, "venv", "--quiet", "--python", sys.executable, str(home)], check=True)
    began = time.perf_counter()
    subprocess.run([uv, "pip", "install", "--quiet", "--python", python, *options, wish], check=True)
    return time.perf_counter() - began


def site_of(home: Path) -> Path:
    """Find the folder of packages of an environment."""
    [site] = home.glob("lib/python*/site-packages")
    return site


def main() -> None:
    """Print a row for each extra, and the largest packages of an installation without any."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    with TemporaryDirectory() as folder:
        _, wheel = distributions(Path(folder, "dist"))
        base, packages = 0.0, []
        print("| installed | size | more | from the registry | again |\n|---|---|---|---|---|")
        for extra in ("", *project["optional-dependencies"]):
            wish = f"{wheel}[{extra}]" if extra else str(wheel)
            first = install(Path(folder, f"first-{extra}"), wish, "--no-cache")
            again = install(Path(folder, f"again-{extra}"), wish)
            site = site_of(Path(folder, f"first-{extra}"))
            total = size(site)
            if not extra:
                base = total
                packages = [(size(path), path.name) for path in site.iterdir() if path.is_dir()]
                packages += [(1e-6 * path.stat().st_size, path.name) for path in site.iterdir() if path.is_file()]
            name, more = f"`[{extra}]`" if extra else "GraspFX", f"{total - base:.0f} MB" if extra else ""
            print(f"| {name} | {total:.0f} MB | {more} | {first:.0f} s | {again:.1f} s |", flush=True)
            shutil.rmtree(Path(folder, f"first-{extra}"))
            shutil.rmtree(Path(folder, f"again-{extra}"))
    print()
    for amount, name in sorted(packages, reverse=True):
        if amount >= LARGE:
            print(f"{amount:6.0f} MB  {name}")


if __name__ == "__main__":
    main()
