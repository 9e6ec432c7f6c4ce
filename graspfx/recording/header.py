"""What a recording says of its run: scene, versions and machine before it, faults, changes and outcome after it."""

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

FORMAT = 6  # counts up with each change that an older reader cannot read; docs/how-to/recording.md says what changed
# fields that are written where they are not empty only, so that other recordings are as they were
RARE = ("settled", "round_trip", "scheduling", "replays")
RARE_OF_LAYOUT = ("guarded", "timed", "varying", "switched", "devices", "raw")
RARE_OF_OUTCOME = ("ticks", "changes", "cause", "skipped", "repeats", "lost", "late")


@dataclass(frozen=True)
class Header:
    """The facts of a run that are known before it starts.

    Attributes:
        period: T [s].
        scene: its name.
        scene_text: the scene file verbatim, or the scene as JSON when it has none.
        scene_table: the scene as it was run, overrides applied, as nested tables.
        scene_folder: where relative paths in the scene start; empty for the current folder.
        overrides: by dotted key, those of a preset among them.
        preset: the name of the scene's preset in force; empty for none.
        title: of the scene.
        created: UTC, ISO 8601.
        versions: of what the run stands on.
        machine: platform, processor, python.
        frames: by object with a mesh, the pose of the mesh file's frame in the recorded one, which is at the centre of
            mass along the principal axes: `position` (3,) [m] and `orientation`, a quaternion x, y, z, w.
        split: by object, what P of its grasp is made of besides the columns: a `SplitRule` as a table. Empty in a
            recording of formats 1 and 2.
        every: ticks from one row to the next; row k is of tick k `every`.
        settled: of a run with hardware, where each of its fingers met its object, by name: `position` (d,) [m], and
            `offset`, by which it was deeper than its contact and which fades out in the recorded positions (d,) [m].
        round_trip: of a reading and a writing of all hardware before the run, the median [s]; 0 without hardware.
        replays: of a replay, what was recorded and when; empty for any other recording.
        scheduling: of a run with hardware, what its loop had: `loop` ("process" or "inline"), `policy` ("fifo 80" or
            "other"), `memory` ("locked", "locked so far" or "free"), `slack` of timers [s], the processor's `governor`.
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

    def rows_before(self, tick: int) -> int:
        """Count the rows of the ticks before one: the number of the first row from that tick on."""
        return -(-tick // self.every)


SPLIT = "split"  # as the key of a change: how forces divide from its tick on, which follows from other keys
MARK = "mark"  # as the key of a change: a text of the user's at a tick
OF_THE_RUN = (SPLIT, REST, MARK)  # keys of changes that are none of the scene's


class KeyChange(NamedTuple):
    """A value of the scene that was replaced in mid-run: the first tick that it holds in, its key and the value."""

    tick: int
    key: str
    value: Any

    def __str__(self) -> str:
        return f"tick {self.tick}: {self.key} = {self.value}"


@dataclass(frozen=True)
class Outcome:
    """How a run went: what its header could not know."""

    faults: tuple[RunFault, ...] = ()
    wall_time: float | None = None  # [s]
    complete: bool = True
    fade_shortfall: float = 0.0  # by how much free fingers began to fade too near the surface, at most [m]
    engine: str = (
        ""  # that ran the ticks: generic, compiled, compiled after some of them, or interpreted; empty if not known
    )
    fade_needed: float = 0.0  # where the fade would have had to begin [m]; 0 if it did
    blended: int = 0  # samples with a rotation in the blend's band, of the object with most
    ticks: int = 0  # that were run, where not each has a row; else as many as rows
    changes: tuple[KeyChange, ...] = ()  # of keys, and OF_THE_RUN; the header's tables are the start's
    cause: str = ""  # of the end of a run that broke off: a signal's name, or an exception; empty if not known
    skipped: int = 0  # periods that a run on the wall's clock left out
    repeats: int = 0  # readings of hardware that brought no new sample
    lost: int = 0  # rows that were not recorded in time, and are NaN
    late: Mapping[str, float] = field(default_factory=dict)  # after the deadline, by quantile: p50, ..., max [s]


def now() -> str:
    """Give the time of day, UTC, ISO 8601."""
    from datetime import UTC, datetime

    return datetime.now(UTC).isoformat(timespec="seconds")


def versions(*packages: str) -> dict[str, str]:
    """List the versions of Python, GraspFX, numpy and the other packages named that are installed."""
    import numpy as np

    import graspfx
    from graspfx.installed import version

    versions_ = {"python": platform.python_version(), "graspfx": graspfx.__version__, "numpy": np.__version__}
    others = {package: version(package) for package in packages}
    return versions_ | {package: number for package, number in others.items() if number is not None}


def machine() -> dict[str, str]:
    """Describe platform, processor and interpreter."""
    return {
        "platform": _platform(),
        "processor": platform.machine() if sys.platform == "linux" else platform.processor() or platform.machine(),
        "implementation": f"{platform.python_implementation()} {sys.version.split()[0]}",
    }


def _platform() -> str:
    """Describe the platform like `platform.platform`, which on Linux waits 20 ms for a process that says `unknown`."""
    if sys.platform != "linux":
        return platform.platform()
    here, library = os.uname(), "".join(platform.libc_ver())
    return "-".join([here.sysname, here.release, here.machine, *(["with", library] if library else [])])


# Attributes of a file, the same ones in a part and in HDF5 ----------------------------------------------------------


def description(layout: Layout, header: Header) -> dict[str, str | float]:
    """Describe a recording before its first row."""
    attributes: dict[str, str | float] = {"format": f"graspfx recording {FORMAT}"}
    for key, value in asdict(header).items():
        if value or key not in RARE:
            attributes[key] = value if isinstance(value, str | float) else _json(value)
    known = {key: value for key, value in asdict(layout).items() if value or key not in RARE_OF_LAYOUT}
    return {**attributes, "layout": _json(known)}


def conclusion(outcome: Outcome) -> dict[str, str | float]:
    """Describe how a run went, its faults apart."""
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
    """Write a value as it comes back from a file: tuples and arrays as lists."""
    return json.loads(_json(value))


def changes_of(text: str | bytes) -> list[KeyChange]:
    """Read changes of keys from JSON: a list of tick, key and value each."""
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
    values: dict[str, Any] = json.loads(attributes["layout"])
    for each in fields(Layout):
        if str(each.type).startswith("tuple"):
            values[each.name] = tuple(values.get(each.name, ()))
    values["raw"] = tuple((str(name), int(count), str(kind)) for name, count, kind in values["raw"])
    return Layout(**values)


def header_of(attributes: Mapping[str, Any]) -> Header:
    """Read the header; a field that came later than the recording has its default."""
    header = Header(**_fields(Header, attributes))
    if header.every < 1:
        raise ValueError(f"a row every {header.every} ticks")
    if not 0.0 < header.period < math.inf:
        raise ValueError(f"a period of {header.period} s")
    return header


def outcome_of(attributes: Mapping[str, Any], faults: Sequence[RunFault]) -> Outcome:
    """Read the outcome; what is not there came later than the recording."""
    values = _fields(Outcome, attributes)
    wall_time = float(attributes["wall_time"])
    values["wall_time"] = None if math.isnan(wall_time) else wall_time
    values["complete"] = bool(int(attributes["complete"]))
    values["changes"] = tuple(changes_of(attributes.get("changes", "[]")))
    return Outcome(faults=tuple(faults), **values)


def _fields(record: type[Header | Outcome], attributes: Mapping[str, Any]) -> dict[str, Any]:
    """Read the fields that attributes have of a record, each as the type of its default."""
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
