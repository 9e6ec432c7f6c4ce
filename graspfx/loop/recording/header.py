"""Header of a recording: the scene verbatim, versions, the machine, and how the run went."""

from __future__ import annotations

import os
import platform
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple


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


class RunFault(NamedTuple):
    """A fault at a tick; from there on every force is zero."""

    tick: int
    message: str

    def __str__(self) -> str:
        return f"tick {self.tick}: {self.message}"


SPLIT = "split"  # as the key of a change: how forces divide from its tick on, which follows from other keys

REST = "rest"  # likewise: from its tick on forces decay, as the run ends by itself ("end") or was ended ("stop")
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
