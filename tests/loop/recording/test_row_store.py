"""Recordings on a disk are opened without their rows, read in parts, and written in little memory."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import graspfx as gx
from graspfx.errors import RecordingError, UnknownNameError
from graspfx.loop.recording.header import Outcome
from graspfx.loop.recording.places import NAME
from graspfx.loop.recording.record import Recording
from graspfx.loop.recording.row_store import StoredRows
from graspfx.loop.recording.sink import FileSink
from graspfx.show.tabular import csv_lines
from tests.support.parts import made, script, values
from tests.support.recordings import header


def test_a_change_in_a_block_is_an_error_where_that_is_read(tmp_path: Path) -> None:
    sink = FileSink(tmp_path / NAME, made, header())
    for first in range(0, 1500, 300):
        sink.write(values[first : first + 300], [])
    sink.close(Outcome())
    rec = Recording.load(tmp_path)
    assert isinstance(rec.store, StoredRows)
    piece = rec.store._pieces[2]
    changed = bytearray((tmp_path / NAME).read_bytes())
    changed[piece.offset + piece.lead + 5] ^= 1
    (tmp_path / "changed.h5").write_bytes(changed)
    other = Recording.load(tmp_path / "changed.h5")
    assert other.part(0, 600).rows.tobytes() == values[:600].tobytes()
    assert other.part(900, 1500).rows.tobytes() == values[900:].tobytes()
    for read in (lambda: other.rows, lambda: other.finger_force, lambda: other.part(899, 901)):
        with pytest.raises(RecordingError, match=r"its bytes were changed since .* rows from 600 up to 900"):
            read()


def test_a_recording_is_read_also_after_its_file_was_replaced(tmp_path: Path) -> None:
    rec = gx.run("reference-1dof", duration=0.5, out=tmp_path)
    force = rec.finger_force.copy()
    gx.run("reference-1dof", {"coupling.internal.stiffness": 77.0}, duration=0.5, out=tmp_path, overwrite=True)
    assert np.array_equal(rec.finger_force, force)


def test_reading_in_parts_gives_what_reading_at_once_does(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Everything that is added up, divided or written over blocks, with blocks of 7 rows."""
    from graspfx.loop.recording import history

    here = gx.run("paper-waving", {"engine": "interpreted"}, duration=0.8)
    here.save(tmp_path / "r.h5")
    summary, lines = here.summary(), "".join(csv_lines(here))
    monkeypatch.setattr(history, "BLOCK", 7 * 8 * here.layout.width)
    rec = Recording.load(tmp_path / "r.h5")
    assert [len(part) for part in rec.parts()][:3] == [7, 7, 7]
    for name in ("internal_force", "external_displacement", "internal_energy", "external_energy", "displayed_force"):
        assert getattr(rec, name).tobytes() == getattr(here, name).tobytes(), name
    assert "".join(csv_lines(rec)) == lines
    assert rec.summary().keys() == summary.keys()
    for key, value in rec.summary().items():
        numbers = isinstance(value, float) or (isinstance(value, list) and value and isinstance(value[0], float))
        assert value == (pytest.approx(summary[key], rel=1e-12) if numbers else summary[key]), key


def test_an_unknown_ledger_is_told_with_the_names_there_are() -> None:
    rec = gx.run("paper-waving", {"coupling.passivity": "observe"}, duration=0.05)
    with pytest.raises(UnknownNameError, match=r"unknown object with a ledger .*'x'.*object"):
        _ = rec.energy["x"]
    with pytest.raises(UnknownNameError, match="unknown energy 'wrok'; did you mean 'work'"):
        _ = rec.energy["object"]["wrok"]


MEMORY = """
import json, resource, sys
import graspfx as gx
from graspfx.build.warm import OF_RECORDINGS
from graspfx.compile.machine import compiled
for kernel in OF_RECORDINGS:  # which takes memory of its own, once
    compiled(kernel)
def peak():
    with open("/proc/self/status") as file:
        return 1024 * next(int(line.split()[1]) for line in file if line.startswith("VmHWM"))
scene = gx.load("sphere-three-fingers", {"engine": "compiled"})
ticks = 400_000
seconds = ticks * scene.period
gx.run(scene, duration=seconds / 400, out="warm").summary()
before = peak()
if sys.argv[1] == "memory":
    rec = gx.run(scene, duration=seconds)
    size = rec.rows.nbytes
    now = peak()
else:
    rec = gx.run(scene, duration=seconds, out="long")
    size = 8 * rec.layout.width * len(rec)
    now = peak()
    rec.finger_force[-1]
print(json.dumps({"ratio": (now - before) / size, "ticks": len(rec)}))
"""


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="asks Linux how much memory was used")
@pytest.mark.parametrize(("way", "most"), [("memory", 1.2), ("disk", 0.15)])
def test_the_memory_of_a_run_is_that_of_its_rows_or_next_to_none(way: str, most: float, tmp_path: Path) -> None:
    """400 000 ticks of 78 numbers, 250 MB."""
    pytest.importorskip("llvmlite")
    seen = script(MEMORY, tmp_path, way)
    assert seen["ticks"] == 400_000
    assert seen["ratio"] <= most
