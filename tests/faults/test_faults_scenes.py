"""Damaged scenes: each runs, or is one error of ours, within its time and memory."""

from __future__ import annotations

import json
import math
import random
import sys
import tomllib
from collections import Counter
from collections.abc import Callable, Iterator
from copy import deepcopy
from pathlib import Path
from shutil import copytree
from typing import Any

import pytest

from graspfx import plugins
from tests.support import trial

SHELF = plugins.shelf("scenes")
SMALL = ("reference-1dof", "paper-waving", "paper-spring")
VALUES: tuple[Any, ...] = (
    math.nan, math.inf, -math.inf, 0, -1, 0.0, -0.0, 1e308, -1e308, 1e-308, 5e-324, 10**18, 10**60, 10**200,
    1e39, 1e-59, True, False, "", "x", "stick", "..", "/", "~", "~nobody99/x", "none.py", "a" * 300, "a\0b", "\n", "é",
    "\u202e", "𝔘",
    [], {}, [[]], [{}], [[[[]]]], [1, "a"], [1.0, 2.0, 3.0, 4.0], [math.nan], [1e200] * 3, {"kind": "box"},
    {"kind": 3}, {"kind": "mesh"}, {"name": "simulated"}, {"stiffness": -1.0}, [[1.0, 0.0], [0.0, -1.0]], [[1.0, 2.0]],
)  # fmt: skip
KEYS = (
    "",
    "kind",
    "name",
    "mass",
    "unknown",
    "a.b",
    "é",
    "0",
    "-1",
    "__class__",
    "model_fields",
    "settings",
    "k" * 150,
)
LETTERS = "[]{}=.,\"'#\n\\\0\t _-+0123456789eEnaif\u00e9\ufeff"


def write(folder: Path, count: int, seed: int, names: tuple[str, ...] | None = None) -> Iterator[Path]:
    """So many damaged scenes, beside what the shelf's name by a path."""
    folder.mkdir(parents=True, exist_ok=True)
    if (SHELF / "meshes").is_dir():
        copytree(SHELF / "meshes", folder / "meshes", dirs_exist_ok=True)
    known = names or tuple(sorted(path.stem for path in SHELF.glob("*.toml")))
    for k in range(count):
        chance = random.Random(f"{seed} {k}")
        name = chance.choice(known)
        text = (SHELF / f"{name}.toml").read_text(encoding="utf-8")
        for _ in range(chance.choice((1, 1, 1, 2, 5))):
            text = chance.choice((of_table, of_table, of_text))(text, chance)
        file = folder / f"{k:05}-{name}.toml"
        file.write_bytes(text.encode("utf-8", "surrogatepass"))
        yield file


def of_table(text: str, chance: random.Random) -> str:
    """One of its tables changed; the text as it is if it is no TOML any more."""
    try:
        table = tomllib.loads(text)
    except (ValueError, RecursionError):
        return of_text(text, chance)
    holders = list(_holders(table))
    holder = chance.choice(holders)
    places = list(holder) if isinstance(holder, dict) else list(range(len(holder)))
    if not places:
        return text
    chance.choice(CHANGES)(holder, chance.choice(places), chance)
    return "".join(f"{json.dumps(key)} = {_toml(value)}\n" for key, value in table.items())


def _replace(holder: Any, at: Any, chance: random.Random) -> None:
    holder[at] = deepcopy(chance.choice(VALUES))


def _delete(holder: Any, at: Any, chance: random.Random) -> None:
    del holder[at]


def _scale(holder: Any, at: Any, chance: random.Random) -> None:
    if isinstance(holder[at], float):
        holder[at] *= 10.0 ** chance.randint(-40, 40) * chance.choice((1, -1))
    else:
        holder[at] = deepcopy(chance.choice(VALUES))


def _wrap(holder: Any, at: Any, chance: random.Random) -> None:
    for _ in range(chance.choice((1, 2, 20, 40, 100))):
        holder[at] = [holder[at]] if chance.random() < 0.5 else {"a": holder[at]}


def _rename(holder: Any, at: Any, chance: random.Random) -> None:
    if isinstance(holder, dict):
        holder[chance.choice(KEYS)] = holder.pop(at)
    else:
        holder.append(holder[at])


def _repeat(holder: Any, at: Any, chance: random.Random) -> None:
    if isinstance(holder[at], list):
        holder[at] = holder[at] * chance.choice((2, 3, 50))
    elif isinstance(holder, dict):
        holder[f"{at}x"] = holder[at]


CHANGES: tuple[Callable[[Any, Any, random.Random], None], ...] = (
    _replace, _replace, _replace, _scale, _scale, _delete, _wrap, _rename, _repeat,
)  # fmt: skip


def _holders(value: Any) -> Iterator[Any]:
    if isinstance(value, dict | list):
        yield value
        for each in value.values() if isinstance(value, dict) else value:
            yield from _holders(each)


def _toml(value: Any) -> str:
    if isinstance(value, dict):
        return f"{{{', '.join(f'{json.dumps(key)} = {_toml(each)}' for key, each in value.items())}}}"
    if isinstance(value, list):
        return f"[{', '.join(map(_toml, value))}]"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, float) and not math.isfinite(value):
        return "nan" if math.isnan(value) else "inf" if value > 0 else "-inf"
    return json.dumps(value) if isinstance(value, bool | int | float) else str(value)


def of_text(text: str, chance: random.Random) -> str:
    """Its letters or lines changed."""
    if not text:
        return chance.choice(LETTERS)
    at = chance.randrange(len(text))
    lines = text.splitlines(keepends=True)
    line = chance.randrange(len(lines))
    what = chance.randrange(7)
    if what == 0:
        return text[:at]
    if what == 1:
        return text[:at] + chance.choice(LETTERS) + text[at + 1 :]
    if what == 2:
        return text[:at] + "".join(chance.choices(LETTERS, k=chance.choice((1, 3, 30)))) + text[at:]
    if what == 3:
        return "".join([*lines[:line], *lines[line + 1 :]])
    if what == 4:
        return "".join([*lines[: line + 1], *lines[line:]])
    if what == 5:
        return text[:at] + text[at + chance.choice((1, 10, 100)) :]
    digits = [k for k, letter in enumerate(text) if letter.isdecimal()]
    if not digits:
        return text[at:]
    k = chance.choice(digits)
    return (
        text[:k] + chance.choice(("9" * 5000, "e400", "-", "nan", "0x", "_", "1979-05-27", "9" * 300)) + text[k + 1 :]
    )


pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="limits of memory and /proc are Linux's")


def require_sound(kind: str, files: list[Path]) -> Counter[str]:
    """Every outcome, by the type of its error; the files of the bad ones are named."""
    found = trial.outcomes(kind, files)
    bad = [f"{file.name}: {each.error}: {each.text[:200]}" for file, each in zip(files, found, strict=True)
           if not each.is_sound]  # fmt: skip
    assert not bad, f"{len(bad)} of {len(files)}:\n" + "\n".join(bad)
    return Counter(each.error for each in found)


def test_some_damaged_scenes(tmp_path: Path) -> None:
    counts = require_sound("scene", list(write(tmp_path, 100, seed=1, names=SMALL)))
    assert counts[""] > 5 and counts["SceneError"] > 50


@pytest.mark.faults
@pytest.mark.parametrize("seed", range(2, 12))
def test_many_damaged_scenes(seed: int, tmp_path: Path) -> None:
    counts = require_sound("scene", list(write(tmp_path, 300, seed)))
    assert counts[""] > 10 and counts["SceneError"] > 100
