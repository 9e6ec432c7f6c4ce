"""Draws the picture of docs/tutorial/your-own-scene.md from its examples: `python docs/pictures/your_own_scene.py`."""

from __future__ import annotations

from contextlib import chdir, redirect_stdout
from doctest import DocTestParser
from io import StringIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from tests.support import page_files

HERE = Path(__file__).resolve().parent
PAGE = HERE.parent / "tutorial" / "your-own-scene.md"


def draw() -> None:
    names: dict[str, Any] = {}
    with TemporaryDirectory() as folder, chdir(folder), redirect_stdout(StringIO()):
        page_files.write(PAGE, Path(folder))
        for example in DocTestParser().get_examples(PAGE.read_text("utf-8")):
            exec(example.source, names)
            if "rec" in names:
                break
    names["rec"].picture(1.2, view=(120.0, 15.0)).save(HERE / "your-own-scene.png")


if __name__ == "__main__":
    draw()
