"""Write the files that a page's examples read: code blocks whose first line is a comment with the file's name."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

BLOCK = re.compile(r"^```(?:toml|python)\n(# ([\w-]+\.(?:toml|py))\b.*?)^```", re.MULTILINE | re.DOTALL)


@pytest.fixture(autouse=True)
def files(request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Run the page in a folder with its files; blocks that name the same file are joined in order."""
    for text, name in BLOCK.findall(request.path.read_text(encoding="utf-8")):
        with (tmp_path / name).open("a", encoding="utf-8") as file:
            file.write(text)
        monkeypatch.chdir(tmp_path)
