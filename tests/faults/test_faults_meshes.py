"""Damaged meshes: each is one error that names the fault, within its time and memory; some are sound all the same."""

from __future__ import annotations

import gzip
import io
import json
import os
import random
import struct
import sys
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.support import trial

FloatArray = NDArray[np.float64]

CUBE = np.array([[x, y, z] for x in (0.0, 0.05) for y in (0.0, 0.05) for z in (0.0, 0.05)])
FACES = np.array(
    [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4],
     [1, 5, 7], [1, 7, 3]]
)  # fmt: skip
INFLATED = 200_000_000  # [bytes] that a small archive or a count in a header promises


def stl(vertices: FloatArray = CUBE, faces: Any = FACES, count: int | None = None) -> bytes:
    """Binary, with a number of facets of its own in the header."""
    rows = b"".join(struct.pack("<12fH", *([0.0] * 3), *vertices[face].ravel(), 0) for face in faces)
    return b"made here".ljust(80) + struct.pack("<I", len(faces) if count is None else count) + rows


def stl_text(vertices: FloatArray = CUBE, faces: Any = FACES) -> str:
    facets = [
        "facet normal 0 0 0\nouter loop\n"
        + "".join(f"vertex {x!r} {y!r} {z!r}\n" for x, y, z in vertices[face].tolist())
        + "endloop\nendfacet\n"
        for face in faces
    ]
    return f"solid cube\n{''.join(facets)}endsolid cube\n"


def obj(vertices: FloatArray = CUBE, faces: Any = FACES, head: str = "") -> str:
    lines = [f"v {x!r} {y!r} {z!r}\n" for x, y, z in vertices.tolist()]
    return head + "".join(lines) + "".join(f"f {a + 1} {b + 1} {c + 1}\n" for a, b, c in faces)


def off(vertices: FloatArray = CUBE, faces: Any = FACES, counts: tuple[int, int] | None = None) -> str:
    v, f = counts or (len(vertices), len(faces))
    lines = [f"{x!r} {y!r} {z!r}\n" for x, y, z in vertices.tolist()]
    return f"OFF\n{v} {f} 0\n" + "".join(lines) + "".join(f"3 {a} {b} {c}\n" for a, b, c in faces)


def ply(
    vertices: FloatArray = CUBE, faces: Any = FACES, counts: tuple[int, int] | None = None, *, form: str = "ascii",
    extra: str = "", lists: str = "uchar int",
) -> bytes:  # fmt: skip
    v, f = counts or (len(vertices), len(faces))
    head = (
        f"ply\nformat {form} 1.0\nelement vertex {v}\nproperty double x\nproperty double y\nproperty double z\n"
        f"element face {f}\nproperty list {lists} vertex_indices\n{extra}end_header\n"
    )
    if form == "ascii":
        rows = [" ".join(map(repr, row)) for row in vertices.tolist()] + [f"3 {a} {b} {c}" for a, b, c in faces]
        return (head + "\n".join(rows) + "\n").encode()
    order = "<" if "little" in form else ">"
    body = b"".join(struct.pack(f"{order}3d", *row) for row in vertices.tolist())
    return head.encode() + body + b"".join(struct.pack(f"{order}B3i", 3, *face) for face in np.asarray(faces).tolist())


def glb(change: Callable[[dict[str, Any]], Any] = lambda tables: None, binary: bytes | None = None) -> bytes:
    points, corners = CUBE.astype("<f4").tobytes(), FACES.astype("<u4").tobytes()
    content = points + corners if binary is None else binary
    tables: dict[str, Any] = {
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 8, "type": "VEC3"},
            {"bufferView": 1, "componentType": 5125, "count": 36, "type": "SCALAR"},
        ],
        "bufferViews": [
            {"buffer": 0, "byteOffset": 0, "byteLength": len(points)},
            {"buffer": 0, "byteOffset": len(points), "byteLength": len(corners)},
        ],
        "buffers": [{"byteLength": len(points) + len(corners)}],
    }
    change(tables)
    text = json.dumps(tables).encode()
    text += b" " * (-len(text) % 4)
    body = struct.pack("<II", len(text), 0x4E4F534A) + text + struct.pack("<II", len(content), 0x004E4942) + content
    return b"glTF" + struct.pack("<II", 2, 12 + len(body)) + body


def _set(at: list[Any], value: Any) -> Callable[[dict[str, Any]], None]:
    """A change of one entry of the tables."""

    def change(tables: dict[str, Any]) -> None:
        holder: Any = tables
        for step in at[:-1]:
            holder = holder[step]
        holder[at[-1]] = value

    return change


def _instances(tables: dict[str, Any]) -> None:
    tables["nodes"] = [{"mesh": 0} for _ in range(100_000)]
    tables["scenes"] = [{"nodes": list(range(100_000))}]


def _doubling(tables: dict[str, Any]) -> None:
    """Each node is twice below the one before: 2^40 cubes."""
    tables["nodes"] = [{"children": [k + 1, k + 1]} for k in range(40)] + [{"mesh": 0}]


def crossing() -> tuple[FloatArray, Any]:
    """A prism on an outline like a figure of eight: one lobe is inside out and nearly as large as the other."""
    outline = 0.05 * np.array([[-1.0, 1.0], [0.9, -0.9], [0.9, 0.9], [-1.0, -1.0]])
    vertices = np.vstack([np.column_stack([outline, np.full(4, z)]) for z in (0.0, 0.02)])
    sides = [[k, (k + 1) % 4, (k + 1) % 4 + 4] for k in range(4)] + [[k, (k + 1) % 4 + 4, k + 4] for k in range(4)]
    return vertices, np.array([*sides, [0, 2, 1], [0, 3, 2], [4, 5, 6], [4, 6, 7]])


def _moved(index: int, value: float) -> FloatArray:
    vertices = CUBE.copy()
    vertices[index] = value
    return vertices


def zipped(suffix: str) -> bytes:
    """A small archive of much."""
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr(f"a.{suffix}", b"\0" * INFLATED)
    return file.getvalue()


def pieces(count: int) -> tuple[FloatArray, Any]:
    """So many cubes, each within the one before."""
    vertices = np.vstack([(CUBE - 0.025) * (1.0 - k / (count + 1)) for k in range(count)])
    return vertices, np.vstack([FACES + 8 * k for k in range(count)])


CASES: dict[str, tuple[str, Callable[[], bytes | str]]] = {
    # no mesh at all
    "nothing": ("stl", lambda: b""),
    "a letter": ("ply", lambda: b"p"),
    "rubbish": ("stl", lambda: bytes(range(256)) * 40),
    "zeros": ("glb", lambda: b"\0" * 4096),
    "a page": ("obj", lambda: "<!doctype html><title>404</title>"),
    "latin letters": ("stl", lambda: b"solid \xe9\xff\xfe\n" + stl_text().encode()[11:]),
    "letters of no encoding": ("obj", lambda: b"# \x81\x8d\xff\xfe\x00\n" + obj().encode() + b"f \xff 1 2\n"),
    "another format": ("3mf", lambda: zipped("model")),
    "an archive": ("zip", lambda: zipped("stl")),
    "an archive as a mesh": ("stl", lambda: zipped("stl")),
    "a stream as a mesh": ("ply", lambda: gzip.compress(b"\0" * INFLATED)),
    # STL
    "stl cut in a facet": ("stl", lambda: stl()[:-13]),
    "stl cut in the header": ("stl", lambda: stl()[:60]),
    "stl with a count too large": ("stl", lambda: stl(count=2**32 - 1)),
    "stl with a count too small": ("stl", lambda: stl(count=3)),
    "stl of no facets": ("stl", lambda: stl(faces=FACES[:0])),
    "stl with NaN": ("stl", lambda: stl(_moved(3, np.nan))),
    "stl with infinity": ("stl", lambda: stl(_moved(3, np.inf))),
    "stl of a size of 1e36 m": ("stl", lambda: stl(CUBE * 1e37)),
    "text stl cut in a facet": ("stl", lambda: stl_text()[:700]),
    "text stl with a word for a number": ("stl", lambda: stl_text().replace("0.05", "wide", 1)),
    "text stl with two corners": ("stl", lambda: stl_text().replace("vertex 0.0 0.0 0.0\n", "", 1)),
    "text stl of solids only": ("stl", lambda: "solid a\nendsolid a\n" * 100_000),
    # OBJ
    "obj with a pipe for its material": ("obj", lambda: obj(head="mtllib pipe.mtl\nusemtl a\n")),
    "obj with a device for its material": ("obj", lambda: obj(head="mtllib /dev/zero\nusemtl a\n")),
    "obj of many materials": ("obj", lambda: "".join(f"usemtl m{k}\n{line}\n" for k, line in
                                                     enumerate(obj().splitlines() * 2000))),
    "obj with corner 0": ("obj", lambda: obj() + "f 0 1 2\n"),
    "obj with corners beyond": ("obj", lambda: obj() + "f 1 2 900\n"),
    "obj with corners before": ("obj", lambda: obj() + "f -900 1 2\n"),
    "obj with corners of 400 digits": ("obj", lambda: obj() + f"f 1 2 {'9' * 400}\n"),
    "obj with corners of 5000 digits": ("obj", lambda: obj() + f"f 1 2 {'9' * 5000}\n"),
    "obj with a face of two": ("obj", lambda: obj() + "f 1 2\n"),
    "obj with a face of 100000": ("obj", lambda: obj() + f"f {' '.join(['1 2 3 4'] * 25_000)}\n"),
    "obj with a corner of two": ("obj", lambda: obj(head="v 1 2\n")),
    "obj of points": ("obj", lambda: obj(faces=FACES[:0])),
    "obj with NaN": ("obj", lambda: obj(_moved(3, np.nan))),
    # OFF
    "off cut short": ("off", lambda: off()[:180]),
    "off with a count too large": ("off", lambda: off(counts=(8, 10**9))),
    "off with vertices too many": ("off", lambda: off(counts=(10**9, 12))),
    "off with a count of less than none": ("off", lambda: off(counts=(-1, -1))),
    "off without counts": ("off", lambda: "OFF\n"),
    "off with corners beyond": ("off", lambda: off(faces=[*FACES, [0, 1, 99]])),
    "off with a face of -3": ("off", lambda: off().replace("3 0 1 3", "-3 0 1 3")),
    # PLY
    "ply cut short": ("ply", lambda: ply()[:-40]),
    "ply cut in the header": ("ply", lambda: ply()[:90]),
    "binary ply cut short": ("ply", lambda: ply(form="binary_little_endian")[:-5]),
    "ply with a count too large": ("ply", lambda: ply(counts=(10**18, 12))),
    "binary ply with a count too large": ("ply", lambda: ply(counts=(8, 10**9), form="binary_big_endian")),
    "ply of another order": ("ply", lambda: ply(form="binary_middle_endian")),
    "ply with lists of floats": ("ply", lambda: ply(lists="float float")),
    "ply with lists of all its bytes": ("ply", lambda: ply(form="binary_little_endian", lists="uint int")),
    "ply without x": ("ply", lambda: ply().replace(b"double x", b"double q")),
    "ply with a list for x": ("ply", lambda: ply().replace(b"double x", b"list uchar int x")),
    "ply with a list of nothing": ("ply", lambda: ply().replace(b"list uchar int", b"list")),
    "ply with a number for corners": ("ply", lambda: ply().replace(b"list uchar int", b"int")),
    "ply without faces": ("ply", lambda: ply(faces=FACES[:0])),
    "ply with a texture": ("ply", lambda: ply(extra="comment TextureFile pipe.mtl\n")),
    "ply with NaN for a corner": ("ply", lambda: ply().replace(b"3 0 1 3", b"3 0 nan 3")),
    # GLB
    "glb cut short": ("glb", lambda: glb()[:-50]),
    "glb cut in its tables": ("glb", lambda: glb()[:200]),
    "glb with tables in tables": ("glb", lambda: b"glTF" + struct.pack("<IIII", 2, 200_020, 200_000, 0x4E4F534A)
                                  + b"[" * 200_000),
    "glb with a buffer elsewhere": ("glb", lambda: glb(_set(["buffers", 0, "uri"], "pipe.mtl"))),
    "glb with rows beyond": ("glb", lambda: glb(_set(["accessors", 0, "count"], 10**15))),
    "glb with an offset beyond": ("glb", lambda: glb(_set(["accessors", 1, "byteOffset"], 2**40))),
    "glb with an offset before": ("glb", lambda: glb(_set(["bufferViews", 0, "byteOffset"], -64))),
    "glb with a stride of nothing": ("glb", lambda: glb(_set(["bufferViews", 0, "byteStride"], 0))),
    "glb with a stride of much": ("glb", lambda: glb(_set(["bufferViews", 0, "byteStride"], 2**50))),
    "glb with corners beyond": ("glb", lambda: glb(_set(["accessors", 1, "byteOffset"], -4))),
    "glb with texts for numbers": ("glb", lambda: glb(_set(["accessors", 0, "count"], "8"))),
    "glb with a list for a table": ("glb", lambda: glb(_set(["meshes"], [[]]))),
    "glb with a node below itself": ("glb", lambda: glb(_set(["nodes", 0, "children"], [0]))),
    "glb with nodes doubled": ("glb", lambda: glb(_doubling)),
    "glb of 100000 instances": ("glb", lambda: glb(_instances)),
    "glb with a flat node": ("glb", lambda: glb(_set(["nodes", 0, "scale"], [1, 1, 0]))),
    "glb with NaN in a pose": ("glb", lambda: glb(_set(["nodes", 0, "translation"], [float("nan"), 0, 0]))),
    "glb that is compressed": ("glb", lambda: glb(_set(["accessors", 0], {"componentType": 5126, "count": 8,
                                                                         "type": "VEC3"}))),
    "glb of no meshes": ("glb", lambda: glb(_set(["nodes"], [{}]))),
    # surfaces
    "self-crossing": ("off", lambda: off(*crossing())),
    "open": ("off", lambda: off(faces=FACES[:-1])),
    "three at an edge": ("off", lambda: off(faces=[*FACES, [0, 1, 7]])),
    "all at one point": ("off", lambda: off(CUBE * 0.0)),
    "all on a line": ("off", lambda: off(CUBE * [1.0, 0.0, 0.0])),
    "all in a plane": ("off", lambda: off(CUBE * [1.0, 1.0, 0.0])),
    "twice the same": ("off", lambda: off(faces=[*FACES, *FACES])),
    "inside and outside the same": ("off", lambda: off(faces=[*FACES, *FACES[:, ::-1]])),
    "too small": ("off", lambda: off(CUBE * 1e-300)),
    "too large": ("off", lambda: off(CUBE * 1e60)),
    "1500 within one another": ("off", lambda: off(*pieces(1500))),
    "5000 apart": ("off", lambda: off(*pieces(5000))),
    "shell of nothing": ("off", lambda: off(CUBE * [1.0, 0.0, 0.0])),
    "more triangles than are taken": ("stl", lambda: stl(faces=[FACES[0]] * 500_001)),
}  # fmt: skip

SOUND = {  # what is wrong with these is outside of what is read, or is repaired, or is no triangle and left out
    "latin letters", "obj with a pipe for its material", "obj with a device for its material", "ply with a texture",
    "stl of a size of 1e36 m", "obj with corner 0", "obj with a face of two", "off with a count too large",
    "ply with lists of floats", "glb with a node below itself", "glb with nodes doubled", "1500 within one another",
}  # fmt: skip


def write(folder: Path, names: list[str]) -> list[Path]:
    """The files of these cases, beside a pipe that nobody writes into."""
    folder.mkdir(parents=True, exist_ok=True)
    if not (folder / "pipe.mtl").exists():
        os.mkfifo(folder / "pipe.mtl")
    files = []
    for k, name in enumerate(names):
        ending, content = CASES[name]
        data = content()
        files.append(folder / f"{k:03}-{name.replace(' ', '-')}.{ending}")
        files[-1].write_bytes(data.encode() if isinstance(data, str) else data)
    return files


pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="limits of memory and /proc are Linux's")

LONG = {
    "more triangles than are taken", "1500 within one another", "5000 apart", "obj of many materials",
    "glb of 100000 instances", "an archive", "an archive as a mesh", "a stream as a mesh", "another format",
    "text stl of solids only",
}  # fmt: skip
SHORT = [name for name in CASES if name not in LONG]
MEGABYTES = 600.0


def require_outcomes(names: list[str], files: list[Path], found: list[trial.Outcome]) -> None:
    bad = []
    for name, file, each in zip(names, files, found, strict=True):
        told = each.error == "InputError" and file.name in each.text and "\n" not in each.text
        wanted = not each.error if name in SOUND else told
        if not (wanted or (each.error == "InputError" and "mesh" in each.text and name not in SOUND)):
            bad.append(f"{name}: {each.error or 'no error'}: {each.text[-300:]}")
        if each.megabytes > MEGABYTES:
            bad.append(f"{name}: {each.megabytes:.0f} MB")
    assert not bad, f"{len(bad)} of {len(found)}:\n" + "\n".join(bad)


def test_there_are_sixty() -> None:
    assert len(CASES) >= 60


@pytest.mark.parametrize("names", [SHORT, pytest.param(sorted(LONG), marks=pytest.mark.faults)], ids=["short", "long"])
def test_a_damaged_mesh_is_one_error(names: list[str], tmp_path: Path) -> None:
    files = write(tmp_path, names)
    require_outcomes(names, files, trial.outcomes("mesh", files))


def test_a_pipe_is_no_mesh(tmp_path: Path) -> None:
    files = [tmp_path / "pipe.stl", tmp_path / "folder.stl", tmp_path / "zero.stl"]
    os.mkfifo(files[0])
    files[1].mkdir()
    files[2].symlink_to("/dev/zero")
    for each in trial.outcomes("mesh", files):
        assert each.error == "InputError" and "this is not a regular file" in each.text


def spoilt(seed: int, count: int, folder: Path) -> list[Path]:
    """Sound files of every form with some bytes changed, left out or put in."""
    sound = {
        "stl": [stl(), stl_text().encode()],
        "obj": [obj().encode()],
        "off": [off().encode()],
        "ply": [ply(form=form) for form in ("ascii", "binary_little_endian", "binary_big_endian")],
        "glb": [glb()],
    }
    files = []
    for k in range(count):
        chance = random.Random(f"{seed} {k}")
        ending = chance.choice(sorted(sound))
        data = bytearray(chance.choice(sound[ending]))
        for _ in range(chance.choice((1, 1, 2, 8))):
            at = chance.randrange(len(data))
            data[at : at + chance.choice((0, 1, 1, 4))] = chance.randbytes(chance.choice((0, 1, 1, 4)))
        files.append(folder / f"{k:04}.{ending}")
        files[-1].write_bytes(bytes(data))
    return files


@pytest.mark.parametrize(
    ("seed", "count"), [(1, 150), *(pytest.param(seed, 2000, marks=pytest.mark.faults) for seed in range(2, 6))]
)
def test_spoilt_bytes_are_sound_or_one_error(seed: int, count: int, tmp_path: Path) -> None:
    files = spoilt(seed, count, tmp_path)
    found = trial.outcomes("mesh", files)
    bad = [f"{file.name}: {each}" for file, each in zip(files, found, strict=True) if not each.is_sound]
    assert not bad, f"{len(bad)} of {count}:\n" + "\n".join(bad)
    assert sum(each.error == "InputError" for each in found) > count / 3
