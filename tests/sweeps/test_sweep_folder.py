"""Files of a sweep on a disk that is full, or whose manifest is damaged."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest

from graspfx.errors import RecordingError
from graspfx.sweeps.sweep_folder import MANIFEST, manifest_of, write_whole


def test_a_full_disk_is_left_no_draft(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(file: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(RecordingError, match="No space left"):
        write_whole(tmp_path / "chunk", b"numbers")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("damage", [{"chunk": 0}, {"created": None}])
def test_a_manifest_that_no_sweep_wrote_is_none(tmp_path: Path, damage: dict[str, object]) -> None:
    whole = {"format": 2, "identity": "a", "chunk": 5, "created": "2026"}
    (tmp_path / MANIFEST).write_text(json.dumps(whole))
    assert manifest_of(tmp_path) == whole
    own = {key: value for key, value in {**whole, **damage}.items() if value is not None}
    (tmp_path / MANIFEST).write_text(json.dumps(own))
    assert manifest_of(tmp_path) is None
