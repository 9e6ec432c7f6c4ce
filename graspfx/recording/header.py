"""Metadata of a recording: scene, versions and machine before the run; faults, changes and outcome after it."""

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
    """Facts about a run that are known before it starts.

    Attributes:
        period: sampling period T [s].
        scene: name of the scene.
        scene_text: text of the scene's file, or the scene as JSON if it has no file.
        scene_table: scene with overrides, as nested tables.
        scene_folder: folder to which relative paths in the scene refer; empty for the current folder.
        overrides: overrides by dotted key, including those of a preset.
        preset: name of the active preset; empty for none.
        title: title of the scene.
        created: time of the run, UTC, ISO 8601.
        versions: versions of the software used.
        machine: platform, processor and Python.
        frames: pose of the mesh file's frame for each object with a mesh, in the recorded frame at the centre of mass
            along the principal axes: `position` (3,) [m] and `orientation`, a quaternion x, y, z, w.
        split: data that define P of each object's grasp, in addition to the columns: a `SplitRule` as a table. Empty in
            recordings of formats 1 and 2.
        every: number of ticks from one row to the next; row k belongs to tick k `every`.
        settled: initial data of each finger, by name, in a run with hardware: `position` (d,) [m], and `offset` (d,)
            [m], its depth below the contact, which fades out in the recorded positions.
        round_trip: median time to read and write all hardware before the run [s]; 0 without hardware.
        replays: name and time of the original run if this recording is a replay; empty for other recordings.
        scheduling: properties of the loop of a run with hardware: `loop` ("native", "driven", "process" or "inline"),
            `policy` ("fifo 80" or "other"), `memory` ("locked", "locked so far" or "free"), `slack` of timers [s], the
            processor's `governor`.
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
        """Count the rows before a tick; the number is the index of the first row from that tick on."""
        return -(-tick // self.every)


SPLIT = "split"  # key of a change: split rule, which depends on other keys, from the tick of the change on
MARK = "mark"  # key of a change: a user's text at a tick
OF_THE_RUN = (SPLIT, REST, MARK)  # keys of changes that are not keys of the scene


class KeyChange(NamedTuple):
    """A value of the scene that was replaced during the run: its first tick, its key and the value."""

    tick: int
    key: str
    value: Any

    def __str__(self) -> str:
        return f"tick {self.tick}: {self.key} = {self.value}"


@dataclass(frozen=True)
class Outcome:
    """Outcome of a run, which its header cannot contain."""

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
    """Return the current time, UTC, ISO 8601."""
    from datetime import UTC, datetime

    return datetime.now(UTC).isoformat(timespec="seconds")


def versions(*packages: str) -> dict[str, str]:
    """Return the versions of Python, GraspFX, numpy and those of the named packages that are installed."""
    import numpy as np

    import graspfx
    from graspfx.installed import version

    versions_ = {"python": platform.python_version(), "graspfx": graspfx.__version__, "numpy": np.__version__}
    others = {package: version(package) for package in packages}
    return versions_ | {package: number for package, number in others.items() if number is not None}


def machine() -> dict[str, str]:
    """Return platform, processor and interpreter."""
    return {
        "platform": _platform(),
        "processor": platform.machine() if sys.platform == "linux" else platform.processor() or platform.machine(),
        "implementation": f"{platform.python_implementation()} {sys.version.split()[0]}",
    }


def _platform() -> str:
    """Return the platform like `platform.platform`, without its 20 ms wait for a process on Linux."""
    if sys.platform != "linux":
        return platform.platform()
    here, library = os.uname(), "".join(platform.libc_ver())
    return "-".join([here.sysname, here.release, here.machine, *(["with", library] if library else [])])


# Attributes of a file, the same in a part and in HDF5 ---------------------------------------------------------------


def description(layout: Layout, header: Header) -> dict[str, str | float]:
    """Return the attributes of a recording before its first row."""
    attributes: dict[str, str | float] = {"format": f"graspfx recording {FORMAT}"}
    for key, value in asdict(header).items():
        if value or key not in RARE:
            attributes[key] = value if isinstance(value, str | float) else _json(value)
    known = {key: value for key, value in asdict(layout).items() if value or key not in RARE_OF_LAYOUT}
    return {**attributes, "layout": _json(known)}


def conclusion(outcome: Outcome) -> dict[str, str | float]:
    """Return the attributes of a run's outcome, except faults."""
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
    """Convert a value to the form that is read back from a file, with tuples and arrays as lists."""
    return json.loads(_json(value))


def changes_of(text: str | bytes) -> list[KeyChange]:
    """Read changes of keys from JSON lists of tick, key and value."""
    return [KeyChange(int(tick), str(key), value) for tick, key, value in json.loads(text)]


def format_of(attributes: Mapping[str, Any]) -> int:
    """Read the format of a recording and require that it is supported.

    Raises:
        ValueError: the file is not a recording, or has a later format.
    """
    match = re.fullmatch(r"graspfx recording (\d{1,9})", str(attributes.get("format")))
    if match is None:
        raise ValueError("it is not a GraspFX recording")
    number = int(match[1])
    if not 1 <= number <= FORMAT:
        raise ValueError(f"its format is {number}, and this GraspFX reads formats 1 to {FORMAT}: update GraspFX")
    return number


def layout_of(attributes: Mapping[str, Any]) -> Layout:
    """Read the layout."""
    values: dict[str, Any] = json.loads(attributes["layout"])
    for each in fields(Layout):
        if str(each.type).startswith("tuple"):
            values[each.name] = tuple(values.get(each.name, ()))
    values["raw"] = tuple((str(name), int(count), str(kind)) for name, count, kind in values["raw"])
    return Layout(**values)


def header_of(attributes: Mapping[str, Any]) -> Header:
    """Read the header; fields that did not exist when the recording was made get default values."""
    header = Header(**_fields(Header, attributes))
    if header.every < 1:
        raise ValueError(f"its header has one row per {header.every} ticks, expected a number above zero")
    if not 0.0 < header.period < math.inf:
        raise ValueError(f"its header has a period of {header.period} s, expected a finite time above zero")
    return header


def outcome_of(attributes: Mapping[str, Any], faults: Sequence[RunFault]) -> Outcome:
    """Read the outcome; fields that did not exist when the recording was made get default values."""
    values = _fields(Outcome, attributes)
    wall_time = float(attributes["wall_time"])
    values["wall_time"] = None if math.isnan(wall_time) else wall_time
    values["complete"] = bool(int(attributes["complete"]))
    values["changes"] = tuple(changes_of(attributes.get("changes", "[]")))
    return Outcome(faults=tuple(faults), **values)


def _fields(record: type[Header | Outcome], attributes: Mapping[str, Any]) -> dict[str, Any]:
    """Read the fields of a record that exist in attributes, converted to the types of their defaults."""
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
