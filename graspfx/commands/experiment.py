"""graspfx experiment: run trials with a person or a simulated observer, record them, and write a table of answers."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from collections import Counter
from collections.abc import Callable
from contextlib import ExitStack
from math import exp
from pathlib import Path
from typing import TYPE_CHECKING

from graspfx.commands.arguments import add_options
from graspfx.commands.destination import OUT
from graspfx.commands.output import FAULTS, INTERRUPTED, SUCCESS, interruptible, is_quiet, tell
from graspfx.errors import InputError

if TYPE_CHECKING:
    from graspfx.experiment.answer_page import AnswerPage
    from graspfx.experiment.answering import Answerer, Keys
    from graspfx.experiment.design import Experiment
    from graspfx.experiment.presenters import Presenter, Watcher
    from graspfx.experiment.session_files import SessionFiles
    from graspfx.experiment.session_of_trials import Event

EXAMPLE = """  graspfx experiment stiffness-jnd --simulate
  graspfx experiment mine.toml --participant 03 --page
  graspfx experiment mine.toml --participant 03 --resume"""


def add_arguments(parser: ArgumentParser) -> None:
    text = "path of an experiment's .toml file, or name of a built-in experiment (stiffness-jnd)"
    parser.add_argument("experiment", metavar="EXPERIMENT", help=text)
    add_options(
        parser,
        ("--participant LABEL", "label of the participant, letters and digits (default: 01)", str, "01"),
        ("--session LABEL", "label of the session (default: 01)", str, "01"),
        ("--run N", "number of the run in the session (default: 1)", int, 1),
        ("--resume", "continue an interrupted session"),
        ("--simulate", "take answers from the file's [observer] instead of a person; trials do not run in real time"),
        ("--plan", "print the order of the trials without running them"),
        ("--page", "also take answers from a page in a browser on this machine"),
        ("--port N", "port of the page (default: the first free one from 8080)", int),
        ("--stream", "stream states to other programs over a WebSocket"),
        ("--lsl", "stream markers and rows over the Lab Streaming Layer"),
        ("--out DIR", "folder of the study (default: out/NAME)", Path),
        (
            "--trust",
            "allow the experiment and its scene to use files outside their folders; Python files are executed",
        ),
    )


def execute(options: Namespace) -> int:
    from graspfx.experiment.experiment_file import load
    from graspfx.experiment.session_files import SessionFiles

    if options.simulate and (options.page or options.lsl or options.stream):
        raise InputError("--simulate", "with --page, --lsl or --stream", "--simulate without these options")
    experiment = load(options.experiment)
    if options.plan:
        return _print_plan(experiment, options)
    root = options.out if options.out is not None else OUT / experiment.name
    files = SessionFiles(root, options.participant, options.session, experiment.name, options.run)
    with interruptible() as stop, ExitStack() as stack:
        return _run(experiment, files, options, stop, stack)


def _run(
    experiment: Experiment, files: SessionFiles, options: Namespace, stop: Callable[[], bool], stack: ExitStack
) -> int:
    from graspfx.experiment.answering import Function, Keys
    from graspfx.experiment.design import REAL_TIME, SIMULATED
    from graspfx.experiment.presenters import RealTime, Simulated
    from graspfx.experiment.simulated_observers import simulated_observer

    tellers: list[Callable[[str], object]] = []
    answerer: Answerer
    presenter: Presenter
    listeners: list[Callable[[Event], object]] = []
    keys: Keys | None = None
    if options.simulate:
        answerer = Function(simulated_observer(experiment.table, files.participant, files.session))
        presenter = Simulated(experiment.scene, experiment.duration)
    else:
        watchers: list[Watcher] = []
        tellers.append(tell)
        answerer = keys = Keys(lambda text: [each(text) for each in tellers], stop)
        if options.page:
            page = _page(experiment, keys, options, stack)
            watchers.append(page)
            tellers.append(page.tell)
        if options.stream:
            from graspfx.live.state_stream import stream_of

            stream, address = stream_of(stack)
            tell(address)
            watchers.append(stream)
        if options.lsl:
            listen, rows = _streams(experiment, stack)
            listeners.append(listen)
            watchers.append(rows)
        presenter = RealTime(experiment.scene, experiment.duration, watchers)
    trials = experiment.session(
        stack, files, presenter, answerer, mode=SIMULATED if options.simulate else REAL_TIME, resume=options.resume,
        stop=stop, tell=lambda text: [each(text) for each in tellers], listeners=listeners,
        is_paced=not options.simulate,
    )  # fmt: skip
    if keys is not None:
        from graspfx.system.terminal import terminal_keys

        stack.enter_context(terminal_keys(keys.press, keys.end if not options.page else _nothing))
    total, faults = len(trials.plan.slots), 0
    for row in trials.trials():
        faults += bool(row.fault)
        if options.simulate and not is_quiet() and row.trial.number % 20 == 0:
            tell(f"{row.trial.number} of {total} trials")
        elif row.fault:
            tell(f"fault: {row.fault}")
    _sum_up(experiment, files)
    if trials.plan.done < total:
        tell(_farewell(trials.plan.done, total, trials.reason))
        return INTERRUPTED
    return FAULTS if faults else SUCCESS


def _farewell(done: int, total: int, reason: str) -> str:
    """Return the message about a session that ended after `done` of `total` trials, for a reason."""
    where = f"after trial {done} of {total}" if done else f"before the first of {total} trials"
    return f"ended {where}: {reason}; the same command with --resume continues with trial {done + 1}"


def _page(experiment: Experiment, keys: Keys, options: Namespace, stack: ExitStack) -> AnswerPage:
    from graspfx.experiment.answer_page import AnswerPage

    table = experiment.table
    answers = table.question.keys if table.question is not None else {}
    scene = experiment.scene if table.page == "scene" else None
    page = stack.enter_context(AnswerPage(experiment.title, answers, keys.press, scene, port=options.port))
    tell(f"{page.server.url}  (this machine only)")
    return page


def _sum_up(experiment: Experiment, files: SessionFiles) -> None:
    """Print the number of correct answers and the threshold for each condition, and the path of the table."""
    from graspfx.experiment.staircase import thresholds
    from graspfx.experiment.trial_table import read_table

    if is_quiet():
        return
    table = read_table(files.table)
    rows = [row for row in table if row["trial_type"] == "test"]
    right = Counter(row["condition"] for row in rows if row["correct"] == "true")
    judged = Counter(row["condition"] for row in rows if row["correct"] in ("true", "false"))
    for name, count in judged.items():
        print(f"{name}: {right[name]} of {count} answers correct")
    if experiment.table.staircase is not None and rows:
        for each in thresholds(experiment, rows):
            if each.trials:
                low, high = (100.0 * each.value * exp(sign * each.spread) for sign in (-1.0, 1.0))
                print(f"{each.condition}: threshold {100.0 * each.value:.1f} % ({low:.1f} to {high:.1f} %)")
    print(f"wrote {files.table}" if table else f"{files.table} has no trial yet")


def _print_plan(experiment: Experiment, options: Namespace) -> int:
    for trial in experiment.order(options.participant, options.session):
        kind = "practice" if trial.is_practice else "test"
        levels = "".join(f"  {name}={level}" for name, level in trial.levels.items())
        size = "" if trial.increment != trial.increment else f"  +{100.0 * trial.increment:.4g} %"
        answer = f"  {trial.answer}" if trial.answer else ""
        print(f"{trial.number}  {kind}  {trial.condition}{levels}{size}{answer}")
    return SUCCESS


def _streams(experiment: Experiment, stack: ExitStack) -> tuple[Callable[[Event], object], Watcher]:
    """Open streams of the Lab Streaming Layer; return the function that sends markers, and the stream of rows."""
    from graspfx.experiment.session_of_trials import LslMarkers
    from graspfx.live.lsl_outlet import RowStream

    rows = stack.enter_context(RowStream(f"GraspFX {experiment.name}"))
    return LslMarkers(f"GraspFX {experiment.name} markers").mark, rows


def _nothing() -> None:
    """Do nothing when the terminal closes, because a session with a page continues."""
