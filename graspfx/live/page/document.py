"""HTML document that shows a recording, a scene that the page itself runs, or a live run, and loads no other files."""

from __future__ import annotations

import json
from base64 import b64encode
from collections.abc import Callable, Mapping
from hashlib import sha256
from html import escape
from math import isfinite
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import graspfx
from graspfx.errors import InputError
from graspfx.live.page.story import Source, story_of
from graspfx.recording.files import placing, recording_path, require_vacancy
from graspfx.recording.record import Recording

if TYPE_CHECKING:
    from graspfx.scene.model import Scene

FOLDER = Path(__file__).parent
SCRIPTS = {  # scripts of a page in loading order, by the source of its frames
    "recording": ("numbers.js", "space.js", "chart.js", "run.js", "page.js"),
    "own": ("numbers.js", "space.js", "chart.js", "run.js", "own.js", "page.js"),
    "live": ("numbers.js", "space.js", "chart.js", "run.js", "live.js", "page.js"),
}


def page_text(
    recording: Recording, folder: Path | None = None, run: Callable[[int], dict[str, Any]] | None = None
) -> str:
    """Return an HTML page that plays a recording or, with `run`, runs the recording's scene.

    Args:
        recording: Recording of a run.
        folder: Folder to which mesh paths are relative; None for the scene's folder.
        run: Function that takes the number of ticks per drawn frame and returns the data for running the scene in the
            page; None for a page that plays the recording.

    Raises:
        InputError: If the recording has no ticks.
    """
    story = story_of(recording, folder, source="recording" if run is None else "own")
    if run is None:
        return document(story)
    return document(story | {"run": run(story["ticks"])}, "own")


def document(story: Mapping[str, Any], source: Source = "recording", connects: str = "") -> str:
    """Assemble the HTML document of a page.

    Args:
        story: Data of the page, from `story_of`; a page that shows a run also needs the entry "run".
        source: Source of the page's frames.
        connects: Address of the WebSocket that sends the frames, such as ws://127.0.0.1:8080; empty for no WebSocket.
    """
    worker = f'"use strict";\n{_script("worker.js")}' if source == "own" else ""
    style, script = _read("page.css"), "\n".join(['"use strict";', *map(_script, SCRIPTS[source])])
    parts = {
        "policy": _policy(style, script, runs=source == "own", connects=connects), "worker": worker,
        "generator": escape(f"GraspFX {graspfx.__version__}"),
        "title": escape(f"{story['title']} \N{EN DASH} GraspFX"), "style": style, "script": script,
        "story": in_script(story),
    }  # fmt: skip
    before, *pieces = _read("page.html").split("{")
    text = [before]
    for piece in pieces:  # each name is replaced once: inserted text is not searched for names
        name, _, rest = piece.partition("}")
        text += [parts[name], rest]
    return "".join(text)


def write_page(
    recording: Recording, path: str | PathLike[str], *, folder: Path | None = None, overwrite: bool = False
) -> Path:
    """Write a page that plays a recording; see `Recording.to_html`, and for `folder` see `page_text`."""
    return _write(path, lambda: page_text(recording, folder), overwrite=overwrite)


def write_running_page(
    scene: Scene, path: str | PathLike[str], *, presets: Mapping[str, Mapping[str, float]], overwrite: bool = False
) -> Path:
    """Write a page that runs a scene; see `Scene.to_html`."""
    from graspfx.assembly.run_scene import run
    from graspfx.live.guides import guided_scene
    from graspfx.live.page.running import require_runnable, running

    if not isinstance(presets, Mapping):
        raise InputError("presets", presets, "values by key, by the name of a button")

    def text() -> str:
        own = guided_scene(scene.replace({"record.every": 1, "record.columns": []}))
        require_runnable(own)
        return page_text(run(own), run=lambda frames: running(own, frames, presets))

    return _write(path, text, overwrite=overwrite)


def _write(path: str | PathLike[str], text: Callable[[], str], *, overwrite: bool) -> Path:
    """Check the path of a page, then compute the text of the page and write it."""
    target = require_page_name(path)
    if not overwrite:
        require_vacancy([target])
    page = text()
    with placing(target) as file:
        file.write_text(page, encoding="utf-8", newline="\n")
    return target


def require_page_name(path: str | PathLike[str]) -> Path:
    """Convert the path of an HTML file to a Path.

    Raises:
        InputError: If the argument is not a path, or if the path does not end in .html or .htm.
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
    """Replace non-finite numbers in nested data by None."""
    if isinstance(data, dict):
        return {key: _plain(value) for key, value in data.items()}
    if isinstance(data, list | tuple):
        return [_plain(each) for each in data]
    return None if isinstance(data, float) and not isfinite(data) else data


def _policy(style: str, script: str, *, runs: bool, connects: str) -> str:
    """Return the content security policy of a page.

    The page may run its own script and load nothing. If `runs`, the page may also start a worker from its own text and
    compile the WebAssembly module in its data. The page may open the WebSocket `connects`, unless this is empty.
    """
    own = {
        f"{kind}-src": f"'sha256-{b64encode(sha256(text.encode()).digest()).decode()}'"
        for kind, text in (("style", style), ("script", script))
    }
    if runs:
        own = {**own, "script-src": f"{own['script-src']} 'wasm-unsafe-eval'", "worker-src": "blob:"}
    if connects:
        own = {**own, "connect-src": connects}
    rules = {"default-src": "'none'", **own, "base-uri": "'none'", "form-action": "'none'"}
    return "; ".join(f"{name} {value}" for name, value in rules.items())


def _read(name: str) -> str:
    return (FOLDER / name).read_text("utf-8")


def _script(name: str) -> str:
    """Read a script without comment lines and indentation, which browsers do not need."""
    lines = (line.strip() for line in _read(name).splitlines())
    return "\n".join(line for line in lines if line and not line.startswith("//"))
