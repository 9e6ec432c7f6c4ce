"""The house is in order: no two files import one another, and names in texts lead somewhere."""

from __future__ import annotations

import ast
import re
from importlib import import_module
from pathlib import Path

import pytest

from tests.support.rooms import PACKAGE, ROOT, SHELF, cycles, files, imports, in_order, page, room_of, rooms, upward

GROUPS = {"graspfx.devices", "graspfx.dynamics", "graspfx.hands", "graspfx.scenes"}  # of entry points
DOTTED = re.compile(r"(?<![\w./])graspfx(?:\.\w+)+")
SHORT = re.compile(
    r"`((?:analysis|batch|bench|build|certificate|compile|cones|loop|objects|show|surfaces|testing)(?:\.\w+)+)`"
)
FILE = re.compile(r"(?<![\w./-])(?:\w+/)+\w+\.py\b")


def test_no_two_files_import_one_another() -> None:
    """Imports in functions and for type checkers count, all but the ways up that pyproject.toml lists."""
    assert cycles(imports()) == []


def test_cycles_and_imports_in_functions_and_for_type_checkers_are_seen() -> None:
    assert cycles({"a": ["b"], "b": ["c"], "c": ["b", "d"], "d": [], "e": ["e"]}) == [["b", "c"], ["e"]]
    assert "graspfx.grasp.quality.internal" in imports()["graspfx.grasp.split"]  # in a method, and for type checkers
    assert "graspfx.protocols" in imports()["graspfx.devices.simulated.point_device"]
    assert "graspfx.analysis.stability" in imports()["graspfx.certificate.mode_limits"]  # entered on the way


@pytest.mark.parametrize(("module", "other"), sorted(upward()))
def test_a_way_up_is_an_import_in_a_function(module: str, other: str) -> None:
    """At the top of a module it would load the room above with the noun, and close a cycle."""
    order = in_order(rooms())
    assert order.index(room_of(other)) < order.index(room_of(module))
    tree = ast.parse(files()[module].read_text("utf-8"))
    functions = [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)]
    made = [node.module for tree in functions for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)]
    assert other in made
    assert other not in [node.module for node in tree.body if isinstance(node, ast.ImportFrom)]


@pytest.mark.parametrize("name", sorted(name for name, path in files().items() if path.name == "__init__.py"))
def test_every_room_says_what_it_is_about(name: str) -> None:
    module = import_module(name)
    assert (module.__doc__ or "").strip()
    assert Path(str(module.__file__)) == files()[name] or name.startswith(SHELF)


def test_the_map_is_that_of_the_code() -> None:
    assert (ROOT / "docs" / "development" / "map.md").read_text("utf-8") == page(), "make map"


def leads_somewhere(name: str) -> bool:
    """Tell whether a dotted name is that of a module, or of something in one."""
    parts = name.split(".")
    for count in range(len(parts), 0, -1):
        try:
            found: object = import_module(".".join(parts[:count]))
        except ModuleNotFoundError:
            continue
        for part in parts[count:]:
            found = getattr(found, part, None)
        return found is not None
    return False


@pytest.mark.parametrize("folder", ["graspfx", "devices", "docs", "README.md", "CHANGELOG.md"])
def test_modules_and_files_that_a_text_names_are_there(folder: str) -> None:
    """Full names everywhere; in sources also those that begin with a room."""
    place = ROOT / folder
    texts = [place] if place.is_file() else sorted([*place.rglob("*.py"), *place.rglob("*.md")])
    lost = []
    for path in texts:
        text = path.read_text("utf-8")
        names = set(DOTTED.findall(text)) - GROUPS
        if path.suffix == ".py":
            names |= {f"{PACKAGE}.{name}" for name in SHORT.findall(text)}
        lost += [(path.name, name) for name in sorted(names) if not leads_somewhere(name)]
        others = [
            name for name in FILE.findall(text) if not any((ROOT / under / name).exists() for under in ("", PACKAGE))
        ]
        lost += [(path.name, name) for name in sorted(others)]
    assert texts and lost == []


def test_a_name_that_leads_nowhere_is_found() -> None:
    assert leads_somewhere("graspfx.loop.device.Device.read") and leads_somewhere("graspfx.loop.device")
    assert not leads_somewhere("graspfx.loop.device.Feature") and not leads_somewhere("graspfx.scene.limits")
