"""Rows that a full disk does not take leave nothing of themselves."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from graspfx.errors import InputError, RecordingError
from graspfx.experiment.session_files import RowFile
from graspfx.experiment.trial_table import read_table


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


def test_a_table_in_another_encoding_is_named(tmp_path: Path) -> None:
    """A program of offices saves it in Latin 1: the error says which file, which line, and what was expected."""
    path = tmp_path / "rows.tsv"
    content = "condition\tresponse\nsoft\tja\nh\u00e4rter\tnein\n".encode("latin-1")
    path.write_bytes(content)
    for read in (read_table, lambda path: RowFile(path, ["condition", "response"], resume=True)):
        with pytest.raises(InputError, match="expected a table in UTF-8") as error:
            read(path)
        assert "rows.tsv, line 3" in str(error.value)
    assert path.read_bytes() == content


def test_tables_that_are_empty_or_have_odd_rows(tmp_path: Path) -> None:
    path = tmp_path / "rows.tsv"
    path.write_text("")
    assert read_table(path) == []
    path.write_text("one\ttwo\n1\t2\n3\n")
    with pytest.raises(InputError, match=r"rows\.tsv, line 3: .*1 cells.* expected 2 cells"):
        read_table(path)
