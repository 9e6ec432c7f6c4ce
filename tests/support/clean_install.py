"""Distributions as users install them: `python -m tests.support.clean_install` builds and runs them.

The wheel is built from the source distribution, which gives the same files as the checkout does. Outside of the
checkout a scene is run and checked, and the notebook of docs/notebooks executed.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path
from tempfile import TemporaryDirectory

from hatchling import build

ROOT = Path(__file__).parents[2]
NOTEBOOK = ROOT / "docs" / "notebooks" / "first-steps.ipynb"
KERNEL = ("nbclient", "ipykernel")
BITS = """
import sys
import graspfx as gx
names = ("reference-1dof", "paper-spring", "paper-waving", "sphere-three-fingers", "thin-plate", "prism")
runs = [gx.run(name, duration=0.2) for name in names]
assert all(run.outcome.engine == "compiled" for run in runs)
assert "llvmlite" not in sys.modules, "the library was not used"
for name, run in zip(names, runs):
    again = gx.run(gx.load(name, {"engine": "interpreted"}), duration=0.2)
    assert again.outcome.engine == "interpreted" and again.rows.tobytes() == run.rows.tobytes(), name
"""


def distributions(out: Path) -> tuple[Path, Path]:
    """Build the source distribution, and from it the wheel; require the checkout's own wheel to be the same."""
    out.mkdir(parents=True, exist_ok=True)
    with TemporaryDirectory() as folder:
        os.chdir(ROOT)
        sdist = out / build.build_sdist(str(out))
        direct = Path(folder, build.build_wheel(folder))
        with tarfile.open(sdist) as archive:
            archive.extraction_filter = getattr(tarfile, "data_filter", None)
            archive.extractall(folder)
        os.chdir(Path(folder, sdist.name.removesuffix(".tar.gz")))
        wheel = out / build.build_wheel(str(out))
        os.chdir(ROOT)
        if contents(wheel) != contents(direct):
            raise SystemExit("the wheel from the source distribution is not that of the checkout")
    return sdist, wheel


def contents(wheel: Path) -> dict[str, bytes]:
    """Read the files of a wheel."""
    with zipfile.ZipFile(wheel) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def install(home: Path, *packages: str) -> Path:
    """Make an environment with packages, by uv where it is; give its folder of programs."""
    bin, uv = home / "bin", shutil.which("uv")
    if uv is None:
        call([sys.executable, "-m", "venv", str(home)])
        call([str(bin / "python"), "-m", "pip", "install", "--quiet", "--disable-pip-version-check", *packages])
    else:
        call([uv, "venv", "--quiet", "--python", sys.executable, str(home)])
        call([uv, "pip", "install", "--quiet", "--python", str(bin / "python"), *packages])
    return bin


def call(words: list[str], cwd: Path | None = None) -> None:
    """Run a program without what this environment sets for Python; its end is ours where it fails."""
    unset = ("PYTHONPATH", "VIRTUAL_ENV", "PYTHONHOME")
    environment = {name: value for name, value in os.environ.items() if name not in unset}
    done = subprocess.run(words, cwd=cwd, env=environment, stdin=subprocess.DEVNULL)
    if done.returncode:
        raise SystemExit(f"failed with code {done.returncode}: {' '.join(words)}")


def try_out(wheel: Path) -> None:
    """Run what a wheel brings, in an environment of its own and a folder that is no checkout."""
    with TemporaryDirectory() as folder:
        home, work = Path(folder, "environment"), Path(folder, "work")
        work.mkdir()
        bin = install(home, str(wheel), *KERNEL)
        code = f"import graspfx; assert graspfx.__file__.startswith({str(home)!r}), graspfx.__file__"
        call([str(bin / "python"), "-c", code], work)
        if not wheel.name.endswith("-none-any.whl"):
            call([str(bin / "python"), "-c", BITS], work)
            print("library of programs: the bits of the interpreter, and LLVM not loaded")
        call([str(bin / "graspfx"), "check", "paper-waving"], work)
        call([str(bin / "graspfx"), "run", "paper-waving", "--duration", "0.5"], work)
        if not wheel.name.endswith("-none-any.whl"):
            call([str(bin / "graspfx"), "page", "paper-waving"], work)  # with the module that the wheel brings
        shutil.copy(NOTEBOOK, work)
        call([str(bin / "jupyter-execute"), "--kernel_name=python3", NOTEBOOK.name], work)
        print(f"{NOTEBOOK.name}: executed")
        uvx = shutil.which("uvx")
        if uvx is not None:
            call([uvx, "--quiet", "--python", sys.executable, "--from", str(wheel), "graspfx", "list"], work)
            print("uvx: ran")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("dist"))
    sdist, wheel = distributions(parser.parse_args().out.resolve())
    try_out(wheel)
    for file in (sdist, wheel):
        print(f"{file.name}: {1e-6 * file.stat().st_size:.1f} MB")
