"""The house is in order: no two files import one another, no name of a file stands twice, no file is too long."""

from __future__ import annotations

from collections import Counter
from importlib import import_module
from pathlib import Path

import pytest

from graspfx import plugins
from tests.support.rooms import PACKAGE, ROOT, SHELF, cycles, files, imports, in_order, page, rooms

LONGEST = 400  # lines


def test_no_two_files_import_one_another() -> None:
    """Imports in functions and for type checkers count; `plugins.UPWARD` is the one way up, by name."""
    assert cycles(imports()) == []


def test_a_cycle_is_found() -> None:
    graph = {"a": ["b"], "b": ["c"], "c": ["b", "d"], "d": [], "e": ["e"]}
    assert cycles(graph) == [["b", "c"], ["e"]]


def test_imports_in_functions_and_for_type_checkers_are_seen() -> None:
    assert "graspfx.grasp.quality.internal" in imports()["graspfx.grasp.split"]  # in a method, and for type checkers
    assert "graspfx.loop.device" in imports()["graspfx.devices.simulated"]
    assert "graspfx.analysis.stability" in imports()["graspfx.certificate.mode_limits"]  # entered on the way


@pytest.mark.parametrize("name", sorted(plugins.UPWARD))
def test_the_way_up_leads_up(name: str) -> None:
    module, _, function = plugins.UPWARD[name].rpartition(".")
    assert callable(getattr(import_module(module), function))
    order = in_order(rooms())
    home = {"Recording": "loop", "Scene": "scene"}[name.partition(".")[0]]
    assert order.index(module.split(".")[1]) < order.index(home)


def test_no_name_of_a_file_stands_twice() -> None:
    """Commands are named as users type them, and the files of packages as Python asks."""
    stems = [path.stem for name, path in files().items() if not name.startswith(f"{PACKAGE}.commands.")]
    assert [name for name, count in Counter(stems).items() if count > 1] == ["__init__"]


def test_no_file_is_too_long() -> None:
    long = {name: len(path.read_text("utf-8").splitlines()) for name, path in files().items()}
    assert {name: count for name, count in long.items() if count > LONGEST} == {}


@pytest.mark.parametrize("name", sorted(name for name, path in files().items() if path.name == "__init__.py"))
def test_every_room_says_what_it_is_about(name: str) -> None:
    module = import_module(name)
    assert (module.__doc__ or "").strip()
    assert Path(str(module.__file__)) == files()[name] or name.startswith(SHELF)


def test_the_map_is_that_of_the_code() -> None:
    assert (ROOT / "docs" / "development" / "map.md").read_text("utf-8") == page(), "make map"
