"""Budget of a reader: whatever stands in a scene, one clear error comes soon and takes little memory."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import graspfx as gx
from graspfx import plugins
from graspfx.errors import MOST_SHOWN, Fault, InputError, SceneError
from graspfx.scene.toml_text import DEEPEST, LARGEST_FILE, MOST_KEYS, MOST_VALUES, KeyLines, excess, outline, too_deep

BASE = (plugins.shelf("scenes") / "reference-1dof.toml").read_text(encoding="utf-8")
TIMES, BYTES = 10.0, 200e6  # of the processor time that tomllib takes for as many keys as may be, and of memory


def on_top(line: str) -> Callable[[], str]:
    return lambda: f"{line}\n{BASE}"


def with_driver(name: str) -> Callable[[], str]:
    return lambda: BASE.replace('name = "simulated"', f'name = "{name}"')


def many(line: str, count: int) -> Callable[[], str]:
    return lambda: "\n".join(line.format(i) for i in range(count)) + "\n" + BASE


CASES: dict[str, tuple[Callable[[], str], str]] = {
    "deep lists": (lambda: f"j = {'[' * 100_000}{']' * 100_000}\n{BASE}", ":1: tables or lists nested more"),
    "deep tables": (lambda: f"j = {'{a=' * 5000}1{'}' * 5000}\n{BASE}", ":1: tables or lists nested more"),
    "a key of 5000 parts": (lambda: f"{'.'.join('a' * 5000)} = 1\n{BASE}", ":1: a key of more than 32 parts"),
    "a key of 10^6 parts": (lambda: f"{'.'.join('a' * 10**6)} = 1\n{BASE}", ":1: a key of more than 32 parts"),
    "parts in quotes": (lambda: f"""j = {{{'.'.join(['"a b"'] * 5000)} = 1}}\n{BASE}""", ":1: a key of more than 32"),
    "a header of 5000 parts": (lambda: f"{BASE}\n[{'.'.join('a' * 5000)}]\n", "a key of more than 32 parts"),
    "a key of 10^6 letters": (lambda: f'"{"k" * 10**6}" = 1\n{BASE}', ":1: a key of 10000"),
    "5000 digits": (lambda: BASE.replace("mass = 0.1 ", f"mass = {'9' * 5000} "), "number of 5000 characters"),
    "350 digits": (lambda: BASE.replace("mass = 0.1 ", f"mass = {'9' * 350} "), "object.mass: expected a number"),
    "10^6 digits of 16": (lambda: f"j = 0x{'f' * 10**6}\n{BASE}", ":1: a word or number of 1000002 characters"),
    "nobody's home": (with_driver("~nobody99/x.py"), "no user of that name has a home folder here"),
    "a file of 300 letters": (with_driver("a" * 300 + ".py"), "File name too long"),
    "a name of 300 letters": (with_driver("a" * 300), "finger.0.device.name: unknown device 'aaa"),
    "a name of 10^6 letters": (with_driver("a" * 10**6), "finger.0.device.name: unknown device 'aaa"),
    "NUL in a name": (with_driver("a\\u0000b.py"), "remove the NUL character"),
    "NUL in a title": (lambda: BASE.replace("title =", 'title = "a\\u0000b" #', 1), "title: expected text without NUL"),
    "10 MB in a key": (lambda: f"j = [{'1,' * 5_000_000}]\n{BASE}", "expected a file of at most 4 MB"),
    "10 MB of text": (lambda: f'j = "{"x" * 10**7}"\n{BASE}', "expected a file of at most 4 MB"),
    "all values in a key": (lambda: f"j = [{'[],' * (MOST_VALUES - 100)}]\n{BASE}", ":1: j: unknown key"),
    "more values": (lambda: f"j = [{'[],' * MOST_VALUES}]\n{BASE}", ":1: more than 200000 values"),
    "10^5 unknown keys": (many("unknown_{} = 1", 100_000), ":40001: more than 40000 keys"),
    "as many as may be": (many("unknown_{} = 1", MOST_KEYS - 100), "faults, 39900 in all"),
    "as many headers": (lambda: BASE + "".join(f"[unknown_{i}]\n" for i in range(39_900)), "faults, 39900 in all"),
    "an open text": (lambda: 't = "' + '\\"' * 1_900_000 + "\n" + BASE, ":1: not TOML: Illegal character"),
}  # fmt: skip

LONG = ("all values in a key", "as many as may be", "as many headers")  # a second each

CHILD = """
import json, pathlib, sys, time, tomllib
import graspfx as gx
began = time.process_time()
tomllib.loads("".join(f"unknown_{i} = 1\\n" for i in range(40_000)))
unit = time.process_time() - began
gx.run("reference-1dof", {"engine": "interpreted"}, duration=0.02)  # imports once, and compiles nothing
for path in sys.argv[1:]:
    began = time.process_time()
    try:
        gx.run(path, duration=0.02)
        outcome = ["", ""]
    except Exception as error:
        outcome = [type(error).__name__, str(error)]
    took = (time.process_time() - began) / unit
    words = pathlib.Path("/proc/self/status").read_text().split()  # getrusage tells the parent's before the fork
    print(json.dumps([*outcome, took, 1024 * int(words[words.index("VmHWM:") + 1])]), flush=True)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="memory is told by /proc")
@pytest.mark.parametrize(
    "names", [sorted({*CASES} - {*LONG}), pytest.param(LONG, marks=pytest.mark.faults)], ids=["short", "long"]
)
def test_one_clear_error_comes_soon(names: list[str], tmp_path: Path) -> None:
    """In one process of their own, so that its memory is that of the greediest."""
    files = [tmp_path / f"{k}.toml" for k in range(len(names))]
    for name, file in zip(names, files, strict=True):
        file.write_text(CASES[name][0](), encoding="utf-8")
    child = subprocess.run([sys.executable, "-c", CHILD, *map(str, files)], stdout=subprocess.PIPE, timeout=300)
    results = [json.loads(line) for line in child.stdout.splitlines()]
    assert child.returncode == 0, f"{names[len(results)]}: exit code {child.returncode}"
    for name, (error, message, times, memory) in zip(names, results, strict=True):
        assert error in ("SceneError", "InputError") and CASES[name][1] in message, f"{name}: {error}: {message[:200]}"
        assert len(message) < 20_000 and len(message.splitlines()) <= MOST_SHOWN + 1
        assert times < TIMES and memory < BYTES, f"{name}: {times:.2f} of tomllib's time, {memory / 1e6:.0f} MB"


def test_at_most_fifty_faults_are_shown_and_their_number() -> None:
    for count, lines in ((MOST_SHOWN, MOST_SHOWN), (MOST_SHOWN + 7, MOST_SHOWN + 1)):
        error = SceneError("a.toml", [Fault(f"k{i}", "unknown key", i) for i in range(count)])
        shown = str(error).splitlines()
        assert len(shown) == lines and len(error.faults) == count
    assert shown[-1] == "a.toml: and 7 more faults, 57 in all"


def test_a_fault_is_one_line_whatever_its_key() -> None:
    assert Fault("a\nb", "unknown key", 3).text("x.toml") == "x.toml:3: a\\nb: unknown key"
    assert len(Fault("k" * 10**6, "unknown key").text("x.toml")) < 300


LEGITIMATE = {
    "300 fingers": BASE + "".join(
        f"\n[[finger]]\nstart = [{x}.0]\ndevice = {{ name = 'simulated', mass = 0.1, damping = 0.2 }}\n"
        for x in range(300)
    ),
    "19 000 vertices": "v = [" + ",\n".join(["[0.123456789012345, -1.23456789012345e-05, 0.3]"] * 19_000) + "]\n"
    "f = [" + ",\n".join(["[18123, 18124, 18125]"] * 38_000) + "]\n",
    "long text": f'title = """{"a b.c = [" * 10_000}"""\n# {"[" * 10_000}\n',
    "dotted keys": ".".join(["a"] * DEEPEST) + " = 1\n",
    "levels": f"a = {'[' * DEEPEST}{']' * DEEPEST}\n",
    "quotes": """a = '"' # "\nb = "'" # '\nc = \"\"\"x"y""z\"\"\"\"\"\nd = '''[[['''''\n""",
    "windows": BASE.replace("\n", "\r\n"),
}  # fmt: skip


@pytest.mark.parametrize("name", LEGITIMATE)
def test_what_a_scene_may_hold_is_not_refused(name: str) -> None:
    import tomllib

    text = LEGITIMATE[name]
    assert len(text) < LARGEST_FILE and excess(text) is None
    assert tomllib.loads(text) is not None
    assert list(tomllib.loads(outline(text))) == list(tomllib.loads(text))
    assert outline(text).count("\n") == text.count("\n")


def test_every_scene_of_the_shelf_is_within() -> None:
    for path in plugins.shelf("scenes").glob("*.toml"):
        text = path.read_text(encoding="utf-8")
        assert excess(text) is None and outline(text) == text


@pytest.mark.parametrize("header", ["[[{}]]", "[{}]", "[ {} ] # a comment"])
def test_a_table_that_only_a_header_names_has_its_line(header: str, tmp_path: Path) -> None:
    file = tmp_path / "scene.toml"
    file.write_text(f"{BASE}\n{header.format('copling.internal')}\nstiffness = 1.0\n")
    with pytest.raises(SceneError) as caught:
        gx.load(file)
    [fault] = caught.value.faults
    assert (fault.key, fault.line) == ("copling", BASE.count("\n") + 2)
    lines = KeyLines("a.b.c = 1\n[d.e]\n[[f.g]]\nh = 1\n[f.g.i]\n[[f.g]]\n")
    wanted = {("a", "b"): 1, ("d",): 2, ("d", "e"): 2, ("f",): 3, ("f", "g", 0, "h"): 4, ("f", "g", 0, "i"): 5,
              ("f", "g", 1): 6}  # fmt: skip
    assert {key: lines[key] for key in wanted} == wanted


def test_tables_from_python_and_overrides_have_a_depth_too() -> None:
    deep: Any = 1
    for _ in range(5000):
        deep = [deep]
    itself: dict[str, Any] = {}
    itself["itself"] = itself
    for value in (deep, itself):
        with pytest.raises(SceneError, match="nested more than 32 levels"):
            gx.Scene(period=0.1, junk=value)
        with pytest.raises(InputError, match="at most 32 levels"):
            gx.load("reference-1dof", {"junk": value})
    with pytest.raises(InputError, match="at most 32 levels"):
        gx.load("reference-1dof", {".".join("a" * 5000): 1})
    assert too_deep({"a": [[{"b": (1, 2)}]]}) is None


def test_numbers_of_5000_digits_from_python() -> None:
    with pytest.raises(SceneError, match=r"object\.mass: expected a number"):
        gx.load("reference-1dof", {"object.mass": 10**5000})
    with pytest.raises(InputError, match="a value of type int"):
        gx.run(gx.load("reference-1dof"), duration=10**5000)
