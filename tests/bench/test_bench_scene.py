"""`graspfx bench SCENE`: errors against a reference that knows its own, and what is not stable is said."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from graspfx.__main__ import main
from graspfx.bench import scene_choices
from graspfx.bench.scene_choices import (
    UNSTABLE,
    Choice,
    attempt,
    converge,
    distance,
    estimate,
    trade_off,
    tradeoff_sheet,
)
from graspfx.scene.load import load
from graspfx.show.style import arranged
from tests.support.writing import faults


@pytest.fixture(autouse=True)
def few(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two integrators, and no PyBullet, which is slow to start."""
    monkeypatch.setattr(scene_choices, "BODIES", ("exact", "explicit"))


@pytest.mark.parametrize("order", [1.0, 2.0, 4.0])
def test_richardson_recovers_the_error_that_is_left(order: float) -> None:
    """After halvings from h = 1 the error left of x_h = h^q is the last h^q itself."""
    sizes = 0.5 ** np.arange(6) ** 1.0
    values = sizes**order
    error, seen = estimate(list(-np.diff(values)))
    assert error == pytest.approx(values[-1], rel=1e-9) and seen == pytest.approx(order, rel=1e-9)


def test_without_a_common_order_the_last_change_is_the_error() -> None:
    assert estimate([1.0, 0.5, 0.1]) == (0.1, None)  # orders 1 and 2.3
    assert estimate([1.0, 0.9, 0.8]) == (0.8, None)  # order 0.2: hardly converging
    assert estimate([1.0]) == (1.0, None)
    assert estimate([0.1, 0.0]) == (0.0, None)


def test_the_reference_is_as_near_to_a_finer_motion_as_it_says() -> None:
    scene = load("reference-1dof")
    reference = converge(scene, 0.2, 0.02, small=1e-3)
    finer = attempt(scene, Choice("exact", reference.period / 8), 0.2, 0.02)
    away = distance(finer.places, reference.places)
    assert reference.order == pytest.approx(1.0, abs=0.1)  # the loop is sampled and held
    assert away == pytest.approx(reference.error * 7 / 8, rel=0.1)  # C h - C h/8
    assert reference.error <= 1e-3 * reference.extent


def test_errors_fall_with_the_period_and_the_front_is_marked() -> None:
    tradeoff = trade_off(load("reference-1dof"), duration=0.2, quick=True)
    errors = {each.choice.period: each.row.error for each in tradeoff.outcomes if each.choice.name == "explicit"}
    assert errors[0.01] > 1.7 * errors[0.005] > 2.5 * errors[0.0025] > 0.0  # type: ignore[operator]
    [interpreted] = [each for each in tradeoff.outcomes if each.choice.engine == "interpreted"]
    [twin] = [each for each in tradeoff.outcomes if each.choice == Choice("exact", 0.005)]
    assert interpreted.row.error == twin.row.error and "same bits" in interpreted.row.note
    assert interpreted.row not in tradeoff.best and tradeoff.best
    lines = list(tradeoff.lines())
    assert "its own error is about" in lines[1] and sum(line.startswith("  * ") for line in lines) == len(tradeoff.best)
    drawing = tradeoff_sheet(tradeoff)
    assert faults(arranged(drawing)) == []
    rings = [line for line in drawing.panels[0, 0].lines if "no other" in str(line.get_label())]
    assert len(rings[0].get_xdata()) == len(tradeoff.best)


def test_what_is_not_stable_at_a_long_period_is_said_and_not_drawn() -> None:
    scene = load("reference-1dof", {"coupling.internal.stiffness": 1500.0, "coupling.internal.damping": 3.0})
    tradeoff = trade_off(scene, duration=1.0, quick=True)
    states = {each.choice.period: each.row for each in tradeoff.outcomes if each.choice.name == "exact"}
    assert states[0.01].state == UNSTABLE and states[0.0025].state == "timed"
    assert states[0.01].error is None and states[0.01].time_us is None and states[0.01].note.startswith("unstable: ")
    rows = [row for row in tradeoff.to_dict()["rows"] if row["state"] == UNSTABLE]
    assert rows and all(row["error_m"] is None and not row["front"] for row in rows)
    [axes] = tradeoff_sheet(tradeoff).panels[0]
    drawn = sum(len(line.get_xdata()) for line in axes.lines if line.get_label() in ("exact", "explicit"))
    assert drawn == sum(each.row.state == "timed" and each.choice.engine == "compiled" for each in tradeoff.outcomes)


def test_the_command_prints_json_and_draws(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["bench", "reference-1dof", "--quick", "--duration", "0.1", "--json", "--out", str(tmp_path / "b")]
    assert main(words) == 0
    table = json.loads(capsys.readouterr().out)
    assert table["scene"] == "reference-1dof" and table["duration_s"] == pytest.approx(0.1)
    assert table["reference"]["error_m"] > 0.0 and any(row["front"] for row in table["rows"])
    assert (tmp_path / "b/bench.png").stat().st_size > 5000
    assert main(words) == 2 and "bench.png" in capsys.readouterr().err  # is there


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (["paper-wavng"], "unknown benchmark or scene 'paper-wavng'; did you mean 'paper-waving'?"),
        (["eq5"], "did you mean 'eq4'?"),
        (["eq4", "paper-waving"], "names of benchmarks, or of one scene only"),
        (["eq4", "--set", "period=0.1"], "the name of a scene"),
        (["missing.toml"], "missing.toml"),
        (["contact"], "python -m tests.bench contact"),
        (["conatct"], "did you mean 'contact'?"),
        (["reference-1dof", "--duration", "0.01"], "twice the longest period"),
    ],
)
def test_names_that_lead_nowhere(
    words: list[str], text: str, capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["bench", *words]) == 2
    assert text in capsys.readouterr().err
