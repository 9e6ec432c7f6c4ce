"""Loading of experiments from TOML files, with a report of all faults."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from os import PathLike, fspath
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import ValidationError

from graspfx import plugins
from graspfx.assembly.checks.faults import field_faults
from graspfx.environment import require_file, resolved, to_path
from graspfx.errors import Fault, GraspFXError, InputError, SceneError, UnknownNameError, closest
from graspfx.experiment.design import Experiment
from graspfx.experiment.experiment_table import MOST_TRIALS, ExperimentTable
from graspfx.experiment.simulated_observers import SHARES
from graspfx.experiment.trial import FIRST, SECOND
from graspfx.scene.keys import Key, as_faults, parts_of
from graspfx.scene.load import file_text, parse
from graspfx.scene.load import load as load_scene
from graspfx.scene.source import Source
from graspfx.scene.tables.fields import DRAFT, NotValid
from graspfx.scene.toml_text import KeyLines

if TYPE_CHECKING:
    from graspfx.scene.model import Scene

Finding = tuple[Key, str]
OVERRIDE = " (set by an override)"
EXAMPLES = Path(__file__).parent / "examples"


def names() -> dict[str, Path]:
    """Return the paths of the built-in experiments, by name."""
    return {path.stem: path for path in sorted(EXAMPLES.glob("*.toml"))}


def load(name: str | PathLike[str]) -> Experiment:
    """Load a built-in experiment by name, or an experiment from a .toml file.

    Args:
        name: Name of a built-in experiment, such as "stiffness-jnd", or path of a file.

    Raises:
        SceneError: If the experiment has faults, or if its scene has faults with the experiment's values. All faults
            are listed with their lines.
        UnknownNameError: If no built-in experiment has this name.
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
        path: Path of the file, or None; the path of the scene is relative to the folder of this file.

    Raises:
        SceneError: If the experiment has faults. All faults are listed.
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


def experiment_faults(table: ExperimentTable, source: Source) -> list[Finding]:
    """Find faults that involve several fields; fields that are invalid by themselves are left out."""
    faults: list[Finding] = []
    for check in (_design, _answers, _comparisons, _spans, _observer, lambda draft: _scene(draft, source)):
        with suppress(NotValid):
            for finding in check(table):
                faults.append(finding)  # one by one, to keep the faults found before an invalid field
    return faults


def scene_of(table: ExperimentTable, source: Source) -> Scene:
    """Load the scene of an experiment, with the values that all trials share.

    Raises:
        GraspFXError: As in `graspfx.load`.
    """
    text = table.scene
    place = (source.folder or Path()) / text if plugins.is_file_name(text) else text
    return load_scene(place, table.set)


def _design(table: ExperimentTable) -> Iterator[Finding]:
    if not table.condition and not table.factor:
        yield ("condition",), "expected at least one condition or factor"
    for kind in ("condition", "factor"):
        names: set[str] = set()
        for i, each in enumerate(getattr(table, kind)):
            with suppress(NotValid):
                if each.name in names:
                    yield (kind, i, "name"), f"{each.name!r} is used twice; give every {kind} a different name"
                names.add(each.name)
    count = table.repetitions * max(len(table.condition), 1)
    for i, factor in enumerate(table.factor):
        with suppress(NotValid):
            if bool(factor.levels) == bool(factor.level) or bool(factor.key) != bool(factor.levels):
                yield ("factor", i), "expected either a key with its levels, or a table of levels by name"
            count *= max(len(factor.levels) + len(factor.level), 1)
    if count > MOST_TRIALS:
        yield ("repetitions",), f"expected at most {MOST_TRIALS} trials, given {count}"


def _answers(table: ExperimentTable) -> Iterator[Finding]:
    options = list(table.question.keys.values()) if table.question is not None else []
    for i, condition in enumerate(table.condition):
        with suppress(NotValid):
            if condition.answer and condition.answer not in options:
                close = closest(condition.answer, options)
                hint = f"; did you mean {close!r}?" if close else f" (known: {', '.join(options) or 'none'})"
                yield ("condition", i, "answer"), f"not an answer of the question: {condition.answer!r}{hint}"
            if condition.answer and condition.compare is not None:
                yield (
                    ("condition", i, "answer"),
                    "omit the answer: in a comparison, the interval with the larger value is correct",
                )


def _comparisons(table: ExperimentTable) -> Iterator[Finding]:
    adaptive, compared = [], False
    for i, condition in enumerate(table.condition):
        with suppress(NotValid):
            if condition.compare is not None:
                compared = True
                if not condition.compare.increments:
                    adaptive.append(i)
    for i in adaptive if table.staircase is None else ():
        yield ("condition", i, "compare"), "expected increments, or a table [staircase] that chooses them"
    if table.staircase is not None and not adaptive:
        yield ("staircase",), "expected a comparison without increments, so that the staircase chooses them"
    if not compared:
        return
    if table.question is None:
        yield ("question",), "required to compare two intervals, but not given"
        return
    answers = set(table.question.keys.values())
    if answers != {FIRST, SECOND}:
        yield ("question", "keys"), f"expected the answers {FIRST!r} and {SECOND!r} where two intervals are compared"
    if table.question.when != "after":
        yield ("question", "when"), "expected 'after' where two intervals are compared"


def _spans(table: ExperimentTable) -> Iterator[Finding]:
    for name in ("increments", "threshold") if table.staircase is not None else ():
        with suppress(NotValid):
            span = getattr(table.staircase, name)
            if not span.least < span.most:
                yield ("staircase", name, "most"), f"expected more than `least`, {span.least:g}; given {span.most:g}"


def _observer(table: ExperimentTable) -> Iterator[Finding]:
    observer = table.observer
    if observer is None:
        return
    names = [condition.name for condition in table.condition]
    for field in ("threshold", "weber"):
        with suppress(NotValid):
            values = getattr(observer, field)
            for name in values if isinstance(values, Mapping) else ():
                if name not in names:
                    close = closest(name, names)
                    hint = f"; did you mean {close!r}?" if close else ""
                    yield ("observer", field, name), f"unknown condition{hint}"
    for i, condition in enumerate(table.condition):
        compare = condition.compare
        if observer.kind != "guess" and compare is None:
            yield ("observer", "kind"), f"expected 'guess', because condition {condition.name!r} compares no intervals"
        elif observer.kind == "physical" and compare is not None and compare.key not in SHARES:
            text = f"the physical observer perceives stiffness only: expected {' or '.join(SHARES)}"
            yield ("condition", i, "compare", "key"), text


def _scene(table: ExperimentTable, source: Source) -> Iterator[Finding]:
    text = table.scene
    if plugins.is_file_name(text) and not source.is_trusted and not source.holds(text):
        yield ("scene",), "is outside this file's folder; add --trust to use it"
        return
    try:
        plain = scene_of(table.model_copy(update={"set": {}}), source)
    except GraspFXError as error:
        yield ("scene",), " ".join(str(error).split())
        return
    shared = dict(table.set)
    yield from _values(plain, {}, shared, ("set",), source)
    for i, condition in enumerate(table.condition):
        with suppress(NotValid):
            yield from _values(plain, shared, condition.set, ("condition", i, "set"), source)
            compare = condition.compare
            if compare is not None:
                most = max(compare.increments, default=table.staircase.increments.most if table.staircase else 0.0)
                values = {**shared, **condition.set}
                for value in (compare.reference, compare.reference * (1.0 + most)):
                    wrong = list(_values(plain, values, {compare.key: value}, ("condition", i, "compare"), source))
                    yield from ((("condition", i, "compare", "key"), message) for _, message in wrong)
                    if wrong:
                        break
    for i, factor in enumerate(table.factor):
        with suppress(NotValid):
            for k, value in enumerate(factor.levels if factor.key else ()):
                at = ("factor", i, "levels", k)
                refused = _values(plain, shared, {factor.key: value}, at, source)
                yield from ((at, f"{factor.key}: {text}") for _, text in refused)
            for name, values in factor.level.items():
                yield from _values(plain, shared, values, ("factor", i, "level", name), source)


def _values(
    scene: Scene, before: Mapping[str, Any], values: Mapping[str, Any], at: Key, source: Source
) -> Iterator[Finding]:
    """Find the faults that a scene reports for `values`, each with the key of the value that caused it."""
    for key, value in values.items():
        if _has_paths(value) and not source.is_trusted:
            yield (*at, key), "names a file; add --trust to use it"
            return
    if not values:
        return
    try:
        scene.replace({**before, **values})
    except SceneError as error:
        for fault in error.faults:
            yield (*at, *_place(fault.key, values)), fault.message.replace(OVERRIDE, "")
    except GraspFXError as error:
        yield at, " ".join(str(error).split())


def _place(key: str, values: Mapping[str, Any]) -> Sequence[str]:
    """Return the key of the value that caused a fault: the fault's key, or the most similar key of a value."""
    if key in values:
        return [key]
    if len(values) == 1:
        return list(values)
    parts = set(key.split("."))
    likely = max(values, key=lambda each: len(parts & set(each.split("."))), default="")
    return [likely] if parts & set(likely.split(".")) else []


def _has_paths(value: Any) -> bool:
    if isinstance(value, str):
        return plugins.is_file_name(value) or any(mark in value for mark in "/\\")
    if isinstance(value, Mapping):
        return any(map(_has_paths, value.values()))
    return isinstance(value, list | tuple) and any(map(_has_paths, value))
