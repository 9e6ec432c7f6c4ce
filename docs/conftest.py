"""Run the examples of a page in a folder with the files that the page shows."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.support import page_files


@pytest.fixture(autouse=True)
def files(request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Change into the folder if the page shows any files."""
    if page_files.write(request.path, tmp_path):
        monkeypatch.chdir(tmp_path)
