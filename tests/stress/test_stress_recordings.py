"""Recordings whose bytes, attributes or data went wrong: an error of GraspFX or the recording, never another's."""

from __future__ import annotations

import json
import math
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

import graspfx as gx
from graspfx.errors import RecordingError
from graspfx.recording.files import seal
from tests.support.families import efforts, family
from tests.support.recordings import layout, recording, rows

SPOILT = family("recordings: corrupted bytes", "RecordingError, or a readable recording")
CHANGED = family("recordings: corrupted attributes and data", "RecordingError")

ROOT = Path(__file__).resolve().parents[2]

# in a process of its own: what a library does with bad bytes may be worse than an exception
READ = """
import faulthandler, sys, warnings
sys.path.insert(0, {root!r})
warnings.simplefilter("error")
from pathlib import Path
import numpy as np
from graspfx.errors import GraspFXError
from graspfx.recording.record import Recording
whole = bytearray(Path("whole.h5").read_bytes())
rng = np.random.default_rng({seed})
for case in range({cases}):
    spoilt = bytearray(whole)
    kind = case % 3
    at = int(rng.integers(len(whole) if kind else 4096))
    count = int(rng.integers(1, 64))
    if kind == 2:
        spoilt[at:at + count] = bytes(count)
    else:
        spoilt[at:at + count] = rng.bytes(len(spoilt[at:at + count]))
    Path("spoilt.h5").write_bytes(spoilt)
    faulthandler.dump_traceback_later(20, exit=True)
    try:
        recording = Recording.load("spoilt.h5")
        recording.rows.sum(), recording.time, recording.objects, recording.touching
    except GraspFXError:
        continue
    except BaseException as error:
        raise AssertionError(f"case {{case}}: bytes {{at}} to {{at + count}}: {{type(error).__name__}}: {{error}}")
"""


@efforts(short=30, full=400)
def test_spoilt_bytes(cases: int, tmp_path: Path) -> None:
    made = layout(3, 2)
    gx.Recording(rows(made, 50), made, recording({"gap": np.zeros((1, 2))}, layout()).header).save(
        tmp_path / "whole.h5"
    )
    code = READ.format(root=str(ROOT), seed=61, cases=cases)
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, timeout=200, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-2000:]
    SPOILT.tried(cases)


def attribute(name: str, value: Any) -> Callable[[h5py.File], None]:
    def change(file: h5py.File) -> None:
        file.attrs[name] = value

    return change


def layout_with(**changes: Any) -> Callable[[h5py.File], None]:
    def change(file: h5py.File) -> None:
        file.attrs["layout"] = json.dumps(json.loads(file.attrs["layout"]) | changes)

    return change


def without(name: str) -> Callable[[h5py.File], None]:
    def change(file: h5py.File) -> None:
        del file[name]

    return change


def instead(name: str, value: Any) -> Callable[[h5py.File], None]:
    def change(file: h5py.File) -> None:
        del file[name]
        file[name] = value

    return change


def as_format_3(change: Callable[[h5py.File], None]) -> Callable[[h5py.File], None]:
    """Let a file say that its variables hold the rows themselves, as they did up to format 3."""

    def both(file: h5py.File) -> None:
        change(file)
        file.attrs["format"] = "graspfx recording 3"

    return both


def stored_elsewhere(name: str) -> Callable[[h5py.File], None]:
    def change(file: h5py.File) -> None:
        shape, (offset, count) = file[name].shape, (0, h5py.h5f.UNLIMITED)
        del file[name]
        file.create_dataset(name, shape, "<f8", external=[(str(beside(file, SECRET)), offset, count)])

    return change


def linked_elsewhere(name: str) -> Callable[[h5py.File], None]:
    return lambda file: instead(name, h5py.ExternalLink(str(beside(file, "other.h5")), "x"))(file)


def virtual(name: str, source: str = "", of: str = "x") -> Callable[[h5py.File], None]:
    """Make a variable a virtual data set of another file, or of this one ("."), instead of what it was."""

    def change(file: h5py.File) -> None:
        whole = h5py.VirtualLayout(file[name].shape, "<f8")
        whole[...] = h5py.VirtualSource(source or str(beside(file, "other.h5")), of, whole.shape)
        del file[name]
        file.create_virtual_dataset(name, whole)

    return change


def packed_elsewhere(file: h5py.File) -> None:
    """Let the rows of format 4 stand in another file, where those of a compressed recording are."""
    stored_elsewhere("rows/rows")(file)


def longer(rows: int) -> Callable[[h5py.File], None]:
    """Let each variable be so long, chunk by chunk, of which none was written."""

    def change(file: h5py.File) -> None:
        names: list[str] = []
        file.visit(names.append)
        for name in names:
            data = file[name]
            if isinstance(data, h5py.Dataset) and data.shape[:1] == (50,):
                shape, kind = (rows, *data.shape[1:]), data.dtype
                del file[name]
                file.create_dataset(name, shape, kind, chunks=(1, *shape[1:]))

    return change


def piece(**changes: int) -> Callable[[h5py.File], None]:
    def change(file: h5py.File) -> None:
        table = file["rows/pieces"][:]
        for key, value in changes.items():
            table[key] = value
        file["rows/pieces"][:] = table

    return change


def wide(file: h5py.File) -> None:
    file["rows/pieces"].attrs["wide"] = 3


def beside(file: h5py.File, name: str) -> Path:
    return Path(file.filename).with_name(name)


SECRET = "secret"
ELSEWHERE = {
    "a variable in another file": stored_elsewhere("finger_force"),
    "a variable in another file, format 3": as_format_3(stored_elsewhere("finger_force")),
    "a link to another file": linked_elsewhere("finger_force"),
    "a link to another file, format 3": as_format_3(linked_elsewhere("finger_force")),
    "a group in another file": linked_elsewhere("objects"),
    "a virtual variable of another file": virtual("finger_force"),
    "a virtual variable of another file, format 3": as_format_3(virtual("finger_force")),
    "a virtual object of another file": as_format_3(virtual("objects/object0/position")),
    "a virtual variable of itself": as_format_3(virtual("finger_force", ".", "finger_force")),
}
CHANGES: dict[str, Callable[[h5py.File], None]] = {
    "another format": attribute("format", "graspfx recording 99"),
    "a format that is a number": attribute("format", 3.0),
    "a period that is a text": attribute("period", "fast"),
    "a period of NaN": attribute("period", math.nan),
    "a period of zero": attribute("period", 0.0),
    "a negative period": attribute("period", -0.001),
    "a layout that is no JSON": attribute("layout", "{"),
    "a layout that is a list": attribute("layout", "[]"),
    "a layout that is a number": attribute("layout", 3.0),
    "a layout of bytes": attribute("layout", np.void(b"\xff\xfe")),
    "a layout with an unknown key": layout_with(colour="red"),
    "a layout of four dimensions": layout_with(dimensions=4),
    "a layout of a text of dimensions": layout_with(dimensions="3"),
    "a layout of more fingers": layout_with(fingers=["a", "b", "c"]),
    "a layout of no fingers": layout_with(fingers=[]),
    "a layout of a number of fingers": layout_with(fingers=2),
    "a layout of other objects": layout_with(objects=["nothing"]),
    "a layout with moments": layout_with(moments=True),
    "a scene that is no JSON": attribute("scene_table", "}"),
    "versions that are a number": attribute("versions", 1.0),
    "frames that are no JSON": attribute("frames", "nothing"),
    "a wall time that is a text": attribute("wall_time", "long"),
    "completeness that is a text": attribute("complete", "yes"),
    "no time": without("time"),
    "no forces": without("finger_force"),
    "no object": without("objects"),
    "no faults": without("faults"),
    "forces of another shape": instead("finger_force", np.zeros((50, 5))),
    "forces of text": instead("finger_force", "none"),
    "forces of fewer ticks": instead("finger_force", np.zeros((20, 2, 3))),
    "time that is one number": instead("time", 0.0),
    "faults of text": instead("faults/tick", "none"),
    "2^36 rows": longer(2**36),
    "2^36 rows, format 3": as_format_3(longer(2**36)),
    **ELSEWHERE,
}
OF_FORMAT_4: dict[str, tuple[str, Callable[[h5py.File], None]]] = {
    "rows in another file": ("4-packed", packed_elsewhere),
    "rows beyond the file": ("4-run", piece(count=2**40)),
    "rows before the file": ("4-run", piece(offset=-8)),
    "rows that begin with the tenth": ("4-run", piece(first=9)),
    "fewer rows than times": ("4-run", piece(count=1)),
    "rows of three numbers": ("4-run", wide),
}


@pytest.mark.parametrize("name", CHANGES)
def test_spoilt_attributes_and_data(name: str, tmp_path: Path) -> None:
    made, path = layout(3, 2), tmp_path / "r.h5"
    gx.Recording(rows(made, 50), made, recording({"gap": np.zeros((1, 2))}, layout()).header).save(path)
    require_refusal(path, CHANGES[name], is_elsewhere=name in ELSEWHERE)


@pytest.mark.parametrize("name", OF_FORMAT_4)
def test_spoilt_blocks_of_format_4(name: str, tmp_path: Path) -> None:
    base, change = OF_FORMAT_4[name]
    path = tmp_path / "r.h5"
    path.write_bytes((ROOT / "tests" / "recording" / "formats" / f"{base}.h5").read_bytes())
    require_refusal(path, change, is_elsewhere=name == "rows in another file")


def require_refusal(path: Path, change: Callable[[h5py.File], None], *, is_elsewhere: bool) -> None:
    (path.parent / SECRET).write_bytes(np.full(5000, 1.25).tobytes())
    with h5py.File(path.parent / "other.h5", "w") as file:
        file["x"] = np.full((50, 2, 3), 1.25)
    with h5py.File(path, "r+") as file:
        change(file)
    with path.open("r+b") as stream:  # as if it had been written so
        stream.write(seal(stream, path.stat().st_size))
    CHANGED.tried()
    with pytest.raises(RecordingError, match=r"r\.h5: .*which is not read" if is_elsewhere else r"r\.h5: "):
        gx.Recording.load(path)


@pytest.mark.parametrize("content", [b"", b"\x89HDF\r\n\x1a\n", b"not a recording", bytes(5000)])
def test_files_of_something_else(content: bytes, tmp_path: Path) -> None:
    (tmp_path / "recording.h5").write_bytes(content)
    for path in (tmp_path, tmp_path / "recording.h5"):
        with pytest.raises(RecordingError):
            gx.Recording.load(path)
