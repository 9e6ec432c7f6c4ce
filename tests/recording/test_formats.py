"""Recordings of every format there was, each written by the code of its time, and changes of any byte of today's."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import asdict, replace
from hashlib import sha256
from pathlib import Path

import h5py
import numpy as np
import pytest

from graspfx.__main__ import main
from graspfx.errors import RecordingError
from graspfx.loop import columns as layouts
from graspfx.loop.columns import Layout, RunFault
from graspfx.recording import header as headers
from graspfx.recording.file import fletcher32
from graspfx.recording.files import LENGTH, NAME
from graspfx.recording.header import FORMAT, Outcome
from graspfx.recording.record import Recording
from graspfx.recording.sink import FileSink
from tests.support.families import efforts
from tests.support.recordings import header, layout, rows

ROOT = Path(__file__).parents[2]
FORMATS = ROOT / "tests" / "recording" / "formats"

EXPECTED = {  # by the reader of that time: rows, numbers in a row, and the digest of the rows
    "1-energy": (6, 46, "c79811691000302f308743ad301c5ad2e8a328c30ce879705da09aa4fd08483e"),
    "1-fade": (6, 17, "65c0cc2f2be14d6127828ada2710c5285a5d419ced9b788ee486dcf8f972abc3"),
    "1-first": (6, 35, "587d09f002eaa552d36aa60d6d824fd99014cf8f6b36d6662d95a4dfb08a223e"),
    "1-frames": (6, 35, "ee7decebcfca2507e95a1c727e90163c877e5ef20a3b4782487e0462a16f5300"),
    "1-last": (6, 65, "bb949f09b2aa1365413e820a33cb85b8d4151052e40fdb2a4f03005e7dad83a0"),
    "1-open": (6, 17, "7f61952cd2f623787f7b690bb393a031da07a90f74d9f49e5041a4eb0286d454"),
    "1-slips": (6, 23, "f0d0ce7d5f1f889cfc7ab638d6d1f2e0e4feec9f4fe561e1dc4fb930b7960836"),
    "2-last": (6, 65, "bb949f09b2aa1365413e820a33cb85b8d4151052e40fdb2a4f03005e7dad83a0"),
    "3-last": (6, 79, "739a86a33614847a54595b31e14cc2b310ef1c570993c1db61937103eed494b8"),
    "4-killed": (6, 79, "739a86a33614847a54595b31e14cc2b310ef1c570993c1db61937103eed494b8"),
    "4-last": (6, 79, "739a86a33614847a54595b31e14cc2b310ef1c570993c1db61937103eed494b8"),
    "4-packed": (6, 79, "739a86a33614847a54595b31e14cc2b310ef1c570993c1db61937103eed494b8"),
    "4-run": (6, 79, "739a86a33614847a54595b31e14cc2b310ef1c570993c1db61937103eed494b8"),
    "5-last": (6, 79, "739a86a33614847a54595b31e14cc2b310ef1c570993c1db61937103eed494b8"),
}


@pytest.mark.parametrize("name", EXPECTED)
def test_a_recording_of_an_earlier_format_loads(name: str, tmp_path: Path) -> None:
    """Format 1: first without the fade's shortfall, then with it, with frames, slips, energies, engines; left open.

    Format 4: saved at once, packed, as a run left it, and the part of one that was killed. What came with format 3,
    how the forces divide, those before do not have.
    """
    N, width, digest = EXPECTED[name]
    rec = Recording.load(FORMATS / f"{name}.h5")
    assert rec.rows.shape == (N, width)
    assert sha256(rec.rows.tobytes()).hexdigest() == digest
    assert rec.outcome.complete is (name not in ("1-open", "4-killed"))
    assert rec.finger_force.shape[0] == N
    assert (rec.status is None) is not (name in ("1-slips", "1-last", "2-last") or name[0] in "345")
    assert bool(rec.energy) is (name == "1-energy")
    assert rec.summary()["ticks"] == N
    if name[0] in "345":
        assert rec.internal_force.shape == rec.finger_force.shape
    else:
        with pytest.raises(RecordingError, match=r"does not say how its forces divide .*: run its scene again"):
            _ = rec.internal_force
    rec.save(tmp_path / "now.h5")
    now = Recording.load(tmp_path / "now.h5")
    assert now.rows.tobytes() == rec.rows.tobytes()
    assert (now.layout, now.header, now.outcome) == (rec.layout, rec.header, rec.outcome)


def test_there_is_a_recording_of_every_format() -> None:
    assert {path.stem for path in FORMATS.iterdir()} == EXPECTED.keys()
    assert {int(name.partition("-")[0]) for name in EXPECTED} == set(range(1, FORMAT))


def test_the_formats_number_is_todays(tmp_path: Path) -> None:
    made = layout()
    Recording(rows(made, 5), made, header()).save(tmp_path / "r.h5")
    with h5py.File(tmp_path / "r.h5") as file:
        assert file.attrs["format"] == f"graspfx recording {FORMAT}"
        assert all(file[name].fletcher32 and file[name].chunks[0] == 5 for name in made.columns)
    Recording(rows(made, 5), made, header()).save(tmp_path / "s.h5", compression="gzip")
    with h5py.File(tmp_path / "s.h5") as file:
        assert all((file[name].fletcher32, file[name].compression) == (True, "gzip") for name in made.columns)


def test_rows_come_back_to_the_bit_whatever_they_are(tmp_path: Path) -> None:
    """A row that was lost is not a number, also where a column is stored in a byte as long as its numbers are whole."""
    made = layout()
    values = rows(made, 40)
    for name, change in (("whole", 1.0), ("lost", np.nan), ("half", 0.5), ("signed", -0.0), ("large", 1000.0)):
        values[7, made.columns["touching"].where] = change
        Recording(values.copy(), made, header()).save(tmp_path / f"{name}.h5")
        assert Recording.load(tmp_path / f"{name}.h5").rows.tobytes() == values.tobytes()
        with h5py.File(tmp_path / f"{name}.h5") as file:
            assert file["touching"].dtype == (np.int8 if name == "whole" else np.float64)


def test_a_column_that_an_earlier_format_does_not_have_is_none(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A layout of today names a column that came later, or may be made without one: the recording has None."""
    first = Recording.load(FORMATS / "1-last.h5")

    light = layouts.Declared("light", "finger axis", "cd", "that the fingers give off", "sample")
    monkeypatch.setattr(layouts, "OF_FINGERS", (*layouts.OF_FINGERS[:4], light, *layouts.OF_FINGERS[4:]))
    rec = Recording.load(FORMATS / "1-last.h5")
    assert rec.optional("light") is None
    assert rec.layout.absent == ("light",)
    assert rec.rows.tobytes() == first.rows.tobytes()
    assert np.array_equal(rec.wrench, first.wrench)
    rec.save(tmp_path / "now.h5")
    assert Recording.load(tmp_path / "now.h5").layout == rec.layout
    made = layout()
    Recording(rows(made, 5), made, header()).save(tmp_path / "lit.h5")
    assert Recording.load(tmp_path / "lit.h5").optional("light") is not None


def test_a_column_that_every_format_has_is_missed(tmp_path: Path) -> None:
    path = tmp_path / "r.h5"
    path.write_bytes((FORMATS / "1-last.h5").read_bytes())
    with h5py.File(path, "r+") as file:
        del file["objects/bar/wrench"]
    with pytest.raises(RecordingError, match=r"cannot be read as a recording; .*wrench"):
        Recording.load(path)


def test_a_later_format_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made = layout()
    with monkeypatch.context() as later:
        later.setattr(headers, "FORMAT", FORMAT + 1)
        Recording(rows(made, 5), made, header()).save(tmp_path / "r.h5")
        sink = FileSink(tmp_path / "s.h5", made, header())
        sink._part.file.close()
    for name in ("r.h5", "s.h5.part"):
        said = f"its format is {FORMAT + 1}, and this GraspFX reads formats 1 to {FORMAT}"
        with pytest.raises(RecordingError, match=said):
            Recording.load(tmp_path / name)


def test_a_recording_that_hdf5_has_changed_is_an_error(tmp_path: Path) -> None:
    """Every attribute, event and row is under the digest; HDF5 leaves it out where it changes a file."""
    made, path = layout(), tmp_path / "r.h5"
    faults = (RunFault(3, "unplugged"),)

    def change_period(file: h5py.File) -> None:
        file.attrs["period"] = 0.004

    def change_event(file: h5py.File) -> None:
        file["faults/tick"][0] = 4

    def change_row(file: h5py.File) -> None:
        file["finger_force"][2] = 0.0

    for change in (change_period, change_event, change_row):
        Recording(rows(made, 50), made, header(), Outcome(faults)).save(path, overwrite=True)
        assert Recording.load(path).faults == faults
        with h5py.File(path, "r+") as file:
            change(file)
        with pytest.raises(RecordingError, match=r"r\.h5: .*its digest is missing"):
            Recording.load(path)
        assert main(["plot", str(path)]) == 2


DAMAGE = """
import faulthandler, json, sys
import h5py
import numpy as np
from pathlib import Path
from graspfx.errors import RecordingError
from graspfx.recording.file import fletcher32
from graspfx.recording.record import Recording
name, cases, rng = sys.argv[1], int(sys.argv[2]), np.random.default_rng(int(sys.argv[3]))
whole = Path(name).read_bytes()
first = Recording.load(name)
def read_by_others(path):
    names = []  # the time and the two forces, which GraspFX computes, have HDF5's checksums like all variables
    with h5py.File(path) as file:
        file.visit(names.append)
        try:
            for each in names:
                if isinstance(file[each], h5py.Dataset):
                    file[each][()]
        except OSError as error:
            raise RecordingError(str(error)) from error
first_rows = first.rows
tally = {"errors": 0, "rows before": 0, "wrong rows": [], "others": []}
for case in range(cases):
    changed = bytearray(whole)
    kind, at, count = case % 4, int(rng.integers(len(whole))), int(rng.integers(1, 64))
    if kind == 0:
        changed[at] ^= 1 << int(rng.integers(8))
    elif kind == 1:
        changed[at : at + count] = rng.bytes(len(changed[at : at + count]))
    elif kind == 2:
        changed[at : at + count] = bytes(len(changed[at : at + count]))
    else:
        to = int(rng.integers(len(whole)))
        changed[at : at + count] = whole[to : to + count].ljust(count, b"x")[: len(changed[at : at + count])]
    if changed == whole:
        continue
    path = Path("changed-" + name)
    path.write_bytes(changed)
    faulthandler.dump_traceback_later(20, exit=True)
    try:
        rec = Recording.load(path)
        rows = rec.rows
        if rec.rows.tobytes() == first_rows.tobytes() and name.endswith(".h5"):
            read_by_others(path)
    except RecordingError:
        tally["errors"] += 1
        continue
    except Exception as error:
        tally["others"].append(f"{case}: {type(error).__name__}: {error}")
        continue
    same = rows.tobytes() == first_rows[: len(rec)].tobytes() and rec.header == first.header
    if not same or name.endswith(".h5"):
        tally["wrong rows"].append(case)
    tally["rows before"] += 1
print(json.dumps(tally))
"""


@pytest.mark.parametrize("name", [NAME, f"{NAME}.part"])
@efforts(short=400, full=20_000, asked="faults")
def test_a_change_of_any_byte_is_an_error(name: str, cases: int, tmp_path: Path) -> None:
    """One bit, up to 64 bytes at random, zeros, or bytes from elsewhere in the file."""
    made = layout(3, 2)
    sink = FileSink(tmp_path / NAME, made, header())
    for first in range(0, 600, 100):
        sink.write(rows(made, 600)[first : first + 100], [RunFault(first, "unplugged")])
    if name == NAME:
        sink.close(Outcome((RunFault(3, "unplugged"),), 0.5))
    else:
        sink._part.file.close()
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-c", DAMAGE, name, str(cases), "11"]
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr[-2000:]
    found = json.loads(done.stdout)
    assert found["others"] == [] and found["wrong rows"] == []
    assert found["rows before"] == 0
    assert found["errors"] > 0.95 * cases


def test_the_digest_is_that_of_all_bytes_but_the_chunks(tmp_path: Path) -> None:
    """By a program that reads the last line: where the chunks are, how many stretches of them, and the SHA-256."""
    made, path = layout(), tmp_path / "r.h5"
    Recording(rows(made, 500), made, header()).save(path, compression="lzf")
    whole = path.read_bytes()
    line, before = whole[-LENGTH:], whole[:-LENGTH]
    count = int(before[-16:], 16)
    table = before[-16 - 32 * count :]
    numbers = [int(table[k : k + 16], 16) for k in range(0, 32 * count, 16)]
    edges = [0, *numbers, len(before) - len(table)]
    rest = b"".join(before[a:b] for a, b in zip(edges[::2], edges[1::2], strict=True))
    assert line == b"graspfx chunks " + sha256(table + rest).hexdigest().encode() + b"\n"
    with h5py.File(path) as file:
        data = [item for item in (file[name] for name in [*made.columns, "time"]) if item.chunks]
        sizes = sum(each.id.get_chunk_info(k).size for each in data for k in range(each.id.get_num_chunks()))
    assert sum(numbers[1::2]) - sum(numbers[::2]) == sizes


def test_a_layout_says_what_is_absent() -> None:
    made = layout()
    short = replace(made, absent=("gap", "objects/object0/velocity"))
    assert short.width == made.width - 2 - 2
    assert Layout(**asdict(short)).columns.keys() == made.columns.keys() - {"gap", "objects/object0/velocity"}
    assert not made.is_essential("gap")
    assert made.is_essential("objects/object0/velocity") and made.is_essential("finger_force")
    assert not made.is_essential("objects/object0/energy/wrench")


@pytest.mark.parametrize("size", [1, 2, 3, 359, 360, 361, 719, 720, 721, 5000, 100_000])
@pytest.mark.parametrize("kind", ["random", "zero", "full"])
def test_checksums_are_those_of_hdf5(size: int, kind: str, tmp_path: Path) -> None:
    """The last four bytes of a chunk that HDF5 wrote are the checksum of those before it."""
    content = {
        "random": np.random.default_rng(size).integers(0, 256, size, dtype=np.uint8),
        "zero": np.zeros(size, np.uint8), "full": np.full(size, 255, np.uint8),
    }[kind]  # fmt: skip
    with h5py.File(tmp_path / "bytes.h5", "w") as file:
        data = file.create_dataset("bytes", data=content, chunks=(size,), fletcher32=True)
        file.flush()
        _, raw = data.id.read_direct_chunk((0,))
    assert bytes(raw[:-4]) == content.tobytes()
    assert fletcher32(content) == int.from_bytes(raw[-4:], "little")
