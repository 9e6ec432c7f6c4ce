"""The documentation site: every page, name, key, command and scene is on it, and nothing comes from another host.

`make site` builds it, where every warning is an error; here is what is seen without a build.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from typing import Any

import pytest

from graspfx import plugins
from graspfx.scene.model import schema
from tests.support import command_reference, driver_reference, scene_reference
from tests.support.built_site import asked_of_others, main
from tests.support.face import GROUPS, MODULES, constant_text, members, names
from tests.support.optional import require

DOCS = Path(__file__).parents[2] / "docs"
TOCTREE = re.compile(r"^```\{toctree\}\n(.*?)^```", re.MULTILINE | re.DOTALL)
WRITTEN = {"scene": scene_reference, "commands": command_reference, "drivers": driver_reference}
ASKED = re.compile(r"^\.\. public-names:: (\S+)(?: (\S+))?$", re.MULTILINE)


def part(name: str) -> Any:
    """Load a module of docs/machinery."""
    spec = require(spec_from_file_location(f"machinery_{name}", DOCS / "machinery" / f"{name}.py"))
    module = module_from_spec(spec)
    require(spec.loader).exec_module(module)
    return module


def pages() -> set[str]:
    """List the pages of the site, by their paths in docs/ without suffixes."""
    files = (path for path in DOCS.rglob("*") if path.suffix in (".md", ".rst"))
    return {path.relative_to(DOCS).with_suffix("").as_posix() for path in files}


def entries(page: str) -> Iterator[str]:
    """List the pages that the contents of a page lead to."""
    path = DOCS / f"{page}.md"
    if not path.is_file():
        return
    for body in TOCTREE.findall(path.read_text("utf-8")):
        lines = [line.strip() for line in body.splitlines() if line.strip() and not line.startswith(":")]
        for line in lines:
            within = path.parent.relative_to(DOCS) / line
            yield from (
                found.relative_to(DOCS).with_suffix("").as_posix()
                for found in sorted(DOCS.glob(f"{within.as_posix()}.*"))
                if found.suffix in (".md", ".rst")
            )


def test_every_page_is_reached_from_the_start_page() -> None:
    reached, waiting = set(), ["index"]
    while waiting:
        page = waiting.pop()
        if page not in reached:
            reached.add(page)
            waiting += [each for each in entries(page) if each != page]
    assert pages() - reached == set()
    assert len(reached) > 80


def test_every_public_name_is_asked_for_on_a_page() -> None:
    asked = [ask for path in (DOCS / "reference").glob("*.md") for ask in ASKED.findall(path.read_text("utf-8"))]
    documented = [f"{module}.{name}" for module, group in asked for name in names(module, group)]
    assert sorted(documented) == sorted(f"{module}.{name}" for module in MODULES for name in names(module))
    assert {name for group in GROUPS.values() for name in group} <= set(names("graspfx"))


def test_no_public_name_is_undocumented() -> None:
    undocumented = []
    for path, module in MODULES.items():
        for name in names(path):
            value = getattr(module, name)
            if not (inspect.isclass(value) or inspect.isroutine(value)):
                text = constant_text(module, name)
            else:
                text = value.__doc__ or ""
            undocumented += [] if text.strip() else [f"{path}.{name}"]
            if inspect.isclass(value):
                own = (member.removesuffix("()") for member, _ in members(value))
                undocumented += [
                    f"{path}.{name}.{each}" for each in own if not inspect.getdoc(inspect.getattr_static(value, each))
                    and not any(inspect.getdoc(vars(kind).get(each)) for kind in value.__mro__ if each in vars(kind))
                ]  # fmt: skip
    assert undocumented == []


@pytest.mark.parametrize("page", WRITTEN)
def test_pages_that_are_written_from_the_code_are_those_of_the_code(page: str) -> None:
    assert (DOCS / "reference" / f"{page}.md").read_text("utf-8") == WRITTEN[page].page(), "make reference"


def test_every_key_of_a_scene_has_a_meaning() -> None:
    tables = {"scene": schema(), **schema()["$defs"]}
    keys = [(name, key, entry) for name, table in tables.items() for key, entry in scene_reference.keys(table)]
    assert [
        f"{name}.{key}" for name, key, entry in keys if "const" not in entry and not scene_reference.meaning(entry)
    ] == []
    assert len(keys) > 150


def test_keys_that_exclude_others_are_checked_for_it() -> None:
    """Each key that a table says it does not go with is a key, or the value of one."""
    tables = schema()["$defs"]
    texts = [
        (name, entry["excludes"]) for name, table in tables.items() for _, entry in scene_reference.keys(table)
        if "excludes" in entry
    ]  # fmt: skip
    words = {key for table in [schema(), *tables.values()] for key, _ in scene_reference.keys(table)}
    named = [(name, word) for name, text in texts for word in re.findall(r"`([\w.]+)", text)]
    assert len(named) > 15
    assert [(name, word) for name, word in named if word.rpartition(".")[2] not in words] == []


def test_every_setting_of_a_driver_has_words() -> None:
    drivers = (DOCS / "reference" / "drivers.md").read_text("utf-8")
    assert re.search(r"^\| `[^|]*\|[^|]*\|[^|]*\|[^|]*\|\s*\|$", drivers, re.MULTILINE) is None


def test_links_lead_to_pages_of_the_site() -> None:
    resolve, page = part("links").resolve, DOCS / "how-to" / "scene.md"
    root = DOCS.parent
    assert (
        resolve("[a](../../SECURITY.md#x) [b](../safety.md)", page, page)
        == "[a](../project/security.rst#x) [b](../safety.md)"
    )
    assert (
        resolve("[a](../decisions/), [b](../../scenes/mug.toml)", page, page)
        == "[a](../decisions/README.md), [b](source:scenes/mug.toml)"
    )
    assert resolve("[a](https://x.y) `[b](../z)` [c](#d)", page, page) == "[a](https://x.y) `[b](../z)` [c](#d)"
    assert resolve("```\n[a](../safety.md)\n```\n", page, page) == "```\n[a](../safety.md)\n```\n"
    beside = DOCS / "project" / "contributing.rst"
    assert resolve("[a](docs/safety.md)", root / "CONTRIBUTING.md", beside) == "[a](../safety.md)"
    assert all((root / file).is_file() and (DOCS / page).is_file() for file, page in part("links").PAGES.items())


def test_the_glossary_is_of_terms() -> None:
    text = (DOCS / "glossary.md").read_text("utf-8")
    rows = [row for row in text.splitlines() if row.startswith("|")][2:]
    terms = part("glossary").as_terms(text)
    words = re.findall(r"^(?! |`|#|\|)\S.*(?=\n(?:\S.*\n)*  \S)", terms, re.MULTILINE)
    expected = [word.strip() for row in rows for word in row.split("|")[1].split(",")]
    assert words == expected and len(set(words)) == len(words) > 50


def test_the_gallery_has_a_card_and_the_file_of_every_scene() -> None:
    gallery = part("gallery")
    shelf = {name for name, origin in plugins.names("scenes").items() if origin.startswith("GraspFX")}
    assert set(gallery.scene_files()) == shelf
    text = gallery.as_gallery((DOCS / "scenes.md").read_text("utf-8"))
    assert text.count("{container} card\n") == text.count("<details>") == len(shelf)
    pictures = re.findall(r"\[!\[[^\]]+\]\((pictures/scenes/[\w-]+\.png)\)\]", text)
    assert len(pictures) == len(shelf) and all((DOCS / picture).is_file() for picture in pictures)


def test_arrows_of_a_chart_lead_down() -> None:
    drawing = part("flowchart").drawing("a --> b\na --> c\nb --> d\nc --> d\na --> d\n")
    assert drawing.count("<rect") == 4 and drawing.count('class="arrow"') == 5
    for path in re.findall(r'd="M(\d+) (\d+)C(\d+) (\d+) (\d+) (\d+) (\d+) (\d+)"', drawing):
        assert int(path[1]) < int(path[7])


def test_docstrings_are_plain_text_to_rest() -> None:
    as_rest = part("docstrings").as_rest
    lines = as_rest(
        ["|f| <= a_i *now*, see `Split` and `K e`, x_", "", "    f = K (e + s)", "", "Args:", "    a, b: of it."],
        {"Split": "gx.Split"},
    )
    assert lines[0] == r"\|f\| <= a_i \*now\*, see :py:obj:`Split <gx.Split>` and ``K e``, x\_"
    assert lines[2:5] == [".. code-block:: python", "", "    f = K (e + s)"]
    assert lines[-2:] == ["    a: of it.", "    b: of it."]


def test_what_pages_ask_of_others_is_seen_and_fails(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tests.support.built_site.program", lambda: None)
    (tmp_path / "good.html").write_text(
        '<a href="https://x.y">x</a><script src="_static/a.js"></script><img src="data:,">'
    )
    assert asked_of_others(tmp_path) == [] and main(tmp_path) == 0
    (tmp_path / "bad.html").write_text(
        '<link rel="stylesheet" href="https://a.b/c.css"><script defer src="//d.e/f.js"></script>'
    )
    (tmp_path / "bad.css").write_text("@font-face { src: url(https://g.h/i.woff2) }")
    assert asked_of_others(tmp_path) == [
        "bad.css: https://g.h/i.woff2",
        "bad.html: https://a.b/c.css",
        "bad.html: //d.e/f.js",
    ]
    assert main(tmp_path) == 1 and "bad.html: //d.e/f.js" in capsys.readouterr().out
