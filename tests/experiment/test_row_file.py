"""Rows that a full disk does not take leave nothing of themselves."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from graspfx.errors import RecordingError
from graspfx.experiment.session_files import RowFile


def test_half_a_row_is_taken_back(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write = os.write

    def full(file: int, data: bytes) -> int:
        if len(data) < 4:
            raise OSError(28, "No space left on device")
        return write(file, data[:3])

    with RowFile(tmp_path / "rows.tsv", ["one", "two"]) as rows:
        rows.write({"one": "1", "two": "2"})
        with monkeypatch.context() as patch:
            patch.setattr(os, "write", full)
            with pytest.raises(RecordingError, match="No space left"):
                rows.write({"one": "333", "two": "44444"})
        rows.write({"one": "5", "two": "6"})
    assert (tmp_path / "rows.tsv").read_text().splitlines() == ["one\ttwo", "1\t2", "5\t6"]
