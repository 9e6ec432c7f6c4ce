"""Table of a session with one row per trial: writing, description of the columns, and reading."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from datetime import datetime
from hashlib import sha256
from os import PathLike
from typing import TYPE_CHECKING, Any

from graspfx import __version__, log
from graspfx.assembly.provenance import by_name, engine_versions, file_changes, files_of, scene_changes
from graspfx.environment import to_path
from graspfx.errors import InputError, RecordingError
from graspfx.experiment.experiment_table import Study
from graspfx.experiment.session_files import MISSING, RowFile, SessionFiles, cell, place_file, text_of
from graspfx.experiment.trial import FIRST, SECOND, Row

if TYPE_CHECKING:
    from graspfx.experiment.session_plan import SessionPlan

COLUMNS: dict[str, dict[str, Any]] = {
    "trial_number": {"Description": "order of the trial in the session, from 1"},
    "trial_type": {"Description": "whether the trial is evaluated", "Levels": {"test": "yes", "practice": "no"}},
    "condition": {"Description": "name of the condition"},
    "repetition": {"Description": "repetition of the condition and levels, from 1; in practice, number of the trial"},
    "reference": {"Description": "smaller value of a comparison, in units of its key"},
    "increment": {"Description": "difference between the two values, relative to the reference", "Units": "1"},
    "larger": {"Description": "interval with the larger value", "Levels": {FIRST: "", SECOND: ""}},
    "response": {"Description": "answer of the participant"},
    "correct": {"Description": "whether the response is correct", "Levels": {"true": "", "false": ""}},
    "response_time": {"Description": "time from the question, once it can be answered, to the response", "Units": "s"},
    "onset": {"Description": "time of the trial's first stimulus since the start of the session", "Units": "s"},
    "duration": {"Description": "time from the onset to the response, or to the trial's end", "Units": "s"},
    "fault": {"Description": "fault of a run in the trial, after which its forces were zero"},
    "path": {"Description": "folder of the trial's recordings, relative to this file"},
}
RESERVED = frozenset(COLUMNS)


def columns_of(experiment: Study) -> list[str]:
    """List the column names; factors follow the repetition."""
    factors = [factor.name for factor in experiment.table.factor]
    names = list(COLUMNS)
    at = names.index("reference")
    return [*names[:at], *factors, *names[at:]]


def describe(experiment: Study, files: SessionFiles, mode: str) -> dict[str, Any]:
    """Return the description of a session: the columns in BIDS form, and the complete experiment."""
    table = experiment.table
    factors = {factor.name: {"Description": f"level of the factor; values of {factor.key or 'several keys'}"}
               for factor in table.factor}  # fmt: skip
    columns = COLUMNS | factors
    question = table.question
    return {
        "TaskName": table.name,
        "TaskDescription": table.title,
        "Instructions": question.text if question is not None else "",
        **{name: columns[name] for name in columns_of(experiment)},
        "GraspFX": {
            "Started": now_precisely(),
            "Participant": files.participant,
            "Session": files.session,
            "Seed": table.seed,
            "Mode": mode,
            "Keys": dict(question.keys) if question is not None else {},
            "Experiment": table.model_dump(mode="json", exclude_unset=True),
            "ExperimentText": experiment.source.text,
            "Scene": experiment.scene.to_dict(),
            **session_identity(experiment, files, mode),
        },
    }


def now_precisely() -> str:
    """Return the date and time in UTC, in ISO 8601 with microseconds."""
    from datetime import UTC

    return datetime.now(UTC).isoformat(timespec="microseconds")


def begin(experiment: Study, files: SessionFiles, mode: str) -> tuple[RowFile, float]:
    """Create the table of a session; return it with the start of the session, as POSIX time [s].

    Raises:
        RecordingError: If the table or its description exists, or a file cannot be written.
    """
    about = describe(experiment, files, mode)
    if not files.study.exists():
        study = {"Name": experiment.table.title or experiment.table.name, "BIDSVersion": "1.10.0", "DatasetType": "raw",
                 "GeneratedBy": [{"Name": "GraspFX", "Version": __version__}]}  # fmt: skip
        place_file(files.study, json.dumps(study, indent=2) + "\n")
    if files.table.exists():
        raise RecordingError(
            f"{files.table}: exists already; --resume continues it, and --run N begins another session"
        )
    if files.table_description.exists():
        why = "but its table does not: a start was interrupted or is in progress, and there is no trial yet"
        do = "--resume continues it, and --run N begins another session; or remove this file"
        raise RecordingError(f"{files.table_description}: exists already, {why}; {do}")
    place_file(files.table_description, json.dumps(about, indent=2, allow_nan=False) + "\n")
    return RowFile(files.table, columns_of(experiment)), _started(about)


def resume(experiment: Study, files: SessionFiles, mode: str, plan: SessionPlan) -> tuple[RowFile, float]:
    """Open the table of an interrupted session, and advance the plan past the trials in the table.

    Return the table and the start of the session, as `begin` does.

    Raises:
        RecordingError: If there is no session, if its experiment, scene, files, version, order or mode differ, or if
            another process is writing to its table.
        InputError: If the table is not UTF-8.
    """
    try:
        about = json.loads(files.table_description.read_text("utf-8"))
        started, _ = _started(about), about["GraspFX"][DIGEST]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise RecordingError(f"{files.table_description}: there is no session to resume") from error
    require_same(about["GraspFX"], experiment, files, mode)
    rows = RowFile(files.table, columns_of(experiment), resume=files.table.exists())
    try:
        for number, row in enumerate(rows.rows):
            _take(plan, row, f"{files.table}:{number + 2}")
    except BaseException:
        rows.close()
        raise
    return rows, started


def _started(about: Mapping[str, Any]) -> float:
    return datetime.fromisoformat(about["GraspFX"]["Started"]).timestamp()


def _take(plan: SessionPlan, row: Mapping[str, str], where: str) -> None:
    """Advance a plan by a row of the table; the response in the row updates the staircase."""
    trial = plan.trial()
    expected = {} if trial is None else cells_of(Row(trial))
    same = ("trial_number", "trial_type", "condition", "repetition", "increment", "larger")
    if trial is None or any(row.get(name) != cell(expected[name]) for name in same):
        raise RecordingError(f"{where}: does not match the order of this session")
    response = row.get("response", MISSING)
    plan.take(Row(trial, "" if response == MISSING else response))


def cells_of(row: Row) -> dict[str, Any]:
    """Return the cells of a row by column."""
    trial = row.trial
    return {
        "trial_number": trial.number,
        "trial_type": "practice" if trial.is_practice else "test",
        "condition": trial.condition,
        "repetition": trial.repetition,
        **{name: level if isinstance(level, str | float | int) else json.dumps(level)
           for name, level in trial.levels.items()},
        "reference": trial.reference,
        "increment": trial.increment,
        "larger": trial.answer if trial.is_comparison else "",
        "response": row.response,
        "correct": row.is_correct,
        "response_time": _rounded(row.response_time),
        "onset": _rounded(row.onset),
        "duration": _rounded(row.duration),
        "fault": row.fault,
        "path": row.path,
    }  # fmt: skip


def _rounded(seconds: float) -> float:
    return seconds if math.isnan(seconds) else round(seconds, 6)


def read_table(path: str | PathLike[str]) -> list[dict[str, str]]:
    """Read the rows of a table of trials as dictionaries by column; an incomplete last row is dropped.

    A missing value remains the text n/a.

    Raises:
        InputError: If there is no such file, the table is not UTF-8, or the number of cells in a row differs from the
            number of columns.
    """
    file = to_path("path", path)
    if not file.is_file():
        raise InputError("path", path, "the path of a table of trials, a file that ends in _beh.tsv")
    text = text_of(file, file.read_bytes())
    head, *lines = text[: text.rfind("\n") + 1].splitlines() or [""]
    names = head.split("\t")
    rows = [line.split("\t") for line in lines]
    for number, row in enumerate(rows):
        if len(row) != len(names):
            where, expected = f"{path}, line {number + 2}", f"{len(names)} cells, one for each column"
            raise InputError(where, f"{len(row)} cells", expected, "use the original table")
    return [dict(zip(names, row, strict=True)) for row in rows]


DIGEST, FILES, VERSION = "Digest", "Files", "Version"
MOST = 5  # differences listed in the message


class SessionWarning(UserWarning):
    """Warning that a session is resumed although its original conditions are not completely known."""


def session_identity(experiment: Study, files: SessionFiles, mode: str) -> dict[str, Any]:
    """Return the data that identify a session's experiment, scene, participant and mode.

    Digests of files used by the scene or by trials are stored by file name, regardless of the folder.
    """
    table = experiment.table
    values = [[each.model_dump(mode="json") for each in tables] for tables in (table.condition, table.factor)]
    digests = by_name(files_of(experiment.scene, values))
    engines = engine_versions(experiment.scene, values)
    version = ", ".join([__version__, *(" ".join(each) for each in engines.items())])
    about = [*_earlier_parts(experiment, files, mode), digests, version]
    return {VERSION: version, FILES: digests, DIGEST: _digest(about)}


def require_same(about: Mapping[str, Any], experiment: Study, files: SessionFiles, mode: str) -> None:
    """Raise an error unless an interrupted session has the same identity as the session that resumes it.

    If the interrupted session has no digests of its files, a warning is given.

    Args:
        about: Entry "GraspFX" of the interrupted session's description.
        experiment, files, mode: Experiment, files and mode of the session that resumes it.

    Raises:
        RecordingError: If the identities differ; the message lists the differences.
    """
    own = session_identity(experiment, files, mode)
    is_whole = FILES in about
    before = own[DIGEST] if is_whole else _digest(_earlier_parts(experiment, files, mode))
    differences = list(_differences(about, own, experiment, mode))
    if about[DIGEST] != before or differences:
        lines = differences or ["the experiment file has other values, or this is another participant's session"]
        more = f"; and {len(lines) - MOST} more" if len(lines) > MOST else ""
        text = "this session has another experiment, scene or mode"
        do = "resume it with the original files and version, or begin another with --run N"
        raise RecordingError(f"{files.table_description}: {text}: {'; '.join(lines[:MOST])}{more}; {do}")
    if not is_whole and own[FILES]:
        names = ", ".join(own[FILES])
        text = f"begun with an older GraspFX, without digests of files; check that these files are unchanged: {names}"
        log.warn(f"{files.table_description}: {text}", SessionWarning)


def _differences(about: Mapping[str, Any], own: Mapping[str, Any], experiment: Study, mode: str) -> Iterator[str]:
    scene = json.loads(json.dumps(experiment.scene.to_dict()))
    if about.get(VERSION) != own[VERSION]:
        yield f"GraspFX {about.get(VERSION)} there, {own[VERSION]} here"
    if about.get("Mode", mode) != mode:
        yield f"the mode is {about['Mode']} there, {mode} here"
    if isinstance(about.get("Scene"), dict):
        yield from scene_changes(about["Scene"], scene)
    if isinstance(about.get(FILES), dict):
        yield from file_changes(about[FILES], own[FILES])


def _earlier_parts(experiment: Study, files: SessionFiles, mode: str) -> list[Any]:
    """List the parts of the digest of earlier versions, which did not include the files and the version."""
    return [experiment.table.model_dump(mode="json"), experiment.scene.to_dict(), files.stem, mode]


def _digest(parts: list[Any]) -> str:
    return sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()
