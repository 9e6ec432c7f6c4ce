"""Compiled programs on disk: found again, thrown away when they are not what was written, of bounded size."""

from __future__ import annotations

import hashlib
import math
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from graspfx.compile import cache, emission, native
from graspfx.compile.native import compiled
from graspfx.errors import InputError, MissingPackageError

SOURCE = "def f(A, n):\n    A[0] = math.sin(A[0]) + n\n    return n\n"


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("GRASPFX_CACHE", str(tmp_path))
    return tmp_path


def works(program: native.Native) -> bool:
    A = np.ones(1)
    assert program.arrays == ["A"]
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
        compiled(SOURCE, apart=False),
    ]
    assert not any(way.cached for way in ways)
    assert len(list(folder.iterdir())) == len(ways)


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
    assert "cannot write to the cache" in program.note


def test_a_user_without_a_folder_compiles_every_time(monkeypatch: pytest.MonkeyPatch) -> None:
    def homeless() -> Path:
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.delenv("GRASPFX_CACHE")
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.setattr(Path, "home", homeless)
    program = compiled(SOURCE)
    assert works(program) and not program.cached
    assert "GRASPFX_CACHE" in program.note and "GRASPFX_CACHE" in cache.folder_text()
    with pytest.raises(InputError, match="GRASPFX_CACHE"):
        cache.require_room()


def test_code_of_another_wrapper_is_not_taken(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """`method.py` writes a part of the machine code too."""
    shutil.copytree(Path(native.__file__).parent / "llvm", tmp_path / "llvm")
    for module in (native, emission):
        shutil.copy(str(module.__file__), tmp_path)
    monkeypatch.setattr(emission, "__file__", str(tmp_path / "emission.py"))
    before = emission._back_end.__wrapped__()
    (tmp_path / "llvm" / "method.py").write_text("# another one\n")
    assert emission._back_end.__wrapped__() != before


def test_the_folder_stays_within_its_limit(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cache, "LIMIT", 1000)
    for k in range(6):
        assert cache.store(f"k{k}", bytes(400)) == ""
        path = folder / f"k{k}{cache.SUFFIX}"
        os.utime(path, (k, k))
    assert sorted(path.stem for path in folder.iterdir()) == ["k4", "k5"]
    assert cache.load("k5") == bytes(400) and cache.load("k0") is None


def test_without_llvm_it_is_said_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "llvmlite", None)
    with pytest.raises(MissingPackageError, match="pip install llvmlite"):
        compiled(SOURCE)


def test_where_the_folder_is(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.delenv("GRASPFX_CACHE")
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "xdg"))
    assert cache.folder() == tmp_path / "xdg" / "graspfx"
    monkeypatch.setattr(sys, "platform", "win32")
    monkeypatch.setenv("LOCALAPPDATA", str(tmp_path / "local"))
    assert cache.folder() == tmp_path / "local" / "graspfx" / "Cache"
    monkeypatch.setattr(sys, "platform", "darwin")
    assert cache.folder().parts[-3:] == ("Library", "Caches", "graspfx")


# Others' hands ----------------------------------------------------------------------------------------------------

users = pytest.mark.skipif(not hasattr(os, "getuid"), reason="users have no numbers on this platform")


@pytest.fixture
def kept_in(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A cache with an entry, two folders below one that is the test's own."""
    place = folder / "above" / "cache"
    monkeypatch.setenv("GRASPFX_CACHE", str(place))
    assert cache.store("key", b"content") == "" and cache.load("key") == b"content"
    return place


def test_folders_and_entries_are_their_users_alone(kept_in: Path) -> None:
    (entry,) = kept_in.iterdir()
    assert [path.stat().st_mode & 0o777 for path in (kept_in.parent, kept_in, entry)] == [0o700, 0o700, 0o600]


def forge(name: str, kept_in: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Open the way for an entry of somebody else's."""
    (entry,) = kept_in.iterdir()
    mine, nobody = os.getuid(), 12345
    real_lstat, real_fstat = Path.lstat, os.fstat

    def owned(status: os.stat_result) -> os.stat_result:
        return os.stat_result([*status[:4], nobody, *status[5:]])

    def link(to: Path) -> None:
        kept_in.rename(to)
        kept_in.symlink_to(to)

    if name in ("folder of another's", "parent of another's", "link of another's"):
        other = kept_in.parent if name.startswith("parent") else kept_in
        if name.startswith("link"):
            link(kept_in.parent / "elsewhere")
        monkeypatch.setattr(Path, "lstat", lambda path: (owned if path == other else lambda s: s)(real_lstat(path)))
    elif name == "entry of another's":
        monkeypatch.setattr(os, "fstat", lambda handle: owned(real_fstat(handle)))
    elif name == "link into an open folder":
        (kept_in.parent / "open").mkdir()
        link(kept_in.parent / "open" / "elsewhere")
        (kept_in.parent / "open").chmod(0o777)
    elif name == "linked entry":
        entry.rename(kept_in / "elsewhere")
        entry.symlink_to(kept_in / "elsewhere")
    elif name == "pipe":
        entry.unlink()
        os.mkfifo(entry)
    elif name == "user that changed":
        monkeypatch.setattr(os, "getuid", lambda: mine + 1)
    else:
        place, mode = {"folder": kept_in, "parent": kept_in.parent, "entry": entry}[name.split()[0]], name.split()[-1]
        place.chmod(int(mode, 8))


@users
@pytest.mark.parametrize(
    "name",
    [
        "folder of mode 770", "folder of mode 702", "folder of mode 1777", "parent of mode 777", "parent of mode 720",
        "entry of mode 620", "entry of mode 602", "folder of another's", "parent of another's", "link of another's",
        "entry of another's", "link into an open folder", "linked entry", "pipe", "user that changed",
    ],
)  # fmt: skip
def test_what_others_could_have_forged_is_not_used(name: str, kept_in: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    forge(name, kept_in, monkeypatch)
    with pytest.warns(cache.CacheWarning, match="is not used: .*GRASPFX_CACHE") as caught:
        assert cache.load("key") is None
    assert len(caught) == 1 and "\n" not in str(caught[0].message)


@users
def test_a_sticky_folder_above_is_no_danger(kept_in: Path) -> None:
    kept_in.parent.chmod(0o1777)
    assert cache.load("key") == b"content"


@users
def test_a_link_of_ones_own_is_followed(kept_in: Path) -> None:
    kept_in.rename(kept_in.parent / "elsewhere")
    kept_in.symlink_to("elsewhere")
    assert cache.load("key") == b"content"


@users
def test_nothing_is_kept_where_others_write(kept_in: Path) -> None:
    kept_in.chmod(0o777)
    before = {entry: entry.read_bytes() for entry in kept_in.iterdir()}
    with pytest.warns(cache.CacheWarning):
        assert "others may write to" in cache.store("key", b"other")
    assert before == {entry: entry.read_bytes() for entry in kept_in.iterdir()}
    with pytest.raises(InputError, match="other users cannot write"):
        cache.require_room()


def test_where_users_have_no_numbers_nothing_is_asked(kept_in: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    kept_in.chmod(0o777)
    monkeypatch.delattr(os, "getuid", raising=False)
    assert cache.load("key") == b"content"


@users
def test_a_forged_program_in_a_shared_folder_is_not_run(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """Somebody puts the machine code of another force law under the key of ours, with its digest right."""
    compiled(SOURCE)
    (ours,) = folder.iterdir()
    forged = SOURCE.replace("+ n", "+ 1000.0 * n")
    compiled(forged)
    (theirs,) = set(folder.iterdir()) - {ours}
    content = theirs.read_bytes()[32:]
    ours.write_bytes(hashlib.sha256(ours.stem.encode() + content).digest() + content)
    assert not works(compiled(SOURCE))  # whoever may write to the folder can do that
    folder.chmod(0o777)
    script = (
        "from graspfx.__main__ import _plain_warnings\nfrom graspfx.compile.native import compiled\nimport sys\n"
        "with _plain_warnings(): [compiled(sys.argv[1]) for _ in range(3)]"
    )
    root = {"PYTHONPATH": str(Path(native.__file__).parents[2]), "GRASPFX_CACHE": str(folder)}
    subprocess.run([sys.executable, "-c", script, SOURCE], check=True, env={**os.environ, **root})
    (line,) = capfd.readouterr().err.splitlines()
    assert line.startswith(f"warning: the cache {folder} is not used: others may write to")
    with pytest.warns(cache.CacheWarning):
        program = compiled(SOURCE)
    assert works(program) and not program.cached
