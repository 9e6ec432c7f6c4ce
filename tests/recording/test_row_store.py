"""Recordings on a disk are opened without their rows, read in parts, and written in little memory."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import pytest

import graspfx as gx
from graspfx.errors import RecordingError, UnknownNameError
from graspfx.recording.files import NAME
from graspfx.recording.record import Recording
from graspfx.recording.rows import BlockRows, DataSetRows
from graspfx.show.conversions import csv_lines
from tests.support.parts import made, script, values
from tests.support.recordings import header

FORMATS = Path(__file__).parent / "formats"


def test_a_change_in_a_block_of_format_4_is_an_error_where_that_is_read(tmp_path: Path) -> None:
    path = FORMATS / "4-run.h5"
    rec = Recording.load(path)
    assert isinstance(rec.store, BlockRows) and len(rec.store._pieces) == 3
    piece = rec.store._pieces[1]
    changed = bytearray(path.read_bytes())
    changed[piece.offset + piece.lead + 5] ^= 1
    (tmp_path / "changed.h5").write_bytes(changed)
    other = Recording.load(tmp_path / "changed.h5")
    assert other.part(0, 2).rows.tobytes() == rec.rows[:2].tobytes()
    assert other.part(4, 6).rows.tobytes() == rec.rows[4:].tobytes()
    for read in (lambda: other.rows, lambda: other.finger_force, lambda: other.part(1, 3).rows):
        with pytest.raises(RecordingError, match=r"its bytes were changed since .* rows from 2 up to 4"):
            read()


def test_a_change_in_a_chunk_is_an_error_where_that_is_read(tmp_path: Path) -> None:
    rec = Recording(values, made, header())
    rec.save(tmp_path / NAME)
    with h5py.File(tmp_path / NAME) as file:
        place = file["gap"].id.get_chunk_info(0).byte_offset
    changed = bytearray((tmp_path / NAME).read_bytes())
    changed[place + 5] ^= 1
    (tmp_path / NAME).write_bytes(changed)
    other = Recording.load(tmp_path)
    assert isinstance(other.store, DataSetRows)
    assert other.finger_force.tobytes() == rec.finger_force.tobytes()
    for read in (lambda: other.rows, lambda: other.gap, lambda: other.part(9, 10).gap):
        with pytest.raises(RecordingError, match="its bytes were changed since it was written"):
            read()


def test_a_recording_is_read_also_after_its_file_was_replaced(tmp_path: Path) -> None:
    rec = gx.run("reference-1dof", duration=0.5, out=tmp_path)
    force = rec.finger_force.copy()
    gx.run("reference-1dof", {"coupling.internal.stiffness": 77.0}, duration=0.5, out=tmp_path, overwrite=True)
    assert np.array_equal(rec.finger_force, force)


def test_reading_in_parts_gives_what_reading_at_once_does(tmp_path: Path) -> None:
    """Everything that is added up, divided or written over blocks, with blocks of 7 rows."""
    here = gx.run("paper-waving", {"engine": "interpreted"}, duration=0.8)
    here.save(tmp_path / "r.h5")
    summary, lines = here.summary(), "".join(csv_lines(here))
    rec = Recording.load(tmp_path / "r.h5")
    rec.store.step = 7
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
