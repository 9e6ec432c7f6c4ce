"""Words of a command: options before or after the scene, what was misspelt, what a recording is for, and help."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

import graspfx as gx
from graspfx import plugins
from graspfx.__main__ import COMMANDS, main, parse
from graspfx.commands.arguments import separate
from graspfx.commands.list import GROUPS, line_about
from graspfx.commands.output import CODES
from graspfx.errors import RecordingError

ROOT = Path(__file__).parents[2]


@pytest.fixture(autouse=True)
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize(
    "words",
    [
        "run knob --set object.mass=0.2 period=0.001 --json --out a",
        "run --set object.mass=0.2 period=0.001 knob --json --out a",
        "run --json --set object.mass=0.2 period=0.001 --out a knob",
        "run --set object.mass=0.2 knob --set period=0.001 --out a --json",
        "run --out a --set object.mass=0.2 --set period=0.001 --json -- knob",
        "run --set=object.mass=0.2 --json knob --out a --set period=0.001",
    ],
)
def test_options_stand_before_or_after_the_scene(words: str) -> None:
    chosen = parse(words.split())
    assert chosen.scene == "knob"
    assert chosen.overrides == [("object.mass", 0.2), ("period", 0.001)]
    assert chosen.json is True and chosen.out == Path("a") and chosen.duration is None
    several = parse(["warmup", "--set", "object.mass=0.2", "period=0.001", "knob", "mug"])
    assert several.scenes == ["knob", "mug"] and several.overrides == chosen.overrides


def test_the_first_word_without_an_equals_sign_ends_the_values() -> None:
    assert list(separate(["run", "--set", "a=1", "b=-2", "s.toml", "c=3"])) == [
        *("run", "--set", "a=1", "--set", "b=-2", "s.toml", "c=3")
    ]
    assert list(separate(["--set", "s.toml", "a=1"])) == ["--set", "s.toml", "a=1"]  # and --set says what it expects
    assert list(separate(["--set", "a=1", "-x=3", "b=2"])) == ["--set", "a=1", "-x=3", "b=2"]


def test_a_run_with_options_before_its_scene(capsys: pytest.CaptureFixture[str]) -> None:
    gains = ["coupling.internal.stiffness=50", "coupling.external.stiffness=20"]
    words = ["run", "--set", *gains, "reference-1dof", "--duration", "0.05", "--no-figure", "--json"]
    assert main(words) == 0
    assert json.loads(capsys.readouterr().out)["ticks"] == 10
    assert gx.Recording.load("out/latest").header.overrides == {
        "coupling.internal.stiffness": 50,
        "coupling.external.stiffness": 20,
    }


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("rnu knob", "unknown command 'rnu'; did you mean 'run'? (known: bench, calibrate, check, "),
        ("stabilty knob", "unknown command 'stabilty'; did you mean 'stability'?"),
        ("plto a", "unknown command 'plto'; did you mean 'plot'?"),
        ("run knob --ovewrite", "unknown option '--ovewrite'; did you mean '--overwrite'?"),
        ("run --duratoin 3 knob", "unknown option '--duratoin'; did you mean '--duration'?"),
        ("run knob --set a=1 mug", "run: given 'mug', expected no further argument"),
    ],
)
def test_what_is_misspelt_is_told_with_what_comes_near(
    words: str, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(words.split()) == 2
    err = capsys.readouterr().err
    assert err.startswith(said) and err.count("\n") == 1


@pytest.mark.parametrize("command", ["run", "check", "stability", "warmup"])
@pytest.mark.parametrize("given", ["a/recording.h5", "a/recording.h5.part", "./a", "a/b"])
def test_a_recording_in_a_scenes_place_says_what_to_use(
    command: str, given: str, capsys: pytest.CaptureFixture[str]
) -> None:
    Path("a/b").mkdir(parents=True)
    with pytest.raises(SystemExit, match="2"):
        main([command, given])
    err = capsys.readouterr().err
    assert f"{given} is a recording or its folder, expected a scene; `graspfx plot {given}` plots it" in err
    assert f"`graspfx picture {given}` draws one instant" in err


@pytest.mark.parametrize("command", ["plot", "export"])
@pytest.mark.parametrize("given", ["mug", "block.toml"])
def test_a_scene_in_a_recordings_place_is_told_what_makes_one(
    command: str, given: str, capsys: pytest.CaptureFixture[str]
) -> None:
    Path("block.toml").write_text("dimensions = 1\n")
    with pytest.raises(SystemExit, match="2"):
        main([command, given])
    err = capsys.readouterr().err
    assert f"{given} is a scene, expected a recording; `graspfx run {given}` records it" in err
    with pytest.raises(RecordingError, match=r"block\.toml: is a scene, not a recording: run it first"):
        gx.Recording.load("block.toml")


def test_a_diagram_that_is_not_named_or_misspelt(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit, match="2"):
        main(["stability", "reference-1dof", "--plot"])
    assert "argument --plot: expected a diagram: bode, nyquist or z-width" in capsys.readouterr().err
    assert main(["stability", "reference-1dof", "--plot", "z-wdth"]) == 2
    assert "unknown diagram 'z-wdth'; did you mean 'z-width'?" in capsys.readouterr().err


def test_a_word_too_many_hears_of_set_where_there_is_one(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["list", "scenes"]) == main(["run", "knob", "mug"]) == 2
    listing, running, _ = capsys.readouterr().err.split("\n")
    assert listing == "list: given 'scenes', expected no further argument"
    assert running.endswith("expected no further argument; values of --set have the form KEY=VALUE")


@pytest.mark.parametrize("command", COMMANDS)
def test_help_has_a_sentence_an_example_that_parses_and_the_exit_codes(
    command: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit, match="0"):
        main([command, "--help"])
    text = capsys.readouterr().out
    sentence = f"{COMMANDS[command][0].upper()}{COMMANDS[command][1:]}."
    assert sentence in " ".join(text.split())
    example = re.search(r"^example:\n  graspfx (.*)$", text, re.MULTILINE)
    assert example is not None
    words = example[1].partition(">")[0].split()
    assert words[0] == command
    parse(words)
    assert CODES in text and "-v, --verbose" in text and "-q, --quiet" in text
    with pytest.raises(SystemExit):
        main([command, "-v", "-q"])


def test_the_commands_together_have_help_and_codes(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit, match="0"):
        main(["--help"])
    text = capsys.readouterr().out
    assert CODES in text
    assert all(re.search(rf"^ +{command}\s+\S", text, re.MULTILINE) for command in COMMANDS)


def test_the_documentation_has_the_same_exit_codes() -> None:
    page = (ROOT / "docs" / "how-to" / "commands.md").read_text(encoding="utf-8")
    rows = dict(re.findall(r"^\| (\d+) \| (.*) \|$", page, re.MULTILINE))
    lines = dict(re.findall(r"^  (\d+) +(.*)$", CODES, re.MULTILINE))
    assert rows == lines
    assert all(f"`graspfx {command}" in page for command in COMMANDS)


def test_list_gives_a_line_about_each(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["list"]) == 0
    rows = [line for line in capsys.readouterr().out.splitlines() if line.startswith("  ")]
    lines = {line.split()[0]: line for line in rows if not line.lstrip().startswith("--preset ")}
    assert lines.keys() == {name for group in GROUPS for name in plugins.names(group)}
    for name, line in lines.items():
        assert re.fullmatch(rf"  {name} +\S.{{20,}}  \[GraspFX \(.*\)\]", line), line
    assert "A mug lifted and tilted as to drink" in lines["mug"]
    assert "A planar two-link arm" in lines["two-link"]


@pytest.mark.parametrize(
    ("name", "text", "line"),
    [
        ("a.toml", 'title = "One\\n  thing."', "One thing  "),
        ("a.toml", "period = 1", ""),
        ("a.toml", "title = ", ""),
        ("a.py", '"""A hand of clay.\n\nAnd more."""', "A hand of clay  "),
        ("a.py", "def", ""),
        ("a.py", "x = 1", ""),
        ("a.py", "x = '\0'", ""),
    ],
)
def test_a_line_about_a_file_is_its_title_or_docstring(name: str, text: str, line: str) -> None:
    Path(name).write_text(text)
    assert line_about(Path(name)) == line
    assert line_about(Path("nowhere.py")) == line_about(None) == ""
