"""The files that a page's examples read: code blocks whose first line is a comment with the file's name."""

from __future__ import annotations

import re
from pathlib import Path

BLOCK = re.compile(r"^```(?:toml|python)\n(# ([\w-]+\.(?:toml|py))\b.*?)^```", re.MULTILINE | re.DOTALL)


def write(page: Path, folder: Path) -> bool:
    """Write the files of a page into a folder, and return whether there are any; blocks of the same file are joined."""
    found = BLOCK.findall(page.read_text(encoding="utf-8"))
    for text, name in found:
        with (folder / name).open("a", encoding="utf-8") as file:
            file.write(text)
    return bool(found)
