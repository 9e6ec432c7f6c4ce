"""An experiment: a scene, what differs between its trials, and the sessions in which people answer."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from os import PathLike
from typing import TYPE_CHECKING

from graspfx.environment import to_path
from graspfx.errors import InputError
from graspfx.experiment.answering import Answerer, Function
from graspfx.experiment.experiment_table import WORD, Study
from graspfx.experiment.markers import Event, Markers
from graspfx.experiment.presenters import Presenter, RealTime, Simulated
from graspfx.experiment.session_files import SessionFiles
from graspfx.experiment.session_of_trials import SessionOfTrials
from graspfx.experiment.session_plan import SessionPlan, session_plan
from graspfx.experiment.simulated_observers import simulated_observer
from graspfx.experiment.trial import Presentation, Row, Trial
from graspfx.experiment.trial_table import begin, resume
from graspfx.plugins import unchanged

if TYPE_CHECKING:
    pass

SIMULATED, REAL_TIME = "simulated", "real time"


class Experiment(Study):
    """An experiment, as it was read from a file by `load`.

    Args:
        table: its tables.
        scene: with the values of all trials.
        source: where it came from.
    """

    def __repr__(self) -> str:
        return f"<Experiment {self.name} with {self.source.name}>"

    @property
    def name(self) -> str:
        """Name of the task."""
        return self.table.name

    @property
    def title(self) -> str:
        """Title of the experiment, or its name."""
        return self.table.title or self.name

    @property
    def duration(self) -> float:
        """Time of an interval [s]."""
        return self.scene.duration if self.table.duration is None else self.table.duration

    def plan(self, participant: str = "01", session: str = "01") -> SessionPlan:
        """Plan a participant's session: the same for the same file, participant and session.

        Raises:
            InputError: a label with other than letters and digits; a Latin square for no number.
            MissingPackageError: a staircase without questplus.
        """
        for name, label in (("participant", participant), ("session", session)):
            require_label(name, label)
        return session_plan(self.table, participant, session)

    def order(self, participant: str = "01", session: str = "01") -> list[Trial]:
        """List the trials of a session in their order; increments that a staircase will choose are nan.

        Raises:
            InputError, MissingPackageError: as of `plan`.
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
        """Run a session, in which a function answers.

        Each trial's row is on the disk before the next trial begins. A trial's interval is a run of its own, that
        starts at rest.

        Args:
            out: the folder of the study; files in it are named as BIDS does.
            respond: gives the answer to a trial that was shown; the experiment's simulated observer if not given.
            participant, session: labels, letters and digits.
            run: of the session, from 1.
            real_time: whether intervals run by the wall's clock.
            ready: is called with a text before forces of hardware come, and returns once the person has acted.
            resume: whether a session that was broken off goes on with its next trial.
            stop: asked again and again; the first True ends the session, to be resumed.

        Returns:
            A row for each trial that was run now.

        Raises:
            InputError: hardware without real time or without `ready`, or that ended in a fault; a label with other
                than letters and digits; an answer that is none.
            RecordingError: the session is there already, or is not there to be resumed.
            GraspFXError: whatever a run raises.
        """
        answerer = Function(respond or simulated_observer(self.table, participant, session), ready)
        show = RealTime if real_time else Simulated
        presenter: Presenter = show(self.scene, self.duration)
        if presenter.has_hardware and ready is None:
            raise InputError("ready", None, "a function that waits until a person acts", "forces come after it")
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
        """Open the files of a session, which the stack closes; its trials are yet to be run.

        Raises:
            InputError, RecordingError, MissingPackageError: as of `run`.
        """
        if not 1 <= files.run <= 99:
            raise InputError("run", files.run, "a number from 1 to 99")
        plan = self.plan(files.participant, files.session)
        if presenter.has_hardware:
            from graspfx.experiment.certified_stimuli import require_certified

            require_certified(self, plan)
        rows, started = _resume(self, files, mode, plan) if resume else begin(self, files, mode)
        stack.callback(rows.close)
        markers = Markers(files, started, resume=resume, listeners=listeners)
        stack.callback(markers.close)
        return SessionOfTrials(self.table, files, plan, rows, markers, presenter, answerer, tell, stop, is_paced)


_resume = resume


def require_label(name: str, label: str) -> None:
    """Require a label that stands in names of files.

    Raises:
        InputError: it has other than letters and digits.
    """
    if re.fullmatch(WORD, str(label)) is None:
        raise InputError(name, label, "letters and digits alone", "as in 03")
