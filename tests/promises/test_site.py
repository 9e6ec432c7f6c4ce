"""The documentation site: every page, name, key, command and scene is on it, and nothing comes from another host.

`make site` builds it, where every warning is an error; here is what is seen without a build.
"""

from __future__ import annotations

import inspect
import re
from pathlib import Path

import pytest

from graspfx import plugins
from graspfx.__main__ import COMMANDS
from graspfx.scene.model import schema
from tests.support import command_reference, driver_reference, scene_reference
from tests.support.built_site import asked_of_others, main
from tests.support.face import GROUPS, MODULES, constant_text, members, names
from tests.support.site import DOCS, entries, pages, part

WRITTEN = {"scene": scene_reference, "commands": command_reference, "drivers": driver_reference}
ASKED = re.compile(r"^\.\. public-names:: (\S+)(?: (\S+))?$", re.MULTILINE)


def test_every_page_is_reached_from_the_start_page() -> None:
    reached, waiting = set(), ["index"]
    while waiting:
        page = waiting.pop()
        if page not in reached:
            reached.add(page)
            waiting += [each for each in entries(page) if each != page]
    assert pages() - reached == set()
    assert len(reached) > 100


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


def test_every_command_and_driver_is_on_its_page() -> None:
    commands = (DOCS / "reference" / "commands.md").read_text("utf-8")
    assert [name for name in COMMANDS if f"## graspfx {name}\n" not in commands] == []
    drivers = (DOCS / "reference" / "drivers.md").read_text("utf-8")
    shelf = [name for name, origin in plugins.names("devices").items() if origin.startswith("GraspFX")]
    assert [name for name in shelf if f"## {name}\n" not in drivers] == []
    assert (
        re.search(r"^\| `[^|]*\|[^|]*\|[^|]*\|[^|]*\|\s*\|$", drivers, re.MULTILINE) is None
    )  # a setting without words


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


def test_what_pages_ask_of_others_is_seen(tmp_path: Path) -> None:
    (tmp_path / "good.html").write_text(
        '<a href="https://x.y">x</a><script src="_static/a.js"></script><img src="data:,">'
    )
    assert asked_of_others(tmp_path) == []
    (tmp_path / "bad.html").write_text(
        '<link rel="stylesheet" href="https://a.b/c.css"><script defer src="//d.e/f.js"></script>'
    )
    (tmp_path / "bad.css").write_text("@font-face { src: url(https://g.h/i.woff2) }")
    assert asked_of_others(tmp_path) == [
        "bad.css: https://g.h/i.woff2",
        "bad.html: https://a.b/c.css",
        "bad.html: //d.e/f.js",
    ]


def test_a_site_that_asks_others_fails(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tests.support.built_site.program", lambda: None)
    assert main(tmp_path) == 0
    (tmp_path / "index.html").write_text('<img src="http://x.y/z.png">')
    assert main(tmp_path) == 1 and "index.html: http://x.y/z.png" in capsys.readouterr().out
