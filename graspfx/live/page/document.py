"""HTML document of a recording: one file that loads nothing and runs only its own script."""

from __future__ import annotations

import json
from base64 import b64encode
from hashlib import sha256
from html import escape
from math import isfinite
from os import PathLike
from pathlib import Path
from typing import Any

import graspfx
from graspfx.errors import InputError
from graspfx.live.page.story import story_of
from graspfx.recording.files import placing, recording_path, require_vacancy
from graspfx.recording.record import Recording

FOLDER = Path(__file__).parent
SCRIPTS = ("numbers.js", "space.js", "chart.js", "page.js")  # in this order


def page_text(recording: Recording, folder: Path | None = None) -> str:
    """Return a recording as an HTML page.

    Args:
        recording: Recording of a run.
        folder: Folder of relative mesh paths; None for the scene's folder.

    Raises:
        InputError: The recording has no ticks.
    """
    story = story_of(recording, folder)
    style, script = _read("page.css"), "\n".join(['"use strict";', *map(_read, SCRIPTS)])
    parts = {
        "policy": _policy(style, script), "generator": escape(f"GraspFX {graspfx.__version__}"),
        "title": escape(f"{story['title']} \N{EN DASH} GraspFX"), "style": style, "script": script,
        "story": in_script(story),
    }  # fmt: skip
    before, *pieces = _read("page.html").split("{")
    text = [before]
    for piece in pieces:  # each name once: what stands for it is not looked through again
        name, _, rest = piece.partition("}")
        text += [parts[name], rest]
    return "".join(text)


def write_page(
    recording: Recording, path: str | PathLike[str], *, folder: Path | None = None, overwrite: bool = False
) -> Path:
    """Write the page of a recording; see `Recording.to_html`, and `page_text` for `folder`."""
    target = require_page_name(path)
    if not overwrite:
        require_vacancy([target])
    text = page_text(recording, folder)
    with placing(target) as file:
        file.write_text(text, encoding="utf-8", newline="\n")
    return target


def require_page_name(path: str | PathLike[str]) -> Path:
    """Require the path of an HTML file.

    Raises:
        InputError: The argument is not a path, or has another ending.
    """
    target = recording_path(path, "path")
    if target.suffix.lower() not in (".html", ".htm"):
        raise InputError("path", str(path), "a file that ends in .html")
    return target


def in_script(data: Any) -> str:
    """Encode data as JSON that is safe inside an HTML element."""
    text = json.dumps(_plain(data), ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    for letter in "<>&\u2028\u2029":
        text = text.replace(letter, f"\\u{ord(letter):04x}")
    return "".join(f"\\u{ord(letter):04x}" if "\ud800" <= letter <= "\udfff" else letter for letter in text)


def _plain(data: Any) -> Any:
    """Replace non-finite numbers by null."""
    if isinstance(data, dict):
        return {key: _plain(value) for key, value in data.items()}
    if isinstance(data, list | tuple):
        return [_plain(each) for each in data]
    return None if isinstance(data, float) and not isfinite(data) else data


def _policy(style: str, script: str) -> str:
    """Return the content security policy: the page may run its own script and load nothing."""
    own = {
        f"{kind}-src": f"'sha256-{b64encode(sha256(text.encode()).digest()).decode()}'"
        for kind, text in (("style", style), ("script", script))
    }
    rules = {"default-src": "'none'", **own, "base-uri": "'none'", "form-action": "'none'"}
    return "; ".join(f"{name} {value}" for name, value in rules.items())


def _read(name: str) -> str:
    return (FOLDER / name).read_text("utf-8")
