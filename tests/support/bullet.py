"""Scenes of the shelf that PyBullet moves: where it has no wheel, tests of them are skipped, which says so."""

from __future__ import annotations

import re
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path

import pytest

SCENES = Path(__file__).parents[2] / "scenes"
DYNAMICS = re.compile(r'^dynamics = "bullet"', re.MULTILINE)
REASON = "pybullet has no wheel for this Python or platform"


def skip(items: Sequence[pytest.Item]) -> None:
    """Leave out the cases of such scenes, by their parameters, where PyBullet is not installed."""
    if find_spec("pybullet") is not None:
        return
    files = [file for file in SCENES.glob("*.toml") if DYNAMICS.search(file.read_text(encoding="utf-8"))]
    names = {file.stem.replace("_", "-") for file in files}
    for item in items:
        values = getattr(getattr(item, "callspec", None), "params", {}).values()
        if any(isinstance(value, str) and value in names for value in values):
            item.add_marker(pytest.mark.skip(reason=REASON))
