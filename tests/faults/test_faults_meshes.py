"""Damaged meshes: each is one error that names the fault, within its time and memory; some are sound all the same."""

from __future__ import annotations

import os
import random
import sys
from pathlib import Path

import pytest

from tests.support import damaged_meshes, trial

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="limits of memory and /proc are Linux's")

LONG = {
    "more triangles than are taken", "1500 within one another", "5000 apart", "obj of many materials",
    "glb of 100000 instances", "an archive", "an archive as a mesh", "a stream as a mesh", "another format",
    "text stl of solids only",
}  # fmt: skip
SHORT = [name for name in damaged_meshes.CASES if name not in LONG]
MEGABYTES = 600.0


def require_outcomes(names: list[str], files: list[Path], found: list[trial.Outcome]) -> None:
    bad = []
    for name, file, each in zip(names, files, found, strict=True):
        told = each.error == "InputError" and file.name in each.text and "\n" not in each.text
        wanted = not each.error if name in damaged_meshes.SOUND else told
        if not (wanted or (each.error == "InputError" and "mesh" in each.text and name not in damaged_meshes.SOUND)):
            bad.append(f"{name}: {each.error or 'no error'}: {each.text[-300:]}")
        if each.megabytes > MEGABYTES:
            bad.append(f"{name}: {each.megabytes:.0f} MB")
    assert not bad, f"{len(bad)} of {len(found)}:\n" + "\n".join(bad)


def test_there_are_sixty() -> None:
    assert len(damaged_meshes.CASES) >= 60


@pytest.mark.parametrize("names", [SHORT, pytest.param(sorted(LONG), marks=pytest.mark.faults)], ids=["short", "long"])
def test_a_damaged_mesh_is_one_error(names: list[str], tmp_path: Path) -> None:
    files = damaged_meshes.write(tmp_path, names)
    require_outcomes(names, files, trial.outcomes("mesh", files))


def test_a_pipe_is_no_mesh(tmp_path: Path) -> None:
    files = [tmp_path / "pipe.stl", tmp_path / "folder.stl", tmp_path / "zero.stl"]
    os.mkfifo(files[0])
    files[1].mkdir()
    files[2].symlink_to("/dev/zero")
    for each in trial.outcomes("mesh", files):
        assert each.error == "InputError" and "that is no regular file" in each.text


def spoilt(seed: int, count: int, folder: Path) -> list[Path]:
    """Sound files of every form with some bytes changed, left out or put in."""
    sound = {
        "stl": [damaged_meshes.stl(), damaged_meshes.stl_text().encode()],
        "obj": [damaged_meshes.obj().encode()],
        "off": [damaged_meshes.off().encode()],
        "ply": [damaged_meshes.ply(form=form) for form in ("ascii", "binary_little_endian", "binary_big_endian")],
        "glb": [damaged_meshes.glb()],
    }
    files = []
    for k in range(count):
        chance = random.Random(f"{seed} {k}")
        ending = chance.choice(sorted(sound))
        data = bytearray(chance.choice(sound[ending]))
        for _ in range(chance.choice((1, 1, 2, 8))):
            at = chance.randrange(len(data))
            data[at : at + chance.choice((0, 1, 1, 4))] = chance.randbytes(chance.choice((0, 1, 1, 4)))
        files.append(folder / f"{k:04}.{ending}")
        files[-1].write_bytes(bytes(data))
    return files


@pytest.mark.parametrize(
    ("seed", "count"), [(1, 150), *(pytest.param(seed, 2000, marks=pytest.mark.faults) for seed in range(2, 6))]
)
def test_spoilt_bytes_are_sound_or_one_error(seed: int, count: int, tmp_path: Path) -> None:
    files = spoilt(seed, count, tmp_path)
    found = trial.outcomes("mesh", files)
    bad = [f"{file.name}: {each}" for file, each in zip(files, found, strict=True) if not each.is_sound]
    assert not bad, f"{len(bad)} of {count}:\n" + "\n".join(bad)
    assert sum(each.error == "InputError" for each in found) > count / 3
