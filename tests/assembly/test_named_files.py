"""Files that runs depend on: what a scene or a value names, and what Python imports from its own folder."""

from __future__ import annotations

from pathlib import Path

import pytest

import graspfx as gx
from graspfx.assembly.provenance import by_name, file_changes, files_of
from tests.support.small_scenes import line


@pytest.fixture
def scene(tmp_path: Path) -> gx.Scene:
    (tmp_path / "steady.py").write_text("from wrist import angle\nimport json, absent\n")
    (tmp_path / "wrist.py").write_text("def late():\n    import tendon.deep\nangle = 1.0\n")
    (tmp_path / "unused.py").write_text("angle = 1.0\n")
    (tmp_path / "tendon").mkdir()
    for name in ("__init__", "deep", "shallow"):
        (tmp_path / "tendon" / f"{name}.py").write_text("from .shallow import *\n" if name == "deep" else "")
    return line()


def test_python_counts_with_what_it_imports_from_its_own_folder(scene: gx.Scene, tmp_path: Path) -> None:
    paths = files_of(scene, {"hand": [str(tmp_path / "steady.py")]})
    names = {str(Path(path).relative_to(tmp_path)) for path in paths}
    assert names == {"steady.py", "wrist.py", "tendon/__init__.py", "tendon/deep.py", "tendon/shallow.py"}
    (tmp_path / "tendon" / "shallow.py").write_text("depth = 1\n")
    after = files_of(scene, {"hand": [str(tmp_path / "steady.py")]})
    assert file_changes(by_name(paths), by_name(after)) == ["the file shallow.py has changed"]


def test_nobodys_own_folder_is_left_out(scene: gx.Scene, tmp_path: Path) -> None:
    """A module among everybody's packages has none of its own; Python that is none counts by itself."""
    site = tmp_path / "site-packages"
    site.mkdir()
    (site / "numpy.py").touch()
    (site / "thumb.py").write_text("import numpy\nimport graspfx\n")
    (site / "odd.py").write_text("import numpy as\n")
    names = [str(site / "thumb.py"), str(site / "odd.py")]
    assert list(files_of(scene, names)) == names


def test_values_that_name_installed_plugins(scene: gx.Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    site = tmp_path / "elsewhere"
    (site / "acme_files").mkdir(parents=True)
    (site / "acme_files" / "__init__.py").touch()
    (site / "acme_files" / "gears.py").touch()
    (site / "acme_files" / "thumb.py").write_text("from acme_files.gears import teeth\n")
    info = site / "acme_files-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: acme-files\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[graspfx.devices]\nthumb = acme_files.thumb\n")
    monkeypatch.syspath_prepend(str(site))
    names = {Path(path).name for path in files_of(scene, {"device.0.name": ["simulated", "thumb"]})}
    assert names == {"thumb.py", "gears.py", "__init__.py"}
    assert not files_of(scene, {"device.0.name": ["simulated"]})


def test_files_of_one_name_keep_their_order(tmp_path: Path) -> None:
    one, two = {"/a/m.stl": "1", "/b/m.stl": "2"}, {"/b/m.stl": "1", "/a/m.stl": "2"}
    assert by_name(one) != by_name(two) and by_name(one) == by_name(dict(reversed(one.items())))
    assert file_changes(by_name(one), by_name(two)) == ["the file m.stl has changed"]
    assert file_changes({"old": "1"}, {"new": "1"}) == [
        "the file new is used here but was not used there",
        "the file old was used there but is not used here, or is missing",
    ]
