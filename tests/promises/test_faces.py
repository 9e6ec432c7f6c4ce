"""Public faces: documents, scenes and drivers import nothing else, and `dir()` shows nothing else."""

from __future__ import annotations

import re
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from types import ModuleType

import pytest

import graspfx as gx
from tests.support.face import page
from tests.support.rooms import ROOT

FACES = ("graspfx", "graspfx.protocols", "graspfx.testing", "graspfx.testing.wire")  # that an import statement may name
SHELF = "graspfx.devices"  # drivers, on which another's may be built
IMPORT = re.compile(r"^\W*(?:import (graspfx[\w.]*)|from (graspfx[\w.]*) import (.+?))(?: as \w+)?\s*(?:#.*)?$")
USE = re.compile(r"\bgx\.([a-z_A-Z]\w*)(?:\.([a-z_A-Z]\w*))?")
FENCE = re.compile(r"^```python\n(.*?)^```", re.DOTALL | re.MULTILINE)
MODULES = {
    "style": gx.style,
    "stability": gx.stability,
    "passivity": gx.passivity,
    "experiment": gx.experiment,
    "testing": gx.testing,
    "protocols": gx.protocols,
}

# docs/development is about the house, and imports what it is about
PAGES = [ROOT / "README.md", *(path for path in (ROOT / "docs").rglob("*.md") if "development" not in path.parts)]
SCRIPTS = [*(ROOT / "docs").rglob("*.py"), *(ROOT / "scenes").rglob("*.py")]


def code_of(path: Path) -> str:
    """Take what is Python of a file: all of it, or the blocks of a page."""
    text = path.read_text("utf-8")
    return text if path.suffix == ".py" else "\n".join(FENCE.findall(text))


def trespasses(code: str) -> Iterator[str]:
    """List what code imports, or reaches through `gx`, that is no public name."""
    for line in code.splitlines():
        match = IMPORT.match(line)
        if match:
            module, names = match[1] or match[2], (match[3] or "").split(", ")
            if module.startswith(SHELF):
                continue
            public = import_module(module).__all__ if module in FACES else []
            if module not in FACES or any(name.partition(" ")[0] not in public for name in names if name):
                yield line.strip()
        for name, member in USE.findall(line):
            module_ = MODULES.get(name)
            if name not in gx.__all__ or (module_ is not None and member and member not in module_.__all__):
                yield f"gx.{name}.{member}".rstrip(".")


@pytest.mark.parametrize("path", [*PAGES, *SCRIPTS], ids=lambda path: path.name)
def test_documents_and_scenes_use_public_names(path: Path) -> None:
    assert list(trespasses(code_of(path))) == []


@pytest.mark.parametrize("path", sorted((ROOT / "devices").rglob("*.py")), ids=lambda path: path.name)
def test_drivers_import_the_protocols_alone(path: Path) -> None:
    """A driver that is used on hardware comes by no test code: an emulator alone imports the kit's wire."""
    allowed = r"protocols|devices\b(?![\w.]*\.emulator)[\w.]*" + (
        r"|testing\.wire" if path.name == "emulator.py" else ""
    )
    lines = [line for line in path.read_text("utf-8").splitlines() if re.match(r"\s*(from|import) graspfx", line)]
    assert [line for line in lines if not re.match(rf"\s*from graspfx\.({allowed}) import (?!emulator)", line)] == []


def test_what_is_no_public_name_is_seen() -> None:
    code = ">>> from graspfx.assembly.run_scene import run\n... import graspfx.loop\n"
    code += ">>> from graspfx import plugins, testing\n"
    code += ">>> gx.stability.wall_limit(1), gx.stability.roots, gx.plugins.load, gx.errors.InputError\n"
    code += "... from graspfx.protocols import Device, Servo\n>>> from graspfx.devices.simulated import connect\n"
    code += "import graspfx as gx  # the package\nfrom graspfx.protocols import Features as Told\n"
    seen = [line.lstrip(">. ") for line in trespasses(code)]
    assert seen == [
        "from graspfx.assembly.run_scene import run",
        "import graspfx.loop",
        "from graspfx import plugins, testing",
        "gx.stability.roots",
        "gx.plugins.load",
        "from graspfx.protocols import Device, Servo",
    ]


@pytest.mark.parametrize("module", [gx, gx.stability, gx.passivity, gx.testing, gx.protocols, gx.errors, gx.style])
def test_a_module_shows_its_public_names_alone(module: ModuleType) -> None:
    assert dir(module) == sorted(module.__all__) and len(set(module.__all__)) == len(module.__all__)
    assert all(getattr(module, name) is not None for name in module.__all__)


def test_the_page_of_the_face_is_that_of_the_code() -> None:
    assert (ROOT / "docs" / "reference" / "python.md").read_text("utf-8") == page(), "make face"
