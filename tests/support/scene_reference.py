"""Every table and key of a scene as a page, from the JSON schema that `graspfx schema` prints.

`python -m tests.support.scene_reference` prints it: docs/reference/scene.md.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Sequence
from typing import Any

from graspfx.numeric import LARGEST, SMALLEST
from graspfx.scene.model import schema

HEAD = f"""# Keys of a scene

Written from the code by `make reference`; a test holds it against the code. `graspfx schema` prints the same as a JSON
schema, for editors that complete keys.

SI units throughout. Numbers are finite and no larger than {LARGEST:g}; what has to be above zero is no less than
{SMALLEST:g}. `d` is the number of `dimensions`, `(d,)` a list of that many numbers. Tables of which a scene may have
several are written `[[finger]]`. [A scene of your own](../how-to/scene.md) explains how tables go together, and
`graspfx check` says at once all that is wrong with a scene.
"""
REFERENCE = "#/$defs/"
UNIT = re.compile(r"\[((?:m|kg|s|N|rad|Hz|J|bytes|samples|deg)\b[^\][]*)\]")
BOUNDS = {"gt": ">", "exclusiveMinimum": ">", "ge": "≥", "minimum": "≥", "le": "≤", "maximum": "≤", "lt": "<"}

Schema = dict[str, Any]


def page() -> str:
    """Write the page."""
    scene = schema()
    tables = scene["$defs"]
    titles = dict(_titles(scene, tables))
    places = _places(scene, tables, titles)
    parts = [HEAD, *_section("The scene itself", scene, titles)]
    for name, title in titles.items():
        parts += _section(title, tables[name], titles, [each for each in places[name] if not title.startswith(each)])
    return "\n".join(parts)


def keys(table: Schema) -> Iterator[tuple[str, Schema]]:
    """List a table's keys with what the schema says of each."""
    yield from table.get("properties", {}).items()


def meaning(entry: Schema) -> str:
    """Look up what a key means; none if the model does not say."""
    inner = (each.get("description", "") for each in entry.get("anyOf", []))
    return str(entry.get("description") or next(filter(None, inner), ""))


def _titles(scene: Schema, tables: dict[str, Schema]) -> Iterator[tuple[str, str]]:
    """List the tables in the order in which a reader of a scene meets them, each with its heading."""
    seen: dict[str, str] = {}
    waiting = [(name, key) for key, entry in keys(scene) for name in _references(entry)]
    while waiting:
        name, path = waiting.pop(0)
        if name in seen:
            continue
        seen[name] = path
        kind = tables[name]["properties"].get("kind", {})
        which = f', kind = "{kind["const"]}"' if "const" in kind else ", of a plug-in" if kind else ""
        yield name, f"{path}{which}"
        waiting[:0] = [(each, f"{path}.{key}") for key, entry in keys(tables[name]) for each in _references(entry)]


def _places(scene: Schema, tables: dict[str, Schema], titles: dict[str, str]) -> dict[str, list[str]]:
    """List the keys at which each table may stand."""
    places: dict[str, list[str]] = {name: [] for name in titles}
    for under, table in [("", scene), *((f"{titles[name].partition(',')[0]}.", tables[name]) for name in titles)]:
        for key, entry in keys(table):
            for name in _references(entry):
                if f"{under}{key}" not in places[name]:
                    places[name].append(f"{under}{key}")
    return places


def _references(entry: Any) -> Iterator[str]:
    """List the tables that a key may be."""
    if isinstance(entry, dict):
        if "$ref" in entry:
            yield entry["$ref"].removeprefix(REFERENCE)
        for name, each in entry.items():
            if name != "default":
                yield from _references(each)
    elif isinstance(entry, list):
        for each in entry:
            yield from _references(each)


def _section(title: str, table: Schema, titles: dict[str, str], others: Sequence[str] = ()) -> list[str]:
    """Write a table of the scene as a section with a row for each key; `others` are other places where it stands."""
    lines = [f"## {title}\n"]
    if text := table.get("description", ""):
        places = f" Also `{'`, `'.join(others)}`." if others else ""
        lines.append(f"{_cell(text)}{places}\n")
    if table.get("additionalProperties") is True:
        lines.append("Besides these it takes keys of its own: [settings of drivers](drivers.md), or of a plug-in.\n")
    lines += ["| key | type | unit | default | meaning |", "|---|---|---|---|---|"]
    for key, entry in keys(table):
        text = meaning(entry) or ("Which table it is" if "const" in entry else "")
        unit = UNIT.search(text) if "$ref" not in json.dumps(entry) or "number" in json.dumps(entry) else None
        cells = [
            f"`{key}`",
            _type(entry, titles),
            unit[1] if unit else "",
            _default(entry, key in table.get("required", ())),
            _cell(capital(unitless(text) if unit else text) + _excluded(entry)),
        ]
        lines.append(f"| {' | '.join(cells)} |")
    return [*lines, ""]


def unitless(text: str) -> str:
    """Leave a unit that has a column of its own out of a sentence."""
    rest = " ".join(UNIT.sub("", text, count=1).split())
    return re.sub(r"^[;,:]\s*", "", re.sub(r" ([;,:])", r"\1", rest))


def capital(text: str) -> str:
    return text[:1].upper() + text[1:] if text[1:2].islower() else text


def _excluded(entry: Schema) -> str:
    """Say with which others a key does not go."""
    excludes = next((each["excludes"] for each in [entry, *entry.get("anyOf", [])] if "excludes" in each), "")
    return f". **Not with** {excludes}." if excludes else ""


def _cell(text: str) -> str:
    return " ".join(text.split()).replace("|", r"\|")


def _default(entry: Schema, is_required: bool) -> str:
    if is_required or "default" not in entry:
        return "**required**" if is_required else ""
    value = entry["default"]
    if value is None or (isinstance(value, dict | list) and not value):
        return "none"
    if isinstance(value, dict):
        return "its defaults" if "kind" not in value else f"`{value['kind']}`"
    return f"`{json.dumps(value)}`"


def _type(entry: Schema, titles: dict[str, str]) -> str:
    """Say in words of what type a value is, with its bounds."""
    choices = entry.get("anyOf") or entry.get("oneOf")
    if choices:
        texts = dict.fromkeys(_type(each, titles) for each in choices if each.get("type") != "null")
        return ", ".join(texts)
    if "$ref" in entry:
        title = titles[entry["$ref"].removeprefix(REFERENCE)]
        kind = re.search(r'kind = "(.*)"', title)
        return f"[{kind[1] if kind else title}](#{_anchor(title)})"
    if "const" in entry:
        return f"`{json.dumps(entry['const'])}`"
    if "enum" in entry:
        return ", ".join(f"`{json.dumps(each)}`" for each in entry["enum"])
    kind = entry.get("type")
    if kind == "array":
        return _list(entry, titles)
    if kind == "object":
        inner = next(iter(entry.get("patternProperties", {}).values()), None)
        return f"tables by name: {_type(inner, titles)}" if inner else "table"
    word = {"number": "number", "integer": "whole number", "boolean": "true or false", "string": "text"}[str(kind)]
    return " ".join([word, *(f"{sign} {entry[key]}" for key, sign in BOUNDS.items() if key in entry)])


def _list(entry: Schema, titles: dict[str, str]) -> str:
    if "prefixItems" in entry:
        return f"{len(entry['prefixItems'])} numbers"
    items, nested = entry["items"], 0
    while items.get("type") == "array" and "prefixItems" not in items:
        items, nested = items["items"], nested + 1
    if "prefixItems" in items:
        return f"list of {_list(items, titles)} each"
    if items.get("type") == "number":
        return f"{'numbers' if nested < 1 else 'matrix' if nested < 2 else 'matrices'}{_bound(items)}"
    return f"list of {_type(items, titles)}"


def _bound(items: Schema) -> str:
    return "".join(f" {sign} {items[key]}" for key, sign in BOUNDS.items() if key in items)


def _anchor(title: str) -> str:
    return re.sub(r"[^\w\- ]", "", title.lower()).strip().replace(" ", "-")


if __name__ == "__main__":
    print(page(), end="")
