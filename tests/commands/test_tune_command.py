"""`graspfx tune` and `graspfx check --operators`: answers, files, codes."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path

import pytest

import graspfx as gx
from graspfx.__main__ import main
from graspfx.show import certificate_figures

OPERATORS = ["--operators", "finger.*.hand.stiffness=50:400", "finger.*.hand.damping=0.2:2"]


def test_tuned_gains_are_printed_and_written(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["tune", "reference-1dof", "--subject-to", "margin.internal >= 1.3", *OPERATORS, "--out", str(tmp_path)]
    assert main(words) == 0
    said = capsys.readouterr().out
    assert "limited by: margin.internal >= 1.3 binds in the hand of finger.*.hand.stiffness = " in said
    assert "fails: " in said and f"wrote {tmp_path / 'tuned.toml'}" in said
    preset = tomllib.loads((tmp_path / "tuned.toml").read_text("utf-8"))["preset"]["tuned"]
    (value,) = preset["set"].values()
    assert f"--set coupling.internal.stiffness={value}" in said
    assert main(words) == 2
    assert "exists already" in capsys.readouterr().err


def test_json_and_a_problem_that_cannot_be_met(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["tune", "reference-1dof", "--subject-to", "margin >= 9e9", "--operators", "own", "--json"]) == 1
    data = json.loads(capsys.readouterr().out)
    assert data["feasible"] is False and "cannot be satisfied" in data["sentence"]


def test_check_over_operators(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(certificate_figures, "POINTS", 4)
    monkeypatch.setattr(certificate_figures, "GAIN_POINTS", 4)
    words = ["check", *OPERATORS, "paper-spring", "--set", "coupling.external.stiffness=60", "--samples", "12"]
    assert main([*words, "--out", str(tmp_path), "--strict"]) == 1
    said = capsys.readouterr().out
    assert said.startswith("in whose hands? ") and "12 drawn" in said
    for name in ("operators.png", "gains.png"):
        assert (tmp_path / name).read_bytes().startswith(b"\x89PNG")
    assert main([*words, "--json"]) == 0
    data = json.loads(capsys.readouterr().out)
    assert data["share"]["total"] == 12 and len(data["population"]) == 12
    again = gx.certify_operators(
        gx.load("paper-spring", {"coupling.external.stiffness": 60}), OPERATORS[1:], samples=12
    )
    assert data["sentence"] == again.sentence


def test_options_of_operators_stand_with_them(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", "paper-spring", "--samples", "12"]) == 2
    assert "--samples together with --operators" in capsys.readouterr().err
    assert main(["check", "paper-spring", "--operators", "finger.*.hand.stifness=50:60"]) == 2
    assert "did you mean 'stiffness'" in capsys.readouterr().err
