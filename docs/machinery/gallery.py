"""Gallery of the built-in scenes: a card for each scene with its picture, and its file below its section."""

from __future__ import annotations

import ast
import re
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import graspfx as gx

if TYPE_CHECKING:
    from sphinx.application import Sphinx

PAGE = "scenes"
RUN = "run"  # folder of the pages that run scenes
WITHOUT = ("two-objects", "twenty-fingers")  # one has bodies of PyBullet, one would be a page of 3 MB
FRONT = "two-stiffnesses"  # on the front page
GAINS = "coupling.external.stiffness", "coupling.internal.stiffness"
PAIRS = {"too soft": (30.0, 30.0), "unstable": (80.0, 80.0), "both good": (30.0, 80.0)}  # [N/m]
SCENES = Path(__file__).parents[2] / "scenes"
PICTURE = r"!\[(?P<alt>[^\]]*)\]\([^)]*\)"
SECTION = re.compile(rf"^### (?P<name>[\w-]+)\n\n{PICTURE}\n\n(?P<text>.*?)(?=^##|\Z)", re.MULTILINE | re.DOTALL)


def scene_files() -> dict[str, Path]:
    """Return the files of the built-in scenes by name."""
    files = (path for path in sorted(SCENES.glob("[!_]*.*")) if path.suffix in (".toml", ".py"))
    return {path.stem.replace("_", "-"): path for path in files}


def as_gallery(text: str) -> str:
    """Write the page with a card for each scene above its first section, and with the files below each section."""
    sections = {match["name"]: match for match in SECTION.finditer(text)}
    files = scene_files()
    names = sorted(files, key=lambda name: _place(name, text))
    cards = [line for name in names for line in _card(name, sections)]
    parts, end = [], 0
    for match in sections.values():
        own = [name for name in files if _section(name, sections) == match["name"]]
        parts += [text[end : match.end()], *(line for name in own for line in _file(files[name]))]
        end = match.end()
    written = "".join([*parts, text[end:]])
    first = written.index("\n## ")
    return "\n".join([written[:first], ":::::{container} cards", *cards, ":::::", written[first:]])


def _section(name: str, sections: dict[str, re.Match[str]]) -> str:
    """Find the section of a scene: its own, or the first one that names it."""
    if name in sections:
        return name
    return next(each for each, match in sections.items() if f"`{name}`" in match["text"])


def _place(name: str, text: str) -> int:
    return text.index(f"### {name}\n") if f"### {name}\n" in text else text.index(f"`{name}`")


def _card(name: str, sections: dict[str, re.Match[str]]) -> Iterator[str]:
    section, title = sections[_section(name, sections)], _title(scene_files()[name])
    alt = section["alt"] if section["name"] == name else title
    yield from ("::::{container} card", f"[![{alt}](pictures/scenes/{name}.png)](#{section['name']})", "")
    yield from (f"[{name}](#{section['name']})", "", title, "")
    if name not in WITHOUT:
        yield from ("```{raw} html", f'<a href="{RUN}/{name}.html">run it in this browser</a>', "```")
    yield from ("::::", "")


def _title(path: Path) -> str:
    """Read a scene's title, or the first line of its module."""
    text = path.read_text("utf-8")
    if path.suffix == ".toml":
        return str(tomllib.loads(text)["title"])
    return (ast.get_docstring(ast.parse(text)) or "").split("\n\n")[0]


def _file(path: Path) -> Iterator[str]:
    """Show a scene's file in a folded block."""
    where = f"scenes/{path.name}"
    yield f"\n<details><summary>{where}</summary>\n\n```{{literalinclude}} ../{where}\n"
    yield f":language: {'toml' if path.suffix == '.toml' else 'python'}\n```\n\n</details>\n\n"


def _read(app: Sphinx, name: str, content: list[str]) -> None:
    if name == PAGE:
        content[0] = as_gallery(content[0])


def _write(app: Sphinx, error: Exception | None) -> None:
    """Write the pages that run scenes into the site."""
    if error is not None or app.builder.format != "html":
        return
    folder = Path(app.outdir, RUN)
    folder.mkdir(exist_ok=True)
    for name in scene_files().keys() - WITHOUT:
        gx.load(name).to_html(folder / f"{name}.html", overwrite=True)
    presets = {f"{name}: {a:g} and {b:g} N/m": {GAINS[0]: a, GAINS[1]: b} for name, (a, b) in PAIRS.items()}
    gx.load("paper-waving", preset="light-hand").to_html(folder / f"{FRONT}.html", presets=presets, overwrite=True)


def setup(app: Sphinx) -> dict[str, bool]:
    """Rewrite the page when it is read, and write the pages that run scenes after all others."""
    app.connect("source-read", _read)
    app.connect("build-finished", _write)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
