"""Validation of a scene before a run: faults of single fields and between fields, and trust in named files."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

from pydantic import ValidationError

from graspfx.assembly.bodies import Stock
from graspfx.assembly.checks.cross_faults import cross_faults
from graspfx.assembly.checks.units import unit_doubts
from graspfx.errors import LONGEST_KEY, Fault, InputError, abbreviate, closest
from graspfx.plugins import is_file_name
from graspfx.scene.keys import Finding, Key, as_faults
from graspfx.scene.source import Source
from graspfx.scene.tables.fields import DRAFT, NotValid, Table
from graspfx.scene.tables.hand_tables import MadeHand, Path
from graspfx.scene.tables.part_tables import Device, Object
from graspfx.scene.tables.scene_table import SceneTable
from graspfx.scene.tables.shapes import MeshShape
from graspfx.scene.toml_text import too_deep

CODE: tuple[tuple[type[Table], str], ...] = ((Device, "name"), (MadeHand, "kind"), (Object, "dynamics"))
DATA: tuple[tuple[type[Table], str], ...] = ((MeshShape, "mesh"), (Path, "file"))
REPLAY, COMMAND = "gx.replay(..., trust=True) in Python", "--trust on the command line, or GRASPFX_TRUST=1"
READ = f"Python files named in a recording run only if you trust the recording: read them, then use {REPLAY}, {COMMAND}"
DO = "move the file there, or trust the scene:"


def trust_faults(scene: SceneTable, source: Source) -> list[Finding]:
    """Find the paths in a scene that lie outside the folder of the scene's file; find none if the source is trusted.

    In a scene from a recording, every Python file that the recording names is a fault, because the recording also
    defines the folder. Paths that an override sets are allowed. All paths with a fault are removed from the scene, so
    that later checks cannot import or read these files.
    """
    return [] if source.is_trusted else list(_faults((), scene, source))


def _faults(at: Key, part: Any, source: Source) -> Iterator[Finding]:
    if isinstance(part, tuple):
        for k, each in enumerate(part):
            yield from _faults((*at, k), each, source)
    if not isinstance(part, Table):
        return
    for kind, name in (*CODE, *DATA):
        text = part.__dict__.get(name) if isinstance(part, kind) else None
        if not isinstance(text, str) or ((kind, name) in CODE and not is_file_name(text)):
            continue
        if (kind, name) in CODE and source.is_recorded and not source.is_of_user(text):
            del part.__dict__[name]
            yield (*at, name), f"{abbreviate(text)}, from {source.folder}; {READ}"
        elif _is_foreign(text, source):
            del part.__dict__[name]
            ways = f"{REPLAY}, {COMMAND}" if source.is_recorded else COMMAND
            yield (*at, name), f"outside of the scene's folder, {source.folder}: {abbreviate(text)}; {DO} {ways}"
    for name, value in list(part.__dict__.items()):
        yield from _faults((*at, name), value, source)


def _is_foreign(text: str, source: Source) -> bool:
    try:
        return not source.holds(text)
    except InputError:  # reading a missing path reports it
        return False


BOUNDS = {
    "greater_than": ("more than", "gt"),
    "greater_than_equal": ("no less than", "ge"),
    "less_than": ("less than", "lt"),
    "less_than_equal": ("no more than", "le"),
}
EXPECTED = {
    "float_type": "a number",
    "finite_number": "a finite number",
    "int_type": "a whole number",
    "bool_type": "true or false",
    "string_type": "text",
    "tuple_type": "a list",
    "model_type": "a table",
    "dict_type": "a table",
}
FORMS = {"list": "a list", "name": "a name", "number": "a number", "word": "a number or a word"}  # others: tables
MOST_HINTS = 200  # largest number of unknown keys for which a close match is sought
VERY_NEAR = 0.75  # the similarity of 'mss' and 'mass' is 0.86, that of 'axis' and 'radius' 0.6
# Places in a scene of what other programs and the paper call otherwise, by table and foreign key.
ELSEWHERE = {
    ("Coupling", "kep"): "external.stiffness",
    ("Coupling", "ked"): "external.damping",
    ("Coupling", "kip"): "internal.stiffness",
    ("Coupling", "kid"): "internal.damping",
    ("SharedHand", "stiffness"): "arm.stiffness and grip.stiffness",
    ("SharedHand", "damping"): "arm.damping and grip.damping",
    ("Capsule", "height"): "length",
    ("Cylinder", "height"): "length",
    ("Capsule", "axis"): "the orientation of the object or obstacle",
    ("Cylinder", "axis"): "the orientation of the object or obstacle",
    ("HalfSpace", "offset"): "the position of the object or obstacle",
    ("Plane", "offset"): "the position of the object or obstacle",
    ("Placement", "position"): "start = [x, y, z]",
}
INSTEAD = {("Placement", "position"): "toward"}  # required keys that are not missed if a foreign key is given


def find_faults(data: Mapping[str, Any], source: Source) -> tuple[list[Fault], Stock]:
    """Find the faults of a scene given as nested tables; the tables of a scene without faults form a `SceneTable`.

    Args:
        data: Tables as read from a file.
        source: File, preset and overrides of the scene, which error messages name.

    Returns:
        The faults, and the stock of devices and shapes that were connected and made during the checks.
    """
    stock = Stock(source.folder)
    if deep := too_deep(data):
        return [deep], stock
    try:
        draft = SceneTable.model_validate(data)
    except ValidationError as error:
        draft = SceneTable.model_validate(data, context=DRAFT)
        faults = [*field_faults(error, draft), *trust_faults(draft, source)]
        misspelt = _likely_keys(error.errors(include_url=False), draft)
        faults += [each for each in cross_faults(draft, stock) if each[0] not in misspelt.values()]
        return as_faults(data, faults), stock
    faults = [*trust_faults(draft, source), *cross_faults(draft, stock)]
    if faults:  # faults between valid values may come from a wrong unit
        faults = [*((at, f"given {text}") for at, text in unit_doubts(draft, stock)), *faults]
    return as_faults(data, faults), stock


def field_faults(error: ValidationError, draft: Table) -> Iterator[tuple[Key, str]]:
    """Yield the location and the text of each fault of a single field.

    Args:
        error: Error that the validation of the data raised.
        draft: Valid part of the data, from a validation with the context `DRAFT`.
    """
    errors = error.errors(include_url=False)
    likely = _likely_keys(errors, draft)
    for each in errors:
        at = each["loc"]
        if each["type"] == "missing" and at in likely.values():
            continue
        if each["type"] == "extra_forbidden":
            yield at, f"unknown key{_hint(at, likely, draft)}"
        elif each["type"] == "kind" and isinstance(each["input"], Mapping):
            yield (*at, "kind"), message(each)
        else:
            yield at, message(each)


def _likely_keys(errors: Iterable[Any], draft: Table) -> dict[Key, Key]:
    """Map unknown keys to similar known keys, so that a misspelt key is not also reported as missing."""
    unknown = [each["loc"] for each in errors if each["type"] == "extra_forbidden"][:MOST_HINTS]
    parts = {at: part_at(draft, at[:-1]) for at in unknown}
    close = {
        at: INSTEAD.get((type(part).__name__, str(at[-1]))) or _near(str(at[-1]), part) for at, part in parts.items()
    }
    return {at: (*at[:-1], name) for at, name in close.items() if name is not None}


def _near(key: str, table: Any) -> str | None:
    """Return the key of a table that is most similar to `key`; None if no key is similar.

    A key that the table already contains must be very similar.
    """
    if table is None:
        return None
    if len(key) > LONGEST_KEY:
        return None
    keys = type(table).model_fields
    near = closest(key, keys.keys() - table.model_fields_set), closest(key, keys, VERY_NEAR)
    return closest(key, filter(None, near))


def _hint(at: Key, likely: Mapping[Key, Key], draft: Table) -> str:
    elsewhere = ELSEWHERE.get((type(part_at(draft, at[:-1])).__name__, str(at[-1])))
    if elsewhere is not None:
        return f"; use {elsewhere} instead"
    return f"; did you mean {likely[at][-1]!r}?" if at in likely else ""


def message(error: Any) -> str:
    """Return the text of a fault for an error of pydantic."""
    kind, context, value = error["type"], error.get("ctx", {}), abbreviate(error["input"])
    if kind == "missing":
        return "required, but not given"
    if kind in BOUNDS:
        words, limit = BOUNDS[kind]
        return f"expected {words} {context[limit]:g}; given {value}"
    if kind in EXPECTED:
        return f"expected {EXPECTED[kind]}; given {value}"
    if kind == "union_tag_invalid":
        forms = [FORMS.get(tag.strip(" '<>"), "a table") for tag in context["expected_tags"].split(",")]
        return f"expected {' or '.join(dict.fromkeys(forms))}; given {value}"
    if kind == "literal_error":
        return f"expected {context['expected']}; given {value}"
    if kind in ("too_short", "too_long"):
        length = context.get("min_length", context.get("max_length"))
        return f"expected {length} numbers; given {context['actual_length']}"
    if kind == "string_pattern_mismatch":
        return f"expected a name of letters, digits, '_' and '-' that starts with a letter; given {value}"
    return str(error["msg"])


def part_at(draft: Table, location: Sequence[str | int]) -> Any:
    """Return the table at a location of pydantic; None if the table is not valid."""
    part: Any = draft
    try:
        for step in location:
            if isinstance(step, int) or isinstance(part, Mapping):
                part = part[step]
            elif not step.startswith("<"):
                part = getattr(part, step)
    except NotValid:
        return None
    return part
