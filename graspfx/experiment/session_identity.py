"""Identity of a session: its experiment, scene, files and version, which a session that goes on has to share."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from hashlib import sha256
from typing import Any

from graspfx import __version__, log
from graspfx.assembly.engine_versions import engine_versions
from graspfx.assembly.named_files import by_name, file_changes, files_of
from graspfx.assembly.scene_changes import scene_changes
from graspfx.errors import RecordingError
from graspfx.experiment.experiment_table import Study
from graspfx.experiment.session_files import SessionFiles

DIGEST, FILES, VERSION = "Digest", "Files", "Version"
MOST = 5  # differences that are said


class SessionWarning(UserWarning):
    """A session that goes on, though not all is known of how it was begun."""


def session_identity(experiment: Study, files: SessionFiles, mode: str) -> dict[str, Any]:
    """Give what says whether a session is of the same experiment, scene, participant and mode.

    The digests of files that the scene or a value of a trial names are by their names, wherever they are.
    """
    table = experiment.table
    values = [[each.model_dump(mode="json") for each in tables] for tables in (table.condition, table.factor)]
    digests = by_name(files_of(experiment.scene, values))
    engines = engine_versions(experiment.scene, values)
    version = ", ".join([__version__, *(" ".join(each) for each in engines.items())])
    about = [*_earlier_parts(experiment, files, mode), digests, version]
    return {VERSION: version, FILES: digests, DIGEST: _digest(about)}


def require_same(about: Mapping[str, Any], experiment: Study, files: SessionFiles, mode: str) -> None:
    """Require that a session that was begun is the same; one that an earlier form describes goes on with a warning.

    Args:
        about: what its description says.
        experiment, files, mode: of the session that is to go on.

    Raises:
        RecordingError: it is another one, with what differs.
    """
    own = session_identity(experiment, files, mode)
    is_whole = FILES in about
    before = own[DIGEST] if is_whole else _digest(_earlier_parts(experiment, files, mode))
    differences = list(_differences(about, own, experiment, mode))
    if about[DIGEST] != before or differences:
        lines = differences or [
            "the file of the experiment has other values, or another participant's session is there"
        ]
        more = f"; and {len(lines) - MOST} more differences" if len(lines) > MOST else ""
        text = "is of another experiment, scene or mode"
        do = "what was begun goes on with what it was begun with; --run N begins another"
        raise RecordingError(f"{files.table_description}: {text}: {'; '.join(lines[:MOST])}{more}; {do}")
    if not is_whole and own[FILES]:
        names = ", ".join(own[FILES])
        text = (
            f"was begun by an earlier GraspFX, which did not note what is in files; see that none has changed: {names}"
        )
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
    """List what alone was digested before files and the version were."""
    return [experiment.table.model_dump(mode="json"), experiment.scene.to_dict(), files.stem, mode]


def _digest(parts: list[Any]) -> str:
    return sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()
