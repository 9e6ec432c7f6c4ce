"""Load experiments from TOML files, and report all faults at once."""

from __future__ import annotations

from collections.abc import Mapping
from os import PathLike, fspath
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from graspfx import plugins
from graspfx.assembly.checks.faults import field_faults
from graspfx.environment import require_file, resolved, to_path
from graspfx.errors import Fault, InputError, SceneError, UnknownNameError
from graspfx.experiment.design import Experiment
from graspfx.experiment.experiment_faults import experiment_faults, scene_of
from graspfx.experiment.experiment_table import ExperimentTable
from graspfx.scene.keys import Key, as_faults, parts_of
from graspfx.scene.load import file_text, parse
from graspfx.scene.source import Source
from graspfx.scene.tables.fields import DRAFT
from graspfx.scene.toml_text import KeyLines

EXAMPLES = Path(__file__).parent / "examples"


def names() -> dict[str, Path]:
    """List the built-in experiments by name."""
    return {path.stem: path for path in sorted(EXAMPLES.glob("*.toml"))}


def load(name: str | PathLike[str]) -> Experiment:
    """Load a built-in experiment by name, or an experiment from a .toml file.

    Args:
        name: Name, such as "stiffness-jnd", or path.

    Raises:
        SceneError: If the experiment, or its scene with the experiment's values, has faults; all are listed with lines.
        UnknownNameError: If no experiment has that name.
        InputError: If the file does not exist.
    """
    if not isinstance(name, str | PathLike):
        raise InputError("experiment", name, "a name or the path of a .toml file")
    text = fspath(name)
    if text.endswith(".toml"):
        path = resolved("experiment", to_path("experiment", text))
        require_file("experiment", text, path)
    elif text in names():
        path = names()[text]
    else:
        raise UnknownNameError("experiment", text, names(), "or give the path of a file that ends in .toml")
    return read(file_text(path), plugins.shown_path(path), path)


def read(text: str, name: str, path: Path | None = None) -> Experiment:
    """Read an experiment from the text of a file.

    Args:
        text: Contents of the file, in TOML.
        name: Name of the file in messages.
        path: Path of the file; the scene's path is relative to its folder.

    Raises:
        SceneError: If the experiment has faults; all are listed.
    """
    data = parse(text, name)
    source = Source(name, text, path)
    faults: list[tuple[Key, str]] = []
    try:
        table = draft = ExperimentTable.model_validate(data)
    except ValidationError as error:
        draft = ExperimentTable.model_validate(data, context=DRAFT)
        faults = list(field_faults(error, draft))
    with plugins.unchanged():
        faults += experiment_faults(draft, source)
        if faults:
            raise SceneError(name, _placed(data, faults, text))
        return Experiment(table, scene_of(table, source), source)


def _placed(data: Mapping[str, Any], faults: list[tuple[Key, str]], text: str) -> list[Fault]:
    lines = KeyLines(text)
    placed = [Fault(each.key, each.message, lines[parts_of(each.key)]) for each in as_faults(data, faults)]
    return sorted(placed, key=lambda fault: fault.line or 0)
