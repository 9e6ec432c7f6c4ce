"""Disks that are full while a trial is recorded: the session ends, and nothing that was answered is lost."""

from __future__ import annotations

import errno
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest

from graspfx.errors import RecordingError
from graspfx.experiment.answering import Function
from graspfx.experiment.design import Experiment
from graspfx.experiment.presenters import RealTime, Showing
from graspfx.experiment.session_files import SessionFiles
from graspfx.experiment.trial_table import read_table
from graspfx.recording.part import PartWriter
from tests.support.experiments import PLAIN, experiment, table_of


def full(method: str) -> Callable[..., object]:
    """Make a method that finds a full disk in the second trial."""
    original = getattr(PartWriter, method)

    def write(self: PartWriter, *given: Any, **more: Any) -> object:
        if "trial-002" in str(self.path):
            raise OSError(errno.ENOSPC, "No space left on device")
        return original(self, *given, **more)

    return write


@pytest.mark.parametrize(("method", "real_time"), [("write", True), ("conclude", True), ("write", False)])
def test_a_full_disk_ends_the_session_and_the_trial_comes_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, method: str, real_time: bool
) -> None:
    plain = experiment(PLAIN, ("repetitions = 2", "repetitions = 1"))
    with monkeypatch.context() as patch:
        patch.setattr(PartWriter, method, full(method))
        said = r"No space left.*\. Trial 2 has no row, the trials before it are in the table: .*--resume continues with"
        with pytest.raises(RecordingError, match=said):
            plain.run(tmp_path, lambda shown: "soft", real_time=real_time)
    assert [row["trial_number"] for row in read_table(table_of(tmp_path))] == ["1"]
    assert len(plain.run(tmp_path, lambda shown: "soft", real_time=real_time, resume=True)) == 1
    rows = read_table(table_of(tmp_path))
    assert [row["fault"] for row in rows] == ["n/a"] * 2 and rows[1]["path"].endswith("trial-002-2")


def test_a_trial_that_is_broken_off_says_why(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    plain: Experiment = experiment(PLAIN)
    monkeypatch.setattr(RealTime, "show", lambda self, values, folder, *more: Showing(folder, 0.0, 0.0, "", False))
    for asked, reason in ((False, "a run ended early, without a fault"), (True, "it was interrupted")):
        with ExitStack() as stack:
            trials = plain.session(
                stack, SessionFiles(tmp_path, f"{asked:d}", "1", "plain"), RealTime(plain.scene, 0.05),
                Function(lambda shown: "soft"), mode="real time", stop=lambda asked=asked: asked,  # type: ignore[misc]
            )  # fmt: skip
            assert list(trials.trials()) == [] and trials.reason == reason
