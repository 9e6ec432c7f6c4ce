"""Sessions that go on: only with the files and the GraspFX that they were begun with; earlier forms say so."""

from __future__ import annotations

import json
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import graspfx as gx
from graspfx.errors import RecordingError
from graspfx.experiment import trial_table
from graspfx.experiment.design import Experiment
from graspfx.experiment.experiment_file import load
from graspfx.experiment.trial_table import SessionWarning
from tests.support.experiments import PLAIN
from tests.support.hand_of_its_own import HAND, SCENE

Change = Callable[[dict[str, Any]], object]


@pytest.fixture
def begun(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Experiment:
    """A session with a hand of its own, of which no trial is done."""
    monkeypatch.setenv("GRASPFX_TRUST", "1")
    (tmp_path / "steady.py").write_text(f"def angle():\n    import wrist\n{HAND}")
    (tmp_path / "wrist.py").write_text("angle = 1.0\n")
    (tmp_path / "firm.py").write_text(HAND.replace("60.0", "90.0"))
    (tmp_path / "steady.toml").write_text(SCENE)
    text = PLAIN.replace('"reference-1dof"', '"steady.toml"').replace(
        "= 70.0 }", '= 70.0, "hand.own.kind" = "firm.py" }'
    )
    assert text != PLAIN and "firm.py" in text
    (tmp_path / "mine.toml").write_text(text)
    study = load(tmp_path / "mine.toml")
    assert study.run(tmp_path / "study", lambda shown: "soft", stop=lambda: True) == []
    return study


def resumed(study: Experiment, folder: Path) -> int:
    """Go on with a session, and count the trials."""
    return len(study.run(folder / "study", lambda shown: "soft", resume=True))


def describe(folder: Path, change: Change) -> None:
    """Change what the description of the session says."""
    (path,) = folder.glob("study/sub-*/ses-*/beh/*_beh.json")
    about = json.loads(path.read_text("utf-8"))
    change(about["GraspFX"])
    path.write_text(json.dumps(about), encoding="utf-8")


@pytest.mark.parametrize("name", ["steady.py", "firm.py", "wrist.py"])
def test_a_file_that_has_changed_refuses_it(begun: Experiment, tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_text(
        (tmp_path / name).read_text().replace("0.8", "0.7").replace("angle = 1.0", "angle = 2")
    )
    with pytest.raises(RecordingError, match=rf"the file {name} has changed; .*begin another with --run N"):
        resumed(begun, tmp_path)


def test_another_version_refuses_it(begun: Experiment, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(trial_table, "__version__", "99.0")
    with pytest.raises(RecordingError, match=f"GraspFX {gx.__version__} there, 99.0 here"):
        resumed(begun, tmp_path)


def test_the_same_goes_on_without_a_word(begun: Experiment, tmp_path: Path) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert resumed(begun, tmp_path) == 4


def test_a_session_of_an_earlier_form_goes_on_with_a_word(begun: Experiment, tmp_path: Path) -> None:
    stem = "sub-01_ses-01_task-plain_run-01"
    parts = [begun.table.model_dump(mode="json"), begun.scene.to_dict(), stem, "function"]

    def date_back(about: dict[str, Any]) -> None:
        del about["Files"]
        about["Digest"] = trial_table._digest(parts)

    describe(tmp_path, date_back)
    with pytest.warns(SessionWarning, match=r"without digests of files; .*: (firm|steady|wrist)\.py, "):
        assert resumed(begun, tmp_path) == 4


@pytest.mark.parametrize(
    ("change", "text"),
    [
        (lambda about: about.pop("Files") and about.update(Version="0.0.1"), "GraspFX 0.0.1 there"),
        (lambda about: about.pop("Files"), "the experiment file has other values"),
        (
            lambda about: about["Scene"]["object"][0].update(mass=9.0),
            "the scene's object.0.mass is 9.0 there, 0.1 here",
        ),
        (lambda about: about.update(Mode="simulated"), "the mode is simulated there, function here"),
        (lambda about: about.pop("Digest"), "there is no session to resume"),
    ],
)
def test_others_are_refused_with_what_differs(begun: Experiment, tmp_path: Path, change: Change, text: str) -> None:
    describe(tmp_path, change)
    with pytest.raises(RecordingError, match=text):
        resumed(begun, tmp_path)
