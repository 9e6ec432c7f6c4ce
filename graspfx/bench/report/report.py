"""The report of benchmarks: rows, and for each benchmark when, on what and how they were measured; as JSON."""

from __future__ import annotations

import json
import os
import platform
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from graspfx.bench.calibration import Calibration
from graspfx.bench.measure import Row
from graspfx.environment import processors
from graspfx.errors import RecordingError
from graspfx.loop.recording.header import machine, now, versions

SCHEMA = 1
NAME = "benchmarks.json"
PEERS = ("scipy", "llvmlite", "mpmath", "clarabel", "control", "trimesh", "coal", "rtree", "mujoco", "pybullet")


@dataclass(frozen=True)
class Stamp:
    """When, on what and how a benchmark was run.

    Attributes:
        title: of the benchmark.
        limits: what its numbers do not say.
        date: UTC, ISO 8601.
        command: that measured it.
        quick: with less effort, by which numbers are rougher.
        machine: platform, processor, implementation.
        cpu: its name and how many there are.
        load: runnable processes on the machine on average over a minute, before and after.
        versions: of what it stands on and is compared with.
        step_ns: of the calibration's chain, before and after.
        calibration: which chain.
    """

    title: str
    limits: str
    date: str
    command: str
    quick: bool
    machine: dict[str, str]
    cpu: str
    load: tuple[float, float]
    versions: dict[str, str]
    step_ns: tuple[float, float]
    calibration: str


@dataclass
class Report:
    """Rows of some benchmarks and a stamp for each."""

    rows: list[Row] = field(default_factory=list)
    stamps: dict[str, Stamp] = field(default_factory=dict)

    def add(self, name: str, rows: Sequence[Row], stamp: Stamp) -> None:
        """Add a benchmark's rows, in place of the old ones."""
        self.rows = [row for row in self.rows if row.benchmark != name] + list(rows)
        self.stamps[name] = stamp

    def ordered(self, names: Iterable[str]) -> Report:
        """Order the benchmarks by the names; others are left out."""
        order = [name for name in names if name in self.stamps]
        rows = [row for name in order for row in self.rows if row.benchmark == name]
        return Report(rows, {name: self.stamps[name] for name in order})

    def to_json(self) -> dict[str, Any]:
        return {
            "schema": SCHEMA,
            "rows": [asdict(row) for row in self.rows],
            "benchmarks": {name: asdict(stamp) for name, stamp in self.stamps.items()},
        }

    def save(self, path: Path) -> None:
        path.write_text(json.dumps(self.to_json(), indent=1, allow_nan=False, ensure_ascii=False) + "\n", "utf-8")

    @classmethod
    def load(cls, path: Path) -> Report:
        """Load a report that `save` has written; RecordingError for anything else."""
        try:
            table = json.loads(path.read_text(encoding="utf-8"))
            if table["schema"] != SCHEMA:
                raise KeyError("schema")
            stamps = {name: _stamp(each) for name, each in table["benchmarks"].items()}
            return cls([Row(**row) for row in table["rows"]], stamps)
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise RecordingError(
                f"{path}: no report of benchmarks of schema {SCHEMA}; choose another folder"
            ) from error


def stamp(
    title: str, limits: str, command: str, quick: bool, loads: tuple[float, float],
    before: Calibration, after: Calibration,
) -> Stamp:  # fmt: skip
    """Stamp a benchmark that has just been run."""
    return Stamp(
        title=title,
        limits=" ".join(limits.split()),
        date=now(),
        command=command,
        quick=quick,
        machine=machine(),
        cpu=cpu(),
        load=loads,
        versions=versions(*PEERS),
        step_ns=(before.step_ns, after.step_ns),
        calibration=before.kind,
    )


def cpu() -> str:
    """Describe the processor: its name and the number of processors that this process may use."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return f"{names[0] if names else platform.processor() or platform.machine()}, {processors()} in use"


def load() -> float:
    """Read the average number of runnable processes over the last minute; 0 where the system does not say."""
    return round(os.getloadavg()[0], 2) if hasattr(os, "getloadavg") else 0.0


def _stamp(table: dict[str, Any]) -> Stamp:
    pairs = {name: (table[name][0], table[name][1]) for name in ("load", "step_ns")}
    return Stamp(**{**table, **pairs})
