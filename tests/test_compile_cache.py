"""Compiled programs on disk: found again, thrown away when they are not what was written, of bounded size."""

from __future__ import annotations

import math
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from graspfx.compile import cache, native
from graspfx.compile.native import compiled
from graspfx.errors import InputError, MissingPackageError

SOURCE = "def f(A, n):\n    A[0] = math.sin(A[0]) + n\n    return n\n"


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("GRASPFX_CACHE", str(tmp_path))
    return tmp_path


def works(program: native.Native) -> bool:
    A = np.ones(1)
    return program.bind(A).brief(3) == 3 and A[0] == math.sin(1.0) + 3


def test_a_second_process_does_not_compile(folder: Path) -> None:
    script = "import sys; from graspfx.compile.native import compiled; print(compiled(sys.argv[1]).cached)"
    root = {"PYTHONPATH": str(Path(native.__file__).parents[2]), "GRASPFX_CACHE": str(folder)}
    for expected in ("False", "True"):
        out = subprocess.run(
            [sys.executable, "-c", script, SOURCE],
            capture_output=True,
            text=True,
            check=True,
            env={**os.environ, **root},
        )
        assert out.stdout.strip() == expected
    assert works(compiled(SOURCE)) and compiled(SOURCE).cached


def test_another_program_is_another_entry(folder: Path) -> None:
    ways = [
        compiled(SOURCE),
        compiled(SOURCE.replace("sin", "cos")),
        compiled(SOURCE, checked=True),
    ]
    assert not any(way.cached for way in ways)
    assert len(list(folder.iterdir())) == len(ways)


def test_quick_code_is_kept_apart_and_gives_way_to_better() -> None:
    assert not compiled(SOURCE, quick=True).cached
    quick = compiled(SOURCE, quick=True)
    assert quick.cached and works(quick)
    full = compiled(SOURCE)
    assert not full.cached
    assert compiled(SOURCE, quick=True).size == full.size != quick.size


@pytest.mark.parametrize("damage", ["cut", "bit", "empty", "foreign", "unreadable"])
def test_what_is_not_as_it_was_written_is_compiled_anew(folder: Path, damage: str) -> None:
    compiled(SOURCE)
    [entry] = folder.iterdir()
    content = bytearray(entry.read_bytes())
    if damage == "cut":
        entry.write_bytes(content[:-100])
    elif damage == "bit":
        content[len(content) // 2] ^= 1
        entry.write_bytes(content)
    elif damage == "empty":
        entry.write_bytes(b"")
    elif damage == "foreign":
        compiled("def f(A, n):\n    return 0\n")
        [other] = set(folder.iterdir()) - {entry}
        entry.write_bytes(other.read_bytes())
    else:
        entry.unlink()
        entry.mkdir()
    again = compiled(SOURCE)
    assert not again.cached and works(again)
    assert (damage == "unreadable") == bool(again.note)
    assert compiled(SOURCE).cached is (damage != "unreadable")


def test_a_folder_that_cannot_be_written_is_no_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("GRASPFX_CACHE", str(tmp_path / "file" / "cache"))
    program = compiled(SOURCE)
    assert works(program) and not program.cached
    assert "can be kept in" in program.note


def test_a_user_without_a_folder_compiles_every_time(monkeypatch: pytest.MonkeyPatch) -> None:
    def homeless() -> Path:
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.delenv("GRASPFX_CACHE")
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.setattr(cache.Path, "home", homeless)
    program = compiled(SOURCE)
    assert works(program) and not program.cached
    assert "GRASPFX_CACHE" in program.note and "GRASPFX_CACHE" in cache.shown()
    with pytest.raises(InputError, match="GRASPFX_CACHE"):
        cache.require_room()


def test_code_of_another_wrapper_is_not_taken(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """`method.py` writes a part of the machine code too."""
    for file in Path(native.__file__).parent.glob("*.py"):
        (tmp_path / file.name).write_bytes(file.read_bytes())
    monkeypatch.setattr(native, "__file__", str(tmp_path / "native.py"))
    before = native._back_end.__wrapped__()
    (tmp_path / "method.py").write_text("# another one\n")
    assert native._back_end.__wrapped__() != before


def test_the_folder_stays_within_its_limit(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cache, "LIMIT", 1000)
    for k in range(6):
        assert cache.store(f"k{k}", bytes(400)) == ""
        path = folder / f"k{k}{cache.SUFFIX}"
        os.utime(path, (k, k))
    assert sorted(path.stem for path in folder.iterdir()) == ["k4", "k5"]
    assert cache.stored("k5") == bytes(400) and cache.stored("k0") is None


def test_without_llvm_it_is_said_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "llvmlite", None)
    with pytest.raises(MissingPackageError, match="pip install llvmlite"):
        compiled(SOURCE)
    assert native.interpreted(SOURCE).bind(np.ones(1)).brief(3) == 3


def test_where_the_folder_is(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.delenv("GRASPFX_CACHE")
    monkeypatch.setattr(cache.sys, "platform", "linux")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "xdg"))
    assert cache.folder() == tmp_path / "xdg" / "graspfx"
    monkeypatch.setattr(cache.sys, "platform", "win32")
    monkeypatch.setenv("LOCALAPPDATA", str(tmp_path / "local"))
    assert cache.folder() == tmp_path / "local" / "graspfx" / "Cache"
    monkeypatch.setattr(cache.sys, "platform", "darwin")
    assert cache.folder().parts[-3:] == ("Library", "Caches", "graspfx")
