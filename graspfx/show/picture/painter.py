"""Solids and lines in space on flat axes, a parallel projection: solids as pixels, lines as lines, cut where hidden."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from math import cos, radians, sin
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspfx.show.picture.surfaces import Surface
from graspfx.show.picture.zbuffer import CREASE, Layer, corner_normals, halved, weld

if TYPE_CHECKING:
    from matplotlib.axes import Axes

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

PIXELS = 1560  # along the longer side, four of which become one
REACH = 2  # pixels about a point, all of which must be nearer for it to be hidden
NEARER = 0.004  # by which lines on a surface come before it, as a share of the extent
SHORTEST = 0.006  # pieces of a line, visible or hidden, that are none, as a share of the extent
OUTLINE = 0.8  # [points]
BEFORE = 0.02  # room about the surfaces, as a share of the extent


@dataclass(frozen=True)
class Camera:
    """A viewer infinitely far away.

    Args:
        azimuth: [degrees] from x towards y.
        elevation: [degrees] above the plane of x and y.
    """

    azimuth: float
    elevation: float

    @property
    def axes(self) -> FloatArray:
        """To the right, up and towards the viewer, unit vectors in rows (3, 3)."""
        a, e = radians(self.azimuth), radians(self.elevation)
        return np.array(
            [
                [-sin(a), cos(a), 0.0],
                [-sin(e) * cos(a), -sin(e) * sin(a), cos(e)],
                [cos(e) * cos(a), cos(e) * sin(a), sin(e)],
            ]
        )

    def project(self, points: ArrayLike) -> FloatArray:
        """Project points (..., 3) to right, up and nearness (..., 3) [m]."""
        return np.asarray(np.asarray(points, dtype=float) @ self.axes.T)


@dataclass
class Painter:
    """Collects solids, then paints them and tells what they hide.

    Args:
        camera: from where it is seen.
        extent: size of the picture [m].
    """

    camera: Camera
    extent: float
    _solids: list[tuple[Surface, str, str, bool, bool]] = field(default_factory=list)
    _layer: Layer | None = None
    _clear: FloatArray | None = None
    _all: tuple[Layer, FloatArray] | None = None

    def add(
        self, solid: Surface, colour: str, *, outline: str = "", both_sides: bool = False, hides: bool = True
    ) -> None:
        """Add a surface of this colour; with an outline, its creases and its rim against what is behind.

        Args:
            both_sides: it is open, and seen from behind too.
            hides: lines behind it are hidden; not so behind a fingertip, which would hide its own arrow.
        """
        self._solids.append((solid, colour, outline, both_sides, hides))
        self._layer = self._clear = self._all = None

    def bounds(self) -> FloatArray:
        """Lower and upper corner (2, 2) of all surfaces, to the right and up; lines may leave them."""
        flat = np.concatenate([self.camera.project(solid.vertices)[:, :2] for solid, *_ in self._solids])
        return np.array([flat.min(axis=0), flat.max(axis=0)])

    def draw(self, axes: Axes) -> None:
        """Paint the solids, and draw their outlines where nothing hides them."""
        from matplotlib.collections import LineCollection

        layer = self._things()[0].copy()
        rims = [(solid, outline) for solid, _, outline, _, _ in self._solids if outline]
        for solid, colour, _, both_sides, hides in self._solids:
            if not hides:
                self._paint(layer, solid, colour, both_sides)
        rgba = halved(layer.shaded())
        height, width = rgba.shape[:2]
        (x0, y0), size = layer.low, 2.0 * layer.cell
        extent = (x0, x0 + width * size, y0, y0 + height * size)
        axes.imshow(rgba, extent=extent, origin="lower", interpolation="antialiased", zorder=1.0, aspect="equal")
        clear = layer.clear_depth(REACH)
        self._all = layer, clear
        for solid, outline in rims:
            cuts = (self._cut(ends, layer, clear, 0.0) for ends in _edges(solid, self.camera))
            pieces = [piece[[0, -1], :2] for each in cuts for piece, visible in each if visible]
            axes.add_collection(
                LineCollection(pieces, colors=outline, linewidths=OUTLINE, capstyle="round", zorder=1.2), autolim=False
            )

    def pieces(self, points: FloatArray, *, before_all: bool = False) -> Iterator[tuple[FloatArray, bool]]:
        """Cut a line through points (k, 3) into pieces as seen (j, 3), with whether each is visible.

        Args:
            before_all: whether solids that hide nothing else hide it; they do once all is drawn.
        """
        layer, clear = self._all if before_all and self._all else self._things()
        return self._cut(points, layer, clear, SHORTEST * self.extent)

    def hidden(self, points: FloatArray) -> BoolArray:
        """Tell which of points (n, 3) are behind a surface."""
        layer, clear = self._things()
        return ~_visible(self.camera.project(points), layer, clear, NEARER * self.extent)

    def _things(self) -> tuple[Layer, FloatArray]:
        """Depths of all that hides."""
        if self._layer is None or self._clear is None:
            low, high = self.bounds()
            room = BEFORE * self.extent
            self._layer = Layer(low - room, high + room, PIXELS)
            for solid, colour, _, both_sides, hides in self._solids:
                if hides:
                    self._paint(self._layer, solid, colour, both_sides)
            self._clear = self._layer.clear_depth(REACH)
        return self._layer, self._clear

    def _paint(self, layer: Layer, solid: Surface, colour: str, both_sides: bool) -> None:
        from matplotlib.colors import to_rgb

        corners = self.camera.project(solid.vertices)[solid.faces]
        normals = self.camera.project(corner_normals(solid.vertices, solid.faces))
        facing = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, 2]
        if both_sides:
            normals = normals * np.where(facing < 0.0, -1.0, 1.0)[:, None, None]
            facing = np.abs(facing)
        front = facing > 0.0
        layer.add(corners[front], normals[front], to_rgb(colour))

    def _cut(
        self, points: FloatArray, layer: Layer, clear: FloatArray, shortest: float
    ) -> Iterator[tuple[FloatArray, bool]]:
        seen = self.camera.project(points)
        pairs = list(pairwise(seen))
        steps = [1 + int(np.linalg.norm(b[:2] - a[:2]) / (2.0 * layer.cell)) for a, b in pairs]
        cuts = [
            a + np.linspace(0.0, 1.0, n, endpoint=False)[:, None] * (b - a)
            for (a, b), n in zip(pairs, steps, strict=True)
        ]
        line = np.concatenate([*cuts, seen[-1:]])
        visible = _visible(line, layer, clear, NEARER * self.extent)
        least = int(shortest / (2.0 * layer.cell))
        runs = _runs(visible, least)
        for begin, end in runs:
            yield line[begin : min(end + 1, len(line))], bool(visible[(begin + end) // 2])


def _visible(seen: FloatArray, layer: Layer, clear: FloatArray, nearer: float) -> BoolArray:
    inside = ((seen[:, :2] >= layer.low) & (seen[:, :2] <= layer.high)).all(axis=1)
    row, column = layer.pixel(seen[:, :2]).T
    return np.asarray(~inside | (seen[:, 2] + nearer >= clear[row, column]))


def _runs(visible: BoolArray, least: int) -> list[tuple[int, int]]:
    """List runs of equal values; one that is too short joins the run before it."""
    ends = [0, *(np.flatnonzero(np.diff(visible)) + 1).tolist(), len(visible)]
    runs: list[tuple[int, int]] = []
    for begin, end in pairwise(ends):
        if runs and (end - begin <= least or visible[begin] == visible[runs[-1][0]]):
            runs[-1] = (runs[-1][0], end)
        else:
            runs.append((begin, end))
    return runs


def _edges(solid: Surface, camera: Camera) -> Sequence[FloatArray]:
    """List edges (2, 3) at creases that are seen, at the rim, and where a surface ends."""
    f = weld(solid.vertices, solid.faces)
    corners = solid.vertices[solid.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(normals, axis=1)
    whole = lengths > 1e-14 * float(np.ptp(solid.vertices, axis=0).max()) ** 2
    f, corners, normals = f[whole], corners[whole], normals[whole] / lengths[whole, None]
    front = camera.project(normals)[:, 2] > 0.0
    ends = np.stack([corners, corners[:, [1, 2, 0]]], axis=2).reshape(-1, 2, 3)
    sides = np.sort(np.stack([f, f[:, [1, 2, 0]]], axis=2).reshape(-1, 2), axis=1)
    owner = np.repeat(np.arange(len(f)), 3)
    _, first, group, count = np.unique(sides, axis=0, return_index=True, return_inverse=True, return_counts=True)
    last = np.zeros(len(first), dtype=np.int64)
    last[group.reshape(-1)] = np.arange(len(sides))
    one, two = owner[first], owner[last]
    crease = (normals[one] * normals[two]).sum(axis=1) < cos(radians(CREASE))
    visible = (crease & (front[one] | front[two])) | (front[one] != front[two]) | (count == 1)
    return list(ends[first[visible]])
