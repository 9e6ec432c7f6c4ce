"""Triangles from text: STL with its keywords, OBJ and OFF. Only where corners are is read; all else is left out."""

from __future__ import annotations

from array import array
from collections.abc import Iterator, Sequence
from io import BytesIO
from itertools import pairwise

import numpy as np

from graspfx.surfaces.tree import FloatArray, IntArray

LARGEST = 2**62  # of a whole number: sums of two still fit


class MeshFault(ValueError):
    """A fault of a file's content, in words that follow the file's name."""


class Triangles:
    """Corners (v, 3) and triangles (f, 3) as they are read, no more than a limit of them.

    Args:
        most: triangles that are taken.
    """

    def __init__(self, most: int) -> None:
        self._most = most
        self._coordinates, self._faces = array("d"), array("q")

    @property
    def corners(self) -> int:
        """How many have been read."""
        return len(self._coordinates) // 3

    def require(self, count: int) -> None:
        """Raise MeshFault where so many triangles are too many."""
        if count > self._most:
            raise MeshFault(f"{count} triangles, more than the {self._most} of most_triangles")

    def corner(self, words: Sequence[bytes | float], place: str) -> None:
        """Add one, from three numbers; a fault names the place where they stand."""
        try:
            x, y, z = map(float, words[:3])
        except ValueError as error:
            raise MeshFault(f"{place}: no corner of three numbers") from error
        self._coordinates.extend((x, y, z))

    def polygon(self, corners: Sequence[int], place: str) -> None:
        """Add a face of three corners or more as a fan of triangles."""
        if len(corners) < 3:
            raise MeshFault(f"{place}: a face of {len(corners)} corners")
        for b, c in pairwise(corners[1:]):
            self._faces.extend((corners[0], b, c))
        self.require(len(self._faces) // 3)

    def arrays(self) -> tuple[FloatArray, IntArray]:
        """Both."""
        faces = np.array(self._faces, dtype=np.intp).reshape(-1, 3)
        return np.array(self._coordinates, dtype=np.float64).reshape(-1, 3), faces


def read_stl_text(data: bytes, most: int) -> tuple[FloatArray, IntArray]:
    """Read the facets of a text STL, three corners each.

    Raises:
        MeshFault: it ends in mid-facet, or a facet has not three corners.
    """
    read, first, line, facet = Triangles(most), 0, 0, False
    for line, words in _lines(data):
        word = words[0].lower()
        if word == b"vertex":
            read.corner(words[1:], f"line {line}")
        elif word == b"facet":
            if facet:
                raise MeshFault(f"line {line}: a facet within a facet")
            first, facet = read.corners, True
        elif word == b"endfacet":
            if read.corners - first != 3 or not facet:
                raise MeshFault(f"line {line}: a facet of {read.corners - first} corners")
            read.polygon(range(first, first + 3), f"line {line}")
            facet = False
    if facet or read.corners % 3:
        raise MeshFault(f"line {line}: the file ends within a facet")
    return read.arrays()


def read_obj(data: bytes, most: int) -> tuple[FloatArray, IntArray]:
    """Read the vertices and faces of a Wavefront OBJ; no groups, no materials, no file that it names.

    Raises:
        MeshFault: a line that cannot be read, or a face of vertices that are not there.
    """
    read = Triangles(most)
    for line, words in _lines(data.replace(b"\\\r\n", b" ").replace(b"\\\n", b" ")):
        if words[0] == b"v":
            read.corner(words[1:], f"line {line}")
        elif words[0] == b"f":
            numbers = _whole([word.partition(b"/")[0] for word in words[1:]], line)
            corners = [k - 1 if k > 0 else read.corners + k for k in numbers]
            if 0 in numbers or min(corners, default=0) < 0:
                raise MeshFault(f"line {line}: a face of vertices that are not there")
            read.polygon(corners, f"line {line}")
    return read.arrays()


def read_off(data: bytes, most: int) -> tuple[FloatArray, IntArray]:
    """Read an Object File Format: counts, vertices, faces.

    Raises:
        MeshFault: no OFF, or less of it than its counts say.
    """
    lines = _lines(data, comment=b"#")
    line, words = next(lines, (1, [b""]))
    if words[0].upper() not in (b"OFF", b"COFF"):
        raise MeshFault(f"line {line}: no file that begins with OFF")
    rest = words[1:]
    if not rest:
        line, rest = next(lines, (line, []))
    counts = _whole(rest[:2], line)
    if len(counts) < 2 or min(counts) < 0:
        raise MeshFault(f"line {line}: no numbers of vertices and faces")
    read = Triangles(most)
    read.require(counts[1])
    vertices, faces = counts[:2]
    for _ in range(vertices):
        line, words = next(lines, (line, []))
        read.corner(words, f"line {line}, of {vertices} vertices")
    for _ in range(faces):
        line, words = next(lines, (line, [b"0"]))
        size = _whole(words[:1], line)[0]
        corners = _whole(words[1 : size + 1], line) if 3 <= size < len(words) else []
        read.polygon(corners, f"line {line}, of {faces} faces")
    return read.arrays()


def _lines(data: bytes, comment: bytes = b"") -> Iterator[tuple[int, list[bytes]]]:
    """Lines that hold something, by their number, as words."""
    for number, line in enumerate(BytesIO(data), 1):
        words = (line.partition(comment)[0] if comment else line).split()
        if words:
            yield number, words


def _whole(words: Sequence[bytes], line: int) -> list[int]:
    try:
        numbers = [int(word) for word in words]
    except ValueError as error:
        raise MeshFault(f"line {line}: expected whole numbers") from error
    if any(abs(number) > LARGEST for number in numbers):
        raise MeshFault(f"line {line}: a whole number of too many digits")
    return numbers
