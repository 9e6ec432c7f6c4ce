"""Experiment: a scene, the conditions of its trials, and sessions with participants."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from os import PathLike
from typing import TYPE_CHECKING, Any

from graspfx.certificate.report import check
from graspfx.environment import to_path
from graspfx.errors import InputError
from graspfx.experiment.answering import Answerer, Function
from graspfx.experiment.experiment_table import WORD, Study
from graspfx.experiment.presenters import Presenter, RealTime, Simulated
from graspfx.experiment.session_files import SessionFiles
from graspfx.experiment.session_of_trials import Event, Markers, SessionOfTrials
from graspfx.experiment.session_plan import SessionPlan, session_plan
from graspfx.experiment.simulated_observers import simulated_observer
from graspfx.experiment.trial import Presentation, Row, Trial
from graspfx.experiment.trial_table import begin, resume
from graspfx.live.hardware_clamp import SHARE
from graspfx.plugins import unchanged
from graspfx.progress import waiting

if TYPE_CHECKING:
    from graspfx.experiment.session_plan import SessionPlan

SIMULATED, REAL_TIME = "simulated", "real time"


class Experiment(Study):
    """Experiment read from a file by `load`.

    Args:
        table: Tables of the file.
        scene: Scene with the values that all trials share.
        source: Source of the tables: name, text and path of the file.
    """

    def __repr__(self) -> str:
        return f"<Experiment {self.name} with {self.source.name}>"

    @property
    def name(self) -> str:
        """Name of the task."""
        return self.table.name

    @property
    def title(self) -> str:
        """Title of the experiment; without a title, the name of the task."""
        return self.table.title or self.name

    @property
    def duration(self) -> float:
        """Duration of an interval [s]."""
        return self.scene.duration if self.table.duration is None else self.table.duration

    def plan(self, participant: str = "01", session: str = "01") -> SessionPlan:
        """Plan a participant's session. The plan depends only on the file, the participant and the session.

        Raises:
            InputError: If a label contains characters other than letters and digits, or if the order is a Latin square
                and the participant is not a whole number of at least 1.
            MissingPackageError: If the experiment has a staircase, and questplus is not installed.
        """
        for name, label in (("participant", participant), ("session", session)):
            require_label(name, label)
        return session_plan(self.table, participant, session)

    def order(self, participant: str = "01", session: str = "01") -> list[Trial]:
        """List the trials of a session in order; increments that a staircase will choose are NaN.

        Raises:
            InputError, MissingPackageError: As in `plan`.
        """
        slots = self.plan(participant, session).slots
        return [
            slot.cell.trial(k + 1, slot.repetition, slot.place, float("nan"), is_practice=slot.is_practice)
            for k, slot in enumerate(slots)
        ]

    def run(
        self,
        out: str | PathLike[str],
        respond: Callable[[Presentation], str] | None = None,
        *,
        participant: str = "01",
        session: str = "01",
        run: int = 1,
        real_time: bool = False,
        ready: Callable[[str], object] | None = None,
        resume: bool = False,
        stop: Callable[[], bool] | None = None,
    ) -> list[Row]:
        """Run a session in which a function answers.

        The row of each trial is on the disk before the next trial begins. Each interval of a trial is a separate run
        that starts at rest.

        Args:
            out: Folder of the study; its files have BIDS names.
            respond: Function that answers a trial; None for the experiment's simulated observer.
            participant, session: Labels of letters and digits.
            run: Number of the run in the session, from 1 to 99.
            real_time: Whether intervals run in real time.
            ready: Function called with a text if a person must be ready. It is called before hardware exerts forces
                and, if `real_time` is true, also at breaks and before trials that wait for a key. It returns when the
                person is ready.
            resume: Whether to continue an interrupted session with its next trial.
            stop: Function that is polled during the session. If it returns True, the session ends, and can be resumed
                later.

        Returns:
            One row for each trial of this call.

        Raises:
            InputError: If hardware is used without `real_time` or without `ready`, if hardware fails, if a label
                contains characters other than letters and digits, or if an answer is unknown.
            RecordingError: If the session already exists, or if the session to be resumed does not exist.
            GraspFXError: If a simulated run fails.
        """
        answerer = Function(respond or simulated_observer(self.table, participant, session), ready)
        show = RealTime if real_time else Simulated
        presenter: Presenter = show(self.scene, self.duration)
        if presenter.has_hardware and ready is None:
            do = "hardware exerts forces after this function returns"
            raise InputError("ready", None, "a function that returns when a person is ready", do)
        place = SessionFiles(to_path("out", out, "the path of a folder"), participant, session, self.name, run)
        with unchanged(), ExitStack() as stack:
            trials = self.session(
                stack, place, presenter, answerer, resume=resume, stop=stop or (lambda: False),
                mode=SIMULATED if respond is None else REAL_TIME if real_time else "function", is_paced=real_time,
            )  # fmt: skip
            return list(trials.trials())

    def session(
        self, stack: ExitStack, files: SessionFiles, presenter: Presenter, answerer: Answerer, *, mode: str,
        resume: bool = False, stop: Callable[[], bool], tell: Callable[[str], object] = lambda text: None,
        listeners: Sequence[Callable[[Event], object]] = (), is_paced: bool = True,
    ) -> SessionOfTrials:  # fmt: skip
        """Open the files of a session, and return the session without running its trials.

        The files are closed by `stack`.

        Raises:
            InputError, RecordingError, MissingPackageError: As in `run`.
        """
        if not 1 <= files.run <= 99:
            raise InputError("run", files.run, "a number from 1 to 99")
        plan = self.plan(files.participant, files.session)
        if presenter.has_hardware:
            require_certified(self, plan)
        rows, started = _resume(self, files, mode, plan) if resume else begin(self, files, mode)
        stack.callback(rows.close)
        markers = Markers(files, started, resume=resume, listeners=listeners)
        stack.callback(markers.close)
        return SessionOfTrials(self.table, files, plan, rows, markers, presenter, answerer, tell, stop, is_paced)


_resume = resume


def require_label(name: str, label: str) -> None:
    """Raise an error unless a label can be part of a file name.

    Raises:
        InputError: If the label contains characters other than letters and digits.
    """
    if re.fullmatch(WORD, str(label)) is None:
        raise InputError(name, label, "letters and digits only", "such as 03")


def require_certified(experiment: Study, plan: SessionPlan) -> None:
    """Raise an error unless every stimulus of a session has the stability margin that hardware needs, 1/0.9.

    Raises:
        InputError: If a stimulus is unstable, is too close to a stability limit, or cannot be judged.
    """
    stimuli = list(_stimuli(plan))
    judged: list[Mapping[str, Any]] = []
    with waiting(f"certifying {len(stimuli)} stimuli", len(stimuli), "stimuli", lambda: len(judged)):
        for values in stimuli:
            _require(experiment, values)
            judged.append(values)


def _require(experiment: Study, values: Mapping[str, Any]) -> None:
    text = ", ".join(f"{key} = {value}" for key, value in values.items())
    report = check(experiment.scene, values)
    if not report.ok:
        raise InputError("stimulus", text, "values that are certified for hardware", report.verdict)
    for certificate in report.certificates:
        for row in certificate.limits:
            if row.margin < 1.0 / SHARE:
                why = f"{row.mode} margin {row.margin:.3f}, {1.0 / SHARE:.3f} needed; limit {row.limit:.4g} N/m"
                raise InputError("stimulus", text, "values with the margin that hardware needs", why)


def _stimuli(plan: SessionPlan) -> Iterator[Mapping[str, Any]]:
    """Yield each distinct set of interval values, with every increment that a staircase may choose."""
    seen: list[Mapping[str, Any]] = []
    for slot in plan.slots:
        increments = plan.stairs[slot.cell.condition].increments.tolist() if slot.cell.is_adaptive else [math.nan]
        if plan.easy is not None and slot.cell.is_adaptive:
            increments = [*increments, plan.easy]
        for increment in increments:
            for values in slot.cell.trial(1, 1, 0, increment).intervals:
                if values not in seen:
                    seen.append(values)
                    yield values
