"""Layout, header and outcome of a recording as attributes, and back: the same ones in a part and in HDF5."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from graspfx.loop.recording.header import Header, KeyChange, Outcome, RunFault
from graspfx.loop.recording.layout import Layout

FORMAT = 4  # counts up with each change that an older reader cannot read; docs/how-to/recording.md says what changed
NAMES = (
    "fingers",
    "objects",
    "finger_objects",
    "predicted",
    "absent",
    "omitted",
    "devices",
)  # of a layout's fields that are tuples
RARE = ("settled", "round_trip", "scheduling", "replays")  # fields of a header that stand where they are not empty

# of a layout's fields: written where they are not empty, so that other recordings are as they were
WHERE_THEY_ARE = ("guarded", "timed", "varying", "switched", "devices", "raw")


def description(layout: Layout, header: Header) -> dict[str, str | float]:
    """Describe a recording before its first row."""
    attributes: dict[str, str | float] = {"format": f"graspfx recording {FORMAT}"}
    for key, value in asdict(header).items():
        if key in RARE and not value:
            continue
        attributes[key] = value if isinstance(value, str | float) else _json(value)
    fields = {key: value for key, value in asdict(layout).items() if value or key not in WHERE_THEY_ARE}
    attributes["layout"] = _json(fields)
    return attributes


def conclusion(outcome: Outcome) -> dict[str, str | float]:
    """Describe how a run went, its faults apart."""
    return {
        "wall_time": math.nan if outcome.wall_time is None else float(outcome.wall_time),
        "complete": int(outcome.complete),
        "engine": outcome.engine,
        "fade_shortfall": float(outcome.fade_shortfall),
        "fade_needed": float(outcome.fade_needed),
        "blended": int(outcome.blended),
        **({"ticks": int(outcome.ticks)} if outcome.ticks else {}),
        **({"changes": changes_text(outcome.changes)} if outcome.changes else {}),
        **({"cause": outcome.cause} if outcome.cause else {}),
        **({"skipped": int(outcome.skipped)} if outcome.skipped else {}),
        **({"repeats": int(outcome.repeats)} if outcome.repeats else {}),
        **({"lost": int(outcome.lost)} if outcome.lost else {}),
        **({"late": _json(outcome.late)} if outcome.late else {}),
    }


def changes_text(changes: Sequence[KeyChange]) -> str:
    """Write changes of keys as JSON: a list of tick, key and value each."""
    return _json([list(change) for change in changes])


def as_stored(value: Any) -> Any:
    """Write a value as it comes back from a file: tuples and arrays as lists."""
    return json.loads(_json(value))


def changes_of(text: str | bytes) -> list[KeyChange]:
    """Read changes of keys from JSON."""
    return [KeyChange(int(tick), str(key), value) for tick, key, value in json.loads(text)]


def format_of(attributes: Mapping[str, Any]) -> int:
    """Read the number of a recording's format, which this reader knows.

    Raises:
        ValueError: no recording, or one of a later GraspFX.
    """
    match = re.fullmatch(r"graspfx recording (\d{1,9})", str(attributes.get("format")))
    if match is None:
        raise ValueError("it is not a GraspFX recording")
    number = int(match[1])
    if not 1 <= number <= FORMAT:
        raise ValueError(f"its format is {number}, and this GraspFX reads formats 1 to {FORMAT}: it is a later one's")
    return number


def layout_of(attributes: Mapping[str, Any]) -> Layout:
    """Read the layout."""
    fields: dict[str, Any] = json.loads(attributes["layout"])
    for key in NAMES:
        fields[key] = tuple(fields.get(key, ()))
    fields["raw"] = tuple((str(name), int(count), str(kind)) for name, count, kind in fields.get("raw", ()))
    return Layout(**fields)


def header_of(attributes: Mapping[str, Any]) -> Header:
    """Read the header; a field that came later than the recording has its default."""
    fields = {key: attributes[key] for key in Header.__dataclass_fields__ if key in attributes}
    for key in ("scene_table", "overrides", "versions", "machine", "frames", "split", "settled", "scheduling"):
        fields[key] = json.loads(fields.get(key, "{}"))
    fields["period"] = float(fields["period"])
    fields["every"] = int(fields.get("every", 1))
    fields["round_trip"] = float(fields.get("round_trip", 0.0))
    if fields["every"] < 1:
        raise ValueError(f"a row every {fields['every']} ticks")
    if not 0.0 < fields["period"] < math.inf:
        raise ValueError(f"a period of {fields['period']} s")
    return Header(**fields)


def outcome_of(attributes: Mapping[str, Any], faults: Sequence[RunFault]) -> Outcome:
    """Read the outcome; what is not there came later than the recording."""
    wall_time = float(attributes["wall_time"])
    return Outcome(
        faults=tuple(faults),
        wall_time=None if math.isnan(wall_time) else wall_time,
        complete=bool(int(attributes["complete"])),
        fade_shortfall=float(attributes.get("fade_shortfall", 0.0)),
        fade_needed=float(attributes.get("fade_needed", 0.0)),
        blended=int(attributes.get("blended", 0)),
        ticks=int(attributes.get("ticks", 0)),
        engine=_text(attributes.get("engine", "")),
        changes=tuple(changes_of(attributes.get("changes", "[]"))),
        cause=_text(attributes.get("cause", "")),
        skipped=int(attributes.get("skipped", 0)),
        repeats=int(attributes.get("repeats", 0)),
        lost=int(attributes.get("lost", 0)),
        late=json.loads(_text(attributes.get("late", "{}"))),
    )


def _text(value: Any) -> str:
    return value if isinstance(value, str) else bytes(value).decode()


def _json(value: Any) -> str:
    return json.dumps(value, default=_plain)


def _plain(value: Any) -> Any:
    return value.tolist() if isinstance(value, np.ndarray | np.generic) else str(value)
