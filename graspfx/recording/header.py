"""Metadata of a recording: scene, software and computer before the run; faults, changes and outcome after the run."""

from __future__ import annotations

import json
import math
import os
import platform
import re
import sys
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, asdict, dataclass, field, fields
from typing import Any, NamedTuple

import numpy as np

from graspfx.loop.columns import REST, Layout, RunFault

FORMAT = 6  # incremented by each change that older readers cannot read; see docs/how-to/recording.md
# fields that are written only if not empty, so that other recordings are unchanged
RARE = ("settled", "round_trip", "scheduling", "replays")
RARE_OF_LAYOUT = ("guarded", "timed", "varying", "switched", "devices", "raw")
RARE_OF_OUTCOME = ("ticks", "changes", "cause", "skipped", "repeats", "lost", "late")


@dataclass(frozen=True)
class Header:
    """Metadata of a run that are known before it starts.

    Attributes:
        period: Sampling period T [s].
        scene: Name of the scene.
        scene_text: Text of the scene's file, or the scene as JSON if there is no file.
        scene_table: Scene with its overrides, as nested tables.
        scene_folder: Folder to which relative paths in the scene refer; empty for the current folder.
        overrides: Overridden values by dotted key, including those of a preset.
        preset: Name of the preset that is used; empty if none is used.
        title: Title of the scene.
        created: Start time of the run, in UTC and ISO 8601.
        versions: Versions of the software used, by package.
        machine: Platform, processor and Python implementation.
        frames: Pose of the frame of each mesh file, by object, relative to the recorded frame, which is at the centre
            of mass along the principal axes: `position` (3,) [m] and `orientation`, a quaternion (x, y, z, w).
        split: Data that, with the columns, define the split of each object's forces: a `SplitRule` as a table, by
            object. Empty in recordings of formats 1 and 2.
        every: Number of ticks from one row to the next; row k belongs to the tick k `every`.
        settled: Initial data of each finger in a run with hardware, by finger: `position` (d,) [m], and `offset` (d,)
            [m], the depth of the finger below its contact, which fades out in the recorded positions.
        round_trip: Median time for reading and writing all hardware once, before the run [s]; 0 without hardware.
        replays: If this recording is a replay, name and time of the original run; otherwise empty.
        scheduling: Properties of the loop in a run with hardware: `loop` ("native", "driven", "process" or "inline"),
            `policy` ("fifo 80" or "other"), `memory` ("locked", "locked so far" or "free"), `slack` of timers [s], and
            `governor` of the processor.
    """

    period: float
    scene: str = ""
    scene_text: str = ""
    scene_table: Mapping[str, Any] = field(default_factory=dict)
    scene_folder: str = ""
    overrides: Mapping[str, Any] = field(default_factory=dict)
    preset: str = ""
    title: str = ""
    created: str = ""
    versions: Mapping[str, str] = field(default_factory=dict)
    machine: Mapping[str, str] = field(default_factory=dict)
    frames: Mapping[str, Mapping[str, Sequence[float]]] = field(default_factory=dict)
    split: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    every: int = 1
    settled: Mapping[str, Mapping[str, Sequence[float]]] = field(default_factory=dict)
    round_trip: float = 0.0
    replays: str = ""
    scheduling: Mapping[str, Any] = field(default_factory=dict)

    @property
    def has_host(self) -> bool:
        """Tell whether another program simulated the object, whose motion and contacts are not recorded."""
        return self.scene_table.get("host") is not None

    def rows_before(self, tick: int) -> int:
        """Return the number of rows before a tick, which is also the index of the first row at or after the tick."""
        return -(-tick // self.every)


SPLIT = "split"  # key of a change: split rule, which depends on other keys, from the tick of the change on
MARK = "mark"  # key of a change: a user's text at a tick
OF_THE_RUN = (SPLIT, REST, MARK)  # keys of changes that are not keys of the scene


class KeyChange(NamedTuple):
    """A change of a key of the scene during a run: the first tick with the new value, the key and the new value."""

    tick: int
    key: str
    value: Any

    def __str__(self) -> str:
        return f"tick {self.tick}: {self.key} = {self.value}"


@dataclass(frozen=True)
class Outcome:
    """Metadata of a run that are known at its end."""

    faults: tuple[RunFault, ...] = ()
    wall_time: float | None = None  # [s]
    complete: bool = True
    fade_shortfall: float = 0.0  # largest distance by which free fingers began to fade too close to the surface [m]
    engine: str = (
        ""  # engine of the ticks: generic, compiled, compiled after some ticks, or interpreted; empty if unknown
    )
    fade_needed: float = 0.0  # required start of the fade [m]; 0 if it was sufficient
    blended: int = 0  # samples with a rotation in the blend's band, for the object with the most such samples
    ticks: int = 0  # number of ticks; equal to the number of rows if every tick has a row
    changes: tuple[KeyChange, ...] = ()  # changes of keys, and OF_THE_RUN; the header contains the tables at the start
    cause: str = ""  # cause of an early end: a signal's name, or an exception; empty if unknown
    skipped: int = 0  # periods that a wall-clock run skipped
    repeats: int = 0  # readings of hardware without a new sample
    lost: int = 0  # rows that were not recorded in time and are NaN
    late: Mapping[str, float] = field(default_factory=dict)  # lateness by quantile: p50, ..., max [s]


def now() -> str:
    """Return the current time in UTC, in ISO 8601 to the second."""
    from datetime import UTC, datetime

    return datetime.now(UTC).isoformat(timespec="seconds")


def versions(*packages: str) -> dict[str, str]:
    """Return the versions of Python, GraspFX and NumPy, and of those of the named packages that are installed."""
    import numpy as np

    import graspfx
    from graspfx.installed import version

    versions_ = {"python": platform.python_version(), "graspfx": graspfx.__version__, "numpy": np.__version__}
    others = {package: version(package) for package in packages}
    return versions_ | {package: number for package, number in others.items() if number is not None}


def machine() -> dict[str, str]:
    """Return the platform, the processor and the Python implementation."""
    return {
        "platform": _platform(),
        "processor": platform.machine() if sys.platform == "linux" else platform.processor() or platform.machine(),
        "implementation": f"{platform.python_implementation()} {sys.version.split()[0]}",
    }


def _platform() -> str:
    """Return the text of `platform.platform`, on Linux without starting a process, which takes 20 ms."""
    if sys.platform != "linux":
        return platform.platform()
    here, library = os.uname(), "".join(platform.libc_ver())
    return "-".join([here.sysname, here.release, here.machine, *(["with", library] if library else [])])


# Attributes of a file, the same in a part and in HDF5 ---------------------------------------------------------------


def description(layout: Layout, header: Header) -> dict[str, str | float]:
    """Return the attributes of a recording's file that are known before the run."""
    attributes: dict[str, str | float] = {"format": f"graspfx recording {FORMAT}"}
    for key, value in asdict(header).items():
        if value or key not in RARE:
            attributes[key] = value if isinstance(value, str | float) else _json(value)
    known = {key: value for key, value in asdict(layout).items() if value or key not in RARE_OF_LAYOUT}
    return {**attributes, "layout": _json(known)}


def conclusion(outcome: Outcome) -> dict[str, str | float]:
    """Return the attributes of a recording's file that are known after the run, except the faults."""
    values: dict[str, Any] = {each.name: getattr(outcome, each.name) for each in fields(outcome)}
    values["wall_time"] = math.nan if outcome.wall_time is None else float(outcome.wall_time)
    values["complete"] = int(outcome.complete)
    del values["faults"]
    return {
        key: _json([list(each) for each in value]) if key == "changes" else _json(value) if key == "late" else value
        for key, value in values.items()
        if value or key not in RARE_OF_OUTCOME
    }


def as_stored(value: Any) -> Any:
    """Return a value in the form in which a file returns it, with lists in place of tuples and arrays."""
    return json.loads(_json(value))


def changes_of(text: str | bytes) -> list[KeyChange]:
    """Read changes of keys from JSON, in which each change is a list of tick, key and value."""
    return [KeyChange(int(tick), str(key), value) for tick, key, value in json.loads(text)]


def format_of(attributes: Mapping[str, Any]) -> int:
    """Return the format of a recording, from the attributes of its file.

    Raises:
        ValueError: The file is not a recording, or its format is later than FORMAT.
    """
    match = re.fullmatch(r"graspfx recording (\d{1,9})", str(attributes.get("format")))
    if match is None:
        raise ValueError("it is not a GraspFX recording")
    number = int(match[1])
    if not 1 <= number <= FORMAT:
        raise ValueError(f"its format is {number}, and this GraspFX reads formats 1 to {FORMAT}: update GraspFX")
    return number


def layout_of(attributes: Mapping[str, Any]) -> Layout:
    """Read the layout from the attributes of a recording's file."""
    values: dict[str, Any] = json.loads(attributes["layout"])
    for each in fields(Layout):
        if str(each.type).startswith("tuple"):
            values[each.name] = tuple(values.get(each.name, ()))
    values["raw"] = tuple((str(name), int(count), str(kind)) for name, count, kind in values["raw"])
    return Layout(**values)


def header_of(attributes: Mapping[str, Any]) -> Header:
    """Read the header from the attributes of a recording's file; fields that the file does not have get defaults."""
    header = Header(**_fields(Header, attributes))
    if header.every < 1:
        raise ValueError(f"its header has one row per {header.every} ticks, expected a number above zero")
    if not 0.0 < header.period < math.inf:
        raise ValueError(f"its header has a period of {header.period} s, expected a finite time above zero")
    return header


def outcome_of(attributes: Mapping[str, Any], faults: Sequence[RunFault]) -> Outcome:
    """Read the outcome from the attributes of a recording's file; fields that the file does not have get defaults."""
    values = _fields(Outcome, attributes)
    wall_time = float(attributes["wall_time"])
    values["wall_time"] = None if math.isnan(wall_time) else wall_time
    values["complete"] = bool(int(attributes["complete"]))
    values["changes"] = tuple(changes_of(attributes.get("changes", "[]")))
    return Outcome(faults=tuple(faults), **values)


def _fields(record: type[Header | Outcome], attributes: Mapping[str, Any]) -> dict[str, Any]:
    """Read those fields of a record that the attributes contain, converted to the types of the fields' defaults."""
    values: dict[str, Any] = {}
    for each in fields(record):
        if each.name not in attributes:
            continue
        value, default = attributes[each.name], each.default
        text = value if isinstance(value, str) else bytes(value).decode() if isinstance(value, bytes) else None
        if each.default_factory is not MISSING:
            values[each.name] = json.loads(value if text is None else text)
        elif isinstance(default, str):
            values[each.name] = str(value) if text is None else text
        elif not isinstance(default, tuple | bool) and default is not None:
            values[each.name] = int(value) if isinstance(default, int) else float(value)
    return values


def _json(value: Any) -> str:
    return json.dumps(value, default=_plain)


def _plain(value: Any) -> Any:
    return value.tolist() if isinstance(value, np.ndarray | np.generic) else str(value)
