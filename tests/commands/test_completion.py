"""Completion of command lines: by bash itself with the script, and what is answered to every shell."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

import graspfx as gx
from graspfx.__main__ import COMMANDS, main, parse
from graspfx.commands.completion import SCRIPTS, answers

NEEDY = (  # commands that need an argument
    "run", "check", "stability", "tune", "plot", "picture", "replay", "touch", "export", "calibrate", "view", "sweep",
    "stream", "experiment", "page",
)  # fmt: skip
ROOT = Path(__file__).parents[2]
PROBE = """
eval "$(graspfx completion bash)"
COMP_WORDS=("$@")
COMP_CWORD=$(($# - 1))
_graspfx
printf '%s\\n' "${COMPREPLY[@]}"
complete -p graspfx
"""


def completed(*words: str) -> list[str]:
    return list(answers(words, tuple(COMMANDS)))


@pytest.fixture
def path(tmp_path: Path) -> str:
    """Where `graspfx` is this tree's."""
    shim = tmp_path / "bin" / "graspfx"
    shim.parent.mkdir()
    shim.write_text(f'#!/bin/sh\nPYTHONPATH={ROOT} exec {sys.executable} -m graspfx "$@"\n')
    shim.chmod(0o755)
    return f"{shim.parent}{os.pathsep}{os.environ['PATH']}"


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("graspfx stab", ["stability"]),
        ("graspfx run --set object.mass=0.2 paper-wav", ["paper-waving", "paper-waving-turning"]),
        ("graspfx stability paper-spring --plot n", ["nyquist"]),
        ("graspfx check --br", ["--brief"]),
        ("graspfx run --out ./", []),
    ],
)
def test_bash_completes_with_the_script(line: str, expected: list[str], path: str, tmp_path: Path) -> None:
    done = subprocess.run(
        ["bash", "-c", PROBE, "bash", *line.split()],
        capture_output=True, text=True, check=True, cwd=tmp_path, env=os.environ | {"PATH": path},
    )  # fmt: skip
    *words, binding = done.stdout.splitlines()
    assert [word for word in words if word] == expected and done.stderr == ""
    assert binding == "complete -o default -F _graspfx graspfx"


def test_commands_and_their_options_are_completed() -> None:
    assert completed("") == sorted([*COMMANDS, "--help", "--version"])
    assert completed("p") == ["page", "picture", "plot"]
    for command in COMMANDS:
        options = parse([command, *(["x"] if command in NEEDY else [])]).options
        assert set(completed(command, "-")) == set(options) - {"--words"}
    assert "--words" not in completed("completion", "--")
    assert completed("nonsense", "") == []


def test_scenes_are_completed_where_a_scene_is_meant(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "own.toml").write_text("")
    assert {"own.toml", "paper-waving", "prism"} <= set(completed("check", ""))
    assert completed("run", "own") == ["own.toml"]
    assert completed("run", "--duration", "") == []


def test_recordings_are_completed_where_one_is_meant(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    gx.run("reference-1dof", duration=0.01, out="out/mine")
    gx.run("reference-1dof", duration=0.01).save("alone.h5")
    (tmp_path / "out" / "empty").mkdir()
    assert completed("plot", "") == ["alone.h5", "out/mine"]
    assert completed("export", "out/mine", "--format", "") == []
    assert {"out/mine", "paper-waving"} <= set(completed("picture", ""))


@pytest.mark.parametrize("shell", SCRIPTS)
def test_each_shell_has_a_script_that_asks_for_words(shell: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["completion", shell]) == 0
    text = capsys.readouterr().out
    assert text == SCRIPTS[shell] and "graspfx completion --words" in text
    assert main(["completion", "--words", "run", "paper-sp"]) == 0
    assert capsys.readouterr().out.splitlines() == ["paper-spring", "paper-spring-arms"]
    with pytest.raises(SystemExit):
        main(["completion", f"t{shell}"])
    assert "invalid choice" in capsys.readouterr().err
