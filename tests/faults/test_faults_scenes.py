"""Damaged scenes: each runs, or is one error of ours, within its time and memory."""

from __future__ import annotations

import sys
from collections import Counter
from pathlib import Path

import pytest

from tests.support import damaged_scenes, trial

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="limits of memory and /proc are Linux's")


def require_sound(kind: str, files: list[Path]) -> Counter[str]:
    """Every outcome, by the type of its error; the files of the bad ones are named."""
    found = trial.outcomes(kind, files)
    bad = [f"{file.name}: {each.error}: {each.text[:200]}" for file, each in zip(files, found, strict=True)
           if not each.is_sound]  # fmt: skip
    assert not bad, f"{len(bad)} of {len(files)}:\n" + "\n".join(bad)
    return Counter(each.error for each in found)


def test_some_damaged_scenes(tmp_path: Path) -> None:
    counts = require_sound("scene", list(damaged_scenes.write(tmp_path, 100, seed=1, names=damaged_scenes.SMALL)))
    assert counts[""] > 5 and counts["SceneError"] > 50


@pytest.mark.faults
@pytest.mark.parametrize("seed", range(2, 12))
def test_many_damaged_scenes(seed: int, tmp_path: Path) -> None:
    counts = require_sound("scene", list(damaged_scenes.write(tmp_path, 300, seed)))
    assert counts[""] > 10 and counts["SceneError"] > 100
