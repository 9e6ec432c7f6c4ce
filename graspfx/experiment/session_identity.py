"""Identity of a session: experiment, scene, files and version. A session is resumed only if they are unchanged."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from hashlib import sha256
from typing import Any

from graspfx import __version__, log
from graspfx.assembly.provenance import by_name, engine_versions, file_changes, files_of, scene_changes
from graspfx.errors import RecordingError
from graspfx.experiment.experiment_table import Study
from graspfx.experiment.session_files import SessionFiles

DIGEST, FILES, VERSION = "Digest", "Files", "Version"
MOST = 5  # differences listed in the message


class SessionWarning(UserWarning):
    """A session is resumed although its original conditions are not completely known."""


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
    """Require that an interrupted session has the same identity; a description in an older form gives a warning.

    Args:
        about: Description of the interrupted session.
        experiment, files, mode: Those of the session to resume.

    Raises:
        RecordingError: The identity differs; the message lists the differences.
    """
    own = session_identity(experiment, files, mode)
    is_whole = FILES in about
    before = own[DIGEST] if is_whole else _digest(_earlier_parts(experiment, files, mode))
    differences = list(_differences(about, own, experiment, mode))
    if about[DIGEST] != before or differences:
        lines = differences or ["the experiment file has other values, or this is another participant's session"]
        more = f"; and {len(lines) - MOST} more differences" if len(lines) > MOST else ""
        text = "is of another experiment, scene or mode"
        do = "resume it with the original files and version, or begin another with --run N"
        raise RecordingError(f"{files.table_description}: {text}: {'; '.join(lines[:MOST])}{more}; {do}")
    if not is_whole and own[FILES]:
        names = ", ".join(own[FILES])
        text = f"begun by an older GraspFX, without digests of files; check that these are unchanged: {names}"
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
    """List the parts in the digest of earlier versions, without files and version."""
    return [experiment.table.model_dump(mode="json"), experiment.scene.to_dict(), files.stem, mode]


def _digest(parts: list[Any]) -> str:
    return sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()
